"""What a robot carries and touches along its measured motion, as its model has it.

    statics = Statics(robot, recording)
    statics.load("knee", time)       # (n,) N·m that hold it still there
    statics.touching("knee", time)   # (n,) whether what it moves is in contact

Positions that were not measured are those of the model at rest.
"""

from __future__ import annotations

import copy

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import QUATERNION, Recording
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]

_INSTANTS = 1500
_NEAR = 0.002  # m; what is measured to be this near touches
_BASE = (*(f"base/position_{axis}" for axis in "xyz"), *QUATERNION)


class Statics:
    """Gravity's effort and contacts at instants of one recording.

    Args:
        robot: the robot.
        recording: its log.
    """

    def __init__(self, robot: Robot, recording: Recording):
        kept = np.unique(np.linspace(0, len(recording.time) - 1, _INSTANTS).astype(np.intp))
        self._time = recording.time[kept]
        self._joints = robot.joints
        model = copy.copy(robot.model)
        model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_OVERRIDE
        model.opt.o_margin = _NEAR
        data = rest(model)
        poses = np.tile(data.qpos, (len(kept), 1))
        for name in recording.joints:
            if name in robot.joints:
                poses[:, robot.joints[name].qpos] = recording.columns[f"{name}/position"][kept]
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        if free.size and all(column in recording.columns for column in _BASE):
            first = int(model.jnt_qposadr[free[0]])
            pose = [recording.columns[column][kept] for column in _BASE]
            poses[:, first : first + len(_BASE)] = np.stack(pose, axis=1)
        self._load = np.empty((len(kept), model.nv))
        self._touches = np.zeros((len(kept), model.nv), dtype=bool)
        moved_by = _moved_by(model)
        for k, pose in enumerate(poses):
            data.qpos[:] = pose
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_rne(model, data, 0, self._load[k])
            for geoms in data.contact.geom[: data.ncon]:
                for body in model.geom_bodyid[geoms]:
                    self._touches[k] |= moved_by[body]

    def load(self, joint: str, time: FloatArray) -> FloatArray:
        """(n,) effort that holds a joint still against gravity at these instants [N·m]."""
        return np.interp(time, self._time, self._load[:, self._joints[joint].dof])

    def touching(self, joint: str, time: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether anything that a joint moves is in contact at these instants."""
        nearest = np.searchsorted(0.5 * (self._time[1:] + self._time[:-1]), time)
        touches: NDArray[np.bool_] = self._touches[nearest, self._joints[joint].dof]
        return touches


def _moved_by(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """(nbody, nv) whether a degree of freedom moves a body."""
    moved = np.zeros((model.nbody, model.nv), dtype=bool)
    for body in range(1, model.nbody):
        moved[body] = moved[model.body_parentid[body]]
        first = int(model.body_dofadr[body])
        moved[body, first : first + int(model.body_dofnum[body])] = True
    return moved
