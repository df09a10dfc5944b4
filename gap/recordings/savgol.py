"""Local polynomials (Savitzky and Golay, Analytical Chemistry 36, 1964) by matrices that are kept.

    savgol(signals, samples=25, order=3, deriv=1, step=0.002)

As scipy.signal.savgol_filter, whose ends are fitted anew for every signal.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.signal import savgol_coeffs

FloatArray = NDArray[np.float64]


def savgol(
    signals: FloatArray, samples: int, order: int, *, deriv: int = 0, step: float = 1.0
) -> FloatArray:
    """Values or derivatives of the polynomials that fit the samples around each one best.

    Args:
        signals: (..., n), at least as many samples as a fit takes.
        samples: of each fit, odd; those at the ends are also those of what is nearer to an end.
        order: of the polynomials.
        deriv: which derivative.
        step: spacing of the samples.

    Returns:
        (..., n) values.
    """
    weights = _weights(samples, order, deriv)
    half = samples // 2
    found: FloatArray = correlate1d(signals, weights[half], axis=-1, mode="constant")
    found[..., :half] = signals[..., :samples] @ weights[:half].T
    found[..., found.shape[-1] - half :] = signals[..., -samples:] @ weights[half + 1 :].T
    return found / step**deriv


@lru_cache(maxsize=64)
def _weights(samples: int, order: int, deriv: int) -> FloatArray:
    """(samples, samples) of a fit's samples, for the value at each of them."""
    return np.stack(
        [savgol_coeffs(samples, order, deriv=deriv, pos=k, use="dot") for k in range(samples)]
    )
