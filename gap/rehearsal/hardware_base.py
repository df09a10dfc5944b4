"""The rehearsal robot's base: what a motion capture system and an inertial unit log of it.

    free = free_joint(model)                       # None where the robot is mounted
    columns = base_readings(states, rng)           # base/position_x and so on

Position and linear velocity are in the world's frame, the quaternion turns from the base's frame to
the world's, the angular velocity is in the base's: as a free joint has them.
"""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BASE_NOISE: Final = {
    "position": 3e-4,  # m
    "orientation": 1e-3,  # rad
    "linear_velocity": 0.01,  # m/s
    "angular_velocity": 0.01,  # rad/s
}
"""Standard deviations of what is logged of the base."""

WIDTH: Final = 13
"""Numbers of a base's state: position, quaternion, linear and angular velocity."""


def free_joint(model: mujoco.MjModel) -> tuple[int, int] | None:
    """Addresses of the base in qpos and in qvel, or None for a robot that does not float."""
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if not free.size:
        return None
    return int(model.jnt_qposadr[free[0]]), int(model.jnt_dofadr[free[0]])


def home(model: mujoco.MjModel) -> Array:
    """The keyframe `home` where there is one, for what no target says; shape (nq,)."""
    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, "home")
    found: Array = model.qpos0 if key < 0 else model.key_qpos[key]
    return found


def base_readings(
    states: Array, rng: np.random.Generator, *, exact: bool = False
) -> dict[str, Array]:
    """Columns of a log.

    Args:
        states: without noise, shape (T, 13).
        rng: source of the noise.
        exact: there is none.

    Returns:
        Column to readings, shape (T,).
    """
    position, quaternion, linear, angular = np.split(states, (3, 7, 10), axis=1)
    noise = {
        name: (0.0 if exact else std) * rng.standard_normal((len(states), 3))
        for name, std in BASE_NOISE.items()
    }
    quaternion = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    for row, turn in zip(quaternion, noise["orientation"], strict=True):
        mujoco.mju_quatIntegrate(row, turn, 1.0)
    measured = {
        "position": position + noise["position"],
        "linear_velocity": linear + noise["linear_velocity"],
        "angular_velocity": angular + noise["angular_velocity"],
    }
    columns = {
        f"base/{name}_{axis}": values[:, k]
        for name, values in measured.items()
        for k, axis in enumerate("xyz")
    }
    return columns | {f"base/quaternion_{a}": quaternion[:, k] for k, a in enumerate("wxyz")}
