"""A log as the estimate of the base's state takes it: evenly sampled, in the base's frame.

    sensed = sensed_by(robot, base, recording)
    sensed.gyro, sensed.pushing, sensed.states

The joints are smoothed as where replays start from them; what the inertial unit reads is turned to
the base's axes and moved to its origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from walkerkit.gap.recordings.imu import ACCELERATION, GYRO, IMU_QUATERNION
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.smooth import Smoothed as SmoothedSignals
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.simulation.base import Base, imu_mounting
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]

_LEAST_GYRO, _LEAST_ACC = 2e-3, 0.05  # rad/s, m/s²
_NO_ACCELEROMETER = 3.0  # m/s², how a walking trunk is accelerated


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """A log, evenly sampled: the joints' states and the unit's readings in the base's frame.

    Attributes:
        recording: the log at these times.
        time: (T,) [s].
        step: from one sample to the next [s].
        states: (T, nq) positions, (T, nv) velocities and accelerations of the joints.
        gyro: (T, 3) [rad/s].
        pushing: (T, 3) of an accelerometer at the base's origin [m/s²]; gravity by the unit's own
            attitude where it has none.
        up: (T, 3) upwards by its own attitude; NaN where it has none.
        gyro_noise, acceleration_noise: standard deviation of a sample.
    """

    recording: Recording
    time: FloatArray
    step: float
    states: tuple[FloatArray, FloatArray, FloatArray]
    gyro: FloatArray
    pushing: FloatArray
    up: FloatArray
    gyro_noise: float
    acceleration_noise: float


def sensed_by(robot: Robot, base: Base, recording: Recording) -> Sensed:
    """A log as the filter takes it."""
    step = float(np.median(np.diff(recording.time)))
    count = int(np.floor((recording.time[-1] - recording.time[0]) / step + 1e-6)) + 1
    time = recording.time[0] + step * np.arange(count)
    state = MeasuredState.shared(recording, recording.joints)
    joints = [robot.joints[name] for name in recording.joints]
    qpos = np.tile(rest(robot.model).qpos, (count, 1))
    qvel, qacc = np.zeros((2, count, robot.model.nv))
    at, dofs = [joint.qpos for joint in joints], [joint.dof for joint in joints]
    qpos[:, at], qvel[:, dofs] = state.at(time)
    qacc[:, dofs] = np.gradient(qvel[:, dofs], step, axis=0)

    columns = {n: np.interp(time, recording.time, one) for n, one in recording.columns.items()}

    def even(names: Sequence[str]) -> FloatArray | None:
        if any(name not in columns for name in names):
            return None
        return np.stack([columns[name] for name in names], axis=1)

    gravity = robot.model.opt.gravity
    place, mounted = imu_mounting(robot.model, base.id)
    own = even(IMU_QUATERNION)
    up = np.full((count, 3), np.nan)
    attitude = None
    if own is not None:
        flips = np.where(np.sum(own[1:] * own[:-1], axis=1) < 0, -1.0, 1.0)
        own[1:] *= np.cumprod(flips)[:, None]
        attitude = Rotation.from_quat(np.roll(own, -1, axis=1)) * Rotation.from_matrix(mounted.T)
        up = attitude.inv().apply([0.0, 0.0, 1.0])
    gyro = even(GYRO)
    if gyro is not None:
        gyro = gyro @ mounted.T
    elif attitude is not None:
        turned = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / step
        gyro = SmoothedSignals(time, np.vstack([turned, turned[-1:]]).T).values.T.copy()
    else:
        raise ValueError("neither angular velocity nor attitude")
    pushing = even(ACCELERATION)
    noise = _NO_ACCELEROMETER / np.sqrt(step)
    if pushing is not None:
        noise = max(_white(pushing), _LEAST_ACC)
        smooth_gyro = SmoothedSignals(time, gyro.T)
        spin, spun_up = smooth_gyro.values.T, smooth_gyro.slopes.T
        lever = np.cross(spun_up, place) + np.cross(spin, np.cross(spin, place))
        pushing = pushing @ mounted.T - lever
    else:
        pushing = float(np.linalg.norm(gravity)) * up
    return Sensed(
        recording=Recording(name=recording.name, time=time, columns=columns),
        time=time,
        step=step,
        states=(qpos, qvel, qacc),
        gyro=gyro,
        pushing=pushing,
        up=up,
        gyro_noise=max(_white(gyro), _LEAST_GYRO),
        acceleration_noise=noise,
    )


def _white(signals: FloatArray) -> float:
    """Standard deviation of the white noise of (T, k) signals, impacts and all."""
    if len(signals) < 3:
        return 0.0
    return float(np.sqrt(np.mean(np.diff(signals, 2, axis=0) ** 2) / 6))
