"""How a walker's root body is held and moves, measured against the pose of the episode's start."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_FORWARD = np.array([1.0, 0.0, 0.0])


class Trunk:
    """Tilt, height and velocity of the root body.

    Args:
        walker: a composer walker that faces along x in its home pose, as dm_control's do.

    Attributes:
        home_height: height of the root body at the start of the episode [m].
    """

    def __init__(self, walker: Any):
        self._walker = walker
        self._body = 0
        self._home = np.eye(3)
        self.home_height = 1.0

    def after_compile(self, physics: Any) -> None:
        """Finds the body in the compiled model."""
        self._body = int(physics.bind(self._walker.root_body).element_id)

    def begin(self, physics: Any) -> None:
        """Takes the present pose for that of the start.

        Args:
            physics: with body poses that are up to date.
        """
        self._home = self._orientation(physics)
        self.home_height = self.height(physics)

    @property
    def home(self) -> FloatArray:
        """Orientation of the body at the start of the episode, a rotation matrix (3, 3)."""
        return self._home

    def cos_tilt(self, physics: Any) -> float:
        """Cosine of the angle between the body's present and its first upward axis."""
        return float(self._orientation(physics)[2] @ self._home[2])

    def height(self, physics: Any) -> float:
        """Height of the body's origin over the world's [m]."""
        return float(physics.data.xpos[self._body, 2])

    def velocity(self, physics: Any) -> FloatArray:
        """Velocity forward and to the left [m/s], and yaw rate [rad/s], (3,).

        In the frame of the heading: level with the ground, x where the body faces.
        """
        spatial = np.empty(6)
        mujoco.mj_objectVelocity(
            physics.model.ptr,
            physics.data.ptr,
            mujoco.mjtObj.mjOBJ_XBODY,
            self._body,
            spatial,
            0,
        )
        facing = self._orientation(physics) @ self._home.T @ _FORWARD
        norm = float(np.hypot(facing[0], facing[1]))
        cos, sin = (facing[:2] / norm) if norm > 0 else (1.0, 0.0)
        yaw_rate, x, y = spatial[2], spatial[3], spatial[4]
        return np.array([cos * x + sin * y, cos * y - sin * x, yaw_rate])

    def _orientation(self, physics: Any) -> FloatArray:
        return np.array(physics.data.xmat[self._body]).reshape(3, 3)
