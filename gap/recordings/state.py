"""The measured state: position and velocity of a joint at any time of its recording.

Windows restart the simulation from it. A local cubic fitted to the positions around each instant
(Savitzky and Golay, Analytical Chemistry 36, 1964) has no lag, unlike the velocity that drives
report; it is used even where a velocity was logged.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from walkerkit.gap.recordings.recording import Recording

FloatArray = NDArray[np.float64]

_WINDOW = 0.05  # s; short against a leg's motion, long against the encoder's steps
_ORDER = 3
_FEWEST_SAMPLES = 7
_ROUNDING = 1e-6  # of a step


class MeasuredState:
    """Smoothed positions and velocities of some joints.

    Args:
        recording: the log.
        joints: names of joints with a measured position.
    """

    def __init__(self, recording: Recording, joints: Sequence[str]):
        time = recording.time
        step = float(np.median(np.diff(time)))
        steps = int(np.floor((time[-1] - time[0]) / step + _ROUNDING))
        self._grid = time[0] + step * np.arange(steps + 1)
        samples = max(_FEWEST_SAMPLES, round(_WINDOW / step))
        samples = min(samples | 1, (len(self._grid) - 1) | 1)  # odd, and no longer than the log
        order = min(_ORDER, samples - 1)
        columns = [recording.columns[f"{joint}/position"] for joint in joints]
        resampled = np.stack([np.interp(self._grid, time, column) for column in columns])
        if len(self._grid) <= samples:
            samples, order = 1, 0
        self._qpos = savgol_filter(resampled, samples, order)
        self._qvel = (
            savgol_filter(resampled, samples, order, deriv=1, delta=step)
            if order
            else np.gradient(resampled, step, axis=1)
        )

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The state at some instants, held at the ends of the recording.

        Args:
            time: (n,) instants [s].

        Returns:
            qpos, qvel: (n, n_joints) each [rad, rad/s; m, m/s on slide joints].
        """
        return (
            np.stack([np.interp(time, self._grid, row) for row in self._qpos], axis=-1),
            np.stack([np.interp(time, self._grid, row) for row in self._qvel], axis=-1),
        )

    @property
    def qvel(self) -> FloatArray:
        """(n_joints, n) velocities on a uniform grid [rad/s]."""
        return self._qvel

    @property
    def step(self) -> float:
        """Spacing of that grid [s]."""
        return float(self._grid[1] - self._grid[0])
