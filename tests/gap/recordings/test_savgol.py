"""Local polynomials, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import savgol_filter

from walkerkit.gap.recordings.savgol import savgol


@pytest.mark.parametrize("deriv", [0, 1])
@pytest.mark.parametrize(("samples", "order"), [(5, 3), (25, 3), (51, 2)])
@pytest.mark.parametrize("count", [51, 52, 400])
def test_is_what_scipy_has(samples: int, order: int, deriv: int, count: int) -> None:
    signals = np.cumsum(np.random.default_rng(0).normal(size=(3, count)), axis=1)
    found = savgol(signals, samples, order, deriv=deriv, step=0.01)
    right = savgol_filter(signals, samples, order, deriv=deriv, delta=0.01)
    assert found == pytest.approx(right, rel=1e-9, abs=1e-9 * np.abs(right).max())
    assert savgol(signals[0], samples, order, deriv=deriv, step=0.01) == pytest.approx(found[0])
