"""The rehearsal robot's inertial unit and foot sensors, in place of a motion capture system.

    unit = Imu.drawn(rng)                                        # biases as data sheets have them
    signals = felt(states, step=2.5e-4, stride=8)                # (n_values, n_sims, 6)
    columns = imu_readings(rows, unit, rng)                      # base/imu_angular_velocity_x …

The unit is in the trunk's origin with the trunk's axes. What it feels is its velocity's own change
over the simulated steps, turned into its frame and averaged over the time from one row to the next,
as such a unit's filter does; then its bias and noise are added. Foot sensors say whether a foot is
loaded, some milliseconds late.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

Array = NDArray[np.float64]

GYRO_BIAS, ACCELERATION_BIAS = 0.01, 0.05  # rad/s, m/s²; of units that were calibrated at rest
GRAVITY = np.array([0.0, 0.0, -9.81])
CONTACT_DELAY = 0.008  # s
LOADED = 5.0  # N


@dataclass(frozen=True, kw_only=True, eq=False)
class Imu:
    """An inertial unit.

    Attributes:
        gyro_bias, acceleration_bias: (3,) of what it is off at first [rad/s, m/s²].
        gyro_drift, acceleration_drift: by how much that changes in a second.
        gyro_noise, acceleration_noise: standard deviation of a row.
    """

    gyro_bias: Array
    acceleration_bias: Array
    gyro_drift: float = 2e-4
    acceleration_drift: float = 2e-3
    gyro_noise: float = 0.005
    acceleration_noise: float = 0.1

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Imu:
        """A unit with biases as such units have them."""
        return cls(
            gyro_bias=GYRO_BIAS * rng.standard_normal(3),
            acceleration_bias=ACCELERATION_BIAS * rng.standard_normal(3),
        )


def felt(states: Array, *, step: float, stride: int, gravity: Array = GRAVITY) -> Array:
    """What an ideal unit would read.

    Args:
        states: of the trunk: position, quaternion, linear velocity in the world, angular velocity
            in the trunk's frame, shape (n_values, n_sims, 13).
        step: time from one value to the next, s.
        stride: values from one row to the next.
        gravity: of the world, m/s².

    Returns:
        Angular velocity and acceleration in the trunk's frame, shape (n_values, n_sims, 6).
    """
    w, x, y, z = np.moveaxis(states[..., 3:7], -1, 0)
    to_world = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        -2,
    )
    changes = np.diff(states[..., 7:10], axis=0, append=states[-1:, :, 7:10]) / step
    pushed = np.einsum("tsji,tsj->tsi", to_world, changes - gravity)
    both = np.concatenate([states[..., 10:13], pushed], axis=-1)
    # A filter that looks as far back as a row is long, and no further.
    averaged: Array = uniform_filter1d(
        both, stride, axis=0, origin=(stride - 1) // 2, mode="nearest"
    )
    return averaged


def contacts(loads: Array, *, step: float) -> Array:
    """What foot sensors say, late: 1 where a foot is loaded, shape as `loads` (n_steps, …) in N."""
    late = round(CONTACT_DELAY / step)
    said: Array = (loads > LOADED).astype(np.float64)
    return np.concatenate([np.repeat(said[:1], late, axis=0), said[: len(said) - late]])


def imu_readings(rows: Array, unit: Imu, rate: float, rng: np.random.Generator) -> dict[str, Array]:
    """Columns of a log.

    Args:
        rows: angular velocity and acceleration without error, shape (T, 6).
        unit: the unit.
        rate: rows a second.
        rng: source of drift and noise.

    Returns:
        Column to readings, shape (T,).
    """
    drift = np.cumsum(rng.standard_normal(rows.shape), axis=0) / np.sqrt(rate)
    noise = rng.standard_normal(rows.shape)
    parts = (
        ("angular_velocity", unit.gyro_bias, unit.gyro_drift, unit.gyro_noise),
        ("acceleration", unit.acceleration_bias, unit.acceleration_drift, unit.acceleration_noise),
    )
    columns = {}
    for place, (name, bias, drifts, std) in enumerate(parts):
        for k, axis in enumerate("xyz"):
            at = 3 * place + k
            columns[f"base/imu_{name}_{axis}"] = (
                rows[:, at] + bias[k] + drifts * drift[:, at] + std * noise[:, at]
            )
    return columns
