"""Local polynomials: fitted to the samples around each sample, evenly spaced.

    smooth = local_polynomials(rows, 25, 3)
    slopes = local_polynomials(rows, 25, 3, derivative=1, step=0.002)

Savitzky and Golay, Analytical Chemistry 36, 1964. The samples at either end are on the polynomial
of the first or last window. `scipy.signal` has the same as `savgol_filter`; importing it takes as
long as all else that a comparison needs.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def local_polynomials(
    rows: FloatArray, samples: int, order: int, *, derivative: int = 0, step: float = 1.0
) -> FloatArray:
    """Values of the polynomials, or of a derivative.

    Args:
        rows: (..., n) signals, n at least `samples`.
        samples: in a window; odd.
        order: of the polynomials, below `samples`.
        derivative: which one, 0 for the value.
        step: spacing of the samples.

    Returns:
        Shape as `rows`; a derivative is by the unit of `step`.
    """
    half = samples // 2
    weights = _weights(samples, order, derivative) / step**derivative
    found = np.empty(rows.shape)
    for place in np.ndindex(rows.shape[:-1]):
        row = rows[place]
        found[place][:half] = weights[:half] @ row[:samples]
        found[place][half : len(row) - half] = np.correlate(row, weights[half], "valid")
        found[place][len(row) - half :] = weights[half + 1 :] @ row[-samples:]
    return found


def own_share(samples: int, order: int) -> float:
    """How much of a sample's own value the polynomial around it has."""
    return float(_weights(samples, order, 0)[samples // 2, samples // 2])


def _weights(samples: int, order: int, derivative: int) -> FloatArray:
    """(samples, samples): of each sample of a window in the value at each place of it."""
    at = np.arange(samples) - samples // 2
    # Powers of numbers up to 1 keep the fit well conditioned.
    reach = max(samples // 2, 1)
    powers = (at / reach)[:, None] ** np.arange(order + 1)
    fit = np.linalg.pinv(powers)
    each = np.zeros((samples, order + 1))
    for power in range(derivative, order + 1):
        factor = factorial(power) / factorial(power - derivative)
        each[:, power] = factor * (at / reach) ** (power - derivative) / reach**derivative
    weights: FloatArray = each @ fit
    return weights
