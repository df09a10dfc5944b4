"""What a log means, guessed from the names in it and from the model.

    mapping, notes = complete(log, model, ColumnMap())

Whatever the given map says stays. What names and model do not decide is refused, with the lines of
a map that decide it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from walkerkit.gap.errors import InputError, closest, refusal
from walkerkit.gap.ingest.bag import CONTROLLER_STATE, HEADER, JOINT_STATE, RECEIVED
from walkerkit.gap.ingest.base_columns import base_columns
from walkerkit.gap.ingest.clocks import unit_of
from walkerkit.gap.ingest.column_map import ColumnMap, JointMap, SignalMap, TimeMap
from walkerkit.gap.ingest.log import FloatArray, Log
from walkerkit.gap.ingest.model import Model
from walkerkit.gap.ingest.patterns import Pattern, is_by_place, kind_of, match, patterns
from walkerkit.gap.ingest.signal_units import with_units
from walkerkit.gap.ingest.unitree import NOT_COMMANDED
from walkerkit.gap.ingest.words import parts
from walkerkit.gap.recordings.recording import LARGEST, SIGNALS

_PREFERRED = (JOINT_STATE, "LowState", "LowCmd", CONTROLLER_STATE)
_FIRST_CLOCKS = (HEADER, "header.stamp", "time", "__time", "timestamp")
_SHOWN = 8


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    """A pattern that may be a signal."""

    pattern: Pattern
    joints: Mapping[str, str]
    rank: tuple[int, ...]


def complete(log: Log, model: Model, given: ColumnMap) -> tuple[ColumnMap, tuple[str, ...]]:
    """A map that says all, from one that says some of it.

    Args:
        log: what was read.
        model: its joints give names, order and ranges.
        given: what is known.

    Returns:
        The map, and what was assumed that may be wrong.

    Raises:
        InputError: it is in doubt which column is what, or in which unit.
    """
    guess = _Guess(log, model, given)
    mapping = guess.mapping()
    mapping, told = with_units(log, model, mapping, given)
    return mapping, (*guess.notes, *told)


class _Guess:
    def __init__(self, log: Log, model: Model, given: ColumnMap):
        self._log, self._model, self._given = log, model, given
        self._patterns = patterns(log, model.joints)
        self.notes: list[str] = []

    def mapping(self) -> ColumnMap:
        """The map but for its units."""
        position = self._chosen("position", "")
        if position is None:
            raise self._none("position")
        joints = self._joints(position)
        signals = {"position": self._signal("position", position, joints)}
        for kind in SIGNALS[1:]:
            found = self._chosen(kind, position.pattern.topic)
            if found is not None:
                signals[kind] = self._signal(kind, found, joints)
                if kind == "position_target":
                    self._tell_gains(found.pattern)
        self._check_named(joints)
        if not any(kind.endswith("_target") for kind in signals):
            raise self._none("position_target")
        columns = self._given.columns
        if columns is None:
            columns = base_columns(self._log) if self._model.floats else {}
        return ColumnMap(
            time=self._time(position.pattern.topic),
            signals=signals,
            joints=joints,
            columns=columns,
            episodes=self._given.episodes,
            source=self._given.source,
        )

    def _chosen(self, kind: str, topic: str) -> _Candidate | None:
        """The pattern of a signal, None where the log seems to lack it."""
        said = self._given.signals.get(kind)
        if said is not None and said.pattern:
            return self._said(kind, said)
        found = [
            candidate
            for pattern in self._patterns.values()
            if kind_of(pattern, self._log) == kind and self._says_something(kind, pattern)
            if (candidate := self._candidate(kind, pattern, topic)) is not None
        ]
        if not found:
            return None
        best = max(candidate.rank for candidate in found)
        rivals = [candidate for candidate in found if candidate.rank == best]
        if len(rivals) > 1:
            names = [candidate.pattern.name for candidate in rivals]
            raise refusal(
                f"{self._log.path}: {kind} may be {' or '.join(map(repr, names[:_SHOWN]))}. Write "
                f'the one that it is into a map, [signals.{kind}] with from = "{names[0]}" for '
                "example, and give it with --map."
            )
        return rivals[0]

    def _candidate(self, kind: str, pattern: Pattern, topic: str) -> _Candidate | None:
        joints = self._as_given(pattern)
        if joints is None and (self._given.joints is None or kind != "position"):
            joints = match(pattern, self._log, self._model)
        if not joints:
            return None
        message = self._log.topics[pattern.topic].kind
        preferred = [k for k, name in enumerate(_PREFERRED) if message.endswith(name)]
        rank = (
            int(bool(topic) and pattern.topic == topic),
            len(joints),
            -preferred[0] if preferred else -len(_PREFERRED),
        )
        return _Candidate(pattern=pattern, joints=joints, rank=rank)

    def _as_given(self, pattern: Pattern) -> dict[str, str] | None:
        """The joints of a pattern, as the given map names them."""
        if self._given.joints is None:
            return None
        named = {name: joint.log for name, joint in self._given.joints.items()}
        return {name: log for name, log in named.items() if log in pattern.elements} or None

    def _said(self, kind: str, said: SignalMap) -> _Candidate:
        """What the given map calls a signal."""
        head, _, tail = said.pattern.partition("{}")
        elements = {
            name[len(head) : len(name) - len(tail)]: name
            for name in self._log.columns
            if name.startswith(head) and name.endswith(tail) and len(name) > len(head) + len(tail)
        }
        if "{}" not in said.pattern:
            elements = {"": said.pattern} if said.pattern in self._log.columns else {}
        if not elements:
            near = [p.name for p in self._patterns.values()]
            raise refusal(
                f"{self._log.path}: it has no column {said.pattern!r}, which the map names for "
                f"{kind}. It has {', '.join(map(repr, near[:_SHOWN]))}"
                f"{' and more' if len(near) > _SHOWN else ''}."
            )
        topic = self._log.columns[next(iter(elements.values()))].topic
        pattern = Pattern(name=said.pattern, topic=topic, elements=elements)
        joints = self._as_given(pattern) or match(pattern, self._log, self._model)
        if said.order is not None:
            joints = {joint: str(place) for place, joint in enumerate(said.order)}
        if not joints:
            raise self._unmatched(kind, pattern)
        return _Candidate(pattern=pattern, joints=joints, rank=())

    def _joints(self, position: _Candidate) -> dict[str, JointMap]:
        if self._given.joints is not None:
            return dict(self._given.joints)
        if is_by_place(position.pattern, position.joints):
            self.notes.append(
                f"{position.pattern.name} does not name its joints: its places were taken in the "
                f"order {', '.join(position.joints)}"
            )
        return {joint: JointMap(log=element) for joint, element in position.joints.items()}

    def _signal(self, kind: str, found: _Candidate, joints: Mapping[str, JointMap]) -> SignalMap:
        said = self._given.signals.get(kind) or SignalMap(pattern="", unit="")
        same = all(joints[j].log == e for j, e in found.joints.items() if j in joints)
        order = said.order
        if order is None and not same:
            by_place = {element: joint for joint, element in found.joints.items()}
            places = [str(k) for k in range(len(by_place))]
            if set(by_place) != set(places):
                raise self._unmatched(kind, found.pattern)
            order = tuple(by_place[place] for place in places)
            self.notes.append(
                f"{found.pattern.name} does not name its joints: its places were taken in the "
                f"order {', '.join(order)}"
            )
        return replace(
            said,
            pattern=found.pattern.name,
            order=order,
            clock=said.clock or self._own_clock(kind, found.pattern),
        )

    def _own_clock(self, kind: str, pattern: Pattern) -> str | None:
        """The clock of a table's commands, where it has one beside that of its states."""
        clocks = self._log.topics[pattern.topic].clocks
        return _of_commands(clocks) if kind.endswith("_target") else None

    def _says_something(self, kind: str, pattern: Pattern) -> bool:
        """Whether targets of speed and effort are more than the zeros of a position command."""
        if not kind.endswith("_target") or kind == "position_target":
            return not self._without_gain(kind, pattern)
        ignored = NOT_COMMANDED.get(kind.removesuffix("_target"))
        for name in pattern.elements.values():
            values = np.nan_to_num(self._log.columns[name].values)
            values = values[(np.abs(values) < LARGEST) & (values != ignored)]
            if values.any():
                return True
        return False

    def _without_gain(self, kind: str, pattern: Pattern) -> bool:
        """Whether a command of positions has gains beside it that are all 0."""
        gains = self._gains(pattern, "kp") if kind == "position_target" else []
        return bool(gains) and not any(values.any() for values in gains)

    def _gains(self, pattern: Pattern, gain: str) -> list[FloatArray]:
        """What a drive's command says of a gain of each joint, beside its position `q`."""
        if not pattern.name.endswith(("}.q", "}_q")):
            return []
        names = [f"{name[:-1]}{gain}" for name in pattern.elements.values()]
        found = [self._log.columns[name].values for name in names if name in self._log.columns]
        return [np.nan_to_num(values) for values in found]

    def _tell_gains(self, pattern: Pattern) -> None:
        """Says with which gains the drives were told to go there."""
        told = []
        for gain in ("kp", "kd"):
            values = [one[one != 0] for one in self._gains(pattern, gain)]
            known = np.concatenate(values) if values else np.zeros(0)
            if known.size:
                low, high = known.min(), known.max()
                told.append(f"{gain} {low:g}" + (f" to {high:g}" if high > low else ""))
        if told:
            self.notes.append(
                f"the commands have {' and '.join(told)}: a model with other gains, or with torque "
                "motors, takes them by `walkerkit servo`"
            )

    def _time(self, topic: str) -> TimeMap:
        if self._given.time is not None:
            return self._given.time
        clocks = self._log.topics[topic].clocks
        if self._log.rate is not None:
            return TimeMap(clock=next(iter(clocks), ""), rate=self._log.rate)
        if not clocks:
            return TimeMap()
        names = [name for name in clocks if name not in (RECEIVED, _of_commands(clocks))]
        first = next((name for name in _FIRST_CLOCKS if name in names), None)
        name = first or next(iter(names), next(iter(clocks)))
        return TimeMap(
            clock=name, unit="ns" if name in (HEADER, RECEIVED) else unit_of(name, clocks[name])
        )

    def _check_named(self, joints: Iterable[str]) -> None:
        for joint in joints:
            if joint not in self._model.joints:
                raise refusal(
                    f"{self._given.source or 'the map'}: joint {joint!r} is not in the model "
                    f"{self._model.source}{closest(joint, self._model.joints)}. Name one of "
                    f"{', '.join(self._model.joints)}."
                )

    def _unmatched(self, kind: str, pattern: Pattern) -> InputError:
        return refusal(
            f"{self._log.path}: {pattern.name!r} has {len(pattern.elements)} numbers, "
            f"{', '.join(list(pattern.elements)[:_SHOWN])}, and the model {self._model.source} has "
            f"{len(self._model.order)} driven joints, {', '.join(self._model.order[:_SHOWN])}. Say "
            f'in a map which is which, [joints] with {self._model.order[0]} = "'
            f'{next(iter(pattern.elements))}" and so on, and give it with --map.'
        )

    def _none(self, kind: str) -> InputError:
        """That no column is a signal, with those that it may be."""
        near = [p for p in self._patterns.values() if kind_of(p, self._log) == kind]
        if near:
            return self._unmatched(kind, near[0])
        names = [p.name for p in self._patterns.values()]
        listed = ", ".join(map(repr, names[:_SHOWN])) + (" and more" if names[_SHOWN:] else "")
        return refusal(
            f"{self._log.path}: no column looks like the {kind.replace('_', ' ')} of a joint. Its "
            f"columns are {listed}. Write which it is into a map, [signals.{kind}] with "
            f"from = {names[0] if names else '...'!r} for example, and give it with --map."
        )


def _of_commands(clocks: Iterable[str]) -> str | None:
    """The one of several clocks that is of commands."""
    names = list(clocks)
    found = [name for name in names if {"cmd", "command", "target", "des"} & {*parts(name)}]
    return found[0] if len(found) == 1 < len(names) else None
