"""What a changed set-up does to a robot, and which confusion sets it is proposed for."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.gap.report.test_planner import member, problem
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.report.planner import Plan, next_experiment
from walkerkit.gap.report.set_ups import SetUp, set_ups
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Structure, Term
from walkerkit.gap.simulation.load_robot import load_robot, robot_from_spec
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials
from walkerkit.walkers.leg import LEG_XML

ARM = """
<mujoco model="arm">
  <compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body name="arm"><joint name="knee" axis="{axis}" armature="0.005" damping="0.1"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/></body></worldbody>
  <actuator><position joint="knee" kp="30" kv="{kv}"/></actuator>
</mujoco>
"""
EXCITATIONS = ("chirp", "multisine", "slow_triangle", "steps")


def robot(axis: str = "0 1 0", kv: float = 1.0) -> Robot:
    return robot_from_spec(mujoco.MjSpec.from_string(ARM.format(axis=axis, kv=kv)), "arm.xml")


def named(robot: Robot, name: str, *, efforts: bool = True) -> SetUp:
    found = set_ups(robot, ["knee"], concerned=["knee"], efforts=efforts, excitations=EXCITATIONS)
    return next(one for one in found if one.name == name)


def planned(
    folder: Path, signals: tuple[str, ...], *members: tuple[str, float], axis: str = "0 1 0"
) -> Plan | None:
    """The plan for a confusion set of an arm, of which the first member explains the recordings."""
    (folder / "arm.xml").write_text(ARM.format(axis=axis, kv=1.0))
    time = np.arange(0.0, 2.0, 0.004)
    targets = [0.5 * np.sin(w * time)[:, None] for w in (4.0, 6.0)]
    recordings = run_hardware(folder / "arm.xml", targets, rate=250.0, seed=1)
    kept = ("position_target", *signals)
    arm = problem(
        folder / "arm.xml",
        [
            type(r)(
                name=r.name,
                time=r.time,
                columns={k: v for k, v in r.columns.items() if k.rpartition("/")[2] in kept},
            )
            for r in recordings
        ],
    )
    return next_experiment(arm, [_member(arm, *one) for one in members])


def _member(arm: Problem, effect: str, value: float) -> Fit:
    if CATALOGUE[effect].kind == "joint":
        return member(arm, effect, value)
    structure = Structure((Term(effect=CATALOGUE[effect], sites=("arm",)),), arm.robots)
    return Fit(structure=structure, values=np.array([value]), score=0.0, mean_square=np.zeros(2))


def test_a_payload_is_a_round_mass_at_a_point_that_is_named() -> None:
    arm = robot()
    payload = named(arm, "known_payload")
    assert payload.instruction.startswith(
        "Put 0.2 kg on body arm, at its centre of mass (0, 0, -125"
    )
    assert payload.changed(arm).model.body("arm").mass[0] == pytest.approx(0.8)
    assert payload.changes_robot


def test_a_reduced_gain_keeps_the_damping() -> None:
    arm = robot()
    changed = named(arm, "reduced_gain").changed(arm).model
    assert changed.actuator_gainprm[0, 0] == pytest.approx(9.0)
    assert changed.actuator_biasprm[0, :3] == pytest.approx([0, -9.0, -1.0])


def test_a_drive_that_is_off_makes_nothing_whatever_a_variant_assumes_of_it() -> None:
    arm = robot()
    trials = Trials(arm, 2)
    for effect, values in (("torque_bias", [0.0, 0.5]), ("torque_constant", [0.3, 0.0])):
        CATALOGUE[effect].apply(trials, "knee", np.array(values)[:, None])
    off = named(arm, "motor_off")
    off.change(trials)
    assert not trials.field("actuator_gainprm").any()
    assert not trials.field("actuator_biasprm").any()
    assert "Switch the drive of knee off" in off.instruction
    # Nothing drives the joint in the model to go with the recording.
    assert robot_from_spec(off.changed(arm).spec, "off.xml").joints["knee"].drives == ()


def test_a_clamped_link_stays() -> None:
    arm = robot()
    model = named(arm, "held_link").changed(arm).model
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.5
    mujoco.mj_step(model, data, 1000)
    assert abs(data.qpos[0]) < 1e-6


def test_the_robot_as_it_is_comes_first_and_efforts_are_asked_for_where_there_are_none() -> None:
    both = [
        [
            one.name
            for one in set_ups(
                robot(), ["knee"], concerned=["knee"], efforts=efforts, excitations=EXCITATIONS
            )
        ]
        for efforts in (True, False)
    ]
    assert both[0][0] == both[1][0] == "as_it_is"
    assert set(both[1]) - set(both[0]) == {"effort_logged"}


def test_nobody_holds_three_joints_and_lets_them_go() -> None:
    leg = load_robot(LEG_XML)
    names = tuple(leg.joints)
    offered = [
        {
            one.name
            for one in set_ups(
                leg, names, concerned=names[:count], efforts=True, excitations=EXCITATIONS
            )
        }
        for count in (2, 3)
    ]
    assert offered[0] - offered[1] == {"motor_off"}


def test_a_payload_or_torque_constant_is_told_by_what_parts_them(tmp_path: Path) -> None:
    signals = ("position", "velocity", "effort")
    # A mass of a tenth of the arm's makes the motor seem weaker by about as much.
    plan = planned(tmp_path, signals, ("payload", 0.06), ("torque_constant", -0.085))
    assert plan is not None
    assert plan.experiment.between == ("payload", "torque_constant")
    assert plan.experiment.separation > 3
    changed = plan.experiment.set_up != "as_it_is"
    assert (plan.robot is not None) == changed == bool(plan.experiment.instruction)
    assert plan.experiment.model == ("next_experiment.xml" if changed else None)


def test_a_late_command_or_log_is_told_by_the_effort_alone(tmp_path: Path) -> None:
    plan = planned(tmp_path, ("position",), ("command_delay", 0.01), ("sensor_delay", 0.01))
    assert plan is not None
    assert plan.experiment.set_up == "effort_logged"
    assert plan.experiment.instruction.startswith("Log the effort of each joint as well")
    assert plan.robot is None
