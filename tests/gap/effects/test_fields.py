"""Every effect says which number of the robot's files it changes, and it is that number."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.gap.effects.machine import JOINTS
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.load_robot import load_robot, robot_from_spec
from walkerkit.gap.simulation.mend import mend, write_model
from walkerkit.gap.simulation.sidecar import FILE, sidecar, with_sidecar

# What says itself how large it is, where the others say how much there is more.
ABSOLUTE = {
    *("effort_limit", "end_stop", "kinematic_error", "timestep"),
    *(name for name, effect in CATALOGUE.items() if hasattr(effect, "law")),
}
SUPPLY = (24.0, 21.0, 25.0)
STANDING = """
<mujoco><compiler angle="radian"/><option timestep="0.002"/>
<worldbody><geom name="floor" type="plane" size="1 1 1" friction="0.9"/>
  <body name="trunk" pos="0 0 0.3"><freejoint/><geom type="box" size=".1 .1 .05" mass="2"/>
    <body name="leg"><joint name="hip" axis="0 1 0" damping="0.2" armature="0.01"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
      <geom name="foot" size="0.03" pos="0 0 -0.25" mass="0.1" solref="0.02 1"/></body></body>
</worldbody><actuator><position name="hip" joint="hip" kp="40" kv="1"/></actuator></mujoco>
"""


def saved_and_loaded(robot, folder):
    """The robot as its files say it."""
    write_model(robot, folder / "model.xml")
    content = json.dumps(sidecar({"model.xml": robot}, []))
    (folder / FILE).write_text(content, encoding="utf-8")
    return with_sidecar(load_robot(folder / "model.xml"), folder / "model.xml")


def odd(parameter):
    """A value with many digits, unlike all starts, that does something."""
    if parameter.choice:
        return parameter.starts[0]
    return parameter.starts[-1] * 0.8127364523 + parameter.starts[0] * 0.1234567


def supplied(robot):
    """The robot, whose supply has varied in its recordings."""
    seen = {joint: replace(robot.excursion(joint), voltage=SUPPLY) for joint in robot.joints}
    return replace(robot, excursions=seen)


def check(name, robot, folder):
    effect, robot = CATALOGUE[name], supplied(robot)
    measured = [joint for joint in JOINTS if joint in robot.joints]
    terms = candidate_terms([effect], [robot], measured)
    if not terms:
        return False
    (term,) = terms
    structure = Structure((term,), (robot,))
    values = np.array([odd(slot.parameter) for slot in structure.slots])
    mended = mend(structure.trials(robot, values[None]))
    loaded = saved_and_loaded(mended, folder)
    for slot, value in zip(structure.slots, values, strict=True):
        field = effect.fields[slot.parameter.name]
        for site in term.sites if slot.place == EVERYWHERE else (slot.place,):
            was, now = field.read(robot, site, robot), field.read(loaded, site, robot)
            adds = name not in ABSOLUTE or slot.parameter.name == "frictionloss"
            if slot.parameter.name == "springref":  # of both springs together
                adds = False
                own = effect.fields["stiffness"].read(robot, site, robot)
                added = values[structure.columns(term, site)[0]]
                value = (own * (was or 0.0) + added * value) / (own + added)
            if name == "presliding_friction" and slot.parameter.name == "bend":
                adds = False
            if slot.parameter.name == "damping_ratio" or (
                slot.parameter.choice and name != "timestep"
            ):
                adds = False
            wanted = (was or 0.0) + value if adds else value
            size = slot.parameter.scale
            assert now == pytest.approx(wanted, rel=1e-6, abs=1e-6 * size), (site, slot.parameter)
    return True


@pytest.mark.parametrize("variant", ["plain", "awkward"])
@pytest.mark.parametrize("name", CATALOGUE)
def test_what_was_and_the_change_make_what_is_in_the_files(name, variant, request, tmp_path):
    robot, _ = request.getfixturevalue(variant)
    if not check(name, robot, tmp_path):
        standing = robot_from_spec(mujoco.MjSpec.from_string(STANDING), "standing")
        assert check(name, standing, tmp_path)


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_parameter_has_a_field(name, plain):
    robot, _ = plain
    effect = CATALOGUE[name]
    for term in candidate_terms([effect], [robot], JOINTS):
        for site in term.sites:
            for parameter in effect.parameters(robot, site):
                assert effect.fields[parameter.name].path
