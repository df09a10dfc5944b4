"""The measurement's own noise, from the signals themselves.

A local cubic is fitted around every sample (Savitzky and Golay, Analytical Chemistry 36, 1964);
what it leaves is noise, corrected for what the fit itself absorbs. Impacts and reversals leave
more, so the typical stretch decides. A quantised signal cannot be better than its step / √12.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

FloatArray = NDArray[np.float64]

_SAMPLES, _ORDER = 9, 3
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
    residuals = [_residual(signal) for signal in signals if len(signal) > _SAMPLES]
    squares = np.concatenate(residuals) ** 2 if residuals else np.zeros(0)
    stretches = len(squares) // _STRETCH
    if stretches:
        means = squares[: stretches * _STRETCH].reshape(stretches, _STRETCH).mean(axis=1)
        seen = float(np.sqrt(np.median(means)))
    else:
        seen = float(np.sqrt(squares.mean())) if len(squares) else 0.0
    largest = max(1.0, *(float(np.abs(signal).max()) for signal in signals))
    return Noise(std=max(seen, quantum / np.sqrt(12), _RESOLUTION * largest), quantum=quantum)


def _residual(signal: FloatArray) -> FloatArray:
    """What the local cubic leaves of white noise of the same variance as the noise."""
    kept = 1 - savgol_coeffs(_SAMPLES, _ORDER)[_SAMPLES // 2]
    left: FloatArray = (signal - savgol_filter(signal, _SAMPLES, _ORDER)) / np.sqrt(kept)
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
