from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf

from tests.tasks.stools import stool
from walkerkit.tasks import FallLimits, Stand


@pytest.fixture
def environment(tmp_path: Path) -> composer.Environment:
    made = composer.Environment(Stand(stool(tmp_path), joint_noise=0.0), random_state=0)
    made.reset()
    return made


def pose(environment: composer.Environment, height: float, quaternion: Any) -> Any:
    """Moves the seat, and returns the physics with everything that follows from it."""
    physics = environment.physics
    walker = environment.task.walker
    walker.set_pose(physics, position=[0.0, 0.0, height], quaternion=quaternion)
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    return physics


def about(axis: tuple[float, float, float], angle: float) -> np.ndarray:
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * np.array(axis))])


def test_it_starts_with_its_feet_on_the_ground(environment: composer.Environment) -> None:
    task, physics = environment.task, environment.physics
    feet = physics.bind(task.walker.ground_contact_geoms)
    lowest = [
        mujoco.mj_geomDistance(
            physics.model.ptr,
            physics.data.ptr,
            int(foot),
            int(physics.bind(task.root_entity.ground_geoms[0]).element_id),
            1.0,
            None,
        )
        for foot in feet.element_id
    ]
    assert min(lowest) == pytest.approx(0.0, abs=1e-9)
    assert physics.bind(task.walker.root_body).xpos[2] != pytest.approx(0.5, abs=0.05)


def test_standing_is_no_fall(environment: composer.Environment) -> None:
    for _ in range(50):
        timestep = environment.step(environment.task.walker.action_for())
    assert environment.task.fallen == ()
    assert not timestep.last()
    assert timestep.discount == 1.0


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)])
def test_tilt_counts_from_its_limit(
    environment: composer.Environment, axis: tuple[float, float, float]
) -> None:
    falls = environment.task._falls
    assert falls.reasons(pose(environment, 1.0, about(axis, 0.99))) == []
    assert falls.reasons(pose(environment, 1.0, about(axis, 1.01))) == ["tilt"]


def test_turning_about_the_vertical_is_no_fall(environment: composer.Environment) -> None:
    physics = pose(environment, 1.0, about((0.0, 0.0, 1.0), 2.5))
    assert environment.task._falls.reasons(physics) == []


def test_height_counts_as_a_share_of_that_at_home(environment: composer.Environment) -> None:
    home = environment.task._trunk.home_height
    falls = environment.task._falls
    upside = np.array([1.0, 0, 0, 0])
    assert "height" not in falls.reasons(pose(environment, 0.51 * home, upside))
    assert "height" in falls.reasons(pose(environment, 0.49 * home, upside))


def test_contact_of_the_seat_with_the_ground(environment: composer.Environment) -> None:
    physics = pose(environment, 0.029, np.array([1.0, 0, 0, 0]))
    assert environment.task._ground.touched(physics)
    assert "contact" in environment.task._falls.reasons(physics)


def test_legs_may_touch_the_ground_also_above_a_foot_that_is_fixed_to_them(
    environment: composer.Environment,
) -> None:
    physics = pose(environment, 0.25, np.array([1.0, 0, 0, 0]))
    touching = {physics.model.id2name(i, "geom") for i in physics.data.contact.geom.flat}
    assert {"stool/front", "stool/toe", "stool/left", "stool/right"} < touching
    assert not environment.task._ground.touched(physics)


def test_a_fall_ends_the_episode_with_discount_zero(tmp_path: Path) -> None:
    environment = composer.Environment(Stand(stool(tmp_path)), random_state=0)
    for _ in range(2):
        environment.reset()
        timestep = environment.step(environment.task.walker.action_for())
        assert not timestep.last()
        pose(environment, 0.3, about((1.0, 0.0, 0.0), 1.5))
        timestep = environment.step(environment.task.walker.action_for())
        assert timestep.last()
        assert timestep.discount == 0.0
        assert "tilt" in environment.task.fallen
        assert 0 <= timestep.reward <= 1
    environment.reset()
    assert environment.task.fallen == ()


def test_limits_can_be_lifted(tmp_path: Path) -> None:
    anything = FallLimits(tilt=math.pi, height=0.0, contact=False)
    environment = composer.Environment(Stand(stool(tmp_path), fall=anything), random_state=0)
    environment.reset()
    pose(environment, 0.1, about((1.0, 0.0, 0.0), 3.0))
    timestep = environment.step(environment.task.walker.action_for())
    assert not timestep.last()


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"tilt": 4.0}, "tilt is 4.0; it should be from 0 to 3.14159"),
        ({"tilt": math.nan}, "tilt is nan"),
        ({"height": 1.5}, "height is 1.5; it should be from 0 to 1"),
    ],
)
def test_impossible_limits(limits: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FallLimits(**limits)


class TestTrunk:
    def test_velocity_is_that_of_the_heading(self, environment: composer.Environment) -> None:
        physics = pose(environment, 1.0, about((0.0, 0.0, 1.0), math.pi / 2))
        free = mjcf.get_frame_freejoint(environment.task.walker.mjcf_model)
        # Facing +y and moving to +y and +x: forward and to the right.
        physics.bind(free).qvel = [0.3, 0.7, 0.1, 0.0, 0.0, 0.4]
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
        np.testing.assert_allclose(
            environment.task._trunk.velocity(physics), [0.7, -0.3, 0.4], atol=1e-12
        )

    def test_velocity_is_level_with_the_ground(self, environment: composer.Environment) -> None:
        physics = pose(environment, 1.0, about((0.0, 1.0, 0.0), 0.6))
        free = mjcf.get_frame_freejoint(environment.task.walker.mjcf_model)
        physics.bind(free).qvel = [0.5, 0.0, -2.0, 0.0, 0.0, 0.0]
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
        np.testing.assert_allclose(
            environment.task._trunk.velocity(physics), [0.5, 0.0, 0.0], atol=1e-12
        )

    def test_it_counts_from_home(self, environment: composer.Environment) -> None:
        physics = pose(environment, 0.7, about((1.0, 0.0, 0.0), 0.5))
        trunk = environment.task._trunk
        assert trunk.cos_tilt(physics) == pytest.approx(math.cos(0.5))
        assert trunk.height(physics) == pytest.approx(0.7)
