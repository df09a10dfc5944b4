"""The column map: which of a log's columns is which signal of which joint, in which unit.

    given = ColumnMap.load("map.toml")
    given.to_toml()                              # the same bytes, where we wrote them

    [time]
    clock = "header"          # which of the log's clocks; a CSV's clocks are columns
    unit = "ns"               # s, ms, us or ns
    # rate = 200.0            # Hz: samples are counted, and no stamp is believed

    [signals.position]
    from = "/joint_states/{}/position"
    unit = "rad"

    [joints]
    knee = {log = "left_knee", sign = -1, offset = 0.1}

A signal of a joint is the column that has the joint's `log` in place of `{}`. In the model's terms
a position is sign × (the log's, in SI units) + offset; velocities and efforts have the sign alone.
All sections may be left out: what a map does not say is guessed.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from walkerkit.gap.errors import InputError, closest, one_line, refusal
from walkerkit.gap.recordings.files import check_file
from walkerkit.gap.recordings.given import check_keys
from walkerkit.gap.recordings.recording import SIGNALS

TIME_UNITS: Final = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
"""Nanoseconds of each."""

OF_RANGE: Final = ("m100", "percent")
"""Units of positions that are parts of the joint's `range`: -100 to 100, and 0 to 100."""

_DEGREE = math.pi / 180
UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "position": {"rad": 1.0, "deg": _DEGREE, "rev": 2 * math.pi, "m": 1.0, "mm": 1e-3},
    "velocity": {
        **{"rad/s": 1.0, "deg/s": _DEGREE, "rev/s": 2 * math.pi, "rpm": math.pi / 30},
        **{"m/s": 1.0, "mm/s": 1e-3},
    },
    "effort": {"N·m": 1.0, "Nm": 1.0, "mN·m": 1e-3, "mNm": 1e-3, "N": 1.0, "kN": 1e3},
    "voltage": {"V": 1.0, "mV": 1e-3},
}
"""Kind of signal to its units, each with what it is in SI units."""

_HEAD = """\
# How walkerkit reads this log. Correct what is wrong, and give it back with --map.
# A signal of a joint is the column with the joint's "log" in place of {}.
# position = sign * (the log's in SI units) + offset; velocities and efforts have the sign alone.
"""
_BARE = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True, kw_only=True)
class TimeMap:
    """How rows are stamped.

    Attributes:
        clock: one of the log's clocks; empty where the log has none.
        unit: one of `TIME_UNITS`.
        rate: samples a second; the clock's unit then does not matter.
    """

    clock: str = ""
    unit: str = "s"
    rate: float | None = None

    def __post_init__(self) -> None:
        if self.unit not in TIME_UNITS:
            raise refusal(
                f"the unit of time is {self.unit!r}{closest(self.unit, TIME_UNITS)}. Write one of "
                f"{', '.join(TIME_UNITS)}."
            )
        if self.rate is not None and not (math.isfinite(self.rate) and self.rate > 0):
            raise refusal(f"rate is {self.rate:g} Hz. Write the samples a second, above 0.")


@dataclass(frozen=True, kw_only=True)
class SignalMap:
    """Where a signal is.

    Attributes:
        pattern: name of a column, with `{}` where the joint's name is.
        unit: its unit, or how many SI units its unit is.
        order: joints of the model in the order of its columns, where these have places for names
            and others have not; by default each joint's `log` says which is its own.
        clock: of its samples, where it is another than that of the rows.
        rate: samples a second, where it has no clock and another rate than the rows.
    """

    pattern: str
    unit: str | float
    order: tuple[str, ...] | None = None
    clock: str | None = None
    rate: float | None = None

    def column(self, joint: str, how: JointMap) -> str | None:
        """The log's column of a joint of the model; None where it is not in the order."""
        if self.order is None:
            return self.pattern.replace("{}", how.log)
        if joint not in self.order:
            return None
        return self.pattern.replace("{}", str(self.order.index(joint)))


@dataclass(frozen=True, kw_only=True)
class JointMap:
    """How a joint of the model is in the log.

    Attributes:
        log: its name there, or its place.
        sign: 1, or -1 where it turns the other way in the log.
        offset: added to positions [rad; m].
        unit: of its positions, where it is another than that of the rest.
        range: positions at the ends of a range that the log has parts of [rad; m].
    """

    log: str
    sign: int = 1
    offset: float = 0.0
    unit: str | None = None
    range: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class ColumnMap:
    """How a log is read; sections that are None are to be guessed.

    Attributes:
        time: how rows are stamped.
        signals: kind of signal to where it is; may be some of them.
        joints: joint of the model to how it is in the log.
        columns: other columns of the recording to the log's, in SI units.
        episodes: those of a data set that are read, by their numbers; all by default.
        source: file that it is from.
    """

    time: TimeMap | None = None
    signals: Mapping[str, SignalMap] = field(default_factory=dict)
    joints: Mapping[str, JointMap] | None = None
    columns: Mapping[str, str] | None = None
    episodes: tuple[int, ...] | None = None
    source: Path | None = None

    @classmethod
    def load(cls, path: str | Path) -> ColumnMap:
        """Reads a map.

        Raises:
            InputError: it is no TOML file, or says what no map says.
        """
        path = Path(path)
        check_file(path)
        try:
            with path.open("rb") as file:
                content = tomllib.load(file)
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
            raise refusal(f"{path}: not a TOML file: {one_line(error)}. Mend it there.") from error
        try:
            return replace(_parsed(content), source=path)
        except InputError as error:
            raise refusal(f"{path}: {error}") from None

    def to_toml(self) -> str:
        """The map as a file has it."""
        lines = [_HEAD]
        if self.episodes is not None:
            lines.append(f"episodes = {list(self.episodes)}\n")
        if self.time is not None:
            lines.append("[time]")
            if self.time.clock:
                lines.append(f"clock = {_text(self.time.clock)}")
            lines.append(
                f"unit = {_text(self.time.unit)}"
                if self.time.rate is None
                else f"rate = {self.time.rate!r}"
            )
            lines.append("")
        for kind, signal in self.signals.items():
            lines += [f"[signals.{kind}]", f"from = {_text(signal.pattern)}"]
            lines.append(f"unit = {_value(signal.unit)}")
            lines += [f"order = {_list(signal.order)}"] if signal.order else []
            lines += [f"clock = {_text(signal.clock)}"] if signal.clock else []
            lines += [f"rate = {signal.rate!r}"] if signal.rate else []
            lines.append("")
        if self.joints is not None:
            lines.append("[joints]")
            lines += [f"{_key(name)} = {_joint_text(joint)}" for name, joint in self.joints.items()]
            lines.append("")
        if self.columns:
            lines.append("[columns]")
            lines += [f"{_key(name)} = {_text(column)}" for name, column in self.columns.items()]
            lines.append("")
        return "\n".join(lines).rstrip("\n") + "\n"


def _parsed(content: Mapping[str, Any]) -> ColumnMap:
    check_keys("the map", content, ("episodes", "time", "signals", "joints", "columns"))
    episodes = content.get("episodes")
    numbers = isinstance(episodes, list) and all(type(one) is int for one in episodes)
    if episodes is not None and not numbers:
        raise refusal(f"episodes is {episodes!r}. Write a list of numbers, such as [0, 2].")
    time = content.get("time")
    if time is not None:
        check_keys("[time]", _table("time", time), ("clock", "unit", "rate"))
        time = TimeMap(**_typed("[time]", time, clock=str, unit=str, rate=float))
    signals = {}
    for kind, entry in _table("signals", content.get("signals", {})).items():
        if kind not in SIGNALS:
            raise refusal(
                f"[signals.{kind}] is none of a recording's signals{closest(kind, SIGNALS)}. They "
                f"are {', '.join(SIGNALS)}."
            )
        signals[kind] = _signal(kind, entry)
    joints = content.get("joints")
    if joints is not None:
        joints = {name: _joint(name, entry) for name, entry in _table("joints", joints).items()}
    columns = content.get("columns")
    if columns is not None:
        columns = _table("columns", columns)
        _typed("[columns]", columns, **dict.fromkeys(columns, str))
    return ColumnMap(
        time=time,
        signals=signals,
        joints=joints,
        columns=columns,
        episodes=None if episodes is None else tuple(episodes),
    )


def _signal(kind: str, entry: Any) -> SignalMap:
    label = f"[signals.{kind}]"
    check_keys(label, _table(f"signals.{kind}", entry), ("from", "unit", "order", "clock", "rate"))
    units = UNITS[kind.removesuffix("_target")]
    unit = entry.get("unit", "")
    known = (*units, *(OF_RANGE if kind.startswith("position") else ()))
    factor = isinstance(unit, int | float) and not isinstance(unit, bool) and unit != 0
    if unit != "" and not factor and unit not in known:
        raise refusal(
            f"{label} has the unit {unit!r}{closest(str(unit), known)}. Write one of "
            f"{', '.join(known)}, or the number of SI units that one of the log's is."
        )
    order = entry.get("order")
    names = isinstance(order, list) and all(isinstance(name, str) for name in order)
    if order is not None and not (names and len(set(order)) == len(order)):
        raise refusal(f"{label} has order = {order!r}. List the model's joints, each once.")
    rest = {key: value for key, value in entry.items() if key not in ("unit", "order")}
    typed = _typed(label, rest, **{"from": str, "clock": str, "rate": float})
    return SignalMap(
        pattern=typed.pop("from", ""),
        unit=float(unit) if factor else str(unit),
        order=None if order is None else tuple(order),
        **typed,
    )


def _joint(name: str, entry: Any) -> JointMap:
    label = f"[joints] {name}"
    if isinstance(entry, str):
        return JointMap(log=entry)
    check_keys(label, _table(f"joints.{name}", entry), ("log", "sign", "offset", "unit", "range"))
    rest = {key: value for key, value in entry.items() if key not in ("sign", "range")}
    typed = _typed(label, rest, log=str, offset=float, unit=str)
    unit, sign, ends = typed.get("unit"), entry.get("sign", 1), entry.get("range")
    known = (*UNITS["position"], *OF_RANGE)
    if unit is not None and unit not in known:
        raise refusal(f"{label} has the unit {unit!r}. Write one of {', '.join(known)}.")
    if sign not in (1, -1):
        raise refusal(f"{label} has sign = {sign!r}. Write 1 or -1.")
    numbers = isinstance(ends, list) and [type(end) in (int, float) for end in ends]
    if ends is not None and numbers != [True, True]:
        raise refusal(f"{label} has range = {ends!r}. Write its two ends, such as [-1.5, 1.5].")
    return JointMap(
        **{"log": name, **typed},
        sign=int(sign),
        range=None if ends is None else (float(ends[0]), float(ends[1])),
    )


def _table(name: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise refusal(f"{name} = {value!r} is no table. Write [{name}] and its entries below.")
    return value


def _typed(label: str, table: Mapping[str, Any], **types: type) -> dict[str, Any]:
    """The entries, each of its type; a whole number may stand for a float."""
    found = {}
    for key, value in table.items():
        wanted = types[key]
        if wanted is float and type(value) is int:
            value = float(value)
        if type(value) is not wanted:
            word = "a number" if wanted is float else "text in quotes"
            raise refusal(f"{label} has {key} = {value!r}. Write {word}.")
        found[key] = value
    return found


def _joint_text(joint: JointMap) -> str:
    fields = [f"log = {_text(joint.log)}", f"sign = {joint.sign}", f"offset = {joint.offset!r}"]
    fields += [f"unit = {_text(joint.unit)}"] if joint.unit else []
    fields += [f"range = {list(joint.range)}"] if joint.range else []
    return "{" + ", ".join(fields) + "}"


def _list(names: tuple[str, ...]) -> str:
    return f"[{', '.join(map(_text, names))}]"


def _value(value: str | float) -> str:
    return _text(value) if isinstance(value, str) else repr(value)


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _text(name)
