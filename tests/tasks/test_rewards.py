from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from walkerkit.tasks.rewards import (
    checked_weights,
    closeness,
    low_effort,
    smoothness,
    upright,
    weighted_mean,
)

NUMBERS = st.floats(-1e200, 1e200)
ROWS = arrays(np.float64, st.integers(0, 6), elements=NUMBERS)
POSITIVE = st.floats(1e-6, 1e6)
SHARES = st.floats(0.0, 1.0)

quick = settings(derandomize=True, max_examples=60, deadline=None)


@quick
@given(ROWS, POSITIVE)
def test_closeness_is_bounded_and_even(error: np.ndarray, scale: float) -> None:
    value = closeness(error, scale)
    assert 0 <= value <= 1
    assert value == closeness(-error, scale)


@quick
@given(st.floats(0, 5), st.floats(0.01, 5), POSITIVE)
def test_closeness_falls_with_the_error(error: float, more: float, scale: float) -> None:
    assert closeness((error + more) * scale, scale) < closeness(error * scale, scale)


def test_closeness_follows_its_equation() -> None:
    assert closeness([0.0, 0.3], 0.3) == pytest.approx((1 + math.exp(-1)) / 2)
    assert closeness(0.0, 0.5) == 1.0
    assert closeness([], 0.5) == 1.0


@quick
@given(NUMBERS)
def test_upright_is_bounded(cosine: float) -> None:
    assert 0 <= upright(cosine) <= 1


@pytest.mark.parametrize(("angle", "value"), [(0, 1.0), (math.pi / 2, 0.5), (math.pi, 0.0)])
def test_upright_follows_its_equation(angle: float, value: float) -> None:
    assert upright(math.cos(angle)) == pytest.approx(value)


@quick
@given(ROWS, POSITIVE)
def test_low_effort_is_bounded(effort: np.ndarray, limit: float) -> None:
    assert 0 <= low_effort(effort, np.full(effort.shape, limit)) <= 1


def test_low_effort_follows_its_equation() -> None:
    assert low_effort([5.0, -20.0, 3.0], [10.0, 10.0, np.inf]) == pytest.approx(1 - 1.25 / 3)
    assert low_effort([], []) == 1.0


@quick
@given(arrays(np.float64, 4, elements=NUMBERS), arrays(np.float64, 4, elements=NUMBERS))
def test_smoothness_is_bounded_and_even(action: np.ndarray, previous: np.ndarray) -> None:
    value = smoothness(action, previous)
    assert 0 <= value <= 1
    assert value == smoothness(previous, action)


def test_smoothness_follows_its_equation() -> None:
    assert smoothness([1.0, 0.0], [-1.0, 0.0]) == pytest.approx(0.5)
    assert smoothness([0.3, 5.0], [0.3, 1.0]) == 1.0
    assert smoothness([], []) == 1.0


@quick
@given(
    st.dictionaries(
        st.sampled_from("abcdef"), st.tuples(SHARES, st.floats(0, 1e300)), min_size=1
    ).filter(lambda terms: any(weight > 0 for _, weight in terms.values()))
)
def test_the_weighted_mean_stays_among_its_terms(terms: dict[str, tuple[float, float]]) -> None:
    values = {name: value for name, (value, _) in terms.items()}
    weights = {name: weight for name, (_, weight) in terms.items()}
    counted = [value for value, weight in terms.values() if weight > 0]
    mean = weighted_mean(values, weights)
    assert 0 <= mean <= 1
    assert min(counted) - 1e-12 <= mean <= max(counted) + 1e-12


def test_the_weighted_mean_follows_its_equation() -> None:
    assert weighted_mean({"a": 1.0, "b": 0.5}, {"a": 1.0, "b": 3.0, "c": 9.0}) == 0.625


def test_weights_that_are_left_out_have_their_default() -> None:
    assert checked_weights({"b": 0}, {"a": 1.0, "b": 2.0}) == {"a": 1.0, "b": 0.0}
    assert checked_weights(None, {"a": 1.0}) == {"a": 1.0}


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({"uprigth": 1.0}, r"no reward term 'uprigth' \(did you mean 'upright'"),
        ({"upright": -1.0}, r"weights\['upright'\]` should be at least 0, got -1.0"),
        ({"upright": math.inf}, r"weights\['upright'\]` should be finite, got inf"),
        ({"upright": 0, "pose": 0}, "at least one should be above 0"),
    ],
)
def test_unusable_weights(weights: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        checked_weights(weights, {"upright": 1.0, "pose": 1.0})
