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
from scipy.signal import savgol_coeffs, savgol_filter

FloatArray = NDArray[np.float64]

_SAMPLES, _ORDERS = 9, (3, 5)
_STRETCH = 50  # samples
_RESOLUTION = 1e-7  # of single precision; a joint that never moves is not known any better
_FEW_LEVELS = 0.5  # a signal with fewer distinct values than this part of its samples is quantised


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
        The noise; its `std` is the largest of what was seen, what the quantum implies and what
        numbers of single precision resolve, so it is never 0.
    """
    quantum = _quantum(signals)
    long_enough = [signal for signal in signals if len(signal) > _SAMPLES]
    seen = min((_typical(long_enough, order) for order in _ORDERS), default=0.0)
    return Noise(std=max(seen, quantum / np.sqrt(12)), quantum=quantum)


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
    kept = 1 - savgol_coeffs(_SAMPLES, order)[_SAMPLES // 2]
    left: FloatArray = (signal - savgol_filter(signal, _SAMPLES, order)) / np.sqrt(kept)
    return left


def _quantum(signals: Sequence[FloatArray]) -> float:
    values = np.unique(np.concatenate(signals))
    total = sum(len(signal) for signal in signals)
    if len(values) < 3 or len(values) > _FEW_LEVELS * total:
        return 0.0
    steps = np.diff(values)
    # Printed digits split a level into neighbours that differ by rounding alone.
    steps = steps[steps > 1e-6 * (values[-1] - values[0])]
    return float(np.min(steps)) if len(steps) else 0.0
