"""States in which loops of links are closed, and which joints a loop holds."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from benchmarks.robots.written import WRITTEN
from tests.gap.simulation.own_log import gaps, own_log
from walkerkit import gap
from walkerkit.gap.simulation.loops import Loops

FOUR_BAR, LEG, MIMIC = WRITTEN["four_bar"], WRITTEN["leg_with_a_rod"], WRITTEN["mimic"]


def states(model, seconds=1.0):
    """Some states of a model that moves, which its constraints agree with."""
    data = mujoco.MjData(model)
    found = []
    for k in range(round(seconds / model.opt.timestep)):
        data.ctrl[:] = 0.4 * np.sin(6 * data.time) if model.nu else 0
        mujoco.mj_step(model, data)
        if k % 50 == 49:
            found.append((data.qpos.copy(), data.qvel.copy()))
    return [np.array(part) for part in zip(*found, strict=True)]


@pytest.mark.parametrize(
    ("xml", "known"),
    [(FOUR_BAR, ["crank"]), (LEG, ["hip", "knee"]), (MIMIC, ["shoulder", "elbow", "left_finger"])],
    ids=["four-bar", "leg with a rod on a ball", "mimic"],
)
def test_what_is_not_measured_stands_where_the_simulation_has_it(xml, known):
    model = mujoco.MjModel.from_xml_string(xml)
    qpos, qvel = states(model)
    loops = Loops(model)
    dofs = [int(model.joint(name).dofadr[0]) for name in known]
    measured = np.zeros(model.nq, dtype=bool)
    measured[[int(model.joint(name).qposadr[0]) for name in known]] = True
    found, speeds = loops.closed(
        np.where(measured, qpos, mujoco.MjData(model).qpos),
        np.where(np.isin(np.arange(model.nv), dofs), qvel, 0.0),
        dofs,
    )
    np.testing.assert_array_equal(found[:, measured], qpos[:, measured])
    # MuJoCo's constraints are soft: the simulation itself is off by some of this.
    np.testing.assert_allclose(found, qpos, atol=0.02)
    np.testing.assert_allclose(speeds, qvel, atol=0.2)
    assert np.abs(qpos[:, ~measured] - mujoco.MjData(model).qpos[~measured]).max() > 0.01


def test_alike_states_are_solved_alike():
    model = mujoco.MjModel.from_xml_string(FOUR_BAR)
    qpos, qvel = np.tile([0.3, 0.0, 0.0], (3, 1)), np.zeros((3, 3))
    found, _ = Loops(model).closed(qpos, qvel, [0])
    np.testing.assert_array_equal(found, found[:1].repeat(3, axis=0))
    assert abs(found[0, 2] - 0.3) < 1e-3  # a parallelogram


def test_friction_in_a_loop_is_named(tmp_path):
    """At a joint without a drive, as much as only the drives through the loop can move."""
    path = tmp_path / "leg.xml"
    path.write_text(LEG)
    spec = mujoco.MjSpec.from_string(LEG)
    ankle = spec.joint("ankle")
    ankle.frictionloss, ankle.solref_friction = 0.3, [0.004, 1]
    ankle.solimp_friction = [0.99, 0.999, 0.001, 0.5, 2]  # as dry as it goes
    rng, logs = np.random.default_rng(0), []
    for seed in range(3):
        columns = own_log(spec.compile(), rows=300, seed=seed, scale=0.3)
        time = columns.pop("time")
        for name in [name for name in columns if name.endswith("/position")]:
            columns[name] += 1e-4 * rng.standard_normal(len(time))
        logs.append(gap.Recording(name=f"log{seed}", time=time, columns=columns))
    few = ["coulomb_friction", "viscous_friction", "payload"]
    found = gap.diagnose(path, logs, effects=few, n_threads=1).effects
    (friction,) = [one for one in found if one.effect == "coulomb_friction"]
    assert friction.joints == ("ankle",)
    assert friction.parameters[0].value == pytest.approx(0.3, rel=0.1)


def test_without_constraints_there_is_nothing_to_close():
    assert not Loops(mujoco.MjModel.from_xml_string(WRITTEN["pair"])).any


def test_a_loop_holds_all_its_joints_where_one_is_held():
    four_bar = Loops(mujoco.MjModel.from_xml_string(FOUR_BAR))
    assert four_bar.holds({"crank"}) == {"crank", "coupler", "rocker"}
    assert four_bar.holds(set()) == set()
    leg = Loops(mujoco.MjModel.from_xml_string(LEG))
    assert "ankle" in leg.holds({"hip", "knee"})
    assert "ankle" not in leg.holds({"hip"})


@pytest.mark.parametrize(
    ("xml", "hidden"),
    [
        (FOUR_BAR, ("coupler", "rocker")),
        (FOUR_BAR, ()),
        (LEG, ("ankle",)),
        (MIMIC, ("right_finger",)),
    ],
)
def test_an_own_log_leaves_no_gap(xml, hidden):
    columns = own_log(mujoco.MjModel.from_xml_string(xml), hidden=hidden, scale=0.1)
    assert gaps(xml, columns)["position"] < 1e-3
