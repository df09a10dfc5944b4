"""Where the gap lives: which joint, and in which regime.

Each regime is a part of the samples of one joint, taken from its measured motion; regimes overlap.
A regime that holds more of the squared gap than its part of the samples is where to look.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.report.diagnosis import Location
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Excursion

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_HIGH = 0.6  # of the peak
_SLOW = 0.05  # of the peak speed
_REVERSAL = 0.05  # s around a change of direction
_SHOWN = 8
_LEAST_LIFT = 1.15
EVERYWHERE = "everywhere"


def locate(
    replays: Sequence[Replay], residuals: Sequence[FloatArray], joints: Sequence[str]
) -> tuple[Location, ...]:
    """Ranks joints and regimes by how much more of the squared position gap they hold than samples.

    Args:
        replays: the replayed recordings, one replay per robot.
        residuals: of each replay, (rows, n_channels) simulated minus measured.
        joints: names of the joints.

    Returns:
        The locations that hold more than their part, largest excess first, and every joint's
        `everywhere`.
    """
    squares: dict[tuple[str, str], float] = {}
    samples: dict[tuple[str, str], int] = {}
    total_square, total_samples = 0.0, 0
    for replay, residual in zip(replays, residuals, strict=True):
        for joint in joints:
            column = next(
                c
                for c, channel in enumerate(replay.channels)
                if channel.joint == joint and channel.signal == "position"
            )
            error = np.nan_to_num(residual[:, column])
            total_square += float(error @ error)
            total_samples += int(np.isfinite(replay.measured[:, column]).sum())
            for name, mask in _regimes(replay, joint).items():
                key = joint, name
                squares[key] = squares.get(key, 0.0) + float(error[mask] @ error[mask])
                samples[key] = samples.get(key, 0) + int(mask.sum())
    if total_square == 0:
        return ()
    found = []
    for (joint, regime), square in squares.items():
        part = samples[joint, regime] / total_samples
        if part > 0:
            share = square / total_square
            found.append(Location(joint=joint, regime=regime, share=share, lift=share / part))
    found.sort(key=lambda at: (at.lift * at.share - at.share, at.share), reverse=True)
    places = [at for at in found if at.regime != EVERYWHERE and at.lift >= _LEAST_LIFT][:_SHOWN]
    whole = sorted((at for at in found if at.regime == EVERYWHERE), key=lambda at: -at.share)
    return (*places, *whole)


def _regimes(replay: Replay, joint: str) -> dict[str, Mask]:
    """Regime to the rows of a replay that belong to it."""
    excursion = replay.robot.excursion(joint)
    parts: list[dict[str, Mask]] = []
    states: dict[int, MeasuredState] = {}
    for segment in replay.segments:
        recording = segment.recording
        if joint not in recording.joints:
            rows = segment.last - segment.first
            parts.append({EVERYWHERE: np.zeros(rows, dtype=bool)})
            continue
        if id(recording) not in states:
            states[id(recording)] = MeasuredState(recording, [joint])
        time = recording.time[segment.first : segment.last]
        parts.append(_of_motion(recording, states[id(recording)], joint, time, excursion))
    names = dict.fromkeys(name for part in parts for name in part)
    return {
        name: np.concatenate(
            [part.get(name, np.zeros_like(next(iter(part.values())))) for part in parts]
        )
        for name in names
    }


def _of_motion(
    recording: Recording,
    state: MeasuredState,
    joint: str,
    time: FloatArray,
    excursion: Excursion,
) -> dict[str, Mask]:
    qpos, qvel = (values[:, 0] for values in state.at(time))
    half = 0.5 * state.step
    qacc = (state.at(time + half)[1] - state.at(time - half)[1])[:, 0] / state.step
    slow = _SLOW * excursion.velocity
    third = excursion.range / 3
    span = recording.time[-1] - recording.time[0]
    regimes = {
        EVERYWHERE: np.ones(len(time), dtype=bool),
        "velocity_reversal": _near_reversal(time, qvel, slow),
        "high_speed": np.abs(qvel) > _HIGH * excursion.velocity,
        "high_acceleration": np.abs(qacc) > _HIGH * excursion.acceleration,
        "forward": qvel > slow,
        "backward": qvel < -slow,
        "pose_low": qpos < excursion.lower + third,
        "pose_high": qpos > excursion.upper - third,
        "late": time > recording.time[0] + 2 / 3 * span,
    }
    for signal in ("effort", "effort_target"):
        effort = recording.signal(joint, signal)
        if effort is not None:
            now = np.interp(time, recording.time, effort)
            regimes["high_effort"] = np.abs(now) > _HIGH * excursion.effort
            break
    return regimes


def _near_reversal(time: FloatArray, qvel: FloatArray, slow: float) -> Mask:
    """Samples close to a change of direction between stretches of real motion."""
    moving = np.flatnonzero(np.abs(qvel) > slow)
    turns = np.flatnonzero(np.diff(np.sign(qvel[moving])) != 0)
    if not len(turns):
        return np.zeros(len(time), dtype=bool)
    # The joint may rest between the two directions: that all belongs to the reversal.
    begin, end = time[moving[turns]] - _REVERSAL, time[moving[turns + 1]] + _REVERSAL
    k = np.searchsorted(begin, time, side="right") - 1
    return (k >= 0) & (time <= end[np.maximum(k, 0)])
