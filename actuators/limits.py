"""How much an actuator can do, whoever says so; the least counts.

A robot file limits an actuator in several places: its force (`forcerange`), its control
(`ctrlrange`, times gain and gear), the joint or tendon behind it (`actuatorfrcrange`), and what the
joint can reach (`range`). A config limits it further. These functions read a compiled model;
`Actuator.reach` and `Actuator.effort_range` put them together for everybody who asks.

Every range is (n, 2), the least and the greatest, infinite where nothing is stated.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drive import read_drive

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def unlimited(n: int) -> FloatArray:
    """Ranges of n things of which nothing is stated."""
    return np.tile([-np.inf, np.inf], (n, 1))


def least(*ranges: FloatArray) -> FloatArray:
    """What all of the ranges have in common.

    Args:
        ranges: (n, 2) each. Where they have nothing in common the first of them counts.
    """
    low = np.max([one[:, 0] for one in ranges], axis=0)
    high = np.min([one[:, 1] for one in ranges], axis=0)
    common = np.stack([low, high], axis=-1)
    return np.where((low < high)[:, None], common, ranges[0])


def mapped(ranges: FloatArray, factor: FloatArray, offset: FloatArray | float = 0.0) -> FloatArray:
    """The ranges of factor · x + offset.

    Args:
        ranges: of x, (n, 2).
        factor: not 0, (n,).
        offset: (n,) or a number.
    """
    ends = ranges * factor[:, None] + np.reshape(offset, (-1, 1))
    return np.sort(ends, axis=-1)


def stated(limited: Any, ranges: Any, ids: Any) -> FloatArray:
    """Ranges of the model as far as they are switched on."""
    has = (limited[ids] != 0)[:, None]
    return np.where(has, ranges[ids], [[-np.inf, np.inf]])


def control_range(model: mujoco.MjModel, actuators: IntArray) -> FloatArray:
    """What controls are held within, in their own units.

    Where a filter lies behind the control, the range of its activation counts as well.

    Args:
        model: the compiled model.
        actuators: their ids; each has one control.
    """
    controls = np.asarray(model.actuator_ctrladr[actuators], dtype=np.intp)
    own = stated(model.actuator_ctrllimited, model.actuator_ctrlrange, controls)
    filtered = np.isin(model.actuator_dyntype[actuators], _FILTERS)[:, None]
    activation = stated(model.actuator_actlimited, model.actuator_actrange, actuators)
    return least(own, np.where(filtered, activation, [[-np.inf, np.inf]]))


def range_behind(model: mujoco.MjModel, actuators: IntArray) -> FloatArray:
    """What the joint or tendon behind actuators lets through of their force, before the gear.

    MuJoCo holds the `actuatorfrcrange` of a joint after the gear and that of a tendon before it.

    Args:
        model: the compiled model.
        actuators: their ids.
    """
    behind = unlimited(len(actuators))
    for i, actuator in enumerate(actuators):
        kind, driven = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
        gear = float(model.actuator_gear[model.actuator_outadr[actuator], 0])
        if kind in _ON_JOINT and model.jnt_actfrclimited[driven] and gear:
            if int(model.jnt_type[driven]) in _SCALAR:
                behind[i] = np.sort(model.jnt_actfrcrange[driven] / gear)
        elif kind == mujoco.mjtTrn.mjTRN_TENDON and model.tendon_actfrclimited[driven]:
            behind[i] = model.tendon_actfrcrange[driven]
    return behind


def force_range(model: mujoco.MjModel, actuators: IntArray) -> FloatArray:
    """What arrives of the force of actuators at most, before the gear [N; N·m].

    Args:
        model: the compiled model.
        actuators: their ids.
    """
    own = stated(model.actuator_forcelimited, model.actuator_forcerange, actuators)
    return least(own, range_behind(model, actuators))


def length_range(model: mujoco.MjModel, transmission: str, ids: IntArray) -> FloatArray:
    """Where joints or tendons can be [rad; m].

    Args:
        model: the compiled model.
        transmission: `joint`, `tendon` or `site`, which has none.
        ids: of the joints or tendons.
    """
    if transmission == "joint":
        return stated(model.jnt_limited, model.jnt_range, ids)
    if transmission == "tendon":
        return stated(model.tendon_limited, model.tendon_range, ids)
    return unlimited(len(ids))


def stated_reach(model: mujoco.MjModel, actuator: int) -> dict[str, FloatArray]:
    """What an actuator of the model can be asked for, {target: (2,)}, as far as that is stated.

    Args:
        model: the compiled model.
        actuator: its id; one whose law is not affine states nothing.
    """
    drive = read_drive(model, actuator)
    if drive is None:
        return {}
    ids = np.array([actuator])
    gear = model.actuator_gear[model.actuator_outadr[ids], 0]
    control = control_range(model, ids)
    target = mapped(control, np.array([1 / drive.slope]), -drive.offset / drive.slope)
    effort = mapped(force_range(model, ids), gear)
    if drive.kind == "effort":
        target = effort = least(target, effort)
    reach = {"effort_target": effort[0], f"{drive.kind}_target": target[0]}
    return {name: ends for name, ends in reach.items() if np.isfinite(ends).all()}
