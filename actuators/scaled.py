"""Scaled servos: `<general>` actuators whose control range is mapped onto a target range.

    knee = root.find("joint", "knee")
    add_position_actuator(knee, qposrange=(-1.57, 0.0), kp=50.0, name="knee")
    physics.bind(root.find("actuator", "knee")).ctrl = -1.0  # asks for -1.57 rad

With `target(u)` the straight line that takes `ctrlrange` to `qposrange` (or `qvelrange`), the force
on the transmission is `kp · (target(u) − length)`, or `kv · (target(u) − velocity)`. That is
MuJoCo's own `<position>` or `<velocity>` with the line put before its control, and element for
element what `dm_control.locomotion.walkers.scaled_actuators` adds, so the two can be exchanged.
What that module lets through as nonsense is refused here, and a refusal leaves the model as it was.

Two promises of that module's documentation are kept here where its code does not keep them:
tendons (`<fixed>` and `<spatial>`) are accepted as targets, and an attribute that `<general>` does
not have is a `TypeError`.

Limits:

* A `<default><general .../>` that applies to the actuator still supplies whatever is not given, for
  instance `dyntype`, `gaintype`, `gear` or `forcerange`: PyMJCF does not resolve defaults, so
  nobody can check them here. Give the attribute itself to override the default.
* Ranges are in units of the transmission's length, which is `gear` times the joint's angle
  [rad] or displacement [m], whatever the model's `compiler angle`.
* The length of a free joint, and of a site without `refsite`, is always zero in MuJoCo: a position
  servo there does not see the position, only a velocity servo works.
* Parameters are computed in double precision, also from float32 numbers.
"""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

if TYPE_CHECKING:
    from dm_control import mjcf

_DISALLOWED_KWARGS = frozenset(
    {
        "biastype",
        "biasprm",
        "cranksite",
        "ctrllimited",
        "gainprm",
        "joint",
        "site",
        "slidersite",
        "tendon",
    }
)
_GOT_INVALID_KWARGS = "Received invalid keyword argument(s): {}"
_GOT_INVALID_TARGET = (
    "`target` tag type should be one of ['joint', 'site', 'tendon']: got {}"  # as in dm_control
)

_REFERENCE_BY_TAG = {
    "joint": "joint",
    "site": "site",
    "tendon": "tendon",
    "fixed": "tendon",
    "spatial": "tendon",
}

_ONE_INPUT = "it describes the inputs of a PID actuator, and this one has a single input"
_CONTRADICTIONS = {
    "body": "`target` alone says what is driven",
    "jointinparent": "`target` alone says what is driven",
    "cranklength": "it belongs to a slider-crank, which cannot be a `target`",
    "inheritrange": "MuJoCo ignores it on <general>; the ranges given here take its place",
    "input": _ONE_INPUT,
    "velrange": _ONE_INPUT,
    "ffrange": _ONE_INPUT,
}
# The other activation dynamics make the control a rate, or clip it to [0, 1], or need a gain that
# is not fixed. "user" is the user's own callback, which only the user can judge.
_ACCEPTED_VALUES = {
    "gaintype": ("fixed",),
    "dyntype": ("none", "filter", "filterexact", "user"),
}


def add_position_actuator(
    target: mjcf.Element,
    qposrange: Sequence[float] | NDArray[Any],
    ctrlrange: Sequence[float] | NDArray[Any] = (-1, 1),
    kp: float = 1.0,
    **kwargs: Any,
) -> mjcf.Element:
    """Adds a position servo whose control range spans a range of positions.

    Args:
        target: PyMJCF joint, tendon or site that is driven.
        qposrange: Two rising numbers, the positions asked for at the ends of `ctrlrange`, in units
            of the actuator's length [rad, or m, times `gear`].
        ctrlrange: Two rising numbers, the range to which the control is clipped [1].
        kp: Stiffness [N·m/rad or N/m], zero or more. Zero makes a limp actuator, without force.
        **kwargs: Attributes of the `<general>` element, for instance `name`, `forcerange`,
            `dclass`, `dyntype="filter"`, or `refsite` where `target` is a site. What is not given
            still comes from the `<default>` that applies.

    Returns:
        The `<general>` element, added to the model that contains `target`.

    Raises:
        TypeError: `target` is not a joint, tendon or site; a range or gain is not made of numbers;
            `kwargs` has an unknown attribute, or one that the arguments already decide.
        ValueError: `target` was removed from its model or only refers to a joint, tendon or site;
            a range has not two finite, rising numbers; `kp` is negative or not finite; an attribute
            has a value that contradicts the servo, or that PyMJCF refuses.
    """
    attributes = _check_target_and_kwargs(target, kwargs, ("qposrange", "ctrlrange", "kp"))
    positions = _check_range("qposrange", qposrange)
    controls = _check_range("ctrlrange", ctrlrange)
    kp = _check_gain("kp", kp)
    gain, offset = _affine(positions, controls, kp)
    return _add_general(target, [gain], [offset, -kp, 0], controls, attributes)


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
    attributes = _check_target_and_kwargs(target, kwargs, ("qvelrange", "ctrlrange", "kv"))
    velocities = _check_range("qvelrange", qvelrange)
    controls = _check_range("ctrlrange", ctrlrange)
    kv = _check_gain("kv", kv)
    gain, offset = _affine(velocities, controls, kv)
    return _add_general(target, [gain], [offset, 0, -kv], controls, attributes)


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
    biasprm: list[float],
    ctrlrange: tuple[float, float],
    attributes: Mapping[str, Any],
) -> mjcf.Element:
    return target.root.actuator.add(
        "general",
        biastype="affine",
        gainprm=gainprm,
        biasprm=biasprm,
        ctrllimited=True,
        ctrlrange=ctrlrange,
        **attributes,
    )


def _check_target_and_kwargs(
    target: Any, kwargs: Mapping[str, Any], parameters: Iterable[str]
) -> dict[str, Any]:
    """Returns `kwargs` with the reference to `target`, after every check that they need."""
    disallowed = _DISALLOWED_KWARGS.intersection(kwargs)
    if disallowed:
        raise TypeError(_GOT_INVALID_KWARGS.format(sorted(disallowed)))
    reference = _check_target(target)
    _check_attributes_exist(target, kwargs, parameters)
    for name, value in kwargs.items():
        if value is None:  # PyMJCF's "not set"
            continue
        _check_not_removed(name, value)
        if name in _CONTRADICTIONS:
            raise TypeError(f"leave `{name}={value!r}` out: {_CONTRADICTIONS[name]}")
        if name == "refsite" and reference != "site":
            raise TypeError(
                f"`refsite={value!r}` needs a site as `target`, which is a {reference}: leave "
                "`refsite` out, or target the site that should move relative to it"
            )
        accepted = _ACCEPTED_VALUES.get(name)
        if accepted is not None and str(value).lower() not in accepted:
            raise ValueError(
                f"`{name}={value!r}` contradicts the map from `ctrlrange` to the target: use one "
                f"of {list(accepted)}, or add a <general> element of your own"
            )
    return {reference: target, **kwargs}


def _check_target(target: Any) -> str:
    """Returns the attribute of `<general>` that refers to `target`: joint, tendon or site."""
    # Not at the top: it loads OpenGL, and whoever has an element has already paid for that.
    from dm_control import mjcf

    if not isinstance(target, mjcf.Element):
        raise TypeError(
            f"`target` should be a PyMJCF joint, tendon or site, got {target!r} of type "
            f"{type(target).__name__}: look the element up, e.g. root.find('joint', 'knee')"
        )
    _check_not_removed("target", target)
    reference = _REFERENCE_BY_TAG.get(target.tag)
    if reference is None:
        raise TypeError(_GOT_INVALID_TARGET.format(target))
    # Attachment frames have namespaces such as "joint@attachment_frame_7".
    if str(target.spec.namespace).split("@")[0] != reference:
        raise ValueError(
            f"`target` is the <{target.tag}> inside <{target.parent.tag}>, which is not itself a "
            f"{reference}: pass the {reference}, e.g. root.find({reference!r}, 'knee')"
        )
    return reference


def _check_not_removed(name: str, value: Any) -> None:
    """Refuses a removed element; before anything prints it, for that recurses without end."""
    if getattr(value, "is_removed", False):
        raise ValueError(
            f"`{name}` is a <{value.tag}> that was removed from its model: look up one that is "
            "still there with root.find(namespace, name)"
        )


def _check_attributes_exist(
    target: mjcf.Element, kwargs: Mapping[str, Any], parameters: Iterable[str]
) -> None:
    known = {*target.root.actuator.spec.children["general"].attributes, "dclass"}
    usable = sorted((known | {*parameters}) - _DISALLOWED_KWARGS - _CONTRADICTIONS.keys())
    for name in kwargs:
        if name not in known:
            closest = difflib.get_close_matches(name, usable, n=3, cutoff=0.5)
            raise TypeError(
                f"<general> has no attribute {name!r}: "
                + (f"did you mean one of {closest}?" if closest else f"use one of {usable}")
            )


def _check_range(name: str, value: Any) -> tuple[float, float]:
    numbers = _plain(value)
    if isinstance(numbers, str | bytes) or not isinstance(numbers, Sequence):
        hint = (
            ". PyMJCF's `joint.range` is None where a default class sets it: read such a range "
            "from the compiled model"
        )
        raise TypeError(
            f"`{name}` should be two numbers (low, high), got {value!r}"
            + (hint if value is None else "")
        )
    if len(numbers) != 2:
        raise ValueError(
            f"`{name}` should be two numbers (low, high), got {len(numbers)}: {value!r}"
        )
    low, high = (float(_check_number(f"{name}[{i}]", n)) for i, n in enumerate(numbers))
    if not low < high:
        raise ValueError(
            f"`{name}` should rise from low to high, got ({low}, {high}): "
            + (f"use ({high}, {low})" if high < low else "give it a width")
        )
    return low, high


def _check_gain(name: str, value: Any) -> float:
    gain = _check_number(name, value)
    if gain < 0:
        raise ValueError(
            f"`{name}` should not be negative, got {value!r}: the actuator would push away from "
            f"its target; use {-gain}, or 0 for no force"
        )
    return gain


def _check_number(name: str, value: Any) -> float:
    number = _plain(value)
    is_number = isinstance(number, Real) and not isinstance(number, bool)
    if not is_number:
        raise TypeError(
            f"`{name}` should be a number, got {value!r} of type {type(value).__name__}: pass an "
            "int or a float"
        )
    if not -sys.float_info.max <= number <= sys.float_info.max:
        raise ValueError(f"`{name}` should be finite, got {value!r}: pass a finite number")
    # An int stays one because its negative has no -0.0, which dm_control would not write either.
    return number if isinstance(number, int) else float(number)


def _plain(value: Any) -> Any:
    """Returns Python's own numbers and lists for those of numpy, JAX, torch or pandas."""
    tolist = getattr(value, "tolist", None)
    return tolist() if callable(tolist) else value
