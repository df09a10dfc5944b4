"""Quirks of real logs: angles that wrap are unwrapped, what cannot be mended is told."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.tidy import tidied

FloatArray = NDArray[np.float64]
TIME = np.arange(2000) * 0.002
TARGET = 0.5 * np.cos(2 * np.pi * 0.7 * TIME * (1 + 0.2 * TIME))


def log(position: FloatArray, target: FloatArray = TARGET) -> Recording:
    return Recording(
        name="log", time=TIME, columns={"knee/position": position, "knee/position_target": target}
    )


def wrapped(angle: FloatArray) -> FloatArray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def noisy(position: FloatArray, counts: float = 1e-3) -> FloatArray:
    noise = np.random.default_rng(0).normal(0, 5e-4, len(position))
    rounded: FloatArray = counts * np.round((position + noise) / counts)
    return rounded


def late(values: FloatArray, samples: int) -> FloatArray:
    return values[np.maximum(np.arange(len(values)) - samples, 0)]


def test_an_ordinary_log_is_left_alone() -> None:
    for position in (noisy(late(TARGET, 5)), noisy(0.02 * TARGET), np.round(TARGET, 1)):
        recording = log(position)
        assert tidied(recording).notes == ()
        assert tidied(recording).columns["knee/position"] is not None
        np.testing.assert_array_equal(tidied(recording).columns["knee/position"], position)
    steps = 0.4 * np.sign(np.sin(9 * TIME))
    assert tidied(log(noisy(0.4 * np.tanh(20 * np.sin(9 * TIME - 0.6))), steps)).notes == ()


@pytest.mark.parametrize("offset", [0.0, 2.9, -3.0])
def test_angles_that_wrap_are_unwrapped(offset: float) -> None:
    angle = offset + 4 * TARGET
    found = tidied(log(wrapped(late(angle, 5)), wrapped(angle)))
    np.testing.assert_allclose(
        found.columns["knee/position"] - found.columns["knee/position_target"],
        late(angle, 5) - angle,
        atol=1e-9,
    )
    assert "knee/position_target jumps by a turn" in " ".join(found.notes) or not offset


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("share", [1.0, 0.6])
def test_a_target_that_wraps_is_unwrapped_however_it_is_followed(sign: int, share: float) -> None:
    angle = 5 * TIME
    found = tidied(log(sign * share * late(angle, 30), wrapped(angle)))
    np.testing.assert_allclose(found.columns["knee/position_target"], angle, atol=1e-9)


@pytest.mark.parametrize("wraps", [False, True])
@pytest.mark.parametrize("step", [2 * np.pi, -2 * np.pi, 6.0])
def test_a_commanded_turn_is_no_wrap(step: float, wraps: bool) -> None:
    target = step * ((TIME > 1) & (TIME < 3))
    turned = lfilter([0.01], [1, -0.99], target)
    recording = log(wrapped(noisy(turned)) if wraps else noisy(turned), target)
    found = tidied(recording)
    np.testing.assert_array_equal(found.columns["knee/position_target"], target)
    np.testing.assert_allclose(found.columns["knee/position"], turned, atol=5e-3)
    assert not any("position_target" in note for note in found.notes)


def test_turns_between_a_reading_and_its_target_are_taken_away() -> None:
    found = tidied(log(late(TARGET, 5) + 4 * np.pi))
    np.testing.assert_allclose(found.columns["knee/position"], late(TARGET, 5), atol=1e-12)
    assert found.notes == ("knee/position is +2 turns from its target; they were taken away",)


def test_a_wheel_may_turn_as_often_as_it_likes() -> None:
    found = tidied(log(wrapped(40 * TIME)))
    np.testing.assert_allclose(found.columns["knee/position"], 40 * TIME, atol=1e-9)
    assert found.notes[0].startswith("knee/position jumps by a turn 25 times, first at 0.08 s")


def test_a_saturated_encoder_is_told() -> None:
    (note,) = tidied(log(np.clip(noisy(TARGET), -0.3, 1))).notes
    assert "knee/position stays at its smallest value -0.3 for" in note
    assert "a saturated encoder, or a stop" in note


def test_samples_that_repeat_are_told() -> None:
    held = np.repeat(noisy(TARGET, 1e-4)[::5], 5)
    assert "logged about 5 times as fast as it was measured" in tidied(log(held)).notes[0]


def test_a_measurement_ahead_of_its_target_is_told() -> None:
    (note,) = tidied(log(noisy(TARGET), late(TARGET, 20))).notes
    ahead = float(note.split("is ")[1].split(" ms")[0])
    assert ahead == pytest.approx(40, abs=10)
    assert "out of step" in note


@pytest.mark.parametrize(("leading", "told"), [(1, 0), (3, 3)])
def test_a_joint_that_the_others_move_is_not_out_of_step(leading: int, told: int) -> None:
    standing = {f"base/quaternion_{axis}": 0 * TIME + (axis == "w") for axis in "wxyz"}
    standing |= {f"base/position_{axis}": 0 * TIME for axis in "xyz"}
    for k, joint in enumerate(("hip", "thigh", "calf")):
        target = late(TARGET, 20) if k < leading else TARGET
        standing |= {f"{joint}/position": noisy(TARGET), f"{joint}/position_target": target}
    notes = tidied(Recording(name="log", time=TIME, columns=standing)).notes
    assert sum("out of step" in note for note in notes) == told
    # On a stand the base may have an inertial sensor all the same.
    for left_out in ("base/", "base/position"):
        fixed = {name: column for name, column in standing.items() if left_out not in name}
        notes = tidied(Recording(name="log", time=TIME, columns=fixed)).notes
        assert sum("out of step" in note for note in notes) == leading


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("end", [1e9, 1e300])
def test_a_log_that_is_mostly_a_gap_is_looked_at_all_the_same(end: float) -> None:
    columns = {"knee/position": noisy(TARGET), "knee/position_target": late(TARGET, 20)}
    recording = Recording(name="log", time=np.append(TIME[:-1], end), columns=columns)
    assert not any("out of step" in note for note in tidied(recording).notes)


@pytest.mark.parametrize("to", [0.4, -0.4])
def test_a_servo_that_stops_where_it_was_to_go_is_no_saturated_encoder(to: float) -> None:
    # At full speed into its target, where its reading stays to the last bit.
    target = np.clip(to * (TIME - 1), min(0, to), max(0, to))
    position = np.round(np.clip(to * (TIME - 1.01), min(0, to), max(0, to)), 4)
    assert not any("saturated" in note for note in tidied(log(position, target)).notes)
    # The same reading of a target that goes on.
    further = np.clip(to * (TIME - 1), min(0, 2 * to), max(0, 2 * to))
    (note,) = tidied(log(position, further)).notes
    assert "saturated encoder, or a stop" in note


def test_a_log_that_begins_in_motion_says_what_its_beginning_is_for() -> None:
    swing = 0.5 * np.sin(4 * TIME)
    (note,) = tidied(log(noisy(swing, 1e-5), swing)).notes
    assert note == (
        "it begins while 'knee' moves: what the targets were before its first row is unknown. "
        "Replays of it as a whole begin 0.1 s later, unless it is short, and take them to be what "
        "they are there"
    )
    rested = 0.5 * (1 - np.cos(4 * TIME))
    assert tidied(log(noisy(rested, 1e-5), rested)).notes == ()
