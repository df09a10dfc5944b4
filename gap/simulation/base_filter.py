"""The state of a floating base from its inertial unit and its legs: a filter, smoothed.

    smoothed = smooth(motion, stances, settings)      # rotation (n, 3, 3), velocity, covariance …

An error-state Kalman filter runs forwards (Bloesch et al., Robotics: Science and Systems 2012;
Hartley et al., International Journal of Robotics Research 39, 2020) and a Rauch–Tung–Striebel pass
backwards. The unit's angular velocity and acceleration carry rotation R, velocity v and position p
of the base in the world; a foot that stands says that its lowest point, at r and moving with u in
the base's frame, does not move,

    v + R (ω × r + u) = noise

along the ground, and is as high as the ground there, one unknown number for each step. Into the
ground it is its height alone that counts: a foot that sinks in and comes out again moves up and
down by as much, but not at random. Errors are
δθ in the world's frame (R = exp(δθ) R̂), of v and p, of the biases of gyroscope and accelerometer,
and of these heights. Heading and place are never seen: both start from 0 and drift.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]
Bools = NDArray[np.bool_]

THETA, V, P, GYRO_BIAS, ACC_BIAS = (slice(3 * k, 3 * k + 3) for k in range(5))
_FEET = 15  # where the errors of the feet's heights begin

_FIXED = 1e-8  # variance of what is chosen: heading [rad²], place [m²]
_FIRST_TILT, _FIRST_SPEED, _FIRST_HEIGHT = 0.1, 0.5, 0.05  # rad, m/s, m
_SPEED, _SPEED_LASTS = 0.7, 0.5  # m/s, s: how fast a legged robot is where no foot tells
# From one step of a foot to its next: a leg that is longer than the model's is so at every step.
_SAME_HEIGHT = 0.98
_TILT_LASTS = 1.0  # s: how long an inertial unit's own attitude is off one way


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How good the measurements are; standard deviations.

    Attributes:
        gyro, acceleration: of a mean over one step [rad/s, m/s²].
        gyro_bias, acceleration_bias: of what they are off at first [rad/s, m/s²].
        gyro_drift, acceleration_drift: by how much that changes in a second.
        attitude: of the unit's own attitude [rad].
        height: of the ground under one step against the model's [m].
        up: (3,) unit vector in which the ground's height is measured, in the world.
        gravity: (3,) in the world [m/s²].
    """

    gyro: float
    acceleration: float
    gyro_bias: float
    acceleration_bias: float
    gyro_drift: float
    acceleration_drift: float
    attitude: float
    height: float
    up: FloatArray
    gravity: FloatArray

    @functools.cached_property
    def along(self) -> FloatArray:
        """(2, 3) unit vectors along the ground."""
        found: FloatArray = np.linalg.svd(self.up[None])[2][1:]
        return found


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What the inertial unit and the legs have measured, at n instants.

    Attributes:
        step: time from one instant to the next [s].
        turning: (n - 1, 3) mean angular velocity from each instant to the next [rad/s].
        pushing: (n - 1, 3) mean of what the accelerometer reads [m/s²].
        spinning: (n, 3) angular velocity at the instants [rad/s].
        up: (n, 3) upwards by the unit's own attitude, in the base's frame; NaN where it has none.
        point: (n, n_feet, 3) lowest points of the feet in the base's frame [m].
        moving: (n, n_feet, 3) their velocities against the base, in its frame [m/s].
        level: height of the model's ground at the world's origin [m].
        start: (3, 3) the first rotation from the base to the world.
    """

    step: float
    turning: FloatArray
    pushing: FloatArray
    spinning: FloatArray
    up: FloatArray
    point: FloatArray
    moving: FloatArray
    level: float
    start: FloatArray


@dataclass(frozen=True, kw_only=True)
class Stances:
    """Which feet stand.

    Attributes:
        stands: (n, n_feet) whether a foot does.
        slipping: (n, n_feet) variance of how fast it then moves along the ground [m²/s²].
        sinking: (n, n_feet) variance of its height then [m²]; both for independent samples.
    """

    stands: Bools
    slipping: FloatArray
    sinking: FloatArray


@dataclass(frozen=True, kw_only=True)
class Smoothed:
    """The base's state at n instants, and how well it is known.

    Attributes:
        rotation: (n, 3, 3) from the base to the world.
        vector: (n, 12 + n_feet) velocity, position, both biases, heights of the ground.
        covariance: (n, k, k) of the errors as the module's text has them.
    """

    rotation: FloatArray
    vector: FloatArray
    covariance: FloatArray

    def of(self, part: slice) -> FloatArray:
        """(n, 3) velocity, position or a bias, by the place of its errors."""
        found: FloatArray = self.vector[:, part.start - 3 : part.stop - 3]
        return found

    @property
    def heights(self) -> FloatArray:
        """(n, n_feet) of the ground under the feet against the model's [m]."""
        return self.vector[:, _FEET - 3 :]

    def foot_heights(self, motion: Motion, settings: Settings) -> FloatArray:
        """(n, n_feet) how high the feet's lowest points are above the ground under them [m]."""
        points = self.of(P)[:, None] + np.einsum("nij,nfj->nfi", self.rotation, motion.point)
        found: FloatArray = points @ settings.up - motion.level - self.heights
        return found

    def foot_velocity(self, motion: Motion) -> FloatArray:
        """(n, n_feet, 3) how fast the feet's lowest points move in the world [m/s]."""
        spin = (motion.spinning - self.of(GYRO_BIAS))[:, None]
        seen = np.cross(spin, motion.point) + motion.moving
        found: FloatArray = self.of(V)[:, None] + np.einsum("nij,nfj->nfi", self.rotation, seen)
        return found


def smooth(motion: Motion, stances: Stances, settings: Settings) -> Smoothed:
    """The most likely course of the base, and its covariance at each instant."""
    n, feet = stances.stands.shape
    size = _FEET + feet
    rotations = np.empty((2, n, 3, 3))  # predicted, filtered
    vectors = np.empty((2, n, size - 3))
    covariances = np.empty((2, n, size, size))
    carried = np.empty((n - 1, size, size))
    rotation, vector, covariance = _first(motion, settings, feet)
    landed = np.zeros((n, feet), dtype=bool)
    landed[1:] = stances.stands[1:] & ~stances.stands[:-1]
    for k in range(n):
        if k:
            rotation, vector, carried[k - 1] = _carried(motion, settings, k - 1, rotation, vector)
            carry, added = _with_landing(carried[k - 1], landed[k], motion, settings)
            vector[_FEET - 3 :][landed[k]] *= _SAME_HEIGHT
            carried[k - 1] = carry
            covariance = carry @ covariance @ carry.T
            covariance[np.diag_indices(size)] += added
        rotations[0, k], vectors[0, k], covariances[0, k] = rotation, vector, covariance
        rotation, vector, covariance = _updated(
            motion, stances, settings, k, rotation, vector, covariance
        )
        rotations[1, k], vectors[1, k], covariances[1, k] = rotation, vector, covariance
    return _backwards(rotations, vectors, covariances, carried)


def _first(
    motion: Motion, settings: Settings, feet: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The state before anything is known but how the unit lies: on the ground, at rest."""
    up = settings.up
    vector = np.zeros(12 + feet)
    below = -motion.point[0] @ (motion.start.T @ up) if feet else np.zeros(1)
    vector[3:6] = (motion.level + float(below.max())) * up
    variance = np.empty(_FEET + feet)
    variance[THETA] = _FIRST_TILT**2
    variance[V] = _FIRST_SPEED**2
    variance[GYRO_BIAS] = settings.gyro_bias**2
    variance[ACC_BIAS] = settings.acceleration_bias**2
    variance[_FEET:] = settings.height**2
    covariance = np.diag(variance)
    heading = np.outer(*(2 * [_upwards(settings.gravity)]))
    covariance[THETA, THETA] = _FIRST_TILT**2 * (np.eye(3) - heading) + _FIXED * heading
    along = settings.along.T @ settings.along
    covariance[P, P] = _FIRST_HEIGHT**2 * np.outer(up, up) + _FIXED * along
    return motion.start.copy(), vector, covariance


def _carried(
    motion: Motion, settings: Settings, k: int, rotation: FloatArray, vector: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """State after one step, and what it makes of errors before it."""
    dt = motion.step
    turning = motion.turning[k] - vector[6:9]
    half = rotation @ _rotation(0.5 * dt * turning)
    push = half @ (motion.pushing[k] - vector[9:12])
    acceleration = push + settings.gravity
    after = vector.copy()
    after[:3] += dt * acceleration
    after[3:6] += dt * vector[:3] + 0.5 * dt**2 * acceleration
    carry = np.eye(3 + len(vector))
    carry[THETA, GYRO_BIAS] = -dt * half
    carry[V, THETA] = -dt * _cross(push)
    carry[V, ACC_BIAS] = -dt * half
    carry[P, V] = dt * np.eye(3)
    carry[P, THETA] = 0.5 * dt * carry[V, THETA]
    return rotation @ _rotation(dt * turning), after, carry


def _with_landing(
    carry: FloatArray, landed: Bools, motion: Motion, settings: Settings
) -> tuple[FloatArray, FloatArray]:
    """What a step makes of errors, and the variances that it adds; the ground differs by step."""
    dt = motion.step
    added = np.zeros(len(carry))
    added[THETA] = (settings.gyro * dt) ** 2
    added[V] = (settings.acceleration * dt) ** 2
    added[P] = (0.5 * settings.acceleration * dt**2) ** 2
    added[GYRO_BIAS] = settings.gyro_drift**2 * dt
    added[ACC_BIAS] = settings.acceleration_drift**2 * dt
    rows = _FEET + np.flatnonzero(landed)
    carry[rows, rows] = _SAME_HEIGHT
    added[rows] = (1 - _SAME_HEIGHT**2) * settings.height**2
    return carry, added


def _updated(
    motion: Motion,
    stances: Stances,
    settings: Settings,
    k: int,
    rotation: FloatArray,
    vector: FloatArray,
    covariance: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """State and covariance with what is measured at one instant."""
    size = len(covariance)
    feet = np.flatnonzero(stances.stands[k])
    tilted = bool(np.isfinite(motion.up[k, 0]))
    n = len(feet)
    rows = (3 * n if n else 3) + 3 * tilted
    jacobian, wrong, variance = np.zeros((rows, size)), np.empty(rows), np.empty(rows)
    if n:
        spin = motion.spinning[k] - vector[6:9]
        seen = (np.cross(spin, motion.point[k, feet]) + motion.moving[k, feet]) @ rotation.T
        lever = motion.point[k, feet] @ rotation.T
        along = settings.along
        block = jacobian[: 2 * n].reshape(n, 2, size)
        block[:, :, V] = along
        block[:, :, THETA] = -along @ _cross(seen)
        # −R (δb × r) = R [r]× δb, and R [r]× = [R r]× R.
        block[:, :, GYRO_BIAS] = along @ _cross(lever) @ rotation
        wrong[: 2 * n] = -((vector[:3] + seen) @ along.T).ravel()
        variance[: 2 * n] = np.repeat(stances.slipping[k, feet], 2)
        height, up = slice(2 * n, 3 * n), settings.up
        jacobian[height, P] = up
        jacobian[height, THETA] = np.cross(lever, up)  # u · (δθ × r) = δθ · (r × u)
        jacobian[np.arange(2 * n, 3 * n), _FEET + feet] = -1.0
        wrong[height] = motion.level + vector[_FEET - 3 + feet] - (vector[3:6] + lever) @ up
        variance[height] = stances.sinking[k, feet]
    else:
        jacobian[:3, V] = np.eye(3)
        wrong[:3] = -vector[:3]
        variance[:3] = _SPEED**2 * max(_SPEED_LASTS / motion.step, 1.0)
    if tilted:
        up = _upwards(settings.gravity)
        jacobian[-3:, THETA] = np.eye(3) - np.outer(up, up)
        wrong[-3:] = -np.cross(up, rotation @ motion.up[k])
        variance[-3:] = settings.attitude**2 * max(_TILT_LASTS / motion.step, 1.0)
    seen_by = covariance @ jacobian.T
    total = jacobian @ seen_by
    total[np.diag_indices(rows)] += variance
    gain = np.linalg.solve(total, seen_by.T).T
    change = gain @ wrong
    covariance = covariance - gain @ seen_by.T
    return (
        _rotation(change[THETA]) @ rotation,
        vector + change[3:],
        0.5 * (covariance + covariance.T),
    )


def _backwards(
    rotations: FloatArray, vectors: FloatArray, covariances: FloatArray, carried: FloatArray
) -> Smoothed:
    """Rauch–Tung–Striebel: what comes later corrects what was filtered."""
    rotation, vector, covariance = (one[1].copy() for one in (rotations, vectors, covariances))
    for k in range(len(carried) - 1, -1, -1):
        back = np.linalg.solve(covariances[0, k + 1], carried[k] @ covariances[1, k]).T
        turned = Rotation.from_matrix(rotation[k + 1] @ rotations[0, k + 1].T).as_rotvec()
        change = back @ np.concatenate([turned, vector[k + 1] - vectors[0, k + 1]])
        rotation[k] = _rotation(change[THETA]) @ rotations[1, k]
        vector[k] = vectors[1, k] + change[3:]
        covariance[k] += back @ (covariance[k + 1] - covariances[0, k + 1]) @ back.T
    return Smoothed(rotation=rotation, vector=vector, covariance=covariance)


def _upwards(gravity: FloatArray) -> FloatArray:
    up: FloatArray = -gravity / np.linalg.norm(gravity)
    return up


def _rotation(vector: FloatArray) -> FloatArray:
    matrix: FloatArray = Rotation.from_rotvec(vector).as_matrix()
    return matrix


def _cross(vector: FloatArray) -> FloatArray:
    """(..., 3) → (..., 3, 3) matrices of the cross product."""
    found = np.zeros((*vector.shape, 3))
    found[..., 0, 1], found[..., 1, 0] = -vector[..., 2], vector[..., 2]
    found[..., 0, 2], found[..., 2, 0] = vector[..., 1], -vector[..., 1]
    found[..., 1, 2], found[..., 2, 1] = -vector[..., 0], vector[..., 0]
    return found
