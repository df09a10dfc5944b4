"""Signals without their noise, and how fast they change.

A local cubic fitted to the samples around each instant (Savitzky and Golay, Analytical Chemistry
36, 1964) has no lag, unlike a causal filter. Where a motion is too fast for it, as at an impact or
where a torque sets in, it is fitted to fewer samples: to as many as tell the same slope as all
smaller fits do, within the noise (Goldenshluger and Nemirovski, Mathematical Methods of Statistics
6, 1997).

    smoothed = Smoothed(recording.time, np.stack([hip, knee]), noise=np.array([1e-4, 1e-4]))
    smoothed.at(time), smoothed.slope_at(time)      # (n, 2) each
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from walkerkit.gap.recordings.savgol import savgol

FloatArray = NDArray[np.float64]

_WINDOW = 0.05  # s; short against a leg's motion, long against the encoder's steps
AT_AN_END = _WINDOW / 2  # s of a log, in which slopes are known less
_ORDER = 3
_FEWEST_SAMPLES = 7
_SHORTER, _LEAST = 0.6, 5  # of the samples of the next longer fit; of all
_BEYOND = 4.0  # standard deviations by which slopes differ that the noise alone does not make
_SLIGHT = 0.03  # of the typical slope, by which they may differ besides
_ROUNDING = 1e-6  # of a step


class Smoothed:
    """Some signals on one clock.

    Args:
        time: (T,) s, increasing.
        signals: (k, T) samples.
        noise: (k,) standard deviations of their noise, to follow fast motions; None where what is
            fast is noise.

    Attributes:
        step: spacing of the uniform grid that they were brought to [s].
        values: (k, n) on that grid.
        slopes: (k, n) derivatives on that grid [1/s].
        fast: (n,) bool on that grid, where one of the signals was followed.
    """

    def __init__(self, time: FloatArray, signals: FloatArray, noise: FloatArray | None = None):
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
        self.values: FloatArray = savgol(resampled, samples, order)
        self.slopes: FloatArray = (
            savgol(resampled, samples, order, deriv=1, step=step)
            if order
            else np.gradient(resampled, step, axis=1)
        )
        self._off_slope = np.zeros_like(self.slopes)
        self.fast = np.zeros(len(self._grid), dtype=bool)
        if noise is not None and order == _ORDER:
            for k, (row, std) in enumerate(zip(resampled, noise, strict=True)):
                self._follow(k, row, float(std), samples)
        spread = 0.0 if noise is None else noise[:, None]
        self._off: FloatArray = np.hypot(spread, self.values - resampled)

    def _follow(self, k: int, row: FloatArray, std: float, samples: int) -> None:
        """Takes fits to fewer samples where a longer one contradicts some that are shorter."""
        lengths = [samples]
        while (shorter := int(_SHORTER * lengths[-1]) | 1) >= _LEAST and shorter < lengths[-1]:
            lengths.append(shorter)
        shorter_fits = (savgol(row, n, _ORDER, deriv=1, step=self.step) for n in lengths[1:])
        slopes = [self.slopes[k].copy(), *shorter_fits]
        spread = [std * _spread(length, len(row)) / self.step for length in lengths]
        slight = _SLIGHT * float(np.sqrt(np.mean(slopes[0] ** 2)))
        left = np.ones(len(row), dtype=bool)  # where no fit is accepted yet
        for i, length in enumerate(lengths):
            contradicted = np.zeros(len(row), dtype=bool)
            beyond = np.zeros(len(row))
            for j in range(i + 1, len(lengths)):
                # Of a fit and a part of its samples, the difference varies by as much less.
                noise = np.sqrt(np.maximum(spread[j] ** 2 - spread[i] ** 2, 0.0))
                apart = np.abs(slopes[j] - slopes[i])
                contradicted |= apart > _BEYOND * noise + slight
                if j == i + 1:  # which has the least noise of its own
                    beyond = uniform_filter1d(apart**2 - noise**2, length)
            contradicted = _closed(contradicted, length)
            here = left & ~contradicted
            self._off_slope[k, here] = np.sqrt(spread[i] ** 2 + np.maximum(beyond, 0.0))[here]
            if i and here.any():
                self.slopes[k, here] = slopes[i][here]
                self.values[k, here] = savgol(row, length, _ORDER)[here]
            left &= contradicted
            if i == 0:
                self.fast |= left
            if not left.any():
                break

    def errors_at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Standard deviations of values and of slopes at (n,) instants, (n, k) each."""
        return self._between(self._off, time), self._between(self._off_slope, time)

    def at(self, time: FloatArray) -> FloatArray:
        """(n, k) values at (n,) instants, held at the ends."""
        return self._between(self.values, time)

    def slope_at(self, time: FloatArray) -> FloatArray:
        """(n, k) derivatives at (n,) instants, held at the ends."""
        return self._between(self.slopes, time)

    def fast_at(self, time: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether one of the signals was followed at (n,) instants."""
        index = np.rint((time - self._grid[0]) / self.step).astype(np.intp)
        found: NDArray[np.bool_] = self.fast[np.clip(index, 0, len(self.fast) - 1)]
        return found

    def _between(self, rows: FloatArray, time: FloatArray) -> FloatArray:
        last = rows.shape[1] - 1
        index = np.clip((time - self._grid[0]) / self.step, 0, last)
        whole = np.minimum(index.astype(np.intp), last - 1)
        part = index - whole
        between: FloatArray = rows[:, whole] * (1 - part) + rows[:, whole + 1] * part
        return between.T


def _closed(marked: NDArray[np.bool_], length: int) -> NDArray[np.bool_]:
    """Marked samples, and those between: a fit to so many passes the truth now and then."""
    wide = maximum_filter1d(marked.view(np.uint8), length)
    return minimum_filter1d(wide, length).view(np.bool_)


@lru_cache(maxsize=64)
def _spread(samples: int, count: int) -> FloatArray:
    """(count,) standard deviation of the slopes of fits to noise of 1, of samples 1 apart."""
    half = samples // 2
    places = np.arange(samples, dtype=np.float64) - half
    fit = np.linalg.pinv(np.vander(places, _ORDER + 1, increasing=True))
    powers = np.arange(1, _ORDER + 1)
    weights = (powers * places[:, None] ** (powers - 1)) @ fit[1:]
    each = np.linalg.norm(weights, axis=1)
    spread = np.full(count, each[half])
    spread[:half], spread[count - half :] = each[:half], each[half + 1 :]
    return spread
