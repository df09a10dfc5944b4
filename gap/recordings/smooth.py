"""Signals without their noise, and how fast they change.

A local cubic fitted to the samples around each instant (Savitzky and Golay, Analytical Chemistry
36, 1964) has no lag, unlike a causal filter.

    smoothed = Smoothed(recording.time, np.stack([hip, knee]))
    smoothed.at(time), smoothed.slope_at(time)      # (n, 2) each
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

FloatArray = NDArray[np.float64]

_WINDOW = 0.05  # s; short against a leg's motion, long against the encoder's steps
_ORDER = 3
_FEWEST_SAMPLES = 7
_ROUNDING = 1e-6  # of a step


class Smoothed:
    """Some signals on one clock.

    Args:
        time: (T,) s, increasing.
        signals: (k, T) samples.

    Attributes:
        step: spacing of the uniform grid that they were brought to [s].
        values: (k, n) on that grid.
        slopes: (k, n) derivatives on that grid [1/s].
    """

    def __init__(self, time: FloatArray, signals: FloatArray):
        step = float(np.median(np.diff(time)))
        steps = int(np.floor((time[-1] - time[0]) / step + _ROUNDING))
        self._grid = time[0] + step * np.arange(steps + 1)
        samples = max(_FEWEST_SAMPLES, round(_WINDOW / step))
        samples = min(samples | 1, (len(self._grid) - 1) | 1)  # odd, and no longer than the log
        order = min(_ORDER, samples - 1)
        resampled = np.stack([np.interp(self._grid, time, row) for row in signals])
        if len(self._grid) <= samples:
            samples, order = 1, 0
        self.step = float(self._grid[1] - self._grid[0])
        self.values: FloatArray = savgol_filter(resampled, samples, order)
        self.slopes: FloatArray = (
            savgol_filter(resampled, samples, order, deriv=1, delta=step)
            if order
            else np.gradient(resampled, step, axis=1)
        )

    def at(self, time: FloatArray) -> FloatArray:
        """(n, k) values at (n,) instants, held at the ends."""
        return self._between(self.values, time)

    def slope_at(self, time: FloatArray) -> FloatArray:
        """(n, k) derivatives at (n,) instants, held at the ends."""
        return self._between(self.slopes, time)

    def _between(self, rows: FloatArray, time: FloatArray) -> FloatArray:
        last = rows.shape[1] - 1
        index = np.clip((time - self._grid[0]) / self.step, 0, last)
        whole = np.minimum(index.astype(np.intp), last - 1)
        part = index - whole
        between: FloatArray = rows[:, whole] * (1 - part) + rows[:, whole + 1] * part
        return between.T
