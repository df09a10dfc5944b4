"""Play between a motor and its link, as a model says it: two joints of one body on one axis.

The first is the motor's, as seen through its gear; the second, which nothing drives and which a
range or a spring holds together, is how far the link is away from it:

    <body name="shank">
      <joint name="knee" axis="0 1 0" armature="0.01"/>
      <joint name="knee_play" axis="0 1 0" limited="true" range="-0.01 0.01"/>

    joint = play_joint(model, knee)       # the id of knee_play, or None

The rotor's inertia is the armature of the first, without which the two cannot be told apart.
"""

from __future__ import annotations

import mujoco
import numpy as np

_TOLERANCE = 1e-6
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_ON_JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


def play_joint(model: mujoco.MjModel, joint: int) -> int | None:
    """The joint between a motor and its link.

    Args:
        model: the compiled model.
        joint: id of the motor's joint.

    Returns:
        The id of the joint after it, where that is a joint of the same body on the same axis which
        has a range or a spring and no actuator; else None.
    """
    other = joint + 1
    if (
        other >= model.njnt
        or model.jnt_bodyid[other] != model.jnt_bodyid[joint]
        or model.jnt_type[joint] not in _SCALAR
        or model.jnt_type[other] != model.jnt_type[joint]
        or not (model.jnt_limited[other] or model.jnt_stiffness[other] > 0)
    ):
        return None
    hinge = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
    same_axis = np.allclose(model.jnt_axis[joint], model.jnt_axis[other], atol=_TOLERANCE)
    same_place = np.allclose(model.jnt_pos[joint], model.jnt_pos[other], atol=_TOLERANCE)
    driven = np.isin(model.actuator_trntype, _ON_JOINTS) & (model.actuator_trnid[:, 0] == other)
    return other if same_axis and (same_place or not hinge) and not driven.any() else None
