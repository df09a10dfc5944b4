"""The base's state where nobody measured its pose: from its inertial unit, legs and contacts.

    recording = with_estimated_base(robot, recording)     # has the base's columns, and `errors`

Everything is on the robot's own terms: where its feet are by the measured joints, the ground by its
model, the unit where the model has the site `imu` on its base, else at the base's origin. What the
feet do that a foot which stands does not (slipping, rolling, sinking) is estimated from the log:
how fast they move on average, for how long one way, and how high the ground is under them.

Limits: heading and place are not seen, they begin at 0 and drift; an accelerometer that is off, on
ground that is not level, leaves the attitude off by as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from walkerkit.gap.recordings.base_state import ANGULAR, LINEAR, ORIENTATIONS, POSITION, missing
from walkerkit.gap.recordings.imu import has_imu
from walkerkit.gap.recordings.recording import QUATERNION, Recording
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.base_filter import (
    ACC_BIAS,
    GYRO_BIAS,
    THETA,
    Motion,
    P,
    Settings,
    Smoothed,
    Stances,
    V,
    smooth,
)
from walkerkit.gap.simulation.base_readings import Sensed, sensed_by
from walkerkit.gap.simulation.feet import Foot, Legs, find_feet
from walkerkit.gap.simulation.ground_geoms import Ground
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.stance import Source, standing
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]

_KNOT = 0.01  # s; the filter takes steps as long where the log has shorter ones
# Of a unit that was calibrated at rest; as delivered, data sheets allow 1°/s and 20 mg.
_GYRO_BIAS, _ACC_BIAS = 0.01, 0.05  # rad/s, m/s²
_GYRO_DRIFT, _ACC_DRIFT = 2e-4, 2e-3  # rad/s and m/s², in a second
_ATTITUDE = 0.02  # rad, of a unit's own
_HEIGHT, _LOWEST_HEIGHT, _HIGHEST_HEIGHT = 5e-3, 4e-3, 0.05  # m, of the ground under a step
_UNKNOWN_HEIGHT = 1.0  # m, where the model's ground is no plane
_SLIP, _LEAST_SLIP = 0.05, 2e-3  # m/s
_SINK, _LEAST_SINK = 3e-3, 2e-4  # m
_LASTS = 0.1  # s, one way, where nothing is known yet
_TAILS = 4.0  # degrees of freedom of the feet's velocities (Student's t)
_PASSES = 2
_LONGEST_MEMORY = 1.0  # s, some strides


def with_known_base(robot: Robot, recording: Recording, *, again: bool = False) -> Recording:
    """A recording whose base is known: as it is, or estimated where nobody measured its pose.

    Args:
        robot: the robot.
        recording: a log that suits it.
        again: what was estimated once is estimated anew.
    """
    if robot.base is None or not has_imu(recording):
        return recording
    if not missing(recording) and not (again and recording.errors):
        return recording
    return with_estimated_base(robot, recording)


def with_estimated_base(robot: Robot, recording: Recording) -> Recording:
    """A recording with the base's pose and velocity as they are estimated.

    Args:
        robot: one that floats.
        recording: a log with an inertial unit (`recordings.imu.has_imu`).

    Returns:
        The recording with the base's columns, their standard deviations in `errors`, and a note.
    """
    base = robot.base
    if base is None:
        raise ValueError(f"{robot.source}: no base floats")
    feet = find_feet(robot.model, base)
    sensed = sensed_by(robot, base, recording)
    joints = [robot.joints[name] for name in recording.joints]
    errors = np.zeros(robot.model.nv)
    state = MeasuredState.shared(recording, recording.joints)
    errors[[joint.dof for joint in joints]] = np.median(state.errors_at(sensed.time)[1], axis=0)
    legs = Legs(robot.model, base, feet, *sensed.states[:2], errors)
    smoothed, source = _estimated(robot, base, sensed, feet, legs)
    return _told(recording, sensed, smoothed, source, robot.model.opt.gravity)


def _estimated(
    robot: Robot, base: Base, sensed: Sensed, feet: Sequence[Foot], legs: Legs
) -> tuple[Smoothed, Source]:
    """The base's course, by passes that learn how well the feet stand."""
    knots = _knots(sensed)
    settings, level = _settings(robot, sensed, int(knots[1]))
    motion = _motion(sensed, knots, settings, level)
    none = np.zeros((len(knots), 0))
    nothing = Stances(stands=none.astype(bool), slipping=none, sinking=none)
    smoothed = smooth(motion, nothing, settings)
    if not feet:
        return smoothed, "heights"
    rotation = _between(sensed, knots, smoothed, settings.gravity)[0].as_matrix()
    found = standing(
        robot, base, sensed.recording, feet, sensed.states, rotation, sensed.pushing, legs
    )
    stands = found.stands[knots]
    stances = Stances(
        stands=stands,
        slipping=np.full(stands.shape, _SLIP**2 * _LASTS / motion.step),
        sinking=np.full(stands.shape, _SINK**2 * _LASTS / motion.step),
    )
    for _ in range(_PASSES):
        motion = _with_feet(motion, smoothed, legs, len(feet), knots, settings)
        motion = replace(motion, start=_upright(smoothed.rotation[0]))
        smoothed = smooth(motion, stances, settings)
        stances, settings = _learned(motion, smoothed, stances, settings, legs)
    return smooth(motion, stances, settings), found.source


def _knots(sensed: Sensed) -> NDArray[np.intp]:
    """The samples at which the filter stops."""
    return np.arange(0, len(sensed.time), max(1, int(_KNOT / sensed.step + 1e-6)))


def _settings(robot: Robot, sensed: Sensed, stride: int) -> tuple[Settings, float]:
    """How good the measurements are, and how high the model's ground is."""
    ground = Ground(robot.model)
    model, height = robot.model, _UNKNOWN_HEIGHT
    up, level = np.array([0.0, 0.0, 1.0]), 0.0
    fixed = ground.fixed
    if len(fixed) == 1 and model.geom_type[fixed[0]] == mujoco.mjtGeom.mjGEOM_PLANE:
        data = rest(model)
        mujoco.mj_kinematics(model, data)
        up = data.geom_xmat[fixed[0]].reshape(3, 3)[:, 2].copy()
        level, height = float(up @ data.geom_xpos[fixed[0]]), _HEIGHT
    settings = Settings(
        gyro=sensed.gyro_noise / np.sqrt(stride),
        acceleration=sensed.acceleration_noise / np.sqrt(stride),
        gyro_bias=_GYRO_BIAS,
        acceleration_bias=_ACC_BIAS,
        gyro_drift=_GYRO_DRIFT,
        acceleration_drift=_ACC_DRIFT,
        attitude=_ATTITUDE,
        height=height,
        up=up,
        gravity=model.opt.gravity.copy(),
    )
    return settings, level


def _motion(sensed: Sensed, knots: NDArray[np.intp], settings: Settings, level: float) -> Motion:
    """What the filter takes of the unit alone, feet left out."""
    stride = int(knots[1] - knots[0])
    dt = stride * sensed.step

    def means(signals: FloatArray) -> FloatArray:
        area = _integral(signals, sensed.step)
        found: FloatArray = np.diff(area[knots], axis=0) / dt
        return found

    first = max(1, round(0.2 / sensed.step))
    up = sensed.up[0] if np.isfinite(sensed.up[0, 0]) else sensed.pushing[:first].mean(axis=0)
    above = -settings.gravity
    start = Rotation.align_vectors(above[None], up[None])[0].as_matrix()
    no_feet = np.zeros((len(knots), 0, 3))
    return Motion(
        step=dt,
        turning=means(sensed.gyro),
        pushing=means(sensed.pushing),
        spinning=sensed.gyro[knots],
        up=sensed.up[knots],
        point=no_feet,
        moving=no_feet,
        level=level,
        start=_upright(start),
    )


def _with_feet(
    motion: Motion,
    smoothed: Smoothed,
    legs: Legs,
    count: int,
    knots: NDArray[np.intp],
    settings: Settings,
) -> Motion:
    """The same with where the feet are lowest by an estimate of the attitude."""
    place = np.minimum(np.arange(legs.rows) / int(knots[1] - knots[0]), len(knots) - 1)
    nearest = smoothed.rotation[np.rint(place).astype(np.intp)]
    down = np.einsum("tji,j->ti", nearest, -settings.up)
    points = [legs.point(f, down) for f in range(count)]
    moving = [legs.velocity(f, point) for f, point in enumerate(points)]
    return replace(
        motion,
        point=np.stack(points, axis=1)[knots],
        moving=np.stack(moving, axis=1)[knots],
    )


def _upright(rotation: FloatArray) -> FloatArray:
    """A rotation with the heading 0."""
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    turned: FloatArray = Rotation.from_euler("z", -yaw).as_matrix() @ rotation
    return turned


def _learned(
    motion: Motion, smoothed: Smoothed, stances: Stances, settings: Settings, legs: Legs
) -> tuple[Stances, Settings]:
    """How fast feet move that stand, for how long one way, and how uneven the ground is."""
    stands = stances.stands
    if not stands.any():
        return stances, settings
    moves = smoothed.foot_velocity(motion) @ settings.along.T
    depths = smoothed.foot_heights(motion, settings)[..., None]
    stances = replace(
        stances,
        slipping=_variance(moves, stands, motion.step, np.hypot(_LEAST_SLIP, legs.noise)),
        sinking=_variance(depths, stands, motion.step, _LEAST_SINK),
    )
    if settings.height < _UNKNOWN_HEIGHT:
        known = smoothed.covariance[:, 15:, 15:].diagonal(axis1=1, axis2=2)
        height = float(np.sqrt(np.mean((smoothed.heights**2 + known)[stands])))
        height = float(np.clip(height, _LOWEST_HEIGHT, _HIGHEST_HEIGHT))
        settings = replace(settings, height=height)
    return stances, settings


def _variance(
    left: FloatArray, stands: NDArray[np.bool_], step: float, least: float | FloatArray
) -> FloatArray:
    """(n, n_feet) variances of independent samples that tell as much as those of a standing foot.

    By expectation–maximisation of Student's t, so that what slips counts for less, times how many
    samples go one way.

    Args:
        left: (n, n_feet, k) what a foot that stands should not do, and does.
        stands: (n, n_feet).
        step: from one sample to the next [s].
        least: standard deviation below which nothing is believed, one or (n_feet,).
    """
    square = np.mean(left**2, axis=2)
    size, typical = left.shape[2], float(np.median(square[stands]))
    for _ in range(20):
        weight = (_TAILS + size) / (_TAILS + size * square / max(typical, 1e-12))
        typical = float(np.mean((weight * square)[stands]))
    each: FloatArray = np.maximum(typical, np.square(least)) / np.minimum(weight, 1.0)
    return _memory(left, stands, step) * each


def _memory(left: FloatArray, stands: NDArray[np.bool_], step: float) -> float:
    """How many samples of what a standing foot does are worth one that is independent.

    A foot that slips a little alike in every stride is off by as much after a hundred of them. So
    it is the spectral density (Blackman–Tukey, by Bartlett's window) at the frequency at which it
    is highest that counts, over that of independent samples.
    """
    held = np.where(stands[..., None], left, 0.0)
    power = float(np.sum(held**2))
    count = min(max(2, round(_LONGEST_MEMORY / step)), len(held))
    if not power or count < 2:
        return 1.0
    lags = np.arange(1, count)
    alike = np.array([float(np.sum(held[lag:] * held[:-lag])) for lag in lags]) / power
    frequencies = np.arange(0.0, 0.5, 0.25 / count)
    waves = np.cos(2 * np.pi * np.outer(frequencies, lags))
    density = 1 + 2 * waves @ (alike * (1 - lags / count))
    return max(1.0, float(density.max()))


def _integral(signals: FloatArray, step: float) -> FloatArray:
    """Since the beginning, of (T, k) samples that are `step` apart."""
    found = np.zeros_like(signals)
    np.cumsum(0.5 * step * (signals[1:] + signals[:-1]), axis=0, out=found[1:])
    return found


def _between(
    sensed: Sensed, knots: NDArray[np.intp], smoothed: Smoothed, gravity: FloatArray
) -> tuple[Rotation, FloatArray]:
    """Rotations and (T, 3) velocities at all samples: as the unit felt it from knot to knot."""
    time, at = sensed.time, sensed.time[knots]

    def interpolated(values: FloatArray) -> FloatArray:
        return np.stack([np.interp(time, at, one) for one in values.T], axis=1)

    spin = sensed.gyro - interpolated(smoothed.of(GYRO_BIAS))
    steps = Rotation.from_rotvec(0.5 * sensed.step * (spin[1:] + spin[:-1])).as_matrix()
    felt = np.empty((len(time), 3, 3))
    felt[0] = smoothed.rotation[0]
    for k, one in enumerate(steps):
        felt[k + 1] = felt[k] @ one
    off = Rotation.from_matrix(smoothed.rotation @ felt[knots].transpose(0, 2, 1)).as_rotvec()
    rotation = Rotation.from_rotvec(interpolated(off)) * Rotation.from_matrix(felt)
    pushed = rotation.apply(sensed.pushing - interpolated(smoothed.of(ACC_BIAS))) + gravity
    speed = _integral(pushed, sensed.step)
    return rotation, speed + interpolated(smoothed.of(V) - speed[knots])


def _told(
    recording: Recording,
    sensed: Sensed,
    smoothed: Smoothed,
    source: Source,
    gravity: FloatArray,
) -> Recording:
    """The recording with what was estimated."""
    rows = _knots(sensed)
    knots = sensed.time[rows]
    time = np.clip(recording.time, knots[0], knots[-1])
    rotation, speed = _between(sensed, rows, smoothed, gravity)
    turned = Slerp(sensed.time, rotation)(np.clip(recording.time, *sensed.time[[0, -1]]))
    place = CubicHermiteSpline(knots, smoothed.of(P), smoothed.of(V))(time)

    def at(values: FloatArray) -> FloatArray:
        return np.stack([np.interp(time, knots, one) for one in values.T], axis=1)

    def rowwise(values: FloatArray) -> FloatArray:
        return np.stack([np.interp(recording.time, sensed.time, one) for one in values.T], axis=1)

    spin = rowwise(sensed.gyro) - at(smoothed.of(GYRO_BIAS))
    values = {
        POSITION: place,
        QUATERNION: np.roll(turned.as_quat(), 1, axis=1),
        LINEAR: rowwise(speed),
        ANGULAR: spin,
    }
    own = np.einsum(
        "nji,njk,nkl->nil",
        smoothed.rotation,
        smoothed.covariance[:, THETA, THETA],
        smoothed.rotation,
    )
    covariances = {
        tuple(f"base/{axis}" for axis in ORIENTATIONS): own,
        **{
            names: smoothed.covariance[:, part, part]
            for names, part in ((POSITION, P), (LINEAR, V), (ANGULAR, GYRO_BIAS))
        },
    }
    stds = {
        names: at(np.sqrt(np.maximum(one.diagonal(axis1=1, axis2=2), 0.0)))
        for names, one in covariances.items()
    }
    columns = dict(recording.columns)
    for names, column in values.items():
        columns |= dict(zip(names, column.T, strict=True))
    return replace(
        recording,
        columns=columns,
        errors={n: v for names, std in stds.items() for n, v in zip(names, std.T, strict=True)},
        notes=(*(n for n in recording.notes if not n.startswith(_NOBODY)), _note(stds, source)),
    )


_NOBODY = "nobody measured the base's pose"
_SOURCES: dict[Source, str] = {
    "logged": "the logged contacts",
    "efforts": "contacts by the joints' efforts",
    "heights": "contacts by how low the feet are",
}


def _note(stds: dict[tuple[str, ...], FloatArray], source: Source) -> str:
    """What a user should know of the estimate."""
    tilt = np.rad2deg(
        float(np.sqrt(np.mean(stds[tuple(f"base/{a}" for a in ORIENTATIONS)][:, :2] ** 2)))
    )
    speed = float(np.sqrt(np.mean(stds[LINEAR] ** 2)))
    return (
        f"{_NOBODY}, so it is estimated from the inertial unit, the legs and "
        f"{_SOURCES[source]}: its attitude to {tilt:.2g}° and its velocity to {speed:.2g} m/s. Of "
        "the base, attitude without heading and angular velocity are compared, and what the "
        "estimate may be wrong by is in their noise floors"
    )
