"""What an inertial unit and foot sensors log of a base whose pose nobody measures.

    imu_columns(recording)          # those of `IMU_QUATERNION`, `GYRO` and `ACCELERATION` it has
    has_imu(recording)              # whether a base state can be estimated from them
    of_feet(recording)              # {"FL_foot": ("contact",)}

The angular velocity [rad/s] and the acceleration [m/s²] are in the unit's own frame; the
acceleration is what an accelerometer reads, +9.81 upwards at rest. The quaternion, real part first,
turns from the unit's frame to a world whose z points up and whose heading may drift.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from walkerkit.gap.recordings.recording import FOOT_SIGNALS, IMU, Recording

IMU_QUATERNION: Final = IMU[:4]
GYRO: Final = IMU[4:7]
ACCELERATION: Final = IMU[7:]

WHAT_TO_LOG: Final = (
    "base/imu_angular_velocity_x, _y, _z [rad/s] and base/imu_acceleration_x, _y, _z [m/s², +9.81 "
    "upwards at rest] of an inertial unit, or base/imu_quaternion_w, _x, _y, _z of its attitude"
)


def imu_columns(recording: Recording) -> tuple[str, ...]:
    """The columns of an inertial unit that a recording has."""
    return tuple(name for name in IMU if name in recording.columns)


def has_imu(recording: Recording) -> bool:
    """Whether there is enough of an inertial unit to estimate the base's state from."""
    has = recording.columns.keys()
    return has >= {*IMU_QUATERNION} or has >= {*GYRO, *ACCELERATION}


def of_feet(recording: Recording) -> Mapping[str, tuple[str, ...]]:
    """What foot sensors log: foot to its signals, `contact` and `force`."""
    found: dict[str, tuple[str, ...]] = {}
    for name in recording.columns:
        foot, _, signal = name.rpartition("/")
        if signal in FOOT_SIGNALS:
            found[foot] = (*found.get(foot, ()), signal)
    return found
