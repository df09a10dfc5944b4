"""The range of a joint as an actuator sees it: with defaults, units and gear resolved.

    low, high = joint_range(knee, {"joint": knee, "gear": [2]})  # twice the knee's range [rad]

PyMJCF resolves neither default classes nor `compiler angle`, so MuJoCo's own parser reads the model
with a trial actuator in it. The model need not compile yet: bodies may still lack a mass, and
meshes are not opened. The trial actuator is taken out again whatever happens.

A model that states no `compiler angle` is in degrees by itself and in radians inside a composer
arena, which states them; dm_control's CMU humanoid is written so. Where the range of such a model
could be either, it is refused rather than guessed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import mujoco

if TYPE_CHECKING:
    from dm_control import mjcf

_TURN = 2 * math.pi  # a range beyond a full turn is hardly meant in radians
_SCALAR_JOINTS = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def joint_range(target: mjcf.Element, attributes: Mapping[str, Any]) -> tuple[float, float]:
    """The range of `target` in units of an actuator's length.

    Args:
        target: PyMJCF joint, tendon or site that the actuator drives.
        attributes: those of its `<general>` element, with the reference to `target`.

    Returns:
        Two rising numbers [rad, or m, times `gear`].

    Raises:
        TypeError: `target` is not a joint.
        ValueError: it is a joint without a range; its range could be degrees or radians;
            the actuator's gear is zero; an attribute has a value that PyMJCF refuses.
    """
    if "joint" not in attributes:
        raise TypeError(
            f'`qposrange="joint"` needs a joint as `target`, got {target}: give two numbers'
        )
    spec, gear = _parse(target, attributes)
    joint = spec.joint(target.full_identifier)
    name = repr(target.full_identifier)
    if joint.type not in _SCALAR_JOINTS:
        raise ValueError(
            f'`qposrange="joint"` needs a hinge or slide joint, and {name} turns freely: '
            "give two numbers"
        )
    low, high = (float(bound) for bound in joint.range)
    if not low < high:
        raise ValueError(
            f'`qposrange="joint"`: joint {name} has no range: give it one, itself or in its '
            'default class, e.g. range="-1 1", or give `qposrange` two numbers'
        )
    automatic = joint.limited == mujoco.mjtLimited.mjLIMITED_AUTO and spec.compiler.autolimits
    if not (joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE or automatic):
        raise ValueError(
            f'`qposrange="joint"`: the range ({low:g}, {high:g}) of joint {name} is switched off: '
            'set limited="true", or give `qposrange` two numbers'
        )
    if gear == 0:
        raise ValueError(
            f'`qposrange="joint"`: the actuator of joint {name} has gear 0, so that its length is '
            "always zero: give it another gear"
        )
    if joint.type == mujoco.mjtJoint.mjJNT_HINGE and spec.compiler.degree:
        unstated = target.root.root_model.compiler.angle is None
        if unstated and max(abs(low), abs(high)) <= _TURN:
            raise ValueError(
                f'`qposrange="joint"`: the range ({low:g}, {high:g}) of joint {name} could be '
                "degrees or radians, for the model states neither: set root.compiler.angle to "
                '"radian" or "degree"'
            )
        low, high = math.radians(low), math.radians(high)
    return (gear * low, gear * high) if gear > 0 else (gear * high, gear * low)


def _parse(target: mjcf.Element, attributes: Mapping[str, Any]) -> tuple[mujoco.MjSpec, float]:
    """The model as MuJoCo reads it, and the gear of a trial actuator in it."""
    trial = target.root.actuator.add("general", **attributes)
    try:
        # The outermost model, whose compiler options apply to every model attached to it.
        spec = mujoco.MjSpec.from_string(target.root.root_model.to_xml_string())
        return spec, float(spec.actuator(trial.full_identifier).gear[0])
    finally:
        trial.remove()
