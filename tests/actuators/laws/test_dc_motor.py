"""The torque–speed line of a motor: reference points, a scalar reference, symmetry, passivity."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.actuators.reference import clip, dc_motor, pd
from walkerkit.actuators.laws.dc_motor import DcMotorClip, DcMotorLaw, dc_motor_clip

quick = settings(derandomize=True, max_examples=60, deadline=None)
effort = st.floats(-1e3, 1e3)
speed = st.floats(-1e3, 1e3)
positive = st.floats(1e-2, 1e3)
motor = st.tuples(positive, positive, positive)

# Stall torque 100, no-load speed 50, continuous limit 60: asked for, speed, what is left.
POINTS = (
    (30, 10, 30),
    (70, 10, 60),
    (80, 40, 20),
    (30, 40, 20),
    (-20, 90, -60),
    (-30, 10, -30),
    (-80, 110, -60),
    (-80, 50, -60),
    (-120, 90, -60),
    (-10, 70, -40),
)


def one(asked, v, stall, no_load, limit):
    """The clip of a single joint."""
    values = (np.array([float(x)]) for x in (asked, v, stall, no_load, limit))
    return float(dc_motor_clip(*values)[0])


@pytest.mark.parametrize(("asked", "v", "left"), POINTS)
def test_reference_points_and_their_mirror_images(asked, v, left):
    assert one(asked, v, 100, 50, 60) == pytest.approx(left, abs=1e-12)
    assert one(-asked, -v, 100, 50, 60) == pytest.approx(-left, abs=1e-12)
    assert dc_motor(asked, v, 100, 50, 60) == pytest.approx(left, abs=1e-12)


@quick
@given(effort, speed, motor)
def test_is_the_scalar_reference(asked, v, numbers):
    expected = dc_motor(asked, v, *numbers)
    assert one(asked, v, *numbers) == pytest.approx(expected, rel=1e-12, abs=1e-9)


@quick
@given(effort, speed, motor)
def test_odd_symmetry(asked, v, numbers):
    assert one(-asked, -v, *numbers) == -one(asked, v, *numbers)


@quick
@given(effort, effort, speed, motor)
def test_monotone_in_effort_and_within_the_limit(asked, other, v, numbers):
    low, high = sorted((asked, other))
    assert one(low, v, *numbers) <= one(high, v, *numbers)
    assert abs(one(asked, v, *numbers)) <= numbers[2]
    # Clipping what was clipped changes nothing.
    left = one(asked, v, *numbers)
    assert one(left, v, *numbers) == left


@quick
@given(effort, speed, speed, motor)
def test_weaker_the_faster(asked, v, other, numbers):
    slow, fast = sorted((abs(v), abs(other)))
    assert one(asked, fast, *numbers) <= one(asked, slow, *numbers)


@quick
@given(effort, speed, motor)
def test_passivity(asked, v, numbers):
    """Never more power than asked for, unless it takes some away; above no-load speed it brakes."""
    left = one(asked, v, *numbers)
    assert left * v <= max(asked * v, 0.0) + 1e-9 * abs(asked * v)
    stall, no_load, limit = numbers
    if abs(v) > no_load * (1 + 1e-9):
        assert left * v < 0
        at_least = min(stall * (abs(v) / no_load - 1), limit)
        assert abs(left) >= at_least * (1 - 1e-9) - 1e-9


@quick
@given(effort, st.floats(0, 1), motor)
def test_within_both_lines_nothing_changes(asked, share, numbers):
    stall, no_load, limit = numbers
    v = share * no_load
    bound = min(stall * (1 - share), limit)
    inside = clip(asked, -bound, bound) * (1 - 1e-12)
    assert one(inside, v, *numbers) == inside


def test_without_a_continuous_limit():
    assert one(500, 25, 100, 50, np.inf) == 50
    assert one(-500, 25, 100, 50, np.inf) == -150
    assert one(0, 200, 100, 50, np.inf) == -300


def test_vectorised_law_is_scalar_and_its_rows_are_single_laws():
    rng = np.random.default_rng(0)
    shape = (4, 3)
    numbers = {
        "stiffness": np.array([30.0, 20.0, 0.0]),
        "damping": np.array([0.5, 0.0, 2.0]),
        "effort_limit": np.array([60.0, 20.0, np.inf]),
        "saturation_effort": np.array([100.0, 15.0, 8.0]),
        "velocity_limit": np.array([50.0, 3.0, 5.0]),
    }
    law = DcMotorLaw(numbers)
    law.allocate(shape)
    for _ in range(20):
        values = [8 * rng.standard_normal(shape) for _ in range(5)]
        computed, applied = law.effort(*values)
        for i, j in np.ndindex(shape):
            asked = pd(
                numbers["stiffness"][j], numbers["damping"][j], *(float(a[i, j]) for a in values)
            )
            left = dc_motor(
                asked,
                float(values[4][i, j]),
                *(numbers[n][j] for n in ("saturation_effort", "velocity_limit", "effort_limit")),
            )
            assert computed[i, j] == pytest.approx(asked, rel=1e-12)
            assert applied[i, j] == pytest.approx(left, rel=1e-12, abs=1e-12)
        single = DcMotorLaw(numbers)
        single.allocate((3,))
        np.testing.assert_array_equal(single.effort(*(a[2] for a in values))[1], applied[2])


def test_changed_parameters_are_those_of_another_motor():
    shape = (2, 1)
    first = {"saturation_effort": 100.0, "velocity_limit": 50.0, "effort_limit": 60.0}
    for name, value in (("saturation_effort", 40.0), ("velocity_limit", 20.0)):
        gains = {"stiffness": np.zeros(1), "damping": np.zeros(1)}
        law = DcMotorLaw({**gains, **{key: np.array([v]) for key, v in first.items()}})
        law.allocate(shape)
        law.set(name, np.array([[value]]), np.array([1]))
        other = {**first, name: value}
        asked, v = np.full(shape, 55.0), np.full(shape, 15.0)
        _, applied = law.effort(None, None, asked, np.zeros(shape), v)
        for row, numbers in enumerate((first, other)):
            assert applied[row, 0] == pytest.approx(dc_motor(55.0, 15.0, *numbers.values()))


def test_scratch_memory_is_not_the_result():
    clip_ = DcMotorClip(np.array([100.0]), np.array([50.0]), np.array([60.0]), (1,))
    first = clip_(np.array([70.0]), np.array([10.0]))
    clip_(np.array([-70.0]), np.array([-10.0]))
    assert first[0] == 60.0
