from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_control import composer, mjcf
from dm_control.locomotion.arenas import floors

from tests.tasks.stools import pendulum, stool
from walkerkit.actuators import (
    BuiltinMotorActuatorCfg,
    IdealPdActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
)
from walkerkit.tasks import TrackJoints
from walkerkit.tasks.excitation import BATTERY, chirp
from walkerkit.tasks.reference import Reference
from walkerkit.tasks.rewards import closeness, low_effort
from walkerkit.tasks.room import room_about

SERVO = XmlPositionActuatorCfg(joint_names_expr=("shoulder",))
MOTOR = XmlMotorActuatorCfg(joint_names_expr=("wrist",))
BOTH = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=20.0, damping=0.5, effort_limit=10.0)


def bench(
    folder: Path, actuators: Any = (SERVO, MOTOR), *, seed: int = 0, **options: Any
) -> composer.Environment:
    task = TrackJoints(pendulum(folder, actuators), **{"seconds": 1.0} | options)
    return composer.Environment(task, random_state=seed, strip_singleton_obs_buffer_dim=True)


def run(environment: composer.Environment, action: Any = None) -> list[Any]:
    spec = environment.action_spec()
    steps = [environment.reset()]
    while not steps[-1].last():
        steps.append(environment.step(np.zeros(spec.shape) if action is None else action))
    return steps


def test_it_sends_the_targets_one_row_for_each_step_and_ends_with_them(tmp_path: Path) -> None:
    environment = bench(tmp_path)
    task = environment.task
    timestep = environment.reset()
    assert task.joint_names == ("shoulder",)
    assert task.targets.shape == (100, 1)
    for k, row in enumerate(task.targets):
        assert timestep.step_type == (0 if k == 0 else 1)
        np.testing.assert_array_equal(timestep.observation["reference"], row)
        timestep = environment.step([0.0])
        np.testing.assert_array_equal(task.walker.command.position_target, [row[0], 0.0])
        servo = environment.physics.bind(task.walker.mjcf_model.find("actuator", "shoulder"))
        assert servo.ctrl == row[0]
        assert 0 <= timestep.reward <= 1
    assert timestep.last()
    assert timestep.discount == 1.0
    assert environment.physics.time() == pytest.approx(1.0)


def test_the_robot_follows(tmp_path: Path) -> None:
    environment = bench(tmp_path, BOTH, excitation="slow_triangle", seconds=3.0)
    rewards = [step.reward for step in run(environment)[1:]]
    assert min(rewards) > 0.8
    assert np.mean(rewards) > 0.9


def test_it_starts_at_rest(tmp_path: Path) -> None:
    environment = bench(tmp_path, BOTH)
    first = environment.reset().observation
    assert environment.physics.time() == 0.0
    # Under the first target, where gravity lets it hang a little.
    np.testing.assert_allclose(first["pendulum/joints_vel"], [0, 0], atol=2e-3)
    np.testing.assert_allclose(first["pendulum/joints_pos"], environment.task.targets[0], atol=0.06)
    started = bench(tmp_path, BOTH, settle=0.0).reset().observation
    np.testing.assert_array_equal(started["pendulum/joints_vel"], [0, 0])


def test_an_action_corrects_within_the_joint_s_range(tmp_path: Path) -> None:
    environment = bench(tmp_path, BOTH, correction=0.2)
    task = environment.task
    environment.reset()
    environment.step([0.5, -9.0])
    row = task.targets[0]
    np.testing.assert_allclose(task.walker.command.position_target, row + np.array([0.1, -0.2]))
    wide = bench(tmp_path, BOTH, correction=5.0)
    wide.reset()
    wide.step([1.0, 0.0])
    assert wide.task.walker.command.position_target[0] == 1.0


def test_terms_follow_their_equations(tmp_path: Path) -> None:
    environment = bench(tmp_path, BOTH)
    environment.reset()
    for _ in range(30):
        environment.step([0.3, 0.0])
    task, physics = environment.task, environment.physics
    error = physics.bind(task.walker.observable_joints).qpos - task.targets[29]
    assert task.reward_terms(physics) == {
        "tracking": pytest.approx(closeness(error, 0.1)),
        "effort": pytest.approx(low_effort(task.walker.actuator_group.applied_effort, [10, 10])),
    }


def test_chosen_joints_move_and_the_others_hold_home(tmp_path: Path) -> None:
    environment = bench(tmp_path, BOTH, joint_names_expr=("wrist",))
    assert environment.action_spec().shape == (1,)
    run(environment)
    assert environment.task.targets.shape == (100, 1)
    assert environment.task.walker.command.position_target[0] == -0.5


@pytest.mark.parametrize("excitation", [*BATTERY, chirp])
def test_every_excitation_stays_in_the_room_and_within_its_slope(
    excitation: Any, tmp_path: Path
) -> None:
    environment = bench(tmp_path, BOTH, excitation=excitation, seconds=4.0, max_velocity=2.0)
    environment.reset()
    targets = environment.task.targets
    # 35 % of the shoulder's range, and ±0.5 rad of the wrist, which has none.
    assert (np.abs(targets - np.array([-0.5, 0.1])) <= np.array([0.525, 0.5]) + 1e-9).all()
    assert np.abs(np.diff(targets, axis=0) / 0.01).max() <= 2.0 + 1e-9
    assert np.ptp(targets, axis=0).min() > 0.05


def test_seeds_are_reproducible_and_differ(tmp_path: Path) -> None:
    def targets(seed: int) -> list[np.ndarray]:
        environment = bench(tmp_path, seed=seed)
        drawn = []
        for _ in range(2):
            environment.reset()
            drawn.append(environment.task.targets)
        return drawn

    first = targets(0)
    np.testing.assert_array_equal(first, targets(0))
    assert not np.array_equal(first, targets(1))
    assert not np.array_equal(first[0], first[1])


@pytest.mark.parametrize("recompile", [True, False])
def test_no_state_survives_a_reset(recompile: bool, tmp_path: Path) -> None:
    def after(before: int) -> list[Any]:
        environment = composer.Environment(
            TrackJoints(pendulum(tmp_path, BOTH), seconds=0.3),
            random_state=0,
            recompile_mjcf_every_episode=recompile,
        )
        for _ in range(before):
            environment.reset()
            for _ in range(20):
                environment.step([1.0, -1.0])
        environment.random_state.seed(5)
        environment.reset()
        environment.random_state.seed(5)
        return run(environment)

    for one, other in zip(after(0), after(2), strict=True):
        assert one.reward == other.reward
        for name, value in one.observation.items():
            np.testing.assert_array_equal(value, other.observation[name], err_msg=name)


def test_a_robot_that_floats_is_hung_up(tmp_path: Path) -> None:
    environment = composer.Environment(
        TrackJoints(stool(tmp_path), seconds=1.0, hang=0.7), random_state=0
    )
    task = environment.task
    assert mjcf.get_frame_freejoint(task.walker.mjcf_model) is None
    for step in run(environment)[1:]:
        np.testing.assert_array_equal(
            environment.physics.bind(task.walker.root_body).xpos, [0.0, 0.0, 0.7]
        )
        # The legs begin inside the seat, which is no collision while the seat moves, either.
        assert environment.physics.data.ncon == 0
        assert 0 <= step.reward <= 1


def test_a_fixed_base_stays_where_the_file_has_it(tmp_path: Path) -> None:
    environment = bench(tmp_path)
    environment.reset()
    base = environment.physics.bind(environment.task.walker.root_body)
    np.testing.assert_array_equal(base.xpos, [0.0, 0.0, 0.8])


def test_arena_and_timesteps(tmp_path: Path) -> None:
    arena = floors.Floor(size=(2, 2))
    environment = bench(tmp_path, arena=arena, control_timestep=0.004)
    assert environment.task.root_entity is arena
    assert environment.physics.timestep() == 0.001  # the file's
    assert environment.control_timestep() == 0.004
    environment.reset()
    assert len(environment.task.targets) == 250


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([np.nan], "the action is nan for 'shoulder'"),
        ([0.0, 0.0], r"the action has shape \(2,\), the walker takes \(1,\)"),
    ],
)
def test_bad_actions_are_refused(action: Any, message: str, tmp_path: Path) -> None:
    environment = bench(tmp_path)
    environment.reset()
    with pytest.raises(ValueError, match=message):
        environment.step(action)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"excitation": "chrip"}, r"no excitation 'chrip' \(did you mean 'chirp'"),
        ({"seconds": 0.01}, r"seconds is 0\.01; an excitation takes two steps of 0\.01 s"),
        ({"seconds": np.inf}, "seconds is inf"),
        ({"joint_names_expr": ("wrist",)}, "no position target goes to 'wrist'"),
        ({"correction": -1.0}, "`correction` should be at least 0"),
        ({"settle": np.nan}, "`settle` should be finite"),
        ({"weights": {"track": 1.0}}, r"no reward term 'track' \(did you mean 'tracking'"),
    ],
)
def test_unusable_arguments(options: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        bench(tmp_path, **options)


def test_a_robot_without_position_targets_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no position target goes to 'shoulder', 'wrist'"):
        bench(tmp_path, BuiltinMotorActuatorCfg(joint_names_expr=(".*",)))


class TestReference:
    def test_slopes_follow_the_motors(self, tmp_path: Path) -> None:
        slow = pendulum(tmp_path, BOTH).drivetrain
        reference = Reference(slow, "fast_sine", seconds=3.0, timestep=0.002)
        targets = reference.draw(np.random.default_rng(0))
        assert np.abs(np.diff(targets, axis=0) / 0.002).max() <= 6.0 + 1e-9
        assert len(reference) == len(targets) == 1500

    def test_a_command_leaves_the_other_targets_at_rest(self, tmp_path: Path) -> None:
        drivetrain = pendulum(tmp_path, (SERVO, MOTOR)).drivetrain
        reference = Reference(drivetrain, "chirp", seconds=1.0, timestep=0.01)
        command = reference.command(np.array([-0.4]))
        np.testing.assert_array_equal(command.position_target, [-0.4, 0.0])
        np.testing.assert_array_equal(command.effort_target, [0.0, 0.0])
        assert command.velocity_target is None


def test_the_room_about_a_pose_ends_at_the_limits() -> None:
    lower, upper = room_about([0.0, 0.9, 2.0], [[-1, 1], [-1, 1], [-np.inf, np.inf]])
    np.testing.assert_allclose(lower, [-0.35, 0.55, 1.5])
    np.testing.assert_allclose(upper, [0.35, 1.0, 2.5])
