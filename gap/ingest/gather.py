"""Samples that come one by one, gathered into columns.

gather = Gather()
gather.add("/imu", "sensor_msgs/msg/Imu", {"received": 1}, {"/imu/orientation.w": 1.0})
topics, columns = gather.done()

flat({"motorState": [{"q": 0.1}]})      # {"motorState[0].q": 0.1}
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass
from math import nan
from numbers import Real
from typing import Any

import numpy as np

from walkerkit.gap.ingest.log import Column, Stamps, Topic
from walkerkit.gap.ingest.unitree import NO_SIGNALS
from walkerkit.gap.recordings.trajectory import Course

MOST_IN_A_LIST = 256
"""Numbers of one list that become columns; pictures and clouds have more."""

_NEVER = {"covariance", "layout", *NO_SIGNALS}
"""Fields that hold no signal, in messages of which every one would become a column."""


@dataclass(kw_only=True)
class _Kept:
    """What is gathered of one topic."""

    kind: str
    clocks: list[Mapping[str, float]] = field(default_factory=list)
    samples: list[Mapping[str, float]] = field(default_factory=list)
    courses: list[Mapping[str, Course]] = field(default_factory=list)


class Gather:
    """Samples of several topics."""

    def __init__(self) -> None:
        self._kept: dict[str, _Kept] = {}

    def add(
        self,
        topic: str,
        kind: str,
        clocks: Mapping[str, float],
        sample: Mapping[str, float],
        courses: Mapping[str, Course] | None = None,
    ) -> None:
        """Adds a sample.

        Args:
            topic: of which it is.
            kind: the type of its message.
            clocks: clock to its stamp; a clock that one sample lacks, the topic has not.
            sample: column to value.
            courses: column to what a trajectory says of it.
        """
        kept = self._kept.setdefault(topic, _Kept(kind=kind))
        kept.clocks.append(clocks)
        kept.samples.append(sample)
        kept.courses.append(courses or {})

    def done(self) -> tuple[dict[str, Topic], dict[str, Column]]:
        """All topics and columns, in the order in which they came first."""
        topics, columns = {}, {}
        for name, kept in self._kept.items():
            shared = [c for c in kept.clocks[0] if all(c in stamps for stamps in kept.clocks)]
            topics[name] = Topic(
                kind=kept.kind,
                size=len(kept.samples),
                clocks={c: _stamps([stamps[c] for stamps in kept.clocks]) for c in shared},
            )
            for column in dict.fromkeys(c for sample in kept.samples for c in sample):
                columns[column] = Column(
                    topic=name,
                    values=np.array([s.get(column, np.nan) for s in kept.samples], float),
                    given=np.array([column in s for s in kept.samples]),
                    courses=[c.get(column) for c in kept.courses]
                    if any(column in c for c in kept.courses)
                    else None,
                )
        return topics, columns


def flat(value: Any, path: str = "") -> dict[str, float]:
    """The numbers of a nested value, by their paths; NaN for what is there and is no number.

    Args:
        value: of mappings, dataclasses, lists, arrays and numbers; anything else is left out. Lists
            that are as long as a list of joints' names beside them have these for places.
        path: where it is itself.
    """
    found: dict[str, float] = {}
    _flatten(value, path, (), found)
    return found


def _flatten(value: Any, path: str, names: Sequence[str], found: dict[str, float]) -> None:
    kind = type(value)
    if kind is float or kind is int or value is None or isinstance(value, Real):
        found[path] = nan if value is None else float(value)
    elif kind is list or kind is tuple or kind is np.ndarray:
        if len(value) > MOST_IN_A_LIST:
            return
        labels: Iterable[Any] = names if len(names) == len(value) else range(len(value))
        for label, entry in zip(labels, value, strict=True):
            _flatten(entry, f"{path}[{label}]", (), found)
    elif kind is not str and (isinstance(value, Mapping) or is_dataclass(value)):
        entries = value if isinstance(value, Mapping) else vars(value)
        names = _names(entries) or names
        for key, entry in entries.items():
            if key not in _NEVER:
                within = f"{path}.{key}" if path and path[-1] != "/" else f"{path}{key}"
                _flatten(entry, within, names, found)


def _names(entries: Mapping[str, Any]) -> Sequence[str]:
    """The names of a message's joints, where it has them."""
    for key in ("joint_names", "name", "names"):
        found = entries.get(key)
        if isinstance(found, list | tuple) and found and all(isinstance(n, str) for n in found):
            return found
    return ()


def _stamps(values: Sequence[float]) -> Stamps:
    """Whole numbers as they are: nanoseconds of the epoch are more than a float holds."""
    if all(isinstance(value, int | np.integer) for value in values):
        return np.array(values, np.int64)
    return np.array(values, float)
