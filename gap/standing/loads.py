"""What the joints of a robot on its feet have to make along a path, and the targets that make it.

    efforts = asked(stand, poses, step, carries)        # (T, n_joints) N·m
    targets = held(stand, poses, step, carries)         # (T, n_joints) rad

Inverse dynamics: M q̈ + c − passive forces = S τ + Jᵀ f, with the forces f of the ground that are
least where a sole may carry, and those of closed loops. A servo that makes τ = kp (u − q) − kd q̇ is
sent u = q + (τ + kd q̇) / kp; otherwise soft servos would sag as weight moves from leg to leg, and
no foot that is to be lifted would leave the ground.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from walkerkit.gap.standing.standing_pose import Stand
from walkerkit.gap.standing.variants import gain

FloatArray = NDArray[np.float64]

_SMOOTHED = 0.05  # s, of what holds the robot: feet that land take their load at once


def asked(stand: Stand, poses: FloatArray, step: float, carries: FloatArray) -> FloatArray:
    """Efforts of the joints that are sent positions.

    Args:
        stand: the robot as it stands.
        poses: (T, nq).
        step: from one to the next [s].
        carries: (T, n_soles) how much of the load soles may take, in [0, 1], against each other.

    Returns:
        (T, n_joints) N·m (N).
    """
    model, data = stand.robot.model, mujoco.MjData(stand.robot.model)
    speeds = _speeds(model, poses, step)
    slopes = np.gradient(speeds, step, axis=0)
    driven = [joint.dof for joint in stand.joints]
    led = np.setdiff1d(np.arange(model.nv), driven)
    loops, moved = stand.robot.loops, np.empty(model.nv)
    efforts = np.empty((len(poses), len(driven)))
    for t in range(len(poses)):
        data.qpos[:], data.qvel[:] = poses[t], speeds[t]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_mulM(model, data, moved, slopes[t])
        needed = moved + data.qfrc_bias - data.qfrc_passive
        rows = []
        for sole, share in zip(stand.soles, carries[t], strict=True):
            for point in sole.where(data):
                jacobian = np.zeros((3, model.nv))
                mujoco.mj_jac(model, data, jacobian, None, point, sole.body)
                rows.append(share * jacobian)
        if loops.any:
            rows.append(loops.residual(poses[t])[1])
        pushes = np.concatenate(rows)
        forces = np.linalg.lstsq(pushes[:, led].T, needed[led], rcond=1e-6)[0]
        efforts[t] = needed[driven] - pushes[:, driven].T @ forces
    return efforts


def held(stand: Stand, poses: FloatArray, step: float, carries: FloatArray) -> FloatArray:
    """Targets that take the joints along poses, as `asked` has them: (T, n_joints) rad (m)."""
    efforts = asked(stand, poses, step, carries)
    speeds = _speeds(stand.robot.model, poses, step)[:, [joint.dof for joint in stand.joints]]
    stiffness, damping = (
        np.array([gain(stand.robot, joint, size) for joint in stand.joints])
        for size in ("stiffness", "damping")
    )
    # What holds it at first is known; forces that soles make against each other are in that.
    more = (efforts - efforts[0] + damping * speeds) / stiffness
    more = uniform_filter1d(more, max(1, round(_SMOOTHED / step)), axis=0, mode="nearest")
    at = [joint.qpos for joint in stand.joints]
    targets: FloatArray = stand.targets + poses[:, at] - stand.qpos[at] + more
    return targets


def _speeds(model: mujoco.MjModel, poses: FloatArray, step: float) -> FloatArray:
    """(T, nv) by differences from the pose before to the one after."""
    speeds = np.zeros((len(poses), model.nv))
    for t in range(1, len(poses) - 1):
        mujoco.mj_differentiatePos(model, speeds[t], 2 * step, poses[t - 1], poses[t + 1])
    return speeds
