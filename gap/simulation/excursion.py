"""How far each joint went in its recordings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.simulation.robot import Excursion, Robot

FloatArray = NDArray[np.float64]

_PEAK = 99.5  # percentile; single samples do not decide
_SMALLEST = 1e-6


def excursions(
    robot: Robot, recordings: Sequence[Recording], joints: Sequence[str]
) -> dict[str, Excursion]:
    """Positions, speeds, accelerations and efforts of every joint that was recorded.

    Args:
        robot: the robot; its nominal drive tells the effort where none was logged.
        recordings: its recordings.
        joints: names of joints.

    Returns:
        Joint to its excursion.
    """
    found = {}
    for joint in joints:
        logs = [r for r in recordings if joint in r.joints]
        if not logs:
            continue
        states = [MeasuredState(r, [joint]) for r in logs]
        velocity = np.concatenate([state.qvel[0] for state in states])
        acceleration = np.concatenate([np.gradient(s.qvel[0], s.step) for s in states])
        position = np.concatenate([r.columns[f"{joint}/position"] for r in logs])
        inertia = float(robot.model.dof_M0[robot.joints[joint].dof])
        measured = [_peak(e) for r in logs if (e := r.signal(joint, "effort")) is not None]
        # Without a measured effort: what was commanded, or what the model's servo would make.
        guessed = [_peak(inertia * acceleration)]
        for recording, state in zip(logs, states, strict=True):
            commanded = recording.signal(joint, "effort_target")
            guessed += [] if commanded is None else [_peak(commanded)]
            guessed += _nominal(robot, recording, state, joint)
        found[joint] = Excursion(
            lower=float(position.min()),
            upper=float(position.min()) + max(float(np.ptp(position)), _SMALLEST),
            velocity=_peak(velocity),
            acceleration=_peak(acceleration),
            effort=max(measured or guessed),
        )
    return found


def _peak(values: FloatArray) -> float:
    return max(float(np.percentile(np.abs(values), _PEAK)), _SMALLEST)


def _nominal(robot: Robot, recording: Recording, state: MeasuredState, joint: str) -> list[float]:
    """Peak effort of the model's servo at the measured state."""
    model = robot.model
    qpos, qvel = state.at(recording.time)
    peaks = []
    for drive in robot.joints[joint].drives:
        if drive.kind == "effort":
            continue
        target = recording.signal(joint, f"{drive.kind}_target")
        if target is None:
            continue
        gain, error = (
            (drive.stiffness, target - qpos[:, 0])
            if drive.kind == "position"
            else (drive.damping, target)
        )
        effort = gain * error - drive.damping * qvel[:, 0]
        if model.actuator_forcelimited[drive.actuator]:
            gear = abs(float(model.actuator_gear[drive.actuator, 0]))
            low, high = gear * model.actuator_forcerange[drive.actuator]
            effort = np.clip(effort, low, high)
        peaks.append(_peak(effort))
    return peaks
