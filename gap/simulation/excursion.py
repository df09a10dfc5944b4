"""How far each joint went in its recordings."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.simulation.robot import Excursion, Robot
from walkerkit.gap.simulation.wave import Wave
from walkerkit.gap.simulation.waves import nominal_effort, waves

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
    voltage = _voltage(recordings)
    # Most effects have none, so they are looked for when one asks.
    every = functools.cache(lambda: waves(robot, recordings, joints))

    def prominent(joint: str) -> tuple[Wave, ...]:
        return every()[joint]

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
            qpos, qvel = state.at(recording.time)
            made = nominal_effort(robot, recording, joint, qpos[:, 0], qvel[:, 0])
            guessed += [] if made is None else [_peak(made)]
        found[joint] = Excursion(
            lower=float(position.min()),
            upper=float(position.min()) + max(float(np.ptp(position)), _SMALLEST),
            velocity=_peak(velocity),
            acceleration=_peak(acceleration),
            effort=max(
                measured if measured and robot.joints[joint].commanded else measured + guessed
            ),
            duration=max(float(np.ptp(r.whole.time)) for r in logs),
            voltage=voltage,
            prominent=functools.partial(prominent, joint),
        )
    return _through_loops(robot, found)


def _through_loops(robot: Robot, found: dict[str, Excursion]) -> dict[str, Excursion]:
    """The same, with the efforts of drives at the joints that these move through loops."""
    driven = {joint for joint in found if robot.joints[joint].commanded}
    most = max((found[joint].effort for joint in driven), default=0.0)
    for joint in (robot.loops.holds(driven) & found.keys()) - driven:
        found[joint] = replace(found[joint], effort=max(found[joint].effort, most))
    return found


def _voltage(recordings: Sequence[Recording]) -> tuple[float, float, float] | None:
    """Median, lowest and highest voltage of the supply, single samples aside [V]."""
    logged = [r.columns["voltage"] for r in recordings if "voltage" in r.columns]
    if not logged:
        return None
    values = np.concatenate(logged)
    low, middle, high = np.nanpercentile(values, (100 - _PEAK, 50, _PEAK))
    return float(middle), float(low), float(high)


def _peak(values: FloatArray) -> float:
    return max(float(np.percentile(np.abs(values), _PEAK)), _SMALLEST)
