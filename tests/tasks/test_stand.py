from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_control import composer
from dm_control.locomotion.walkers import ant

from tests.tasks.stools import PD, pendulum, stool
from walkerkit.actuators import DelayedActuatorCfg
from walkerkit.actuators.randomization import Randomization
from walkerkit.tasks import JointPositionAction, Stand, TrackVelocity
from walkerkit.tasks.rewards import closeness, low_effort
from walkerkit.walkers import with_actuators

TASKS = (Stand, TrackVelocity)
WEAKER = Randomization(parameter="strength", range=(0.6, 1.0))


def make(
    task: Any, folder: Path, *, seed: int = 0, walker: Any = None, **options: Any
) -> composer.Environment:
    return composer.Environment(
        task(stool(folder) if walker is None else walker, **options),
        time_limit=options.pop("time_limit", 1.0),
        random_state=seed,
        strip_singleton_obs_buffer_dim=True,
    )


def episode(environment: composer.Environment, rng: np.random.Generator | None = None) -> list[Any]:
    """All time steps of an episode, holding home or with random actions."""
    steps = [environment.reset()]
    hold = environment.task.walker.action_for()
    while not steps[-1].last():
        steps.append(environment.step(hold if rng is None else rng.uniform(-1, 1, hold.shape)))
    return steps


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("recompile", [True, False])
def test_it_stands_and_says_what_its_robot_sees(task: Any, recompile: bool, tmp_path: Path) -> None:
    environment = composer.Environment(
        task(stool(tmp_path)),
        time_limit=1.0,
        random_state=0,
        strip_singleton_obs_buffer_dim=True,
        recompile_mjcf_every_episode=recompile,
    )
    shapes = {name: spec.shape for name, spec in environment.observation_spec().items()}
    expected = {
        "stool/joints_pos": (3,),
        "stool/joints_vel": (3,),
        "stool/world_zaxis": (3,),
        "stool/sensors_gyro": (3,),
        "stool/sensors_accelerometer": (3,),
        "stool/sensors_velocimeter": (3,),
        "stool/prev_action": (3,),
    }
    if task is TrackVelocity:
        expected["command"] = (3,)
    assert shapes == expected
    for _ in range(3):
        steps = episode(environment)
        assert len(steps) == 51
        assert environment.task.fallen == ()
        assert steps[-1].discount == 1.0
        for step in steps[1:]:
            assert 0 <= step.reward <= 1
            assert step.observation.keys() == expected.keys()
    last = steps[-1].observation
    np.testing.assert_allclose(last["stool/joints_pos"], [0.2] * 3, atol=0.1)
    np.testing.assert_allclose(last["stool/world_zaxis"], [0, 0, 1], atol=0.05)
    np.testing.assert_allclose(
        last["stool/prev_action"], environment.task.walker.action_for(), atol=1e-12
    )


def test_terms_of_standing_follow_their_equations(tmp_path: Path) -> None:
    environment = make(Stand, tmp_path)
    environment.reset()
    timestep = environment.step([0.4, 0.1, -0.2])
    task, physics = environment.task, environment.physics
    terms = task.reward_terms(physics)
    trunk = physics.bind(task.walker.root_body)
    home = task._trunk.home_height
    error = physics.bind(task.walker.observable_joints).qpos - 0.2
    effort = task.walker.actuator_group.applied_effort
    assert terms == {
        "upright": pytest.approx((1 + trunk.xmat[8]) / 2, abs=1e-6),
        "height": pytest.approx(closeness(trunk.xpos[2] - home, home / 4)),
        "pose": pytest.approx(closeness(error, 0.5)),
        "effort": pytest.approx(low_effort(effort, [20.0] * 3)),
    }
    weights = task.weights
    mean = sum(weights[name] * value for name, value in terms.items()) / sum(weights.values())
    assert timestep.reward == pytest.approx(mean)


@pytest.mark.parametrize("task", TASKS)
def test_weights(task: Any, tmp_path: Path) -> None:
    names = make(task, tmp_path).task.weights
    only = dict.fromkeys(names, 0.0) | {"upright": 2.0}
    environment = make(task, tmp_path, weights=only)
    environment.reset()
    timestep = environment.step(np.zeros(3))
    assert timestep.reward == environment.task.reward_terms(environment.physics)["upright"]


@pytest.mark.parametrize("task", TASKS)
def test_rewards_are_bounded_whatever_the_action(task: Any, tmp_path: Path) -> None:
    environment = make(task, tmp_path)
    rng = np.random.default_rng(0)
    for _ in range(5):
        for step in episode(environment, rng)[1:]:
            assert 0 <= step.reward <= 1
        terms = environment.task.reward_terms(environment.physics)
        assert all(0 <= value <= 1 for value in terms.values())


@pytest.mark.parametrize("task", TASKS)
def test_no_state_survives_a_reset(task: Any, tmp_path: Path) -> None:
    late = DelayedActuatorCfg(
        base_cfg=PD, delay_target="position", delay_min_lag=1, delay_max_lag=5
    )

    def after(before: int) -> list[Any]:
        environment = make(task, tmp_path, walker=stool(tmp_path, late), randomizations=(WEAKER,))
        for _ in range(before):
            environment.reset()
            for _ in range(7):
                environment.step([1.0, -1.0, 0.5])
        environment.random_state.seed(3)
        steps = [environment.reset()]
        # Two resets in a row are one.
        environment.random_state.seed(3)
        steps += [environment.reset()]
        steps += [environment.step([0.3, 0.2, 0.1]) for _ in range(10)]
        return steps

    for one, other in zip(after(0), after(3), strict=True):
        assert one.reward == other.reward
        for name, value in one.observation.items():
            np.testing.assert_array_equal(value, other.observation[name], err_msg=name)


@pytest.mark.parametrize("task", TASKS)
def test_seeds_are_reproducible_and_differ(task: Any, tmp_path: Path) -> None:
    def final(seed: int) -> np.ndarray:
        environment = make(task, tmp_path, seed=seed, randomizations=(WEAKER,))
        episode(environment)
        return np.array(environment.physics.state())

    np.testing.assert_array_equal(final(0), final(0))
    assert not np.array_equal(final(0), final(1))


def test_randomizations_of_task_and_walker(tmp_path: Path) -> None:
    softer = Randomization(parameter="stiffness", range=(0.5, 0.9))
    walker = stool(tmp_path, randomizations=(WEAKER,))
    environment = make(Stand, tmp_path, walker=walker, randomizations=(softer,))
    drawn = []
    for _ in range(3):
        environment.reset()
        actuator = walker.actuator_group.actuators[0]
        drawn.append([actuator.get("stiffness"), actuator.get("strength")])
    drawn_array = np.array(drawn)
    assert ((drawn_array[:, 0] >= 30.0) & (drawn_array[:, 0] <= 54.0)).all()
    assert ((drawn_array[:, 1] >= 0.6) & (drawn_array[:, 1] <= 1.0)).all()
    assert len(np.unique(drawn_array[:, 0])) == len(np.unique(drawn_array[:, 1])) == 9


def test_joints_start_within_the_noise_and_their_ranges(tmp_path: Path) -> None:
    environment = make(Stand, tmp_path, joint_noise=0.5)
    starts = np.array([environment.reset().observation["stool/joints_pos"] for _ in range(40)])
    assert (np.abs(starts - 0.2) <= 0.5).all()
    assert np.ptp(starts, axis=0).min() > 0.7
    still = make(Stand, tmp_path, joint_noise=0.0)
    np.testing.assert_array_equal(still.reset().observation["stool/joints_pos"], [0.2] * 3)
    wide = make(Stand, tmp_path, joint_noise=3.0)
    starts = np.array([wide.reset().observation["stool/joints_pos"] for _ in range(20)])
    assert starts.min() == -0.6
    assert starts.max() == 0.9


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.0, np.nan, 0.0], "the action is nan for 'left': check the policy"),
        ([0.0, 0.0, np.inf], "the action is inf for 'right'"),
        ([0.0, 0.0], r"the action has shape \(2,\), the walker takes \(3,\)"),
    ],
)
def test_bad_actions_are_refused(task: Any, action: Any, message: str, tmp_path: Path) -> None:
    environment = make(task, tmp_path)
    environment.reset()
    with pytest.raises(ValueError, match=message):
        environment.step(action)


@pytest.mark.parametrize("task", TASKS)
def test_actions_out_of_range_are_clipped(task: Any, tmp_path: Path) -> None:
    states = []
    for action in ([1.0, -1.0, 0.2], [9.0, -1.5, 0.2]):
        environment = make(task, tmp_path)
        environment.reset()
        rewards = [environment.step(action).reward for _ in range(5)]
        states.append([*environment.physics.state(), *rewards])
    np.testing.assert_array_equal(*states)


def test_the_action_is_the_walker_s_own(tmp_path: Path) -> None:
    hop = JointPositionAction(joint_names_expr=("front",), scale=0.1)
    environment = make(Stand, tmp_path, walker=stool(tmp_path, action=hop))
    spec = environment.action_spec()
    assert (spec.name, spec.shape) == ("front", (1,))
    environment.reset()
    environment.step([1.0])
    command = environment.task.walker.command
    np.testing.assert_allclose(command.position_target, [0.3, 0.2, 0.2])


def test_timesteps(tmp_path: Path) -> None:
    environment = make(Stand, tmp_path)
    assert environment.physics.timestep() == 0.002  # the file's
    assert environment.control_timestep() == 0.02
    other = make(Stand, tmp_path, physics_timestep=0.001, control_timestep=0.005)
    assert other.physics.timestep() == 0.001
    assert other.task.physics_steps_per_control_step == 5
    with pytest.raises(ValueError, match="integer multiple"):
        Stand(stool(tmp_path), control_timestep=0.003)


def test_walkers_of_others() -> None:
    pd = replace(PD, stiffness=80.0, effort_limit=60.0)
    walker = with_actuators(ant.Ant(), pd)
    environment = composer.Environment(Stand(walker), time_limit=0.2, random_state=0)
    steps = episode(environment)
    assert all(0 <= step.reward <= 1 for step in steps[1:])
    assert "contact" not in environment.task.fallen


def test_what_cannot_stand_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="walker is a Ant, which has no actuators of ours: use"):
        Stand(ant.Ant())
    with pytest.raises(ValueError, match="the walker 'pendulum' has a fixed base"):
        Stand(pendulum(tmp_path, PD))
    with pytest.raises(ValueError, match=r"joint_noise is -1\.0 rad; it should be at least 0"):
        Stand(stool(tmp_path), joint_noise=-1.0)
