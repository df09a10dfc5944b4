"""Rows of two clocks: targets are held, and the rows of the measurement are kept.

    one = on_one_clock({"time": ..., "knee/position": ..., "knee/position_target": ...})
    one.columns, one.notes

A log that is put together of two topics has a row for each stamp of either, with empty cells where
the other one has nothing. A target holds until the next one, so its empty cells are known. It acts
from the row whose stamp is nearest, which is half a step off at most and right on average. Rows
without any measurement, and those before the first targets, are left out. Nothing is interpolated:
cells of a measurement that are empty beside others of their row stay so, and are refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import some

FloatArray = NDArray[np.float64]

Values = NDArray[Any]

# What holds until it is told anew: targets, and what is told now and then beside them.
_HELD = ("position_target", "velocity_target", "effort_target", "voltage", "current")


@dataclass(frozen=True, kw_only=True)
class OneClock:
    """A log whose rows all measure something.

    Attributes:
        columns: name to samples.
        rows: which rows of the log these are, counted from 0; None for all.
        notes: what was done.
    """

    columns: dict[str, Values]
    rows: NDArray[np.intp] | None = None
    notes: tuple[str, ...] = ()


def on_one_clock(columns: Mapping[str, Values]) -> OneClock:
    """A log without empty targets, where its rows tell what they were.

    Args:
        columns: name to (T,) numbers, NaN where a cell is empty; with `time`.

    Returns:
        The log as it was, where nothing is to be done.
    """
    as_it_is = OneClock(columns=dict(columns))
    time = columns["time"]
    told = {name: values for name, values in columns.items() if name != "time"}
    if len({values.shape for values in columns.values()}) > 1 or time.ndim != 1:
        return as_it_is  # the recording says what is wrong with them
    if not np.isfinite(time).all():
        return as_it_is
    there = {name: ~np.isnan(values) for name, values in told.items()}
    known = [name for name in told if there[name].any()]
    sent = [name for name in known if _signal(name) in _HELD]
    held = [name for name in sent if not there[name].all()]
    measured = [there[name] for name in known if name not in sent]
    rows = np.any(measured, axis=0) if measured else np.ones(time.size, dtype=bool)
    stamps = time[rows]
    if (not held and rows.all()) or stamps.size < 2 or (np.diff(stamps) <= 0).any():
        return as_it_is
    found = {name: values[rows] for name, values in told.items()}
    unknown = np.zeros(stamps.size, dtype=bool)
    for name in sent:  # those without empty cells may be in the rows that are left out, too
        found[name] = _held(time[there[name]], told[name][there[name]], stamps)
        unknown |= np.isnan(found[name])
    if np.count_nonzero(~unknown) < 2:
        return as_it_is
    notes = [_note(held, time.size, stamps)]
    if unknown.any():
        notes.append(
            f"the first {np.count_nonzero(unknown)} rows, until {stamps[~unknown][0]:.6g} s, were "
            "left out, since the targets before the first ones are not in the log"
        )
    return OneClock(
        columns={"time": stamps[~unknown]} | {n: v[~unknown] for n, v in found.items()},
        rows=np.flatnonzero(rows)[~unknown],
        notes=tuple(notes),
    )


def _held(stamps: Values, values: Values, at: Values) -> FloatArray:
    """Samples that hold, at other instants; NaN before the first of them."""
    order = np.argsort(stamps, kind="stable")
    stamps, values = stamps[order], values[order]
    half = 0.5 * float(np.median(np.diff(at)))
    first_row = np.searchsorted(at, stamps - half)
    # Of what was sent after the last row, nothing shows.
    first_row[stamps > at[-1]] = at.size
    last = np.searchsorted(first_row, np.arange(at.size), side="right") - 1
    return np.where(last < 0, np.nan, values[np.maximum(last, 0)])


def _note(held: Sequence[str], rows: int, stamps: Values) -> str:
    what = (
        f"{some(held)} {'has' if len(held) == 1 else 'have'} empty cells, which hold the last value"
    )
    if not held:
        what = "some rows have targets only, which hold"
    if stamps.size == rows:
        return what
    half = 500 * float(np.median(np.diff(stamps)))
    return (
        f"{what}; the {stamps.size} of {rows} rows that measure something were kept, and a target "
        f"that came between two of them acts from the nearer one, {half:.2g} ms off at most"
    )


def _signal(column: str) -> str:
    return column.rpartition("/")[2]
