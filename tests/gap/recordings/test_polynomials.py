"""Local polynomials against those of SciPy and against polynomials."""

import numpy as np
import pytest
from scipy.signal import savgol_coeffs, savgol_filter

from walkerkit.gap.recordings.polynomials import local_polynomials, own_share

ROWS = np.random.default_rng(0).normal(size=(3, 60)).cumsum(axis=1)


@pytest.mark.parametrize(
    ("samples", "order", "derivative"),
    [(1, 0, 0), (3, 2, 0), (3, 2, 1), (9, 5, 0), (9, 3, 1), (25, 3, 0), (25, 3, 1), (59, 3, 1)],
)
def test_are_those_of_scipy(samples, order, derivative):
    found = local_polynomials(ROWS, samples, order, derivative=derivative, step=0.01)
    expected = savgol_filter(ROWS, samples, order, deriv=derivative, delta=0.01)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(
        local_polynomials(ROWS[1], samples, order, derivative=derivative, step=0.01), found[1]
    )


def test_a_polynomial_is_itself_to_the_ends():
    time = 0.002 * np.arange(80)
    cubic = np.array([0.3, -7.0, 40.0, 500.0])
    values = np.polynomial.polynomial.polyval(time, cubic)
    slopes = np.polynomial.polynomial.polyval(time, np.polynomial.polynomial.polyder(cubic))
    np.testing.assert_allclose(local_polynomials(values, 25, 3), values, atol=1e-12)
    found = local_polynomials(values, 25, 3, derivative=1, step=0.002)
    np.testing.assert_allclose(found, slopes, rtol=1e-9)


@pytest.mark.parametrize("order", [3, 5])
def test_a_sample_s_own_share(order):
    assert own_share(9, order) == pytest.approx(savgol_coeffs(9, order)[4], rel=1e-12)
