"""Proportional-derivative control: against a scalar reference, and by its symmetries."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.actuators.reference import clip, pd
from walkerkit.actuators.laws.pd import PdLaw, clipped, pd_effort

quick = settings(derandomize=True, max_examples=40, deadline=None)
number = st.floats(-1e3, 1e3)
gain = st.floats(0, 1e3)
maybe = st.none() | number
N = 3


def arrays(values):
    """(n,) arrays of tuples of numbers, None where the first has none."""
    return [None if v[0] is None else np.array(v, dtype=float) for v in zip(*values, strict=True)]


@st.composite
def cases(draw):
    """(p, v, e, q, qd, kp, kd) of a few joints, the same targets missing in all of them."""
    given_ = [draw(st.booleans()) for _ in range(3)]
    one = st.tuples(*(number if has else st.none() for has in given_), number, number, gain, gain)
    return draw(st.lists(one, min_size=1, max_size=4))


@quick
@given(cases())
def test_vectorised_is_scalar(values):
    p, v, e, q, qd, kp, kd = arrays(values)
    got = pd_effort(p, v, e, q, qd, kp, kd)
    again = pd_effort(p, v, e, q, qd, kp, kd, np.empty(len(values)))
    np.testing.assert_array_equal(got, again)
    for i, (p1, v1, e1, q1, qd1, kp1, kd1) in enumerate(values):
        assert got[i] == pytest.approx(pd(kp1, kd1, p1, v1, e1, q1, qd1), rel=1e-12, abs=1e-6)


@quick
@given(cases())
def test_odd_symmetry(values):
    p, v, e, q, qd, kp, kd = arrays(values)
    minus = [None if a is None else -a for a in (p, v, e)]
    np.testing.assert_array_equal(
        pd_effort(*minus, -q, -qd, kp, kd), -pd_effort(p, v, e, q, qd, kp, kd)
    )


@quick
@given(number, number, st.floats(1e-3, 1e3))
def test_clip_is_monotone_odd_and_within(one, other, limit):
    low, high = sorted((one, other))
    a, b, c = clipped(np.array([low, high, -low]), np.full(3, limit))
    assert a <= b
    assert c == -a
    assert a == clip(low, -limit, limit)


def law(n_sims=None, limit=5.0):
    """A law of three joints."""
    made = PdLaw(
        {
            "stiffness": np.array([1.0, 2.0, 3.0]),
            "damping": np.array([0.1, 0.2, 0.3]),
            "effort_limit": np.full(N, limit),
        }
    )
    made.allocate((N,) if n_sims is None else (n_sims, N))
    return made


def test_rows_of_a_batch_are_single_laws():
    rng = np.random.default_rng(0)
    values = [4 * rng.standard_normal((5, N)) for _ in range(5)]
    together = law(5).effort(*values)
    for row in range(5):
        alone = law().effort(*(value[row] for value in values))
        for one, other in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one, other[row])
    assert (together[0] != together[1]).any()


def test_parameters_of_some_rows():
    zero = np.zeros((2, N))
    one = law(2)
    one.set("stiffness", np.array([[10.0, 20.0, 30.0]]), np.array([1]))
    computed, _ = one.effort(np.ones((2, N)), None, None, zero, zero)
    np.testing.assert_array_equal(computed, [[1.0, 2.0, 3.0], [10.0, 20.0, 30.0]])
    one.set("stiffness", np.full((2, N), 4.0), None)
    np.testing.assert_array_equal(one.effort(np.ones((2, N)), None, None, zero, zero)[0], 4.0)
    assert one.names == ("stiffness", "damping", "effort_limit")


def test_results_are_new_and_inputs_are_left_alone():
    rng = np.random.default_rng(1)
    values = [rng.standard_normal(N) for _ in range(5)]
    before = [value.copy() for value in values]
    one = law()
    first = one.effort(*values)
    kept = [array.copy() for array in first]
    one.effort(*(3 * value for value in values))
    for value, was in zip((*values, *first), (*before, *kept), strict=True):
        np.testing.assert_array_equal(value, was)


def test_position_is_needed_where_there_is_stiffness():
    assert law().needs == {"position_target"}
    free = {"stiffness": np.zeros(2), "damping": np.ones(2), "effort_limit": np.full(2, np.inf)}
    assert PdLaw(free).needs == frozenset()
