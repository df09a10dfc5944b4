"""Commands as they were some time ago, and signals between the steps of a simulation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

NEAREST: Final = 0.499
"""Of a step: what is stamped up to so long after it happens at it, what is later at the next."""

_ROUNDED = 1e-6  # of a step


def delayed(values: FloatArray, past: int, steps: int, shift: FloatArray) -> FloatArray:
    """Commands of each trial, interpolated linearly between steps as MuJoCo's own delay does.

    Args:
        values: (n_segments, past + ..., width) held commands; index `past` is the start.
        past: steps before the start.
        steps: steps wanted.
        shift: (n, n_segments, width) age in steps.

    Returns:
        (n, n_segments, steps, width).
    """
    n, n_segments, width = shift.shape
    if not shift.any():
        return np.broadcast_to(values[None, :, past : past + steps], (n, *values[:, :steps].shape))
    out = np.empty((n, n_segments, steps, width))
    for row in range(n):
        for column in range(width):
            for some, age in _alike(shift[row, :, column]):
                position = past - min(age, float(past))
                whole = int(np.floor(position))
                part = position - whole
                out[row, some, :, column] = values[some, whole : whole + steps, column]
                if part:  # an age that rounding loses ends where the values do
                    late = values[some, whole + 1 : whole + 1 + steps, column]
                    out[row, some, :, column] *= 1 - part
                    out[row, some, :, column] += part * late
    return out


def made_delay(delay: ArrayLike, step: float) -> FloatArray:
    """What MuJoCo makes of an actuator's `delay`: one of less than a step is a whole step."""
    asked = np.asarray(delay, dtype=float)
    return np.where(asked > 0, np.maximum(asked, step), 0.0)


def _alike(ages: FloatArray) -> Iterator[tuple[slice, float]]:
    """All segments at once where they have the same age, else one by one."""
    if (ages == ages[0]).all():
        yield slice(None), float(ages[0])
    else:
        for s, age in enumerate(ages):
            yield slice(s, s + 1), float(age)


def one_if_alike(*values: FloatArray) -> tuple[FloatArray, ...]:
    """Arrays with a row for each variant, or with one row where all variants are alike in all."""
    alike = all((each == each[:1]).all() for each in values)
    return tuple(each[:1] for each in values) if alike else values


def at_index(
    series: FloatArray,
    segment: NDArray[np.intp],
    index: FloatArray,
    jumps: NDArray[np.bool_] | None = None,
    instant: FloatArray | None = None,
) -> FloatArray:
    """Values of segments at fractional indices, (n, rows).

    They are interpolated linearly, but for those between which they jump: before the jump it is
    the value before it, and from then on that after it.

    Args:
        series: (n, n_segments, steps).
        segment: (rows,) which segment each is of.
        index: (n, rows) or (1, rows).
        jumps: (n or 1, n_segments, steps) whether the series jumps at a step; nowhere by default.
        instant: as `index`, where it is counted from jumps; `index` itself by default.
    """
    last = series.shape[2] - 1
    if instant is None:
        instant = index
    index = np.clip(index, 0, last)
    whole = np.minimum(index.astype(np.int64), last - 1)
    part = index - whole
    if jumps is not None:
        jumped = _at(jumps, segment, whole + 1)
        part = np.where(jumped, instant + _ROUNDED >= whole + 1, part)
    between: FloatArray = _at(series, segment, whole) * (1 - part)
    between += _at(series, segment, whole + 1) * part
    return between


def jumps_at(jumps: FloatArray, segment: NDArray[np.intp], instant: FloatArray) -> FloatArray:
    """Of (n or 1, n_segments, steps) jumps those that come at just these instants, (n or 1, rows).

    Args:
        jumps: by how much.
        segment: (rows,) which segment each is of.
        instant: (n or 1, rows) steps.
    """
    step = np.clip(np.round(instant), 0, jumps.shape[2] - 1)
    there = np.abs(instant - step) < _ROUNDED
    found: FloatArray = np.where(there, _at(jumps, segment, step.astype(np.int64)), 0.0)
    return found


def nearest_step(instant: FloatArray) -> FloatArray:
    """The step at which what is stamped with an instant happens, of instants in steps."""
    return np.ceil(instant - NEAREST)


def _at(values: NDArray[Any], segment: NDArray[np.intp], index: NDArray[np.intp]) -> NDArray[Any]:
    """Of (n or 1, n_segments, steps) those of (rows,) segments at (n or 1, rows) steps."""
    if len(index) == 1:
        found: NDArray[Any] = values[:, segment, index[0]]
    else:
        rows = np.arange(len(index))[:, None] if len(values) > 1 else 0
        found = values[rows, segment, index]
    return found
