"""A log as columns of samples, whatever file it came from; what they mean is not known here.

    log = Log(path=path, name="run_1", topics={"/joint_states": topic}, columns={...})
    log.columns["/joint_states/hip/position"].values     # (T,), in the log's own unit
    log.topics["/joint_states"].clocks["header"]          # (T,), in the log's own unit

A topic is what has a clock: a topic of ROS, or a whole table. A table has the topic `""`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.trajectory import Course

FloatArray = NDArray[np.float64]
Stamps = NDArray[np.int64] | NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """One number over time.

    Attributes:
        topic: whose clocks it has.
        values: (T,) samples in the log's unit, NaN where there is none.
        given: (T,) whether the log says something there, be it no number; by default all of them.
        courses: what a trajectory says at each of the samples, instead of one value.
    """

    topic: str
    values: FloatArray
    given: BoolArray | None = None
    courses: Sequence[Course | None] | None = None

    @property
    def said(self) -> BoolArray:
        """(T,) whether the log says something there."""
        return np.ones(len(self.values), bool) if self.given is None else self.given


@dataclass(frozen=True, kw_only=True, eq=False)
class Topic:
    """What has a clock.

    Attributes:
        kind: the type of its messages, empty for a table.
        size: number of its samples.
        clocks: name to (T,) stamps in the log's own unit.
    """

    kind: str = ""
    size: int
    clocks: Mapping[str, Stamps] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """One run of the robot, as its file has it.

    Attributes:
        path: the file or folder.
        name: of the recording that it becomes.
        topics: name to topic.
        columns: name to column, in the log's order.
        rate: samples a second where the log says so and has stamps that count [Hz].
        calibrated: joint's name in the log to the width of its calibrated range [rad].
        convention: `lerobot` for positions that may be per cent of a calibrated range, else empty.
        notes: what a user should know of how it was read.
    """

    path: Path
    name: str
    topics: Mapping[str, Topic]
    columns: Mapping[str, Column]
    rate: float | None = None
    calibrated: Mapping[str, float] = field(default_factory=dict)
    convention: str = ""
    notes: tuple[str, ...] = ()
