"""Columns that differ in the joint only, put together, and joints found by name or by place.

found = patterns(log, ["hip", "knee"])
found["/joint_states/{}/position"].elements      # {"hip": "/joint_states/hip/position", ...}
match(found["dof_pos[{}]"], model)               # joint of the model to element, or None
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from walkerkit.gap.ingest.bag import ARRAY, TRAJECTORY
from walkerkit.gap.ingest.log import Column, Log
from walkerkit.gap.ingest.model import Model
from walkerkit.gap.ingest.unitree import QUADRUPED_ORDER
from walkerkit.gap.ingest.words import signal_of
from walkerkit.gap.recordings.recording import LARGEST

_BRACKET = re.compile(r"^(.*\[)([^\[\]]+)(\].*)$")
_DIGITS = re.compile(r"^(.*?)(\d+)(\D*)$")
_PLACE = re.compile(r"^(.*?)(\d+)$")
_LONG = 3  # letters of a name, from which a part of it says enough


@dataclass(frozen=True, kw_only=True)
class Pattern:
    """Columns whose names differ in one part.

    Attributes:
        name: that of the columns, with `{}` for the part.
        topic: of which they are.
        elements: the part to the column's name.
    """

    name: str
    topic: str
    elements: dict[str, str] = field(default_factory=dict)


def patterns(log: Log, joints: Iterable[str]) -> dict[str, Pattern]:
    """All patterns of a log, in the order of its columns.

    Args:
        log: what was read.
        joints: names of the model's joints, which mark the part that differs.
    """
    aliases = {alias: name for name in joints for alias in (name, _short(name)) if alias}
    ordered = sorted(aliases, key=len, reverse=True)
    marks = [
        re.compile(rf"(?<![a-z0-9]){re.escape(a)}(?![a-z0-9])", re.IGNORECASE) for a in ordered
    ]
    found: dict[str, Pattern] = {}
    for name, column in log.columns.items():
        head, element, tail = _split(name, marks)
        pattern = f"{head}{{}}{tail}" if element else name
        known = found.setdefault(pattern, Pattern(name=pattern, topic=column.topic))
        known.elements[element] = name
    return found


def kind_of(pattern: Pattern, log: Log) -> str | None:
    """The signal that a pattern is, or None."""
    message = log.topics[pattern.topic].kind
    signal = signal_of(pattern.name)
    if message == TRAJECTORY and signal and not signal.endswith("_target"):
        return f"{signal}_target"
    if message == ARRAY and signal is None:
        return "position_target"
    return signal


def match(pattern: Pattern, log: Log, model: Model) -> dict[str, str] | None:
    """The joints of the model that a pattern has.

    Returns:
        Joint to element; None where the elements are neither names of joints nor as many.
    """
    elements = pattern.elements
    if list(elements) == [""]:
        return {model.order[0]: ""} if len(model.order) == 1 else None
    named = _by_name(list(elements), list(model.joints))
    if named:
        return named
    places = [_PLACE.match(element) for element in elements]
    found = [place for place in places if place]
    if len(found) < len(places) or len({place[1] for place in found}) > 1:
        return None
    ordered = sorted(elements, key=lambda element: int(_DIGITS.match(element)[2]))  # type: ignore[index]
    vendor = _vendor_order(model) if "motor" in pattern.name.lower() else None
    if vendor is not None and len(ordered) >= len(vendor):
        return dict(zip(vendor, ordered, strict=False))
    if len(ordered) > len(model.order):
        # Drives that are not there say 0 all the time, or are told to do nothing.
        ordered = [e for e in ordered if _says_something(log.columns[elements[e]])]
    if len(ordered) != len(model.order):
        return None
    return dict(zip(model.order, ordered, strict=True))


def is_by_place(pattern: Pattern, matched: Mapping[str, str]) -> bool:
    """Whether joints were found by their places."""
    return any(element.isdigit() or _PLACE.match(element) for element in matched.values()) and (
        not any(_plain(joint) == _plain(element) for joint, element in matched.items())
    )


def _split(name: str, marks: Sequence[re.Pattern[str]]) -> tuple[str, str, str]:
    """What is before, in and behind the part of a name that says which joint it is."""
    listed = _BRACKET.match(name)
    if listed and not listed[2].isdigit():  # a name in a list is the joint's, but for its signal
        joint, dot, signal = listed[2].rpartition(".")
        if dot and signal_of(signal):
            return listed[1], joint, f".{signal}{listed[3]}"
        return listed[1], listed[2], listed[3]
    for mark in marks:
        hits = list(mark.finditer(name))
        if hits:
            return name[: hits[-1].start()], hits[-1][0], name[hits[-1].end() :]
    for form in (_BRACKET, _DIGITS):
        hit = form.match(name)
        if hit:
            return hit[1], hit[2], hit[3]
    parts = re.split(r"([/.])", name)
    if len(parts) >= 3 and parts[-3] and signal_of(parts[-1]):
        return "".join(parts[:-3]), parts[-3], "".join(parts[-2:])
    return name, "", ""


def _by_name(elements: Sequence[str], joints: Sequence[str]) -> dict[str, str]:
    """Joints by their names, else by a name that ends as theirs."""
    found = {}
    for joint in joints:
        same = [e for e in elements if _plain(e) == _plain(joint)]
        if not same and len(_plain(joint)) >= _LONG:
            same = [
                e
                for e in elements
                if len(_plain(e)) >= _LONG
                and (_plain(e).endswith(_plain(joint)) or _plain(joint).endswith(_plain(e)))
            ]
        if len(same) == 1:
            found[joint] = same[0]
    return found if len(set(found.values())) == len(found) else {}


def _says_something(column: Column) -> bool:
    values = np.nan_to_num(column.values)
    return bool(np.any((values != 0) & (np.abs(values) < LARGEST)))


def _vendor_order(model: Model) -> list[str] | None:
    """Joints of one of Unitree's quadrupeds in the order of its motors, None for others."""
    found = []
    for leg, part in QUADRUPED_ORDER:
        some = [joint for joint in model.order if _plain(joint) == _plain(f"{leg}_{part}")]
        if len(some) != 1:
            return None
        found += some
    return found


def _short(joint: str) -> str:
    """A joint's name without the word joint."""
    return re.sub(r"(?i)(^joint[_\-/ ]|[_\-/ ]joint$)", "", joint)


def _plain(name: str) -> str:
    """A name's letters and digits, without what many put around it."""
    short = re.sub(r"\.(pos|position|vel|q|dq|tau)$", "", name)
    return re.sub(r"[^a-z0-9]", "", _short(short).lower())
