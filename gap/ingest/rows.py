"""A log that is mapped, laid out in rows on one clock: a recording.

    recording = recording_of(log, mapping)

Each sample of the positions is a row. A command holds from when it was given until the next one of
its joint, and a trajectory goes from point to point until then. What was measured on another clock
is interpolated. Rows before the first commands and the few in which something is no number are left
out, and notes say so.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import closest, refusal
from walkerkit.gap.ingest.clocks import Clocks
from walkerkit.gap.ingest.column_map import (
    OF_RANGE,
    UNITS,
    ColumnMap,
    JointMap,
    SignalMap,
    TimeMap,
)
from walkerkit.gap.ingest.log import Column, FloatArray, Log
from walkerkit.gap.ingest.unitree import NOT_COMMANDED
from walkerkit.gap.recordings.recording import LARGEST, QUATERNION, SIGNALS, TARGETS, Recording
from walkerkit.gap.recordings.trajectory import Course

_FEW: Final = 0.05  # of the rows, that may lack a number and are left out
_NANO = 1e9
_LATER = np.iinfo(np.int64).max


def recording_of(log: Log, mapping: ColumnMap) -> Recording:
    """Makes a recording of a log.

    Args:
        log: as it was read.
        mapping: with its time, its joints, and a signal `position`.

    Raises:
        InputError: the log lacks what the map names, or nothing is left of it.
    """
    return _Rows(log, mapping).recording()


@dataclass(frozen=True, kw_only=True)
class _Source:
    """A column of the recording and where it is from."""

    name: str
    joint: str
    kind: str
    column: Column
    signal: SignalMap
    how: JointMap

    def scaled(self, values: FloatArray) -> FloatArray:
        """Values of the log in the model's terms."""
        position = self.kind.startswith("position")
        unit = (self.how.unit if position else None) or self.signal.unit
        if unit in OF_RANGE:
            lower, upper = self.how.range or (0.0, 0.0)
            share = values / 100 if unit == "percent" else (values + 100) / 200
            values = lower + share * (upper - lower)
        else:
            kind = self.kind.removesuffix("_target")
            values = (unit if isinstance(unit, float) else UNITS[kind][unit]) * values
        return self.how.sign * values + (self.how.offset if position else 0.0)


class _Rows:
    """States and commands on one clock."""

    def __init__(self, log: Log, mapping: ColumnMap):
        self._log = log
        self._map = mapping
        self._notes: list[str] = []
        self._begun: dict[tuple[str, int], Course] = {}  # of positions, by joint and command
        self._sources = self._found()
        (self._topic,) = dict.fromkeys(s.column.topic for s in self._of("position"))
        self._word = "joint states" if log.topics[self._topic].kind else "rows"
        self._clocks = Clocks(log, mapping.time or TimeMap(), self._topic)
        self._states, self._time = self._state_rows()

    def recording(self) -> Recording:
        """The rows from the first commands on."""
        targets = {
            source.name: source.scaled(values)
            for source in self._sources
            if source.kind in TARGETS and (values := self._target(source)) is not None
        }
        if not targets:
            raise refusal(
                f"{self._log.path}: no joint of the map has a command. Write where it is, "
                '[signals.position_target] with from = "...", into the map.'
            )
        ready = np.all([np.isfinite(values) for values in targets.values()], axis=0)
        if not ready.any():
            raise refusal(
                f"{self._log.path}: no joint state comes after the first command of each joint. "
                "Record both topics at the same time."
            )
        first = int(np.argmax(ready))
        if first:
            self._notes.append(f"{first} {self._word} before the first commands were left out")
        columns = self._measured(first)
        whole = [np.isfinite(values) for values in columns.values()]
        rows = first + np.flatnonzero(np.all(whole, axis=0))
        columns = {column: values[rows - first] for column, values in columns.items()}
        columns |= {column: values[rows] for column, values in targets.items()}
        time = self._time[rows]
        return Recording(
            name=self._log.name,
            time=(time - time[:1]) / _NANO,
            columns=self._ordered(columns),
            source=self._log.path,
            unused=self._unused(),
            notes=tuple(dict.fromkeys((*self._log.notes, *self._clocks.notes, *self._notes))),
            imported=True,
        )

    def _found(self) -> list[_Source]:
        """The log's columns that the map names."""
        found = []
        # A trajectory's velocities are slopes of its positions, which come first in SIGNALS.
        for kind in sorted(self._map.signals, key=SIGNALS.index):
            signal = self._map.signals[kind]
            for joint, how in (self._map.joints or {}).items():
                name = signal.column(joint, how)
                column = self._log.columns.get(name) if name is not None else None
                if column is not None:
                    found.append(
                        _Source(
                            name=f"{joint}/{kind}",
                            joint=joint,
                            kind=kind,
                            column=column,
                            signal=signal,
                            how=how,
                        )
                    )
                elif kind == "position":
                    raise refusal(
                        f"{self._log.path}: joint {joint!r} has no position: there is no column "
                        f"{name!r}{closest(str(name), self._log.columns)}. Correct "
                        "[signals.position] or [joints] of the map, or leave the joint out there."
                    )
            if not any(source.kind == kind for source in found):
                raise refusal(
                    f"{self._log.path}: it has no column {signal.pattern!r} of any joint"
                    f"{closest(signal.pattern, self._log.columns)}. Correct [signals.{kind}] of "
                    "the map, or leave it out."
                )
        topics = dict.fromkeys(s.column.topic for s in found if s.kind == "position")
        if len(topics) > 1:
            raise refusal(
                f"{self._log.path}: positions are in {' and '.join(map(repr, topics))}, with "
                "clocks of their own. Name one of them in [signals.position] of the map."
            )
        return found

    def _of(self, kind: str) -> list[_Source]:
        return [source for source in self._sources if source.kind == kind]

    def _state_rows(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The samples of the positions that become rows, and when they are from [ns]."""
        said = np.stack([source.column.said for source in self._of("position")])
        some, all_of_them = said.any(axis=0), said.all(axis=0)
        if not all_of_them.any():
            raise refusal(
                f"{self._log.path}: no sample has the positions of all joints. Name fewer joints "
                "in the map, or log them together."
            )
        if (lacking := int(np.sum(some & ~all_of_them))) > 0:
            self._notes.append(
                f"{lacking} messages of {self._topic or 'it'} lack some of the joints and were "
                "left out"
            )
        rows = np.flatnonzero(all_of_them)
        time = self._clocks.of(self._topic, self._map.signals["position"].clock)[rows]
        order = np.argsort(time, kind="stable")
        rows, time = rows[order], time[order]
        fresh = np.concatenate([[True], np.diff(time) > 0])
        if (repeated := int(np.sum(~fresh))) > 0:
            self._notes.append(f"{repeated} {self._word} repeat a stamp: left out")
        return rows[fresh], time[fresh]

    def _target(self, source: _Source) -> FloatArray | None:
        """What a joint was told in the log's unit, NaN before it was; None where it never was."""
        column = source.column
        values = column.values.copy()
        values[np.abs(values) > LARGEST] = np.nan
        values[values == NOT_COMMANDED.get(source.kind.removesuffix("_target"))] = np.nan
        time = self._clocks.of(column.topic, source.signal.clock, source.signal.rate)
        order = np.argsort(time, kind="stable")
        given = order[column.said[order]]
        which = given[np.isfinite(values[given])]
        if not len(which):
            return None
        if len(which) < len(given):
            self._notes.append(
                f"{len(given) - len(which)} of {len(given)} commands of "
                f"{source.name.removesuffix('_target')} are no numbers; those before them were held"
            )
        if column.courses is not None:
            return self._followed(source, column.courses, which, time[which])
        last = np.searchsorted(time[which], self._time, side="right") - 1
        return np.where(last < 0, np.nan, values[which][last])

    def _followed(
        self,
        source: _Source,
        courses: Sequence[Course | None],
        which: NDArray[np.int64],
        given: NDArray[np.int64],
    ) -> FloatArray:
        """The target of trajectories, each until the next one is given."""
        topic = source.column.topic
        if any(course is not None and course.moves for course in courses):
            self._notes.append(
                f"trajectories of {topic} go from point to point, as a "
                "joint_trajectory_controller takes them"
            )
        target = np.full(len(self._time), np.nan)
        position = source.kind == "position_target"
        before = self._position(source.joint, given[0]) if position else np.nan
        for k, start, until in zip(which, given, [*given[1:], _LATER], strict=True):
            course = courses[k]
            if course is None:
                continue
            if course.order:
                course = replace(self._begun[source.joint, k], order=course.order)
            else:
                course = self._begun[source.joint, k] = course.begun(before)
            first, last = np.searchsorted(self._time, (start, until))
            target[first:last] = course.at((self._time[first:last] - start) / _NANO)
            (before,) = course.at(np.array([(until - start) / _NANO]))
        return target

    def _position(self, joint: str, time: int) -> float:
        """Where a joint was in the log's unit, NaN where nobody knows."""
        (source,) = (s for s in self._of("position") if s.joint == joint)
        values = source.column.values[self._states]
        known = np.isfinite(values)
        if not known.any():
            return np.nan
        return float(np.interp(0.0, (self._time[known] - time).astype(float), values[known]))

    def _measured(self, first: int) -> dict[str, FloatArray]:
        """What was measured from a row on, NaN in the few rows that lack a number."""
        found: dict[str, FloatArray] = {}
        for source in self._sources:
            if source.kind in TARGETS:
                continue
            if not np.isfinite(source.column.values).any():
                continue
            values = self._at_rows(source.name, source.column, source.signal)[first:]
            lacking = int(np.count_nonzero(~np.isfinite(values)))
            if lacking == len(values) and source.kind != "position":
                continue
            told = f"{source.name} is no number in {lacking} of {len(values)} {self._word}"
            if lacking > _FEW * len(values):
                if source.kind == "position":
                    raise refusal(
                        f"{self._log.path}: {told} of {self._topic!r}. Mend what publishes "
                        "it, or leave the joint out."
                    )
                self._notes.append(f"{told}; the column was left out")
                continue
            if lacking:
                self._notes.append(f"{told}; these were left out")
            found[source.name] = source.scaled(values)
        return found | self._others(first)

    def _others(self, first: int) -> dict[str, FloatArray]:
        """The columns that the map names one by one, of the base above all."""
        found = {}
        for name, wanted in (self._map.columns or {}).items():
            column = self._log.columns.get(wanted)
            if column is None:
                raise refusal(
                    f"{self._log.path}: it has no column {wanted!r}"
                    f"{closest(wanted, self._log.columns)}. Correct {name!r} in [columns] of the "
                    "map, or leave it out."
                )
            found[name] = self._at_rows(name, column, None)[first:]
        if all(name in found for name in QUATERNION):
            size = np.sqrt(sum(found[name] ** 2 for name in QUATERNION))
            found |= {name: found[name] / size for name in QUATERNION}
        return found

    def _at_rows(self, name: str, column: Column, signal: SignalMap | None) -> FloatArray:
        """(rows,) a measurement, interpolated where it has other samples than the rows."""
        same = column.topic == self._topic and (signal is None or not (signal.clock or signal.rate))
        values = column.values
        own = np.flatnonzero(column.said)
        message = bool(self._log.topics[column.topic].kind)  # a table has rows of several clocks
        if same and (message or np.mean(column.said[self._states]) >= 1 - _FEW):
            return values[self._states]
        clock, rate = (signal.clock, signal.rate) if signal else (None, None)
        time = self._clocks.of(column.topic, clock, rate)[own]
        order = np.argsort(time, kind="stable")
        time, kept = time[order], values[own][order]
        if not len(time):
            return np.full(len(self._time), np.nan)
        self._notes.append(f"{name} has samples of its own; it was interpolated at the rows")
        start = self._time[0]
        x, known = (self._time - start).astype(float), (time - start).astype(float)
        interpolated: FloatArray = np.interp(x, known, kept)
        return interpolated

    def _ordered(self, columns: dict[str, FloatArray]) -> dict[str, FloatArray]:
        """Joint by joint, in the order of the map."""
        names: Iterable[str] = [f"{j}/{kind}" for j in self._map.joints or {} for kind in SIGNALS]
        known = {name: columns[name] for name in names if name in columns}
        return known | {name: values for name, values in columns.items() if name not in known}

    def _unused(self) -> tuple[str, ...]:
        """The log's columns that the map does not name."""
        used = {id(source.column) for source in self._sources}
        named = set((self._map.columns or {}).values())
        return tuple(
            name for name, c in self._log.columns.items() if id(c) not in used and name not in named
        )
