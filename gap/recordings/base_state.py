"""The base of a robot that floats: its measured pose and velocity, and what is compared of them.

    missing(recording)                         # () where the log has the whole pose
    base_signal(recording, "orientation_y")    # (T,) rad, the pitch
    BaseState(recording).at(time)              # (n, 7) and (n, 6), as a MuJoCo free joint has them
    with_checked_base(recording)               # a note of each velocity that is not used
    compared(recording)                        # which of `SIGNALS`: few of an estimated base's

Position and linear velocity are in the world's frame; the quaternion, real part first, turns from
the base's frame to the world's; the angular velocity is in the base's frame. A quaternion and its
opposite are the same pose, so jumps between them do not matter. Where no velocity was logged, or
one that contradicts the poses (most often one in the other frame), it is the poses' own, and that
is told. Of a base that was estimated (`Recording.errors`), where it is and where it heads are not
compared: nothing has seen them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from walkerkit.gap.recordings import noise
from walkerkit.gap.recordings.recording import QUATERNION, Recording
from walkerkit.gap.recordings.smooth import Smoothed

FloatArray = NDArray[np.float64]

BASE: Final = "base"
"""What takes the place of a joint's name in channels, reports and columns."""
POSITION: Final = tuple(f"base/position_{axis}" for axis in "xyz")
LINEAR: Final = tuple(f"base/linear_velocity_{axis}" for axis in "xyz")
ANGULAR: Final = tuple(f"base/angular_velocity_{axis}" for axis in "xyz")
ORIENTATIONS: Final = tuple(f"orientation_{axis}" for axis in "xyz")
TURNING: Final = tuple(f"angular_velocity_{axis}" for axis in "xyz")
SIGNALS: Final = (*(f"position_{axis}" for axis in "xyz"), *ORIENTATIONS, *TURNING)
"""What can be compared: position [m], orientation [rad] as roll, pitch and yaw, and, of a base with
an inertial unit, angular velocity [rad/s] in its own frame."""
_OF_POSES, _OF_UNITS = SIGNALS[:6], (*ORIENTATIONS[:2], *TURNING)

_CONTRADICTS = 0.5  # of the velocity that the poses have
_SLOW = {LINEAR: 0.02, ANGULAR: 0.1}  # m/s, rad/s; differences below are the poses' own noise
_AVERAGED = 0.2  # s, over which velocities are compared: a change of pose has little noise


def missing(recording: Recording) -> tuple[str, ...]:
    """The columns of the base's pose that a recording lacks."""
    return tuple(name for name in (*POSITION, *QUATERNION) if name not in recording.columns)


def compared(recording: Recording) -> tuple[str, ...]:
    """Which of `SIGNALS` a recording has: none without the pose, measured or estimated."""
    if missing(recording):
        return ()
    return _OF_UNITS if recording.errors else _OF_POSES


def base_signal(recording: Recording, signal: str) -> FloatArray | None:
    """One of `SIGNALS`.

    Args:
        recording: the log.
        signal: its name.

    Returns:
        (T,) m in the world's frame, rad of roll, pitch and yaw without jumps, or rad/s; None where
        nothing of the recording is to be compared with it.
    """
    if signal not in compared(recording):
        return None
    if signal in ORIENTATIONS:
        return angles(quaternions(recording))[:, ORIENTATIONS.index(signal)]
    return recording.columns[f"base/{signal}"]


def quaternions(recording: Recording) -> FloatArray:
    """(T, 4) unit quaternions without changes of sign."""
    quaternion = np.stack([recording.columns[name] for name in QUATERNION], axis=1)
    quaternion = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    flips = np.sign(np.sum(quaternion[1:] * quaternion[:-1], axis=1))
    signs = np.concatenate([[1.0], np.cumprod(np.where(flips < 0, -1.0, 1.0))])
    continuous: FloatArray = quaternion * signs[:, None]
    return continuous


def angles(quaternion: FloatArray) -> FloatArray:
    """Roll, pitch and yaw, (T, 4) → (T, 3) rad: turned about z, then the new y, then the new x."""
    w, x, y, z = quaternion.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([np.unwrap(roll), pitch, np.unwrap(yaw)], axis=1)


def turned(first: FloatArray, second: FloatArray) -> FloatArray:
    """The rotation from one orientation to another.

    Args:
        first: (..., 4) quaternions.
        second: (..., 4) quaternions.

    Returns:
        (..., 3) rotation vectors in the first's frame [rad].
    """
    w, vector = _product(_conjugate(first), second)
    sine = np.linalg.norm(vector, axis=-1)
    # Of the two quaternions of a rotation, the one that turns by less than half a turn.
    angle = 2 * np.arctan2(sine, np.abs(w)) * np.where(w < 0, -1.0, 1.0)
    near = sine < 1e-9
    factor = np.where(near, 2.0 * np.where(w < 0, -1.0, 1.0), angle / np.where(near, 1.0, sine))
    rotation: FloatArray = vector * factor[..., None]
    return rotation


def with_checked_base(recording: Recording) -> Recording:
    """The recording, with a note of each velocity of the base that contradicts its poses.

    Args:
        recording: has the whole pose, and no pause.
    """
    if recording.errors:
        return recording
    frames = {LINEAR[0]: "world", ANGULAR[0]: "base"}
    notes = tuple(
        f"{column}, _y and _z contradict how the base's pose changes, which is used instead: log "
        f"them in the {frames[column]}'s frame, in SI units"
        for column in BaseState(recording).contradictions
    )
    return replace(recording, notes=(*recording.notes, *notes)) if notes else recording


class BaseState:
    """Smoothed pose and velocity of the base.

    Args:
        recording: a log that has the whole pose.
    """

    def __init__(self, recording: Recording):
        columns = recording.columns
        poses = np.concatenate(
            [np.stack([columns[name] for name in POSITION]), quaternions(recording).T]
        )
        self._pose = Smoothed(recording.time, poses)
        self._contradictions: tuple[str, ...] = ()
        self._velocity: dict[tuple[str, ...], Smoothed | None] = {
            names: self._logged(recording, names) for names in (LINEAR, ANGULAR)
        }

    def at(self, time: FloatArray, ahead: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Pose and velocity at some instants, held at the ends of the recording.

        Args:
            time: (n,) instants [s].
            ahead: how much earlier a velocity is that the poses tell [s].

        Returns:
            (n, 7) position [m] and quaternion; (n, 6) linear [m/s] and angular [rad/s] velocity.
        """
        pose = self._pose.at(time)
        pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        velocity = self._own(time - ahead)
        for place, names in ((slice(0, 3), LINEAR), (slice(3, 6), ANGULAR)):
            logged = self._velocity[names]
            if logged is not None:
                velocity[:, place] = logged.at(time)
        return pose, velocity

    @property
    def contradictions(self) -> tuple[str, ...]:
        """The first column of each logged velocity that contradicts the poses, and is not used."""
        return self._contradictions

    def _own(self, time: FloatArray) -> FloatArray:
        """(n, 6) velocity of the smoothed poses."""
        pose, slope = self._pose.at(time), self._pose.slope_at(time)
        _, turning = _product(_conjugate(pose[:, 3:]), slope[:, 3:])
        return np.concatenate([slope[:, :3], 2 * turning], axis=1)

    def _logged(self, recording: Recording, names: tuple[str, ...]) -> Smoothed | None:
        """The logged velocity, where there is one that the poses bear out."""
        if any(name not in recording.columns for name in names):
            return None
        columns = np.stack([recording.columns[name] for name in names])
        if recording.errors:
            return Smoothed(recording.time, columns, noise.each(columns))
        logged = Smoothed(recording.time, columns)
        place = slice(0, 3) if names == LINEAR else slice(3, 6)
        own = self._own(recording.time)[:, place]
        rows = max(1, round(_AVERAGED * recording.rate))
        off, size = (
            float(np.sqrt(np.mean(uniform_filter1d(velocity, rows, axis=0) ** 2)))
            for velocity in (logged.at(recording.time) - own, own)
        )
        if off > max(_SLOW[names], _CONTRADICTS * size):
            self._contradictions += (names[0],)
            return None
        return logged


def _conjugate(quaternion: FloatArray) -> FloatArray:
    conjugate: FloatArray = quaternion * np.array([1.0, -1.0, -1.0, -1.0])
    return conjugate


def _product(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Real and imaginary part of the product of two quaternions."""
    w1, v1, w2, v2 = first[..., 0], first[..., 1:], second[..., 0], second[..., 1:]
    real = w1 * w2 - np.sum(v1 * v2, axis=-1)
    return real, w1[..., None] * v2 + w2[..., None] * v1 + np.cross(v1, v2)
