"""What the log shows of a joint's position and velocity: a q + A sin(N q + φ), and its slope.

    reading = Reading(gain=1.01, wave=np.array([0.002, 40.0, 0.3]))
    shown = reading.position(q)
    q, qd = reading.joint(shown, shown_velocity)        # and back

All arrays broadcast.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_HALVINGS = 50  # of where the position can be
_FLATTEST = 0.2  # slope, below which a reading says little of the position


@dataclass(frozen=True)
class Reading:
    """How an encoder reads a joint.

    Attributes:
        gain: (...) a [1].
        wave: (..., 3) amplitude A [rad; m], periods N per radian or metre, phase φ [rad].
    """

    gain: FloatArray
    wave: FloatArray

    @property
    def straight(self) -> bool:
        """There is no wave in it."""
        return not self.wave[..., 0].any()

    def position(self, q: FloatArray) -> FloatArray:
        """What is shown of a position [rad; m]."""
        return self.gain * q if self.straight else self.gain * q + self._wave(q)

    def velocity(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """What is shown of a velocity [rad/s; m/s]."""
        return self.gain * qd if self.straight else self._slope(q) * qd

    def joint(self, position: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The position and velocity of which these are shown.

        Where a wave is so steep that several are, one of them.
        """
        q = position / self.gain
        if self.straight:
            return q, velocity / self.gain
        width = np.abs(self.wave[..., 0]) / self.gain
        low, high = q - width, q + width
        for _ in range(_HALVINGS):
            q = 0.5 * (low + high)
            beyond = self.position(q) > position
            low, high = np.where(beyond, low, q), np.where(beyond, q, high)
        return q, velocity / np.maximum(self._slope(q), _FLATTEST * self.gain)

    def _wave(self, q: FloatArray) -> FloatArray:
        amplitude, periods, phase = np.moveaxis(self.wave, -1, 0)
        wave: FloatArray = amplitude * np.sin(periods * q + phase)
        return wave

    def _slope(self, q: FloatArray) -> FloatArray:
        amplitude, periods, phase = np.moveaxis(self.wave, -1, 0)
        slope: FloatArray = self.gain + amplitude * periods * np.cos(periods * q + phase)
        return slope
