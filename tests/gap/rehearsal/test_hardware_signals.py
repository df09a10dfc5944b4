import numpy as np
import pytest

from walkerkit.gap.rehearsal.hardware_signals import delayed, filtered, held, read, slewed

RAMP = np.arange(40.0)[:, None, None] * [1.0, -2.0]  # (steps, 1, 2 joints)


def test_what_is_late_was_constant_before():
    late = delayed(RAMP, np.array([3.0, 0.0]))
    np.testing.assert_array_equal(late[:, 0, 0], np.maximum(np.arange(40) - 3.0, 0))
    np.testing.assert_array_equal(late[..., 1], RAMP[..., 1])


def test_between_its_steps_a_signal_is_a_straight_line():
    at = np.array([[0.25], [7.5], [38.75], [90.0]])
    np.testing.assert_allclose(read(RAMP, at)[:, 0, 0], [0.25, 7.5, 38.75, 39.0])


@pytest.mark.parametrize("period", [4.0, 2.5, 1.0, 0.0])
def test_stairs_show_what_was_there_at_the_last_look(period):
    stairs = held(RAMP, np.array([period, 0.0]), start=10)[:, 0, 0]
    for k in range(10, 40):
        looks = [0.0] if period <= 1 else np.arange(10, 50, period)
        seen = k if period <= 1 else int(np.ceil(max(t for t in looks if t <= k)))
        assert stairs[k] == seen


def test_a_filter_has_gone_63_percent_of_a_jump_after_its_time_constant():
    jump = np.ones((60, 1, 2))
    jump[:10] = 0.0
    round_ = filtered(jump, np.array([12.0, 0.0]))
    assert round_[10, 0, 0] == 0.0
    assert round_[22, 0, 0] == pytest.approx(1 - np.exp(-1))
    np.testing.assert_array_equal(round_[..., 1], jump[..., 1])
    np.testing.assert_array_equal(filtered(jump + 5.0, np.array([12.0, 12.0]))[0], 5.0)


def test_a_follower_is_never_faster_than_it_may_and_arrives():
    jump = np.ones((60, 1, 2))
    jump[:10] = 0.0
    slow = slewed(jump, np.array([0.05, np.inf]))
    assert np.diff(slow[..., 0], axis=0).max() == pytest.approx(0.05)
    assert slow[29, 0, 0] == pytest.approx(1.0)
    np.testing.assert_array_equal(slow[..., 1], jump[..., 1])
