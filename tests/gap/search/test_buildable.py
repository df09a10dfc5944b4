"""An effect that cannot be built costs itself, with a note, and never the diagnosis."""

import mujoco
import numpy as np
import pytest

from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.effects.friction import ViscousFriction
from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.gap.search.buildable import buildable, why_not
from walkerkit.gap.simulation.load_robot import robot_from_spec

ARM = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body><joint name="shaft" axis="0 1 0" range="-1.6 1.6" damping="0.05"
    armature="0.005"/><geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body>
  </worldbody><actuator><position joint="shaft" kp="20" kv="0.6"/></actuator></mujoco>
"""


def torn(self, robot, site):
    """Numbers of a table that has no such joint."""
    return {}[site]


def odd_effects():
    """One whose numbers cannot be made, and one that writes what is no number.

    Defined where they are used: an effect is in the catalogue once it is defined.
    """

    class Torn(ViscousFriction):
        name = "torn"
        parameters = torn

    class Endless(ViscousFriction):
        name = "endless"

        def apply(self, trials, site, values):
            with np.errstate(divide="ignore"):
                trials.field("dof_damping")[:, 0] += values[:, 0] / np.zeros(len(values))

    return Torn(), Endless()


@pytest.fixture(scope="module")
def robots():
    return [robot_from_spec(mujoco.MjSpec.from_string(ARM), "arm.xml")]


def test_what_can_be_built_stays_and_what_cannot_is_told(robots):
    torn_one, endless = odd_effects()
    effects = [CATALOGUE["armature"], torn_one, endless, CATALOGUE["coulomb_friction"]]
    found, notes = buildable(effects, robots, ["shaft"])
    assert [effect.name for effect in found] == ["armature", "coulomb_friction"]
    assert notes == (
        "torn was left out, as it cannot be built for arm.xml: KeyError: 'shaft'. All other "
        "effects were considered.",
        "endless was left out, as it cannot be built for arm.xml: it makes dof_damping infinite "
        "or no number. All other effects were considered.",
    )


def test_the_whole_catalogue_can_be_built(robots):
    assert {name: why_not(one, robots, ["shaft"]) for name, one in CATALOGUE.items()} == (
        dict.fromkeys(CATALOGUE)
    )


@pytest.mark.parametrize(
    ("flag", "idle"),
    [
        ("constraint", {"coulomb_friction"}),
        ("frictionloss", {"coulomb_friction"}),
        ("damper", {"viscous_friction"}),
        ("gravity", set()),
    ],
)
def test_what_a_flag_switches_off_is_left_out(tmp_path, flag, idle):
    switched = ARM.replace(
        'integrator="implicitfast"/>',
        f'integrator="implicitfast"><flag {flag}="disable"/></option>',
    )
    off = [robot_from_spec(mujoco.MjSpec.from_string(switched), "arm.xml")]
    left_out = {
        name: why
        for name in ("armature", "coulomb_friction", "viscous_friction", "stribeck_friction")
        if (why := why_not(CATALOGUE[name], off, ["shaft"]))
    }
    assert set(left_out) == idle
    assert all(f'<flag {flag}="disable"/>' in why for why in left_out.values())
    path = tmp_path / "arm.xml"
    path.write_text(switched, encoding="utf-8")
    for name in idle:
        with pytest.raises(InputError, match=rf"{name} can be hidden but not found.*{flag}"):
            rehearse(path, [name], seconds=2)


def test_a_diagnosis_goes_on_without_what_cannot_be_built(tmp_path, monkeypatch):
    path = tmp_path / "arm.xml"
    path.write_text(ARM, encoding="utf-8")
    logs = rehearse(path, ["coulomb_friction"], seed=1, seconds=2).recordings
    monkeypatch.setattr(ViscousFriction, "parameters", torn)
    result = gap.diagnose(path, logs, effects=["viscous_friction", "coulomb_friction"])
    assert [named.effect for named in result.diagnosis.effects] == ["coulomb_friction"]
    assert result.diagnosis.notes[0] == (
        f"viscous_friction was left out, as it cannot be built for {path}: KeyError: 'shaft'. All "
        "other effects were considered."
    )
    with pytest.raises(InputError, match=r"viscous_friction cannot be built for .*'shaft'"):
        gap.fit(gap.load(path, logs), {"viscous_friction": ["shaft"]})
