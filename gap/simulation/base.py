"""The base of a robot that floats."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError

_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True, kw_only=True)
class Base:
    """A body with a free joint, and with the robot's joints on it.

    Attributes:
        body: its name, or that of its joint, or `base`.
        id: body id.
        qpos, dof: addresses of its 7 numbers in qpos and its 6 in qvel.
    """

    body: str
    id: int
    qpos: int
    dof: int


def imu_mounting(
    model: mujoco.MjModel, body: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where an inertial unit is on a base: at the site `imu`, else at the base's origin.

    Args:
        model: the model.
        body: id of the base, or of what the base is welded to.

    Returns:
        Its place in the base's frame, (3,) m, and the rotation from its frame to that, (3, 3).
    """
    for site in range(model.nsite):
        name = model.site(site).name.rpartition("/")[2]
        if name == "imu" and model.body_weldid[model.site_bodyid[site]] == body:
            data = mujoco.MjData(model)
            mujoco.mj_kinematics(model, data)
            turned = data.xmat[body].reshape(3, 3).T
            place = turned @ (data.site_xpos[site] - data.xpos[body])
            return place, turned @ data.site_xmat[site].reshape(3, 3)
    return np.zeros(3), np.eye(3)


def find_base(model: mujoco.MjModel, source: str) -> Base | None:
    """The base of a model, None where no robot floats in it.

    What floats without joints of its own is no robot: it lies about as in the first keyframe.

    Args:
        model: the model.
        source: names it in messages.

    Raises:
        InputError: several robots float.
    """
    scalar = np.isin(model.jnt_type, _SCALAR)
    jointed = {int(root) for root in model.body_rootid[model.jnt_bodyid[scalar]]}
    found = []
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        body = int(model.jnt_bodyid[joint])
        if body in jointed:
            found.append(
                Base(
                    body=model.body(body).name or model.joint(joint).name or "base",
                    id=body,
                    qpos=int(model.jnt_qposadr[joint]),
                    dof=int(model.jnt_dofadr[joint]),
                )
            )
    if len(found) > 1:
        names = ", ".join(repr(base.body) for base in found)
        raise InputError(
            f"{source}: {len(found)} robots float, {names}, and a log has one base. Give a model "
            "of one robot."
        )
    return found[0] if found else None
