"""What the log shows of a joint, and the joint that it is shown of."""

import numpy as np
import pytest

from walkerkit.gap.simulation.reading import Reading

WAVES = {"none": (0.0, 1.0, 0.0), "long": (0.2, 1.3, 0.4), "short": (0.01, 60.0, -2.0)}


@pytest.fixture(params=WAVES)
def reading(request):
    return Reading(np.array(1.07), np.array(WAVES[request.param]))


def test_velocity_is_the_slope_of_the_position(reading):
    time = np.linspace(0, 3, 11)
    q, qd = 0.7 * np.sin(2 * time), 1.4 * np.cos(2 * time)
    step = 1e-6
    ahead, behind = (0.7 * np.sin(2 * (time + d)) for d in (step, -step))
    slope = (reading.position(ahead) - reading.position(behind)) / (2 * step)
    np.testing.assert_allclose(reading.velocity(q, qd), slope, rtol=1e-7, atol=1e-7)


def test_joint_is_what_is_shown(reading):
    rng = np.random.default_rng(0)
    q, qd = rng.uniform(-2, 2, 50), rng.uniform(-9, 9, 50)
    again = reading.joint(reading.position(q), reading.velocity(q, qd))
    np.testing.assert_allclose(again, (q, qd), rtol=1e-9, atol=1e-9)


def test_without_wave_nothing_is_rounded():
    q = np.random.default_rng(0).normal(size=20)
    ideal = Reading(np.array(1.0), np.array([0.0, 1.0, 0.0]))
    np.testing.assert_array_equal(ideal.position(q), q)
    np.testing.assert_array_equal(ideal.joint(q, 2 * q), (q, 2 * q))


def test_each_variant_has_its_own():
    gains = np.array([[1.0], [2.0]])
    reading = Reading(gains, np.array([[[0.0, 1.0, 0.0]], [[0.1, 3.0, 0.5]]]))
    q = np.linspace(-1, 1, 5)[None]
    expected = np.concatenate([q, 2 * q + 0.1 * np.sin(3 * q + 0.5)])
    np.testing.assert_allclose(reading.position(q), expected)


def test_of_a_wave_too_steep_for_one_answer_one_is_found():
    reading = Reading(np.array(1.0), np.array([0.1, 40.0, 0.0]))
    shown = np.linspace(-1, 1, 101)
    q, qd = reading.joint(shown, np.ones(101))
    np.testing.assert_allclose(reading.position(q), shown, atol=1e-9)
    assert np.abs(qd).max() <= 5
