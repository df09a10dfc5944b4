"""What a policy observes is what the robot's encoders show, when they show it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_control import composer

from tests.gap.policy.balance import PENDULUM, Balance, pendulum
from walkerkit.gap.policy.sensing import SensedWalker
from walkerkit.gap.simulation.robot import Measurement


def swung(path: Path, **measured: float) -> tuple[Any, Any]:
    """The pendulum in an environment, read as is said."""
    walker = SensedWalker.from_file(path)
    walker.reads({"hinge": Measurement(**measured)}, {})
    return composer.Environment(Balance(walker), time_limit=1.0, random_state=3), walker


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return pendulum(tmp_path)


def test_late_readings_are_those_of_before(path: Path) -> None:
    """By a delay that is no whole number of physics steps, from the start on."""
    delay = 0.013
    environment, _ = swung(path, position_delay=delay)
    timestep = environment.reset()
    times, true = [0.0], [float(environment.physics.data.qpos[0])]

    def watch(physics: Any, random_state: Any) -> None:
        times.append(float(physics.time()))
        true.append(float(physics.data.qpos[0]))

    environment.add_extra_hook("after_substep", watch)
    assert np.ravel(timestep.observation["pendulum/joints_pos"])[0] == true[0]
    for _ in range(12):
        timestep = environment.step(np.array([0.05]))
        seen = np.ravel(timestep.observation["pendulum/joints_pos"])[0]
        assert seen == pytest.approx(np.interp(times[-1] - delay, times, true), abs=1e-12)
        if times[-1] > delay:
            assert seen != true[-1]


def test_an_episode_forgets_the_last_one(path: Path) -> None:
    environment, _ = swung(path, position_delay=0.05)
    environment.reset()
    for _ in range(10):
        environment.step(np.array([1.0]))
    timestep = environment.reset()
    assert np.ravel(timestep.observation["pendulum/joints_pos"])[0] == float(
        environment.physics.data.qpos[0]
    )


def test_an_encoder_has_a_gain_and_waves(path: Path) -> None:
    environment, _ = swung(
        path, encoder_gain=1.1, error_amplitude=0.02, error_periods=30.0, error_phase=0.4
    )
    timestep = environment.reset()
    for _ in range(5):
        timestep = environment.step(np.array([0.5]))
    q, qd = float(environment.physics.data.qpos[0]), float(environment.physics.data.qvel[0])
    seen = timestep.observation
    assert np.ravel(seen["pendulum/joints_pos"])[0] == pytest.approx(
        1.1 * q + 0.02 * np.sin(30 * q + 0.4)
    )
    assert np.ravel(seen["pendulum/joints_vel"])[0] == pytest.approx(
        (1.1 + 0.02 * 30 * np.cos(30 * q + 0.4)) * qd
    )


def test_drives_report_their_effort_as_in_the_log(path: Path) -> None:
    environment, walker = swung(path, effort_scale=1.2, effort_offset=0.3)
    walker.observables.applied_effort.enabled = True
    environment.reset()
    timestep = environment.step(np.array([0.25]))
    seen = np.ravel(timestep.observation["pendulum/applied_effort"])[0]
    assert seen == pytest.approx(1.2 * walker.actuator_group.applied_effort[0] + 0.3)
    assert walker.actuator_group.applied_effort[0] == pytest.approx(5.0)


def test_an_encoder_on_the_link_sees_the_play(tmp_path: Path) -> None:
    behind = '<body name="link"><joint name="hinge_play" axis="0 1 0" range="-0.1 0.1"'
    behind += ' limited="true"/><geom size="0.05" pos="0 0 0.5" mass="0.2" contype="0"/></body>'
    text = PENDULUM.replace("</body>", f"{behind}</body>", 1)
    walker = SensedWalker.from_file(pendulum(tmp_path, text), joints=["hinge"])
    walker.reads({"hinge": Measurement(load_side=1.0)}, {"hinge": "hinge_play"})
    environment = composer.Environment(Balance(walker), time_limit=1.0, random_state=0)
    environment.reset()
    timestep = environment.step(np.array([0.5]))
    q = environment.physics.data.qpos
    assert abs(q[1]) > 1e-3
    seen = np.ravel(timestep.observation["pendulum/joints_pos"])
    assert seen == pytest.approx([q[0] + q[1]])


def test_without_anything_between_it_is_the_plain_walker(path: Path) -> None:
    from walkerkit.walkers import MjcfWalker

    ours, _ = swung(path)
    plain = composer.Environment(Balance(MjcfWalker.from_file(path)), time_limit=1.0)
    plain.random_state.seed(3)
    ours.random_state.seed(3)
    for environment in (ours, plain):
        environment.reset()
    for _ in range(20):
        one, other = (e.step(np.array([0.3])) for e in (ours, plain))
        for name, value in other.observation.items():
            np.testing.assert_array_equal(one.observation[name], value)
