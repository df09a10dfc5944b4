"""The model, and what every walker of ours can do."""

import numpy as np
import pytest
from dm_control import composer, mjcf
from walkerkit import gap
from walkerkit.tasks import TrackJoints

from hopper.bench import steps
from hopper.robot import on_stand


def test_at_home_the_foot_is_below_the_hip() -> None:
    hopper = on_stand()
    physics = mjcf.Physics.from_mjcf_model(hopper.mjcf_model)
    hopper.reinitialize_pose(physics, np.random.RandomState(0))
    physics.forward()
    expected = [0.0, 0.0, 0.7 - 2 * 0.24 * np.cos(0.6)]
    assert physics.bind(hopper.foot).xpos == pytest.approx(expected, abs=1e-9)


def test_follows_its_targets_in_a_task() -> None:
    hopper = on_stand()
    environment = composer.Environment(TrackJoints(hopper, excitation="chirp"), random_state=0)
    environment.reset()
    rewards = [environment.step(np.zeros(2)).reward for _ in range(20)]
    assert hopper.actuator_group.joint_names == ("hip", "knee")
    assert min(rewards) > 0.8


def test_its_model_replays_its_own_log() -> None:
    fitted, held_out = (steps(on_stand(), seed, seconds=0.5) for seed in (0, 1))
    found = gap.replay(gap.load("hopper.robot:on_stand", fitted, held_out=held_out))
    assert found.gap.position.before < 1e-5
