"""A log of the robot: time-stamped joint signals, checked as they are loaded.

recording = Recording.load("walk.csv")         # .csv, .parquet or .npz
recording.joints                               # ("hip", "knee")
recording.signal("knee", "position")           # (T,) rad, or None where it was not logged
recording.between(2.0, 4.0).save("part.npz")

One column per signal, `<joint>/<signal>`, beside `time` in seconds; SI units and radians; the joint
is everything before the last slash. Optional: of the base `base/position_x…z` and
`base/linear_velocity_x…z` (world frame), `base/quaternion_w…z` (base to world),
`base/angular_velocity_x…z` (base frame), as a MuJoCo free joint has them; where nobody measures
those, of an inertial unit what `recordings.imu` says, and of feet `<foot>/contact` (0 or 1) or
`<foot>/force` (in any unit); the supply's `voltage`; and `<joint>/current`, which is kept though
nothing reads it. Every joint has a `position`, and at least one target is logged: of a joint, or of
an actuator, `<actuator>/position_target`, where that drives a tendon or a site and so no joint
alone. A recording that cannot be used raises InputError: one line that says where, what, and how to
mend it.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from walkerkit.gap.errors import InputError, closest, one_line, refusal, some
from walkerkit.gap.recordings.files import describe_row, read, write
from walkerkit.gap.recordings.one_clock import on_one_clock
from walkerkit.gap.recordings.spans import Spans, kept_rows
from walkerkit.gap.recordings.stamps import coarse_stamps
from walkerkit.gap.recordings.wiring_errors import WiringError

Array = npt.NDArray[np.float64]

SIGNALS = (
    "position",
    "velocity",
    "effort",
    "position_target",
    "velocity_target",
    "effort_target",
    "voltage_target",
)
_MEASURED, TARGETS = SIGNALS[:3], SIGNALS[3:]
MAY_BE_EMPTY = ("velocity", "effort", "current", "voltage")
"""Signals of which a column without any number is one that was not logged."""
QUATERNION = tuple(f"base/quaternion_{axis}" for axis in "wxyz")
BASE = QUATERNION + tuple(
    f"base/{quantity}_{axis}"
    for quantity in ("position", "linear_velocity", "angular_velocity")
    for axis in "xyz"
)
IMU = (
    *(f"base/imu_quaternion_{axis}" for axis in "wxyz"),
    *(f"base/imu_{q}_{axis}" for q in ("angular_velocity", "acceleration") for axis in "xyz"),
)
FOOT_SIGNALS = ("contact", "force")
LARGEST = 1e9
"""Anything beyond this is no measurement, in whichever unit of the SI."""
LONGEST_STEP = 0.2
"""A median step from here on is taken for milliseconds or less [s]; 1 kHz in milliseconds is 1."""

_FEW = 0.1  # of the rows, which can be spared
_RESET, _MOST_RESETS = 10.0, 3  # median steps back, at a few places: no rows out of order


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Recording:
    """Signals of one run of the robot.

    Attributes:
        name: label, unique among the recordings used together; the file's stem.
        time: (T,) s, strictly increasing; starts wherever the file does.
        columns: column name to (T,) samples, read-only, in the file's order.
        source: the file that the rows come from.
        unused: the file's columns that nothing uses, and velocities, efforts, currents and voltages
            without any number; they are not kept.
        notes: what a user should know about the data.
        wiring: errors of wiring that were mended in the columns.
        part_of: the recording that this was cut from; it knows the commands before.
        file_rows: (T,) which row of the file each is, counted from 0, where some were left out.
        skipped: from when to when it was left out [s]; nothing goes on across that.
        imported: its rows are not those of the source, of which they were made.
        errors: standard deviations of the base's state where that is estimated and not measured,
            (T,) each, by column; of its orientation `base/orientation_x…z` about its own axes.

    Raises:
        InputError: the data break the contract of this module.
    """

    name: str
    time: Array
    columns: Mapping[str, Array]
    source: Path | None = None
    unused: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    wiring: tuple[WiringError, ...] = ()
    part_of: Recording | None = None
    file_rows: npt.NDArray[np.intp] | None = None
    skipped: Spans = ()
    imported: bool = False
    errors: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._check_names()
        time = self._numbers("time", self.time)
        columns = {name: self._numbers(name, values) for name, values in self.columns.items()}
        empty = tuple(
            name
            for name, values in columns.items()
            if _split(name)[1] in MAY_BE_EMPTY and np.isnan(values).all()
        )
        columns = {name: values for name, values in columns.items() if name not in empty}
        if time.size < 2:
            raise self._error(f"too few rows of data ({time.size}). At least two are needed")
        for name, values in columns.items():
            if values.size != time.size:
                raise self._error(
                    f"column {name!r} has {values.size} samples and 'time' has {time.size}. "
                    "Put all columns on one clock"
                )
        self._check_clocks(columns)
        for name, values in {"time": time, **columns}.items():
            self._check_finite(name, values)
        self._check_time(time)
        self._check_units(columns)
        for values in (time, *columns.values()):
            values.setflags(write=False)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "columns", MappingProxyType(columns))
        object.__setattr__(self, "errors", MappingProxyType(dict(self.errors)))
        object.__setattr__(self, "unused", (*self.unused, *empty))

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy cannot be pickled or deep-copied.
        state = {one.name: getattr(self, one.name) for one in fields(self)}
        plain = {name: dict(state[name]) for name in ("columns", "errors")}
        return functools.partial(Recording, **state | plain), ()

    def __repr__(self) -> str:
        return (
            f"<Recording {self.name!r}: joints {', '.join(self.joints)}; "
            f"{self.duration:.4g} s at {self.rate:.4g} Hz>"
        )

    @functools.cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in order of their first column."""
        return tuple(
            dict.fromkeys(
                joint
                for joint, _ in map(_split, self.columns)
                if f"{joint}/position" in self.columns
            )
        )

    @functools.cached_property
    def commanded(self) -> tuple[str, ...]:
        """Names that have a target and no position: of actuators, as far as a log can tell."""
        named = (joint for joint, signal in map(_split, self.columns) if signal in TARGETS)
        return tuple(dict.fromkeys(name for name in named if name not in self.joints))

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def rate(self) -> float:
        """One over the median time step [Hz]."""
        return float(1.0 / np.median(np.diff(self.time)))

    def signal(self, joint: str, signal: str) -> Array | None:
        """One signal of one joint.

        Args:
            joint: name of the joint.
            signal: one of SIGNALS, or "current".

        Returns:
            (T,) SI units, read-only; None where the recording does not have it.

        Raises:
            InputError: there is no such kind of signal.
        """
        if signal not in (*SIGNALS, "current"):
            raise self._error(f"no signal is called {signal!r}{closest(signal, SIGNALS)}")
        return self.columns.get(f"{joint}/{signal}")

    def between(self, start: float, stop: float) -> Recording:
        """The part with start <= time < stop, named after the recording and the times.

        Args:
            start: first time [s].
            stop: time at which the part has ended [s].

        Returns:
            The part, on the same clock.

        Raises:
            InputError: fewer than two samples lie there.
        """
        first, last = np.searchsorted(self.time, (start, stop))
        if last - first < 2:
            raise self._error(
                f"{max(last - first, 0)} samples lie between {start:g} and {stop:g} s. "
                f"Choose times from {self.time[0]:g} to {self.time[-1]:g} s with at least two"
            )
        return replace(
            self,
            name=f"{self.name}[{start:g}:{stop:g}]",
            time=self.time[first:last],
            columns={name: values[first:last] for name, values in self.columns.items()},
            errors={name: values[first:last] for name, values in self.errors.items()},
            part_of=self.whole,
            file_rows=None if self.file_rows is None else self.file_rows[first:last],
        )

    def without(self, *spans: tuple[float, float]) -> Recording:
        """The recording without some spans of time; what is simulated starts anew after each.

        Args:
            spans: first time [s], and the time [s] from which on it is kept again.

        Raises:
            InputError: a span has no sample, or fewer than two are left.
        """
        kept = kept_rows(self.time, spans, str(self.source or self.name))
        rows = np.arange(self.time.size) if self.file_rows is None else self.file_rows
        return replace(
            self,
            time=self.time[kept],
            columns={name: values[kept] for name, values in self.columns.items()},
            file_rows=rows[kept],
            skipped=(*self.skipped, *spans),
            notes=(*self.notes, *_left_out(spans)),
        )

    @property
    def starts_anew(self) -> npt.NDArray[np.bool_]:
        """(T − 1,) whether something was skipped between a sample and the next."""
        anew = np.zeros(self.time.size - 1, dtype=bool)
        for start, _ in self.skipped:
            before = int(np.searchsorted(self.time, start)) - 1
            if 0 <= before < anew.size:
                anew[before] = True
        return anew

    @property
    def whole(self) -> Recording:
        """The recording that this is a part of, or itself."""
        return self.part_of or self

    @classmethod
    def load(cls, path: str | Path, *, skip: Spans = ()) -> Recording:
        """Reads a recording.

        Args:
            path: a .csv, .parquet or .npz file.
            skip: from when to when it is left out [s], whatever is wrong with it there.

        Returns:
            The recording, with `unused` and `notes` filled in.

        Raises:
            InputError: the file cannot be read, or breaks the contract of this module.
        """
        path = Path(path)
        names: list[str] = []

        def choose(found: list[str]) -> list[str]:
            names.extend(name for name in found if name)  # a comma too many at the header's end
            _check_header(path, names)
            return ["time", *_used(names)]

        columns, notes = read(path, choose)
        unused = tuple(name for name in names if name != "time" and name not in columns)
        columns = {name: _without_none(values) for name, values in columns.items()}
        numeric = all(values.dtype.kind in "iuf" for values in columns.values())
        rows, held = None, tuple[str, ...]()
        if numeric:  # else the constructor says which cell is no number
            one = on_one_clock(columns)
            columns, rows, held = one.columns, one.rows, one.notes
        if skip and len({values.size for values in columns.values()}) == 1:
            kept = kept_rows(_seconds(path, columns["time"]), skip, str(path))
            rows = (np.arange(kept.size) if rows is None else rows)[kept]
            columns = {name: values[kept] for name, values in columns.items()}
            held = (*held, *_left_out(skip))
        recording = cls(
            name=path.stem,
            time=columns.pop("time"),
            columns=columns,
            source=path,
            unused=unused,
            file_rows=rows,
            skipped=tuple(skip),
        )
        return replace(recording, notes=(*notes, *held, *remarks(recording)))

    def save(self, path: str | Path) -> None:
        """Writes the recording so that `load` gives the same numbers.

        Columns that nothing uses are not written: they were never kept.

        Args:
            path: a .csv, .parquet or .npz file; replaced in one step where it exists.

        Raises:
            InputError: the format is unknown, or the path cannot be a file.
        """
        write(Path(path), {"time": self.time, **self.columns})

    def _error(self, problem: str) -> InputError:
        return refusal(f"{self.source or f'recording {self.name!r}'}: {problem}.")

    def row(self, row: int) -> str:
        """Where one of its rows, counted from 0, is in the file: its number, and its line."""
        source = None if self.imported else self.source
        return describe_row(source, row if self.file_rows is None else self.file_rows[row])

    def _check_names(self) -> None:
        joints = {joint for joint, signal in map(_split, self.columns) if signal == "position"}
        used = _used(self.columns)
        for name in self.columns:
            joint, signal = _split(name)
            if name not in used:
                raise self._error(f"nothing uses the column {name!r}. Name it in `unused` only")
            # A target alone may be an actuator's; whether it is, the model says.
            if signal in SIGNALS and joint not in joints and not (joints and signal in TARGETS):
                raise self._error(
                    f"joint {joint!r} has {name!r} but no position{closest(joint, joints)}. "
                    f"Add '{joint}/position' or rename the column"
                )
        if not joints:
            raise self._error(
                f"no joint: no column is called '<joint>/position'{_some(self.unused)}. "
                "Name one column per signal, such as 'knee/position'"
            )
        if not any(_split(name)[1] in TARGETS for name in self.columns):
            raise self._error(
                f"no joint has a target: add the command that was sent, such as "
                f"'{min(joints)}/position_target' (or velocity_target, effort_target, "
                "voltage_target)"
            )
        for whole in (QUATERNION, IMU[:4], IMU[4:7], IMU[7:]):
            missing = [name for name in whole if name not in self.columns]
            if 0 < len(missing) < len(whole):
                what = whole[0].rpartition("_")[0]
                raise self._error(
                    f"{what} lacks {missing[0]!r}. Log all {len(whole)} columns of it, or none"
                )

    def _numbers(self, name: str, values: npt.ArrayLike) -> Array:
        """A float64 copy of a column, or the first entry that is no number."""
        array = np.asarray(values)
        if array.ndim != 1:
            raise self._error(
                f"column {name!r} has the shape {array.shape}. Give it one dimension, (T,)"
            )
        if array.dtype.kind in "iuf":
            return array.astype(np.float64)
        numbers = np.empty(array.size)
        for row, value in enumerate(array):
            try:
                if array.dtype.kind not in "OSU":  # float() would take dates and truth values
                    raise TypeError
                numbers[row] = np.nan if value is None else float(value)
            except (TypeError, ValueError):
                raise self._error(
                    f"column {name!r} has {str(value)[:40]!r} at {self.row(row)}: no number. "
                    "Write plain numbers in SI units, time in seconds"
                ) from None
        return numbers

    def _check_clocks(self, columns: Mapping[str, Array]) -> None:
        empty = [
            name
            for name, values in columns.items()
            if _split(name)[1] in _MEASURED and np.mean(np.isnan(values)) > _FEW
        ]
        if len(empty) > 1:
            signals = tuple(f"/{signal}" for signal in _MEASURED)
            raise self._error(
                f"columns {some(empty)} are empty in rows that have others: each came on a clock "
                "of its own. Interpolate them over time where they are empty (pandas: names = "
                f"[n for n in frame if n.endswith({signals})]; "
                "frame[names] = frame.set_index('time')[names].interpolate('index', "
                "limit_direction='both').to_numpy()), and leave the targets "
                "as they are: they hold"
            )

    def _check_finite(self, name: str, values: Array) -> None:
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            remedy = _filled(name, values, bad)
            raise self._error(
                f"column {name!r} is empty, NaN or infinite in {bad.size} of {values.size} rows, "
                f"first {values[bad[0]]} at {self.row(bad[0])}. {remedy}"
            )

    def _check_time(self, time: Array) -> None:
        steps = np.diff(time)
        bad = np.flatnonzero(steps <= 0)
        coarse = coarse_stamps(time)
        if coarse:
            raise self._error(f"column 'time' {coarse}")
        if bad.size:
            before, after = float(time[bad[0]]), float(time[bad[0] + 1])
            if before - after > _RESET * np.median(np.abs(steps)) and bad.size <= _MOST_RESETS:
                raise self._error(
                    f"column 'time' jumps back at {self.row(bad[0] + 1)}: {before!r} s, then "
                    f"{after!r} s: the clock was reset. Cut the file there into two recordings"
                )
            raise self._error(
                f"column 'time' {'repeats' if before == after else 'goes backwards'} at "
                f"{self.row(bad[0] + 1)}: {before!r} s, then {after!r} s. "
                "Sort the rows by time and delete repeated ones"
            )
        step = float(np.median(steps))
        if step >= LONGEST_STEP:
            unit, factor = "nanoseconds", "1e9"
            if step < 1e6 * LONGEST_STEP:
                unit, factor = "microseconds", "1e6"
            if step < 1e3 * LONGEST_STEP:
                unit, factor = "milliseconds", "1e3"
            raise self._error(
                f"column 'time' has a median step of {step:g} s and looks like {unit}. Divide it "
                f"by {factor} to have seconds; a log that is so slow cannot be compared"
            )

    def _check_units(self, columns: Mapping[str, Array]) -> None:
        for name, values in columns.items():
            beyond = np.flatnonzero(np.abs(values) > LARGEST)
            if beyond.size:
                raise self._error(
                    f"column {name!r} has {values[beyond[0]]:g} at {self.row(beyond[0])}, over "
                    f"{LARGEST:g} in any SI unit. Delete such rows, or fill them"
                )
        for quaternion in (QUATERNION, IMU[:4]):
            if quaternion[0] not in columns:
                continue
            norm = np.linalg.norm([columns[name] for name in quaternion], axis=0)
            off = np.flatnonzero(np.abs(norm - 1.0) > 0.01)
            if off.size:
                raise self._error(
                    f"columns '{quaternion[0]}…z' have norm {norm[off[0]]:g} at "
                    f"{self.row(off[0])}. Log unit quaternions"
                )


def _split(column: str) -> tuple[str, str]:
    joint, _, signal = column.rpartition("/")
    return joint, signal


def _used(names: Iterable[str]) -> list[str]:
    """The columns that a recording keeps, in their order."""
    names = list(names)
    measured = {joint for joint, signal in map(_split, names) if signal == "position"}

    def used(name: str) -> bool:
        joint, signal = _split(name)
        if not joint or not joint.isprintable() or joint.startswith(" "):
            return name == "voltage"
        return (
            signal in (*SIGNALS, *FOOT_SIGNALS)
            or name in (*BASE, *IMU)
            or (signal == "current" and joint in measured)
        )

    return [name for name in names if used(name)]


def _check_header(path: Path, names: list[str]) -> None:
    twice = next((name for row, name in enumerate(names) if name in names[:row]), None)
    if twice is not None:
        raise refusal(f"{path}: two columns are called {twice!r}. Rename one.")
    if "time" not in names:
        raise refusal(
            f"{path}: no column 'time'{closest('time', names) or _some(names)}. "
            "Name the column of seconds 'time'."
        )


def _some(names: Iterable[str]) -> str:
    shown = [repr(name) for name in names][:5]
    return f" (there are {', '.join(shown)})" if shown else ""


def _without_none(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A column that has no cell at all, as one of empty numbers."""
    if values.dtype == object and values.ndim == 1 and all(value is None for value in values):
        return np.full(values.size, np.nan)
    return values


def _seconds(path: Path, time: npt.NDArray[Any]) -> Array:
    """The times of a file that is cut before it is checked."""
    try:
        return time.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise refusal(
            f"{path}: column 'time' has what is no number: {one_line(error)}. Write seconds."
        ) from None


def _left_out(spans: Spans) -> Iterator[str]:
    for start, stop in spans:
        first, last = (f"{t:.6g}" if np.isfinite(t) else "its end" for t in (start, stop))
        yield f"{'its beginning' if np.isinf(start) else first} to {last} s was skipped, as asked"


def remarks(recording: Recording) -> Iterator[str]:
    """What a user should know about a log that can be used: its sampling, its joints."""
    steps = np.diff(recording.time)[~recording.starts_anew] * 1e3
    if not steps.size:
        return
    low, middle, high = np.quantile(steps, (0.0, 0.5, 1.0))
    if high > 1.9 * middle or low < 0.5 * middle:  # from a missed sample on
        yield (
            f"irregular sampling: steps of {low:.3g} to {high:.3g} ms, median {middle:.3g} ms, "
            f"longest at {recording.time[:-1][~recording.starts_anew][np.argmax(steps)]:.6g} s"
        )
    for joint in recording.joints:
        if np.ptp(recording.columns[f"{joint}/position"]) == 0:
            yield f"joint {joint!r} never moves"


def _filled(name: str, values: Array, bad: npt.NDArray[np.intp]) -> str:
    """How to go on from cells without a number so that nothing is lost."""
    if bad.size == values.size:
        return "Log it, or delete the column"
    if name == "time":
        return "Delete such rows"
    # What pandas fills is empty; what is infinite has to be made so first.
    emptied, where = "", "where it is empty"
    if np.isinf(values).any():
        emptied = ".replace([float('inf'), -float('inf')], float('nan'))"
        where = "where it is empty or infinite"
    if _split(name)[1] in TARGETS:
        how = f"frame[{name!r}]{emptied}.ffill()" if emptied else "ffill"
        return f"Fill such cells: a target holds until the next one (pandas: {how})"
    optional = ", or delete the column" if _split(name)[1] in MAY_BE_EMPTY else ""
    if bad.size <= _FEW * values.size:
        return f"Delete such rows{optional}"
    return (
        f"Interpolate it over time {where} (pandas: frame.set_index('time')[{name!r}]{emptied}"
        f".interpolate('index').to_numpy()){optional}"
    )
