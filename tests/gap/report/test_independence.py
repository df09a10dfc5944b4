"""How long errors stay alike, against processes of which it is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from walkerkit.gap.report.independence import correlated_samples
from walkerkit.gap.report.planner import _distance


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9, 0.98])
def test_an_autoregressive_process_has_its_known_correlation_time(memory: float) -> None:
    # x_t = φ x_{t−1} + e_t has Σ φ^|k| = (1 + φ) / (1 − φ).
    noise = np.random.default_rng(0).normal(size=200_000)
    errors = lfilter([1.0], [1.0, -memory], noise)
    assert correlated_samples(errors) == pytest.approx((1 + memory) / (1 - memory), rel=0.15)


def test_an_offset_is_one_error_however_often_it_is_measured() -> None:
    assert correlated_samples(np.full(1000, 0.3)) > 300
    assert correlated_samples(np.zeros(1000)) == 1000


def test_what_a_shift_in_time_makes_up_parts_nothing_where_nobody_knows_the_instant() -> None:
    time = np.arange(0.0, 3.0, 0.005)
    swing, late = (np.cos(4 * (time - d))[:, None] for d in (0.0, 0.01))
    slower = np.cos(3.9 * time)[:, None]
    assert _distance(swing, late, any_instant=True) < 0.05 * _distance(
        swing, late, any_instant=False
    )
    assert _distance(swing, slower, any_instant=True) > 1.0
