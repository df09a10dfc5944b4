"""The measured state: position and velocity of a joint at any time of its recording.

Windows restart the simulation from it. The velocity is that of the smoothed positions, which has no
lag, unlike the velocity that drives report; it is used even where a velocity was logged.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.smooth import Smoothed

FloatArray = NDArray[np.float64]


class MeasuredState:
    """Smoothed positions and velocities of some joints.

    Args:
        recording: the log.
        joints: names of joints with a measured position.
    """

    def __init__(self, recording: Recording, joints: Sequence[str]):
        columns = [recording.columns[f"{joint}/position"] for joint in joints]
        self._smoothed = Smoothed(recording.time, np.stack(columns))

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The state at some instants, held at the ends of the recording.

        Args:
            time: (n,) instants [s].

        Returns:
            qpos, qvel: (n, n_joints) each [rad, rad/s; m, m/s on slide joints].
        """
        return self._smoothed.at(time), self._smoothed.slope_at(time)

    @property
    def qvel(self) -> FloatArray:
        """(n_joints, n) velocities on a uniform grid [rad/s]."""
        return self._smoothed.slopes

    @property
    def step(self) -> float:
        """Spacing of that grid [s]."""
        return self._smoothed.step
