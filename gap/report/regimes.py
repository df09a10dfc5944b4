"""The regimes of a joint's measured motion: which samples belong to which.

Regimes overlap: a sample may be fast, at high effort and late.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.report.statics import Statics
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

EVERYWHERE = "everywhere"
REGIMES = (
    *("velocity_reversal", "resting", "high_speed", "high_acceleration"),
    *("high_effort", "high_load", "forward", "backward"),
    *("pose_low", "pose_high", "contact", "late"),
)
"""All of them, in the order in which they are shown."""

_HIGH = 0.6  # of the peak
_SLOW = 0.05  # of the peak speed
_REVERSAL = 0.05  # s around a change of direction
_FELT = 0.02  # of the peak effort; gravity that makes less is no load


def regimes(replay: Replay, joints: Sequence[str]) -> dict[str, dict[str, Mask]]:
    """Joint and regime to the rows of a replay that belong to it, `everywhere` among them."""
    recordings = {id(segment.recording): segment.recording for segment in replay.segments}
    per_recording = {
        key: _of_recording(replay.robot, recording, joints) for key, recording in recordings.items()
    }
    return {
        joint: {
            name: np.concatenate(
                [
                    per_recording[id(segment.recording)][joint][name][segment.first : segment.last]
                    for segment in replay.segments
                ]
            )
            for name in (*REGIMES, EVERYWHERE)
        }
        for joint in joints
    }


def _of_recording(
    robot: Robot, recording: Recording, joints: Sequence[str]
) -> dict[str, dict[str, Mask]]:
    statics = Statics(robot, recording)
    nowhere = np.zeros(len(recording.time), dtype=bool)
    return {
        joint: dict.fromkeys((*REGIMES, EVERYWHERE), nowhere)
        | (_of_joint(robot, recording, statics, joint) if joint in recording.joints else {})
        for joint in joints
    }


def _of_joint(robot: Robot, recording: Recording, statics: Statics, joint: str) -> dict[str, Mask]:
    time, whole, excursion = recording.time, recording.whole, robot.excursion(joint)
    state = MeasuredState(recording, [joint])
    qpos, qvel = (values[:, 0] for values in state.at(time))
    half = 0.5 * state.step
    qacc = (state.at(time + half)[1] - state.at(time - half)[1])[:, 0] / state.step
    slow = _SLOW * excursion.velocity
    third = excursion.range / 3
    load = np.abs(statics.load(joint, time))
    loaded = load.max() > _FELT * excursion.effort
    found = {
        EVERYWHERE: np.ones(len(time), dtype=bool),
        "velocity_reversal": _near_reversal(time, qvel, slow),
        "resting": np.abs(qvel) <= slow,
        "high_speed": np.abs(qvel) > _HIGH * excursion.velocity,
        "high_acceleration": np.abs(qacc) > _HIGH * excursion.acceleration,
        "high_load": load > _HIGH * load.max() if loaded else np.zeros(len(time), dtype=bool),
        "forward": qvel > slow,
        "backward": qvel < -slow,
        "pose_low": qpos < excursion.lower + third,
        "pose_high": qpos > excursion.upper - third,
        "contact": statics.touching(joint, time),
        "late": time > whole.time[0] + 2 / 3 * whole.duration,
    }
    for signal in ("effort", "effort_target"):
        effort = recording.signal(joint, signal)
        if effort is not None:
            found["high_effort"] = np.abs(effort) > _HIGH * excursion.effort
            break
    return found


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
