"""Scaled actuators: `<general>` elements whose control range is mapped onto a target range.

    knee = root.find("joint", "knee")
    add_position_actuator(knee, qposrange=(-1.57, 0.0), kp=50.0, name="knee")
    physics.bind(root.find("actuator", "knee")).ctrl = -1.0  # asks for -1.57 rad

With `target(u)` the straight line that takes `ctrlrange` to `qposrange` (or `qvelrange`, or
`effortrange`), the force on the transmission is

    kp · (target(u) − length) − kv · velocity      add_position_actuator
    kv · (target(u) − velocity)                    add_velocity_actuator
    target(u)                                      add_effort_actuator

That is MuJoCo's own `<position>`, `<velocity>` or `<motor>` with the line put before its control.
The first (without `kv`, as by default) and the second are element for element what
`dm_control.locomotion.walkers.scaled_actuators` adds, so they can be exchanged. What that module
lets through as nonsense is refused here, and a refusal leaves the model as it was.

Beyond that module: the damping `kv` of a position actuator, `qposrange="joint"` for the joint's own
range, and efforts. Two promises of its documentation are kept here where its code does not keep
them: tendons (`<fixed>` and `<spatial>`) are accepted as targets, and an attribute that `<general>`
does not have is a `TypeError`.

Limits:

* A `<default><general .../>` that applies to the actuator still supplies whatever is not given, for
  instance `dyntype`, `gaintype`, `gear` or `forcerange`: PyMJCF does not resolve defaults, so
  nobody can check them here. Give the attribute itself to override the default.
* Ranges are in units of the transmission's length, which is `gear` times the joint's angle
  [rad] or displacement [m], whatever the model's `compiler angle`; efforts are in those of its
  force, of which the joint gets `gear` times as much. `qposrange="joint"` does this conversion
  itself, with the defaults and the `compiler` of the model as they are when it is called.
* The length of a free joint, and of a site without `refsite`, is always zero in MuJoCo: a position
  servo there does not see the position, only a velocity servo works.
* Parameters are computed in double precision, also from float32 numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from numpy.typing import NDArray

from walkerkit.actuators.arguments import check_number, check_range
from walkerkit.actuators.joint_range import joint_range
from walkerkit.actuators.scaled_checks import check_target_and_kwargs

if TYPE_CHECKING:
    from dm_control import mjcf

_REPELS = "push away from its target; use {}, or 0 for no force"


def add_position_actuator(
    target: mjcf.Element,
    qposrange: Sequence[float] | NDArray[Any] | Literal["joint"],
    ctrlrange: Sequence[float] | NDArray[Any] = (-1, 1),
    kp: float = 1.0,
    *,
    kv: float = 0,
    **kwargs: Any,
) -> mjcf.Element:
    """Adds a position servo whose control range spans a range of positions.

    Args:
        target: PyMJCF joint, tendon or site that is driven.
        qposrange: Two rising numbers, the positions asked for at the ends of `ctrlrange`, in units
            of the actuator's length [rad, or m, times `gear`]. Or "joint", for the range of a
            hinge or slide joint, whether it stands on the joint or in a default class, and in
            degrees or radians; a negative `gear` turns it around.
        ctrlrange: Two rising numbers, the range to which the control is clipped [1].
        kp: Stiffness [N·m/rad or N/m], zero or more. Zero makes a limp actuator, without force.
        kv: Damping [N·m·s/rad or N·s/m], zero or more; dm_control has none.
        **kwargs: Attributes of the `<general>` element, for instance `name`, `forcerange`,
            `dclass`, `dyntype="filter"`, or `refsite` where `target` is a site. What is not given
            still comes from the `<default>` that applies.

    Returns:
        The `<general>` element, added to the model that contains `target`.

    Raises:
        TypeError: `target` is not a joint, tendon or site; a range or gain is not made of numbers;
            `kwargs` has an unknown attribute, or one that the arguments already decide.
        ValueError: `target` was removed from its model or only refers to a joint, tendon or site;
            a range has not two finite, rising numbers; `qposrange` is "joint" and `target` has no
            range; a gain is negative or not finite; an attribute has a value that contradicts the
            servo, or that PyMJCF refuses.
    """
    parameters = ("qposrange", "ctrlrange", "kp", "kv")
    attributes = check_target_and_kwargs(target, kwargs, parameters)
    controls = check_range("ctrlrange", ctrlrange)
    kp = _check_gain("kp", kp, _REPELS)
    kv = _check_gain("kv", kv, "push along with the motion; use {}, or 0 for no damping")
    if isinstance(qposrange, str) and qposrange == "joint":
        positions = joint_range(target, attributes)
    else:
        positions = check_range("qposrange", qposrange)
    gain, offset = _affine(positions, controls, kp)
    return _add_general(target, [gain], [offset, -kp, -kv], controls, attributes)


def add_velocity_actuator(
    target: mjcf.Element,
    qvelrange: Sequence[float] | NDArray[Any],
    ctrlrange: Sequence[float] | NDArray[Any] = (-1, 1),
    kv: float = 1.0,
    **kwargs: Any,
) -> mjcf.Element:
    """Adds a velocity servo whose control range spans a range of velocities.

    Args:
        target: PyMJCF joint, tendon or site that is driven.
        qvelrange: Two rising numbers, the velocities asked for at the ends of `ctrlrange`, in units
            of the actuator's velocity [rad/s, or m/s, times `gear`].
        ctrlrange: Two rising numbers, the range to which the control is clipped [1].
        kv: Gain [N·m·s/rad or N·s/m], zero or more. Zero makes a limp actuator, without force.
        **kwargs: Attributes of the `<general>` element, for instance `name`, `forcerange`,
            `dclass`, `dyntype="filter"`, or `refsite` where `target` is a site. What is not given
            still comes from the `<default>` that applies.

    Returns:
        The `<general>` element, added to the model that contains `target`.

    Raises:
        TypeError: As in `add_position_actuator`.
        ValueError: As in `add_position_actuator`, with `qvelrange` and `kv`.
    """
    attributes = check_target_and_kwargs(target, kwargs, ("qvelrange", "ctrlrange", "kv"))
    velocities = check_range("qvelrange", qvelrange)
    controls = check_range("ctrlrange", ctrlrange)
    kv = _check_gain("kv", kv, _REPELS)
    gain, offset = _affine(velocities, controls, kv)
    return _add_general(target, [gain], [offset, 0, -kv], controls, attributes)


def add_effort_actuator(
    target: mjcf.Element,
    effortrange: Sequence[float] | NDArray[Any],
    ctrlrange: Sequence[float] | NDArray[Any] = (-1, 1),
    **kwargs: Any,
) -> mjcf.Element:
    """Adds an effort actuator whose control range spans a range of efforts.

    Args:
        target: PyMJCF joint, tendon or site that is driven.
        effortrange: Two rising numbers, the efforts at the ends of `ctrlrange`, in units of the
            actuator's force [N·m, or N, divided by `gear`]. Where zero control is not zero effort,
            as with (0, 10), an actuator that nobody commands pushes.
        ctrlrange: Two rising numbers, the range to which the control is clipped [1].
        **kwargs: Attributes of the `<general>` element, as in `add_position_actuator`.

    Returns:
        The `<general>` element, added to the model that contains `target`.

    Raises:
        TypeError: As in `add_position_actuator`.
        ValueError: As in `add_position_actuator`, with `effortrange`.
    """
    attributes = check_target_and_kwargs(target, kwargs, ("effortrange", "ctrlrange"))
    efforts = check_range("effortrange", effortrange)
    controls = check_range("ctrlrange", ctrlrange)
    gain, offset = _affine(efforts, controls, 1.0)
    # A line through the origin is a plain motor, without the bias that rounding would leave.
    through_origin = efforts[0] * controls[1] == efforts[1] * controls[0]
    bias = None if through_origin else [offset, 0, 0]
    return _add_general(target, [gain], bias, controls, attributes)


def _affine(
    targets: tuple[float, float], controls: tuple[float, float], gain: float
) -> tuple[float, float]:
    """Returns (a, b) such that a·u + b is `gain` times the target at control u."""
    slope = (targets[1] - targets[0]) / (controls[1] - controls[0])
    a, b = gain * slope, gain * (targets[0] - slope * controls[0])
    if not (slope > 0 and math.isfinite(a) and math.isfinite(b)):
        raise ValueError(
            f"a gain of {gain}, targets {targets} and `ctrlrange` {controls} give a slope of "
            f"{slope}, gainprm {a} and biasprm {b}, beyond double precision: use numbers of an "
            "ordinary size"
        )
    return a, b


def _add_general(
    target: mjcf.Element,
    gainprm: list[float],
    biasprm: list[float] | None,
    ctrlrange: tuple[float, float],
    attributes: Mapping[str, Any],
) -> mjcf.Element:
    return target.root.actuator.add(
        "general",
        biastype="none" if biasprm is None else "affine",
        gainprm=gainprm,
        biasprm=biasprm,
        ctrllimited=True,
        ctrlrange=ctrlrange,
        **attributes,
    )


def _check_gain(name: str, value: Any, would: str) -> float:
    gain = check_number(name, value)
    if gain < 0:
        raise ValueError(
            f"`{name}` should not be negative, got {value!r}: the actuator would "
            + would.format(-gain)
        )
    return gain
