"""The base of a robot that floats."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

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
