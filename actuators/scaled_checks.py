"""What a scaled actuator may drive, and which attributes of `<general>` may be added to it.

    attributes = check_target_and_kwargs(joint, {"name": "knee"}, ("qposrange", "ctrlrange", "kp"))

Everything is judged before anything is added, so that a refusal leaves the model as it was.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dm_control import mjcf

DISALLOWED_KWARGS = frozenset(
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
GOT_INVALID_KWARGS = "Received invalid keyword argument(s): {}"
GOT_INVALID_TARGET = (
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


def check_target_and_kwargs(
    target: Any, kwargs: Mapping[str, Any], parameters: Iterable[str]
) -> dict[str, Any]:
    """Returns `kwargs` with the reference to `target`, after every check that they need."""
    disallowed = DISALLOWED_KWARGS.intersection(kwargs)
    if disallowed:
        raise TypeError(GOT_INVALID_KWARGS.format(sorted(disallowed)))
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
        raise TypeError(GOT_INVALID_TARGET.format(target))
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
    usable = sorted((known | {*parameters}) - DISALLOWED_KWARGS - _CONTRADICTIONS.keys())
    for name in kwargs:
        if name not in known:
            closest = difflib.get_close_matches(name, usable, n=3, cutoff=0.5)
            raise TypeError(
                f"<general> has no attribute {name!r}: "
                + (f"did you mean one of {closest}?" if closest else f"use one of {usable}")
            )
