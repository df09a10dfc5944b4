"""Signals without their noise: slopes of slow motions, of impacts, and where a torque sets in."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from walkerkit.gap.recordings.smooth import Smoothed

Array = NDArray[np.float64]
RATE, STD = 400.0, 1e-4
TIME = np.arange(0.0, 4.0, 1 / RATE)


def errors(true: Array, slope: Array, std: float = STD) -> tuple[Array, Array]:
    """Errors of the slopes by one fit for all, and by fits that follow fast motions."""
    noisy = (true + std * np.random.default_rng(0).standard_normal(len(true)))[None]
    one, following = Smoothed(TIME, noisy), Smoothed(TIME, noisy, np.array([std]))
    return one.slopes[0] - slope, following.slopes[0] - slope


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_where_a_torque_sets_in_as_the_log_begins() -> None:
    """1000 rad/s² from rest, as a leg's joint under its full torque."""
    rise = np.minimum(TIME, 0.015)
    true = 500 * rise**2 + 15 * 0.015 * (1 - np.exp(-(TIME - rise) / 0.015))
    slope = np.where(TIME < 0.015, 1000 * TIME, 15 * np.exp(-(TIME - 0.015) / 0.015))
    one, following = errors(true, slope)
    assert abs(one[0]) > 2.0
    assert abs(following[0]) < 0.6
    assert rms(following[:20]) < 0.4 * rms(one[:20])


def test_an_impact() -> None:
    """The velocity turns around from one sample to the next."""
    true, slope = 3 * np.abs(TIME - 2.00125), 3 * np.sign(TIME - 2.00125)
    one, following = errors(true, slope)
    assert rms(following) < 0.6 * rms(one)
    far = np.abs(TIME - 2.0) > 0.03
    np.testing.assert_array_equal(following[far], one[far])


@pytest.mark.parametrize("std", [1e-5, 1e-4, 1e-3])
def test_slow_motions_and_noise_are_left_to_the_longest_fit(std: float) -> None:
    true, slope = np.sin(6 * TIME), 6 * np.cos(6 * TIME)
    one, following = errors(true, slope, std)
    assert np.mean(one != following) < 0.002


def test_a_staircase_of_an_encoder_is_no_motion() -> None:
    step = 2 * np.pi / 4096
    true, slope = 0.2 * np.sin(TIME), 0.2 * np.cos(TIME)
    read = step * np.round(true / step)[None]
    one = Smoothed(TIME, read)
    following = Smoothed(TIME, read, np.array([step / np.sqrt(12)]))
    assert rms(following.slopes[0] - slope) < 1.05 * rms(one.slopes[0] - slope)


def test_short_logs_have_slopes_too() -> None:
    for count in (2, 3, 6, 9):
        time = TIME[:count]
        found = Smoothed(time, (2 * time)[None], np.array([STD]))
        np.testing.assert_allclose(found.slopes, 2.0)


@pytest.mark.parametrize("pace", [1.0, 6.0, 25.0])
def test_errors_are_as_large_as_they_are_told(pace: float) -> None:
    """By noise alone, and where the motion is so fast that a fit lags behind it."""
    true, slope = np.sin(pace * TIME), pace * np.cos(pace * TIME)
    noisy = (true + STD * np.random.default_rng(1).standard_normal(len(true)))[None]
    smoothed = Smoothed(TIME, noisy, np.array([STD]))
    of_values, of_slopes = (each[40:-40, 0] for each in smoothed.errors_at(TIME))
    off, off_slope = smoothed.values[0] - true, smoothed.slopes[0] - slope
    assert np.mean(np.abs(off_slope[40:-40]) > 3 * of_slopes) < 0.02
    assert rms(of_slopes) < 2 * rms(off_slope[40:-40])
    assert np.mean(np.abs(off[40:-40]) > 3 * of_values) < 0.01
