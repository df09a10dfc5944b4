"""The noise of a channel, from the motion of a servo with known noise put on."""

import functools

import numpy as np
import pytest
from scipy import signal as filters

from walkerkit.gap.recordings.noise import estimate

SECONDS = 12.0


def target(kind, time):
    if kind == "steps":
        return 0.3 * np.sign(np.sin(2.7 * time)) + 0.2 * np.sign(np.sin(1.1 * time))
    if kind == "slow":
        return 0.02 * 2 / np.pi * np.arcsin(np.sin(0.8 * time))
    if kind == "chirp":
        return 0.3 * np.sin(2 * np.pi * (0.1 + 0.3 * time) * time)
    if kind == "fast":
        return 0.15 * np.sin(2 * np.pi * 7 * time)
    return np.where(time > 0.9 * SECONDS, 0.2 * np.sin(9 * time), 0.5)  # mostly at rest


KINDS = ("steps", "slow", "chirp", "fast", "rest")


@functools.cache
def followed(kind):
    """A servo of 4 Hz and damping 0.7 that follows the target, at 1 kHz."""
    time = np.arange(0, SECONDS, 1e-3)
    servo = filters.lti([25**2], [1, 2 * 0.7 * 25, 25**2])
    _, position, _ = filters.lsim(servo, target(kind, time), time)
    return position


def motion(kind, rate):
    return followed(kind)[:: round(1000 / rate)]


def within(factor, value, truth):
    assert truth / factor < value < truth * factor, value / truth


@pytest.mark.parametrize("rate", [1000, 250, 100])
@pytest.mark.parametrize("kind", KINDS)
class TestServo:
    @pytest.mark.parametrize("std", [3e-5, 1e-3])
    def test_white_noise(self, kind, rate, std):
        clean = motion(kind, rate)
        noise = estimate([clean + std * np.random.default_rng(0).normal(size=len(clean))])
        within(2.0, noise.std, std)
        assert noise.quantum == 0.0

    @pytest.mark.parametrize("counts", [2**12, 2**14, 1000])
    def test_quantised(self, kind, rate, counts):
        quantum = 2 * np.pi / counts
        clean = motion(kind, rate)
        noise = estimate([np.round(clean / quantum) * quantum])
        within(1.5, noise.std, quantum / np.sqrt(12))

    def test_noise_and_quantum_together(self, kind, rate):
        rng, quantum = np.random.default_rng(1), 2 * np.pi / 4096
        clean = motion(kind, rate)
        for std in (0.3 * quantum, 2 * quantum):
            noisy = clean + std * rng.normal(size=len(clean))
            noise = estimate([np.round(noisy / quantum) * quantum])
            within(1.6, noise.std, np.hypot(std, quantum / np.sqrt(12)))
            assert noise.quantum == pytest.approx(quantum)

    def test_no_noise_is_far_below_the_motion(self, kind, rate):
        clean = motion(kind, rate)
        assert estimate([clean]).std < 1e-3 * np.ptp(clean)


class TestQuantum:
    def test_printed_digits_are_a_quantum_too(self):
        printed = np.round(motion("chirp", 250), 4)
        noise = estimate([printed])
        assert noise.quantum == pytest.approx(1e-4)
        within(1.5, noise.std, 1e-4 / np.sqrt(12))

    def test_levels_that_printing_split_are_one(self):
        quantum = 2 * np.pi / 4096
        levels = np.round(np.round(motion("chirp", 250) / quantum) * quantum, 5)
        split = levels + 1e-9 * np.random.default_rng(2).integers(0, 2, len(levels))
        for signal in (levels, split):
            assert estimate([signal]).quantum == pytest.approx(quantum, rel=0.01)

    def test_is_found_whatever_the_zero_of_each_recording(self):
        quantum = 0.002
        levels = np.round(motion("chirp", 250) / quantum) * quantum
        assert estimate([levels, levels + 0.0007]).quantum == pytest.approx(quantum)

    @pytest.mark.parametrize("signal", [np.zeros(500), np.repeat([0.0, 1.0], 250)])
    def test_signals_with_hardly_any_value_have_none(self, signal):
        assert estimate([signal]).quantum == 0.0
        assert estimate([signal]).std == pytest.approx(0.0, abs=1e-12)


class TestRecordings:
    def test_all_recordings_of_a_channel_count(self):
        rng = np.random.default_rng(3)
        parts = [motion(kind, 250) for kind in KINDS]
        noise = estimate([part + 1e-4 * rng.normal(size=len(part)) for part in parts])
        within(1.2, noise.std, 1e-4)

    def test_impacts_do_not_decide(self):
        rng = np.random.default_rng(4)
        noisy = motion("slow", 250) + 1e-4 * rng.normal(size=3000)
        noisy[rng.integers(0, 3000, 15)] += 0.1
        within(1.5, estimate([noisy]).std, 1e-4)

    @pytest.mark.parametrize("samples", [2, 9])
    def test_recordings_too_short_say_nothing(self, samples):
        assert estimate([np.exp(np.arange(samples))]).std == 0.0
        assert estimate([]).std == 0.0

    def test_short_recordings_say_a_little(self):
        rng = np.random.default_rng(5)
        shorts = [1e-3 * rng.normal(size=30) for _ in range(20)]
        within(1.3, estimate(shorts).std, 1e-3)
        within(2.0, estimate(shorts[:1]).std, 1e-3)
