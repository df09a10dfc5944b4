"""The log of a simulated robot, against MuJoCo itself and against the workflow that reads it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from dm_control import composer
from dm_control import suite as dm_suite
from dm_control.locomotion.arenas import floors
from dm_control.locomotion.walkers import ant

from tests.tasks.stools import PD, pendulum, stool
from walkerkit import gap
from walkerkit.actuators import (
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
)
from walkerkit.actuators.drivetrain import StribeckFriction, TorqueSpeedLimit
from walkerkit.tasks import FallLimits, Stand, TrackJoints, suite
from walkerkit.tasks.excitation import BATTERY
from walkerkit.walkers import LEG_XML, MjcfWalker

XML = (
    XmlPositionActuatorCfg(joint_names_expr=("shoulder",)),
    XmlMotorActuatorCfg(joint_names_expr=("wrist",)),
)


def bench(folder: Path, actuators: Any = XML, **options: Any) -> composer.Environment:
    task = TrackJoints(pendulum(folder, actuators), **{"seconds": 0.5} | options)
    return composer.Environment(task, random_state=0)


def leg(excitation: str, seed: int, **options: Any) -> gap.Recording:
    walker = MjcfWalker.from_file(LEG_XML, XmlPositionActuatorCfg(joint_names_expr=(".*",)))
    task = TrackJoints(walker, excitation=excitation, **options)
    return gap.record(composer.Environment(task, random_state=seed), name=excitation)


@pytest.mark.parametrize("every", ["control_step", "physics_step"])
@pytest.mark.parametrize("control_timestep", [0.001, 0.004])
def test_a_row_is_the_instant_at_which_its_targets_begin_to_act(
    every: Any, control_timestep: float, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    environment = bench(tmp_path, control_timestep=control_timestep, seconds=0.2)
    log = gap.record(environment, lambda _: rng.uniform(-1, 1, 1), every=every)
    # The model file by itself, started from the first row and sent the targets of the log.
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    data = mujoco.MjData(model)
    names = ("shoulder", "wrist")
    data.qpos[:] = [log.columns[f"{name}/position"][0] for name in names]
    data.qvel[:] = [log.columns[f"{name}/velocity"][0] for name in names]
    rows = len(log.time)
    assert rows == (200 if every == "physics_step" else round(0.2 / control_timestep))
    stride = round(0.2 / 0.001) // rows
    for row in range(rows):
        assert log.time[row] == pytest.approx(data.time, abs=1e-12)
        for i, name in enumerate(names):
            assert log.columns[f"{name}/position"][row] == pytest.approx(data.qpos[i], abs=1e-12)
            assert log.columns[f"{name}/velocity"][row] == pytest.approx(data.qvel[i], abs=1e-10)
        data.ctrl[:] = [
            log.columns["shoulder/position_target"][row],
            log.columns["wrist/effort_target"][row] / 2.0,  # its gear
        ]
        mujoco.mj_step(model, data)
        for i, name in enumerate(names):
            logged = log.columns[f"{name}/effort"][row]
            assert logged == pytest.approx(data.qfrc_actuator[i], abs=1e-10)
        for _ in range(stride - 1):
            mujoco.mj_step(model, data)


def test_columns_are_those_of_a_recording(tmp_path: Path) -> None:
    log = gap.record(bench(tmp_path), name="bench")
    assert log.name == "bench"
    assert log.joints == ("shoulder", "wrist")
    assert list(log.columns) == [
        "shoulder/position",
        "shoulder/velocity",
        "shoulder/effort",
        "shoulder/position_target",
        "wrist/position",
        "wrist/velocity",
        "wrist/effort",
        "wrist/effort_target",
    ]
    assert log.notes == ()
    path = tmp_path / "bench.csv"
    log.save(path)
    again = gap.Recording.load(path)
    np.testing.assert_array_equal(again.time, log.time)
    assert again.columns.keys() == log.columns.keys()


@pytest.mark.parametrize("excitation", ["chirp", "multisine", "slow_triangle"])
def test_an_excitation_leaves_no_gap_to_the_model_that_made_it(excitation: str) -> None:
    log = leg(excitation, 0, seconds=3.0, control_timestep=0.002)
    diagnosis = gap.compare(str(LEG_XML), [log])
    assert diagnosis.verdict == "no_gap"
    assert diagnosis.gap.position.before < 2e-5


def test_a_policy_s_log_leaves_no_gap_to_the_model_that_made_it() -> None:
    walker = MjcfWalker.from_file(LEG_XML, XmlPositionActuatorCfg(joint_names_expr=(".*",)))
    environment = composer.Environment(TrackJoints(walker, control_timestep=0.01), random_state=0)

    def policy(timestep: Any) -> np.ndarray:
        time = environment.physics.time()
        return np.sin(np.array([5.0, 7.0, 9.0]) * time)

    log = gap.record(environment, policy, seconds=2.0)
    few = ["viscous_friction", "coulomb_friction", "command_delay", "sensor_delay", "timestep"]
    result = gap.diagnose(str(LEG_XML), [log], effects=few)
    assert result.diagnosis.verdict == "no_gap"


def test_another_model_does_leave_a_gap(tmp_path: Path) -> None:
    text = LEG_XML.read_text(encoding="utf-8").replace('damping="0.1"', 'damping="0.6"')
    other = tmp_path / "leg.xml"
    other.write_text(text, encoding="utf-8")
    log = leg("multisine", 0, seconds=3.0, control_timestep=0.002)
    right, wrong = (gap.compare(str(model), [log]) for model in (LEG_XML, other))
    assert wrong.gap.position.before > 100 * right.gap.position.before


def twin_of_the_law() -> MjcfWalker:
    """A leg that has in MuJoCo what another has in Python."""
    return MjcfWalker.from_file(LEG_XML, BuiltinPdActuatorCfg(**_GAINS))


def model_of_the_law() -> MjcfWalker:
    """A leg whose law runs in Python."""
    return MjcfWalker.from_file(LEG_XML, IdealPdActuatorCfg(**_GAINS))


_GAINS: dict[str, Any] = {
    "joint_names_expr": (".*",),
    "stiffness": 60.0,
    "damping": 3.0,
    "effort_limit": 30.0,
}


def test_a_law_in_python_is_compared_with_itself_and_with_its_native_twin() -> None:
    task = TrackJoints(model_of_the_law(), seconds=3.0, control_timestep=0.002)
    log = gap.record(composer.Environment(task, random_state=0))
    assert log.notes == ()
    own = gap.compare(f"{__name__}:model_of_the_law", [log])
    twin = gap.compare(f"{__name__}:twin_of_the_law", [log])
    # Nothing but how the damping is integrated: implicitly in MuJoCo, explicitly in Python.
    assert own.verdict == twin.verdict == "no_gap"
    assert own.gap.position.before < 0.1 * twin.gap.position.before < 5e-5


def test_behind_delays_in_python_targets_are_logged_as_sent(tmp_path: Path) -> None:
    late = DelayedActuatorCfg(base_cfg=PD, delay_min_lag=3, delay_max_lag=5)
    environment = bench(tmp_path, late)
    log = gap.record(environment)
    sent = np.column_stack([log.columns[f"{name}/position_target"] for name in log.joints])
    np.testing.assert_array_equal(sent, environment.task.targets)


def test_a_native_delay_is_no_note(tmp_path: Path) -> None:
    servo = BuiltinPositionActuatorCfg(joint_names_expr=(".*",), stiffness=20.0, damping=1.0)
    late = DelayedActuatorCfg(base_cfg=servo, delay_min_lag=4, delay_max_lag=4)
    assert gap.record(bench(tmp_path, late)).notes == ()


@pytest.mark.parametrize(
    ("law", "reported"),
    [
        (TorqueSpeedLimit(joint_names_expr=(".*",), saturation_effort=3.0, velocity_limit=4.0), 1),
        (StribeckFriction(joint_names_expr=(".*",), breakaway=0.2, velocity=0.1), 0),
    ],
)
def test_effort_is_what_the_drive_reports_and_not_the_friction_behind_it(
    law: Any, reported: int, tmp_path: Path
) -> None:
    task = TrackJoints(pendulum(tmp_path, XML, laws=(law,)), seconds=0.5, control_timestep=0.001)
    environment = composer.Environment(task, random_state=0)
    shoulder = task.walker.mjcf_model.find("joint", "shoulder")
    expected, changed = [], []

    def after(physics: Any, random_state: Any) -> None:
        bound = physics.bind(shoulder)
        changed.append(float(bound.qfrc_applied[0]))
        expected.append(float(bound.qfrc_actuator[0]) + reported * changed[-1])

    environment.add_extra_hook("after_substep", after)
    log = gap.record(environment)
    np.testing.assert_allclose(log.columns["shoulder/effort"], expected, rtol=1e-12)
    if reported:
        assert np.abs(changed).max() > 0.1


@pytest.mark.parametrize("policy", ["steps", BATTERY["steps"]])
def test_excitations_as_policies(policy: Any, tmp_path: Path) -> None:
    task = Stand(stool(tmp_path), fall=FallLimits(tilt=3.0, height=0.0, contact=False))
    environment = composer.Environment(task, random_state=0)
    log = gap.record(environment, policy, seconds=1.0, seed=3)
    targets = np.column_stack([log.columns[f"{name}/position_target"] for name in log.joints])
    assert targets.shape == (50, 3)
    assert np.ptp(targets, axis=0).min() > 0.1
    again = gap.record(environment, policy, seconds=1.0, seed=3)
    np.testing.assert_array_equal(
        targets, np.column_stack([again.columns[f"{n}/position_target"] for n in again.joints])
    )


def test_a_base_that_floats_is_logged(tmp_path: Path) -> None:
    environment = composer.Environment(Stand(stool(tmp_path), joint_noise=0.0), random_state=0)
    hold = environment.task.walker.action_for()
    log = gap.record(environment, lambda _: hold, n_steps=10)
    assert log.columns["base/position_z"][0] == pytest.approx(environment.task._trunk.home_height)
    np.testing.assert_allclose(log.columns["base/quaternion_w"], 1.0, atol=1e-3)
    assert {name for name in log.columns if name.startswith("base/")} == {
        *(f"base/position_{axis}" for axis in "xyz"),
        *(f"base/quaternion_{axis}" for axis in "wxyz"),
        *(f"base/{kind}_velocity_{axis}" for kind in ("linear", "angular") for axis in "xyz"),
    }


class TestSuite:
    def test_actuators_of_ours(self) -> None:
        pd = IdealPdActuatorCfg(
            joint_names_expr=(".*_knee",), stiffness=40.0, damping=1.0, effort_limit=30.0
        )
        environment = suite.load("walker", "walk", pd, task_kwargs={"random": 0})
        log = gap.record(environment, n_steps=20)
        assert log.time[1] == pytest.approx(0.025)
        assert log.joints[:3] == ("rootz", "rootx", "rooty")
        assert "rootz/effort" not in log.columns
        assert "left_knee/position_target" in log.columns
        np.testing.assert_array_equal(log.columns["left_hip/effort_target"], np.zeros(20))
        assert np.abs(log.columns["left_knee/effort"]).max() > 0

    def test_the_suite_s_own(self) -> None:
        environment = dm_suite.load("cartpole", "swingup", {"random": 0})
        log = gap.record(environment, lambda _: [0.5], n_steps=30)
        # Its motor has a gear of 10.
        np.testing.assert_allclose(log.columns["slider/effort_target"], 5.0)
        np.testing.assert_allclose(log.columns["slider/effort"], 5.0)
        assert "hinge_1/position" in log.columns

    def test_recording_changes_nothing(self) -> None:
        states = []
        for watched in (True, False):
            environment = dm_suite.load("hopper", "hop", {"random": 0})
            rng = np.random.default_rng(1)
            if watched:
                gap.record(environment, lambda _, rng=rng: rng.uniform(-1, 1, 4), n_steps=50)
            else:
                environment.reset()
                for _ in range(50):
                    environment.step(rng.uniform(-1, 1, 4))
            states.append(environment.physics.get_state())
        np.testing.assert_array_equal(*states)


def test_recording_leaves_the_environment_as_it_was(tmp_path: Path) -> None:
    environment = bench(tmp_path)
    gap.record(environment)
    assert "step" not in vars(environment._physics)
    first, second = (gap.record(bench(tmp_path)) for _ in "ab")
    for name, values in first.columns.items():
        np.testing.assert_array_equal(values, second.columns[name])


def test_an_error_of_the_policy_leaves_the_environment_as_it_was(tmp_path: Path) -> None:
    environment = bench(tmp_path)
    with pytest.raises(ValueError, match="the action is nan"):
        gap.record(environment, lambda _: [np.nan])
    assert "step" not in vars(environment._physics)


def test_an_episode_that_ends_early_says_so(tmp_path: Path) -> None:
    log = gap.record(bench(tmp_path), seconds=2.0)
    assert len(log.time) == 50
    (note,) = log.notes
    assert note.startswith("the episode ended after 0.5 s of 2: the robot fell, or the time limit")


def test_one_of_several_walkers(tmp_path: Path) -> None:
    arena = floors.Floor()
    second = stool(tmp_path, name="second")
    second.create_root_joints(arena.attach(second))
    environment = bench(tmp_path, arena=arena)
    with pytest.raises(ValueError, match="the environment has 2 walkers, 'second', 'pendulum'"):
        gap.record(environment)
    log = gap.record(environment, walker=environment.task.walker)
    assert log.joints == ("shoulder", "wrist")
    assert gap.record(environment, walker=second).joints == ("front", "left", "right")


def test_a_task_that_passes_the_walker_by_is_refused(tmp_path: Path) -> None:
    environment = composer.Environment(composer.NullTask(pendulum(tmp_path, XML)))
    with pytest.raises(ValueError, match="NullTask writes actions into MuJoCo's controls, past"):
        gap.record(environment, n_steps=10)


def test_a_walker_of_others(tmp_path: Path) -> None:
    environment = composer.Environment(composer.NullTask(ant.Ant()), random_state=0)
    log = gap.record(environment, lambda _: np.full(8, 0.2), n_steps=10)
    assert len(log.joints) == 8
    assert log.notes == ()
    # Its motors have a gear of 75.
    np.testing.assert_allclose(log.columns["back_left_hip/effort_target"], 15.0)
    np.testing.assert_allclose(log.columns["back_left_hip/effort"], 15.0)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"seconds": 1.0, "n_steps": 3}, ValueError, "give one of the two, or none"),
        ({"seconds": -1.0}, ValueError, r"seconds is -1\.0; it should be above 0"),
        ({"n_steps": 0}, ValueError, "n_steps is 0; it should be at least 1"),
        ({"every": "step"}, ValueError, "every is 'step'"),
        ({"policy": 3}, TypeError, "policy is 3; it should be a function of a TimeStep"),
        ({"policy": "chirp", "seconds": 1.0}, ValueError, "which TrackJoints takes itself"),
        ({"n_steps": 1}, gap.InputError, r"too few rows of data \(1\)"),
    ],
)
def test_unusable_arguments(
    options: dict[str, Any], error: type[Exception], message: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=message):
        gap.record(bench(tmp_path), **options)


def test_excitations_need_a_length_and_actuators_of_ours(tmp_path: Path) -> None:
    environment = composer.Environment(Stand(stool(tmp_path)), random_state=0)
    with pytest.raises(ValueError, match="an excitation has no length of its own"):
        gap.record(environment, "chirp")
    with pytest.raises(ValueError, match=r"no excitation 'chrip' \(did you mean 'chirp'"):
        gap.record(environment, "chrip", seconds=1.0)
    with pytest.raises(ValueError, match="'chirp', which takes actuators of ours: use with_act"):
        gap.record(dm_suite.load("hopper", "hop"), "chirp", seconds=1.0)


def test_an_episode_without_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("walkerkit.gap.recorder.LONGEST", 0.2)
    environment = composer.Environment(Stand(stool(tmp_path)), random_state=0)
    hold = environment.task.walker.action_for()
    with pytest.raises(ValueError, match=r"has not ended after 0\.2 s: give seconds or n_steps"):
        gap.record(environment, lambda _: hold)
