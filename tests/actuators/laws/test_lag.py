"""Delay lines: a shift, lags within their bounds from the first step, and the odds of redraws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.actuators.reference import late
from walkerkit.actuators.laws.lag import DelayLine, LagSchedule

quick = settings(derandomize=True, max_examples=30, deadline=None)


def line(low, high, shape=(1,), hold_prob=0.0, update_period=0, seed=0):
    """A delay line."""
    schedule = LagSchedule(
        min_lag=low, max_lag=high, hold_prob=hold_prob, update_period=update_period
    )
    return DelayLine(schedule, shape, np.random.SeedSequence(seed))


def push(one, values, before=lambda k: None):
    """What comes out for a series of targets, and the lag of every step."""
    out, lags = [], []
    for k, value in enumerate(values):
        before(k)
        out.append(np.array(one.push(np.asarray(value, dtype=float))))
        lags.append(one.lag)
    return np.array(out), np.array(lags)


@quick
@given(st.integers(0, 6), st.lists(st.floats(-9, 9), min_size=1, max_size=20))
def test_a_constant_lag_is_a_shift(lag, values):
    out, lags = push(line(lag, lag), [[v] for v in values])
    assert (lags == lag).all()
    for k in range(len(values)):
        assert out[k, 0] == late(values[: k + 1], lag)


@quick
@given(
    st.integers(0, 4),
    st.integers(0, 4),
    st.sampled_from([0.0, 0.3, 1.0]),
    st.integers(0, 5),
    st.integers(0, 9),
    st.sampled_from([(), (1,), (4,)]),
)
def test_lags_are_within_bounds_from_the_first_step(low, more, hold_prob, period, seed, batch):
    high = low + more
    one = line(low, high, (*batch, 2), hold_prob, period, seed)
    assert ((one.lag >= low) & (one.lag <= high)).all()
    values = np.random.default_rng(seed).standard_normal((25, *batch, 2))
    out, lags = push(one, values)
    assert ((lags >= low) & (lags <= high)).all()
    # What comes out is what was pushed as many steps ago as the lag says.
    for k in range(25):
        for row in np.ndindex(batch):
            for j in range(2):
                history = [float(v[(*row, j)]) for v in values[: k + 1]]
                assert out[k][(*row, j)] == late(history, int(lags[k][row]))


def test_all_lags_occur_alike():
    lags = np.concatenate(
        [push(line(2, 5, (500, 1), seed=s), np.zeros((4, 500, 1)))[1] for s in range(2)]
    )
    counts = np.bincount(lags.ravel(), minlength=6)
    assert (counts[:2] == 0).all()
    assert counts[2:] / counts.sum() == pytest.approx([0.25] * 4, abs=0.03)


@pytest.mark.parametrize("batch", [(), (200,)])
def test_hold_prob_one_draws_once_per_reset_and_only_then(batch):
    one = line(0, 9, (*batch, 1), hold_prob=1.0)
    drawn = []
    for _ in range(12):
        one.reset(None)
        _, lags = push(one, np.zeros((30, *batch, 1)))
        assert (lags == lags[0]).all()
        drawn.append(lags[0])
    assert len(np.unique(drawn)) > 4
    assert (np.array(drawn) > 0).any()


def test_hold_prob_is_the_share_of_kept_lags():
    _, lags = push(line(0, 99, (400, 1), hold_prob=0.3), np.zeros((60, 400, 1)))
    kept = (np.diff(lags, axis=0) == 0).mean()
    assert kept == pytest.approx(0.3 + 0.7 / 100, abs=0.01)


@pytest.mark.parametrize("period", [1, 4, 10])
@pytest.mark.parametrize("batch", [(), (50,)])
def test_redraws_come_every_update_period(period, batch):
    one = line(0, 1000, (*batch, 1), update_period=period)
    for _ in range(2):
        one.reset(None)
        _, lags = push(one, np.zeros((41, *batch, 1)))
        changed = np.flatnonzero((np.diff(lags, axis=0) != 0).reshape(40, -1).any(axis=1)) + 1
        assert changed.tolist() == list(range(period, 41, period))


def test_zero_redraws_at_every_step():
    _, each = push(line(0, 1000, update_period=1), np.zeros((20, 1)))
    _, zero = push(line(0, 1000, update_period=0), np.zeros((20, 1)))
    np.testing.assert_array_equal(each, zero)


def test_after_a_reset_the_first_target_stands_for_the_past():
    one = line(3, 3, (2, 1))
    push(one, np.full((9, 2, 1), 5.0))
    one.reset(np.array([1]))
    out, _ = push(one, [[[6.0], [-1.0]]] * 5)
    assert out[:, 0, 0].tolist() == [5.0, 5.0, 5.0, 6.0, 6.0]
    assert out[:, 1, 0].tolist() == [-1.0] * 5
    one.reset(None)
    one.reset(None)
    out, _ = push(one, [[[7.0], [8.0]], [[0.0], [0.0]]])
    assert out[:, :, 0].tolist() == [[7.0, 8.0], [7.0, 8.0]]


def test_seeds():
    values = np.random.default_rng(0).standard_normal((30, 4, 1))
    one, same, other = (push(line(0, 6, (4, 1), seed=s), values) for s in (3, 3, 4))
    np.testing.assert_array_equal(one[0], same[0])
    np.testing.assert_array_equal(one[1], same[1])
    assert (one[1] != other[1]).any()


@pytest.mark.parametrize("hold_prob", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("period", [0, 3])
def test_a_partial_reset_leaves_the_other_rows_as_they_would_have_been(hold_prob, period):
    values = np.random.default_rng(0).standard_normal((40, 4, 2))
    untouched, partly = (line(1, 7, (4, 2), hold_prob, period) for _ in range(2))
    out, lags = push(untouched, values)

    def reset(k):
        if k in (5, 11, 12):
            partly.reset(np.array([1, 3]))

    out2, lags2 = push(partly, values, reset)
    np.testing.assert_array_equal(out[:, [0, 2]], out2[:, [0, 2]])
    np.testing.assert_array_equal(lags[:, [0, 2]], lags2[:, [0, 2]])
    assert (lags[:, [1, 3]] != lags2[:, [1, 3]]).any()


@pytest.mark.parametrize("source", [np.random.default_rng, np.random.RandomState])
def test_a_reset_may_bring_its_own_source(source):
    drawn = []
    for seed in (1, 1, 2):
        one = line(0, 1000, (5, 1), hold_prob=1.0, seed=len(drawn))
        one.reset(None, source(seed))
        drawn.append(one.lag)
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert (drawn[0] != drawn[2]).any()


@pytest.mark.parametrize("source", [np.random.default_rng, np.random.RandomState])
def test_redraws_follow_the_source_of_a_whole_reset(source):
    values = np.zeros((30, 4, 1))
    lags = []
    for own, seed in ((1, 8), (2, 8), (1, 9)):
        one = line(0, 6, (4, 1), hold_prob=0.2, seed=own)
        push(one, values[:7])
        one.reset(None, source(seed))
        lags.append(push(one, values)[1])
    np.testing.assert_array_equal(lags[0], lags[1])
    assert (lags[0] != lags[2]).any()


def test_the_source_of_a_partial_reset_leaves_the_other_rows_alone():
    values = np.zeros((30, 3, 1))
    untouched, partly = (line(0, 6, (3, 1), hold_prob=0.2) for _ in range(2))
    _, lags = push(untouched, values)
    rows = np.array([1])
    source = np.random.default_rng(5)
    _, lags2 = push(partly, values, lambda k: partly.reset(rows, source) if k == 9 else None)
    np.testing.assert_array_equal(lags[:, [0, 2]], lags2[:, [0, 2]])
    assert (lags[:, 1] != lags2[:, 1]).any()


def test_narrower_bounds_hold_from_the_next_reset():
    one = line(0, 8, (6, 1), hold_prob=1.0)
    one.narrow(np.array([3, 4]), np.array([4, 20]), np.array([0, 5]))
    low, high = one.bounds
    assert low.tolist() == [3, 0, 0, 0, 0, 4]
    assert high.tolist() == [4, 8, 8, 8, 8, 8]
    seen = []
    for _ in range(60):
        one.reset(None)
        seen.append(one.lag)
    assert {*np.array(seen)[:, 0].tolist()} == {3, 4}
    assert {*np.array(seen)[:, 5].tolist()} == {4, 5, 6, 7, 8}
    assert {*np.array(seen)[:, 1].tolist()} == {*range(9)}
