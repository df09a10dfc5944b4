"""Which joints an expression means, and which number belongs to which joint."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from walkerkit.actuators.selection import per_joint, select

NAMES = ("left_hip", "left_knee", "right_hip", "right_knee", "waist")
quick = settings(derandomize=True, max_examples=40, deadline=None)


@pytest.mark.parametrize(
    ("expressions", "chosen"),
    [
        ((".*",), (0, 1, 2, 3, 4)),
        (("waist", "left_hip"), (0, 4)),
        ((".*_knee", ".*_hip"), (0, 1, 2, 3)),
        (("right_(hip|knee)", "left_k.*"), (1, 2, 3)),
    ],
)
def test_kinematic_order_whatever_the_order_of_the_expressions(expressions, chosen):
    assert select(expressions, NAMES) == chosen
    assert select(expressions[::-1], NAMES) == chosen


@quick
@given(st.lists(st.text("ab_", min_size=1, max_size=3), min_size=1, max_size=6, unique=True))
def test_plain_names_are_themselves_only(names):
    for i, name in enumerate(names):
        assert select((name,), names) == (i,)
    assert select(tuple(reversed(names)), names) == tuple(range(len(names)))


@quick
@given(
    st.lists(st.text("ab", min_size=1, max_size=3), min_size=1, max_size=6, unique=True),
    st.sampled_from(["a.*", ".*b", "a|b", "(ab)+", ".", "a?b?"]),
)
def test_is_full_match(names, expression):
    expected = tuple(i for i, name in enumerate(names) if re.fullmatch(expression, name))
    if expected:
        assert select((expression,), names) == expected
    else:
        with pytest.raises(ValueError, match="matches none of"):
            select((expression,), names)


@pytest.mark.parametrize("expression", ["hip", "left", "left_hip_", "LEFT_HIP", "_hip"])
def test_part_of_a_name_is_not_the_name(expression):
    with pytest.raises(ValueError) as error:
        select((".*_knee", expression), NAMES)
    message = str(error.value)
    assert f"joint_names_expr: {expression!r} matches none of 'left_hip', 'left_knee'" in message
    assert "has to match the whole name" in message


def test_closest_names_are_offered():
    with pytest.raises(ValueError, match="did you mean 'left_knee'"):
        select(("left_kneee",), NAMES)
    with pytest.raises(ValueError) as error:
        select(("zzz",), [f"joint_{i}" for i in range(40)])
    assert "and 28 more" in str(error.value)
    assert "did you mean" not in str(error.value)


def test_matched_twice():
    with pytest.raises(ValueError) as error:
        select((".*_hip", "left_.*"), NAMES)
    for part in ("'left_hip' is matched by '.*_hip' and by 'left_.*'", "narrower"):
        assert part in str(error.value)
    with pytest.raises(ValueError, match=r"'waist' is matched by 'waist' and by 'waist'"):
        select(("waist", "waist"), NAMES)


def test_numbers():
    np.testing.assert_array_equal(per_joint(2.5, NAMES, field="damping"), [2.5] * 5)
    value = {"waist": 9.0, ".*_hip": 1.0, ".*_knee": 0.0}
    np.testing.assert_array_equal(
        per_joint(value, NAMES, field="damping"), [1.0, 0.0, 1.0, 0.0, 9.0]
    )


@pytest.mark.parametrize(
    ("value", "parts"),
    [
        ({".*_hip": 1.0}, ("damping has no number for 'left_knee', 'right_knee', 'waist'",)),
        ({".*": 1.0, "waist": 2.0}, ("damping: 'waist' is matched by 'waist'", "another of")),
        ({".*": 1.0, "wrist": 2.0}, ("damping: 'wrist' matches none of", "'waist'")),
    ],
)
def test_numbers_that_do_not_fit(value, parts):
    with pytest.raises(ValueError) as error:
        per_joint(value, NAMES, field="damping")
    for part in parts:
        assert part in str(error.value)
