"""The measurement's own noise, from the signals themselves.

Local polynomials are fitted around every sample (Savitzky and Golay, Analytical Chemistry 36,
1964); what they leave is noise, corrected for what the fit itself absorbs. Motion that is fast for
the sampling leaves more with a cubic than with a quintic, so the smaller decides; impacts and
reversals leave more than the rest, so the typical stretch does. A quantised signal cannot be better
than its step / √12.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs

from walkerkit.gap.recordings.savgol import savgol

FloatArray = NDArray[np.float64]

_SAMPLES, _ORDERS = 9, (3, 5)
_KEPT = {order: 1 - savgol_coeffs(_SAMPLES, order)[_SAMPLES // 2] for order in _ORDERS}
_STRETCH = 20  # samples; short, so that most lie between the steps of the targets
_ROUNDING = 1e-6  # of the signal's range
_FEWEST_STEPS = 2
_OFF_GRID, _MOST = 0.1, 0.9  # of a step; of the steps


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise of one channel, in its own unit.

    Attributes:
        std: standard deviation.
        quantum: step between neighbouring values, 0 where none is seen.
    """

    std: float
    quantum: float


def estimate(signals: Sequence[FloatArray]) -> Noise:
    """Noise of one channel over all its recordings.

    Args:
        signals: (n_samples,) each, in the order of time.

    Returns:
        The noise; its `std` is the larger of what was seen and what the quantum implies.
    """
    quantum = min((q for q in map(_quantum, signals) if q > 0), default=0.0)
    long_enough = [signal for signal in signals if len(signal) > _SAMPLES]
    seen = min((_typical(long_enough, order) for order in _ORDERS), default=0.0)
    return Noise(std=max(seen, quantum / np.sqrt(12)), quantum=quantum)


def each(signals: FloatArray) -> FloatArray:
    """(k,) standard deviations of the noise of (k, n_samples) signals, each by itself."""
    return np.array([estimate([signal]).std for signal in signals])


def _typical(signals: Sequence[FloatArray], order: int) -> float:
    """Noise of the typical stretch, where local polynomials of an order follow the motion."""
    if not signals:
        return 0.0
    squares = np.concatenate([_residual(signal, order) for signal in signals]) ** 2
    stretches = len(squares) // _STRETCH
    if not stretches:
        return float(np.sqrt(squares.mean()))
    means = squares[: stretches * _STRETCH].reshape(stretches, _STRETCH).mean(axis=1)
    return float(np.sqrt(np.median(means)))


def _residual(signal: FloatArray, order: int) -> FloatArray:
    """What the local polynomials leave, scaled to the noise's variance where that is white."""
    left: FloatArray = (signal - savgol(signal, _SAMPLES, order)) / np.sqrt(_KEPT[order])
    return left


def _quantum(signal: FloatArray) -> float:
    """The step of which all differences between the signal's values are multiples, 0 for none."""
    values = np.unique(signal)
    steps = np.diff(values)
    # Printed digits split a level into neighbours that differ by rounding alone.
    steps = steps[steps > _ROUNDING * np.ptp(values)]
    if len(steps) < _FEWEST_STEPS:
        return 0.0
    multiples = steps / steps.min()
    on_grid = np.abs(multiples - np.round(multiples)) < _OFF_GRID
    return float(steps.min()) if on_grid.mean() > _MOST else 0.0
