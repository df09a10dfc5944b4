"""What an ideal inertial unit and foot switches of a simulated robot read.

    unit = Unit(model, free)                        # id of the free joint of the robot's base
    columns = unit.columns(qpos, qvel, changes)     # base/imu_…, <foot>/contact

The unit is at the site `imu` of the base, or at its origin. It reads without noise or bias what the
base does in the physics step that begins at the row: its acceleration is the change of its velocity
over that step. A foot has contact where it touches the ground at the row.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from walkerkit.gap.recordings.imu import ACCELERATION, GYRO
from walkerkit.gap.simulation.base import Base, imu_mounting
from walkerkit.gap.simulation.feet import find_feet

FloatArray = NDArray[np.float64]


class Unit:
    """An inertial unit on a base, and switches under its feet.

    Args:
        model: the simulation.
        free: id of the base's joint.
    """

    def __init__(self, model: mujoco.MjModel, free: int):
        self._model = model
        self._base = Base(
            body="base",
            id=int(model.jnt_bodyid[free]),
            qpos=int(model.jnt_qposadr[free]),
            dof=int(model.jnt_dofadr[free]),
        )
        self._place, self._mounted = imu_mounting(model, self._base.id)
        self._feet = find_feet(model, self._base)

    def columns(
        self, qpos: FloatArray, qvel: FloatArray, changes: FloatArray
    ) -> dict[str, FloatArray]:
        """Readings at (T, nq) positions, (T, nv) velocities and accelerations: column to (T,)."""
        base = self._base
        turned = Rotation.from_quat(np.roll(qpos[:, base.qpos + 3 : base.qpos + 7], -1, axis=1))
        linear, angular = slice(base.dof, base.dof + 3), slice(base.dof + 3, base.dof + 6)
        spin, spun_up = qvel[:, angular], changes[:, angular]
        pushed = turned.inv().apply(changes[:, linear] - self._model.opt.gravity)
        pushed += np.cross(spun_up, self._place) + np.cross(spin, np.cross(spin, self._place))
        found = dict(zip(GYRO, (spin @ self._mounted).T, strict=True))
        found |= zip(ACCELERATION, (pushed @ self._mounted).T, strict=True)
        return found | self._contacts(qpos)

    def _contacts(self, qpos: FloatArray) -> dict[str, FloatArray]:
        model, data = self._model, mujoco.MjData(self._model)
        fixed = model.body_weldid[model.geom_bodyid] == 0
        touches = np.zeros((len(self._feet), len(qpos)))
        for row, one in enumerate(qpos):
            data.qpos[:] = one
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_collision(model, data)
            pairs = data.contact.geom[data.contact.dist <= 0]
            on_ground = {int(g) for g in pairs[fixed[pairs].any(axis=1)].ravel()}
            touches[:, row] = [not on_ground.isdisjoint(foot.reach) for foot in self._feet]
        names = (foot.name.rpartition("/")[2] for foot in self._feet)
        return {f"{name}/contact": row for name, row in zip(names, touches, strict=True)}
