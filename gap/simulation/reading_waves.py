"""Waves of a joint's reading: A sin(N q + φ) that the log adds to the positions, and nothing feels.

Of a servo whose effort is logged they show in the error that it leaves of its target. Elsewhere
they show in the effort that they seem to take, to the servo that seems to see them, its damping and
the joint's inertia:

    series = A (kp − I N² q̇²) sin(N q + φ) + A N (d q̇ + I q̈) cos(N q + φ) + …

which is regressed for every N on a grid that is as fine as the joint's range can tell apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_ROWS = 1500  # that are looked at
_FINENESS = 4  # points of the grid per period over the joint's range
_FEWEST = 1.25  # periods over the range
_RIDGE = 1e-9


@dataclass(frozen=True, kw_only=True)
class Sense:
    """What a reading that is too large by a unit makes of the series, (n,) each.

    Attributes:
        position: at once.
        velocity: per rate of change.
        acceleration: per rate of change of that.
        qd, qdd: of the joint.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    qd: FloatArray
    qdd: FloatArray

    def of(self, periods: FloatArray) -> NDArray[np.complex128]:
        """(n, n_periods) factor of exp(i N q)."""
        turning = 1j * (self.velocity * self.qd + self.acceleration * self.qdd)
        static = self.position[:, None] - np.outer(self.acceleration * self.qd**2, periods**2)
        return np.asarray(static + np.outer(turning, periods), dtype=np.complex128)

    def some(self, rows: slice) -> Sense:
        """Some of the samples."""
        return Sense(**{name: values[rows] for name, values in vars(self).items()})


def reading_waves(
    q: FloatArray,
    series: FloatArray,
    beside: FloatArray,
    sense: Sense,
    *,
    highest: float,
    most: int,
) -> list[tuple[float, float, float]]:
    """The most prominent waves.

    Args:
        q: (n,) positions [rad; m].
        series: (n,) what shows them.
        beside: (k, n) what else it shows.
        sense: how it shows them.
        highest: the largest N.
        most: how many.

    Returns:
        Amplitude [rad; m], N [1/rad; 1/m] and phase [rad] of each, the most prominent first.
    """
    rows = slice(None, None, len(q) // _ROWS + 1)
    q, series, sense = q[rows], series[rows], sense.some(rows)
    width = 2 * np.pi / float(np.ptp(q))
    periods = np.arange(_FEWEST * width, highest, width / _FINENESS)
    if not len(periods):
        return []
    basis, _ = np.linalg.qr((beside[:, rows] / np.abs(beside).max(axis=1, keepdims=True)).T)
    turned = np.exp(1j * np.outer(q, periods)) * sense.of(periods)
    sine, cosine = (part - basis @ (basis.T @ part) for part in (turned.imag, turned.real))
    rest = series - basis @ (basis.T @ series)
    size = np.array([[sine * sine, sine * cosine], [sine * cosine, cosine * cosine]]).sum(axis=2)
    size[[0, 1], [0, 1]] += _RIDGE * (size[0, 0] + size[1, 1])
    along = np.stack([sine.T @ rest, cosine.T @ rest], axis=1)
    weights = np.linalg.solve(size.transpose(2, 0, 1), along[..., None])[..., 0]
    gain = (weights * along).sum(axis=1)
    found: list[tuple[float, float, float]] = []
    while len(found) < most and gain.max() > 0:
        k = int(np.argmax(gain))
        amplitude, phase = np.hypot(*weights[k]), np.arctan2(weights[k, 1], weights[k, 0])
        found.append((float(amplitude), float(periods[k]), float(phase)))
        gain[max(0, k - _FINENESS) : k + _FINENESS + 1] = 0
    return found
