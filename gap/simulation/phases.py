"""How long the feet of a robot that walks stand and swing, by its log.

np.median(phases_of(robot, recording))      # s; without bound where most feet stay down
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from walkerkit.gap.recordings.base_state import quaternions
from walkerkit.gap.recordings.recording import QUATERNION, Recording
from walkerkit.gap.simulation.feet import Legs, find_feet
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.stance import as_low_as_the_lowest, logged_stance
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]

_RATE: Final = 100.0  # Hz, at which feet are looked at


def phases_of(robot: Robot, recording: Recording) -> FloatArray:
    """How long the phases last, standing or swinging, that the feet are in at many instants.

    By foot sensors where the log has them, else by how low each foot is in the measured posture.

    Args:
        robot: the robot.
        recording: a log with the pose of its base, measured or estimated.

    Returns:
        (n,) durations [s], without bound where a foot does the same in all of the log; none of a
        robot that does not float.
    """
    feet = find_feet(robot.model, robot.base)
    if robot.base is None or not feet or any(name not in recording.columns for name in QUATERNION):
        return np.empty(0)
    rows = np.arange(0, len(recording.time), max(1, round(recording.rate / _RATE)))
    logged = [logged_stance(recording, foot) for foot in feet]
    stands = [one[rows] for one in logged if one is not None]
    if len(stands) < len(feet):
        turned = Rotation.from_quat(np.roll(quaternions(recording)[rows], -1, axis=1))
        qpos = np.tile(rest(robot.model).qpos, (len(rows), 1))
        for name in recording.joints:
            qpos[:, robot.joints[name].qpos] = recording.columns[f"{name}/position"][rows]
        still = np.zeros((len(rows), robot.model.nv))
        legs = Legs(robot.model, robot.base, feet, qpos, still, still[0])
        stands = list(as_low_as_the_lowest(turned.as_matrix(), legs, len(feet)).T)
    return np.concatenate([_durations(one, recording.time[rows]) for one in stands])


def _durations(stands: NDArray[np.bool_], time: FloatArray) -> FloatArray:
    changes = np.flatnonzero(np.diff(stands)) + 1
    if not changes.size:
        return np.full(len(time), np.inf)
    edges = np.r_[0, changes, len(time) - 1]
    counts = np.diff(np.r_[0, changes, len(time)])
    return np.repeat(np.diff(time[edges]), counts)
