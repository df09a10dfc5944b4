from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf

from tests.tasks.stools import stool
from walkerkit.tasks import TrackVelocity


def make(folder: Path, **options: object) -> composer.Environment:
    task = TrackVelocity(stool(folder), **options)  # type: ignore[arg-type]
    return composer.Environment(
        task, time_limit=1.0, random_state=0, strip_singleton_obs_buffer_dim=True
    )


def test_commands_are_drawn_for_each_episode_and_hold(tmp_path: Path) -> None:
    environment = make(tmp_path, forward=(0.5, 1.5), left=(-0.2, 0.0), yaw_rate=(0.0, 0.3))
    drawn = []
    for _ in range(30):
        first = environment.reset().observation["command"]
        drawn.append(first)
        np.testing.assert_array_equal(first, environment.task.command)
        later = environment.step(np.zeros(3)).observation["command"]
        np.testing.assert_array_equal(later, first)
    low, high = np.min(drawn, axis=0), np.max(drawn, axis=0)
    assert (low >= [0.5, -0.2, 0.0]).all()
    assert (high <= [1.5, 0.0, 0.3]).all()
    assert (high - low > 0.5 * np.array([1.0, 0.2, 0.3])).all()


def test_terms_follow_their_equations(tmp_path: Path) -> None:
    environment = make(tmp_path, forward=(0.6, 0.6), left=(0.1, 0.1), yaw_rate=(0.2, 0.2))
    environment.reset()
    environment.step([0.2, 0.2, 0.2])
    environment.step([0.6, 0.2, 0.2])
    task, physics = environment.task, environment.physics
    free = mjcf.get_frame_freejoint(task.walker.mjcf_model)
    physics.bind(free).qpos[3:] = [math.cos(0.4), 0, 0, math.sin(0.4)]
    forward = np.array([math.cos(0.8), math.sin(0.8)])
    left = np.array([-forward[1], forward[0]])
    physics.bind(free).qvel = [*(0.9 * forward + 0.5 * left), 0.0, 0.0, 0.0, 0.7]
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    terms = task.reward_terms(physics)
    assert terms["velocity"] == pytest.approx(math.exp(-(0.3**2 + 0.4**2) / 0.25))
    assert terms["yaw_rate"] == pytest.approx(math.exp(-1.0))
    assert terms["upright"] == pytest.approx(1.0)
    assert terms["smoothness"] == pytest.approx(1 - 0.2**2 / 3)


def test_the_command_that_is_read_is_a_copy(tmp_path: Path) -> None:
    environment = make(tmp_path)
    environment.reset()
    environment.task.command[:] = 9.0
    assert (environment.task.command < 2.0).all()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"forward": (1.0, 0.0)}, ValueError, r"forward should not fall .* got \(1\.0, 0\.0\)"),
        ({"yaw_rate": (0.0, math.nan)}, ValueError, r"`yaw_rate\[1\]` should be finite, got nan"),
        ({"left": 0.3}, TypeError, r"left should be two numbers \(low, high\), got 0\.3"),
    ],
)
def test_unusable_ranges(
    options: dict[str, object], error: type[Exception], message: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=message):
        make(tmp_path, **options)
