"""The measured state: position and velocity of a joint at any time of its recording.

Windows restart the simulation from it. The velocity is that of the smoothed positions, which has no
lag, unlike the velocity that drives report; it is used even where a velocity was logged.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from walkerkit.gap.recordings import noise
from walkerkit.gap.recordings.base_state import (
    ANGULAR,
    LINEAR,
    ORIENTATIONS,
    POSITION,
    missing,
    quaternions,
)
from walkerkit.gap.recordings.recording import QUATERNION, Recording
from walkerkit.gap.recordings.smooth import Smoothed

FloatArray = NDArray[np.float64]

_ONE_WAY = 0.25  # s, for which an estimate is wrong one way
_OF_BASE = (*POSITION, *QUATERNION, *LINEAR, *ANGULAR)


def with_more_noise(recording: Recording, seed: Sequence[int]) -> Recording:
    """A recording that measures the state with its own noise once more, and is the same otherwise.

    What a replay that restarts from it does differently is what the noise makes of a restart.

    Args:
        recording: the log.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    measured = dict(recording.columns)
    if not missing(recording):
        measured |= zip(QUATERNION, quaternions(recording).T, strict=True)
    for name in (*(f"{joint}/position" for joint in recording.joints), *_OF_BASE):
        if name in measured:
            std = noise.estimate([measured[name]]).std
            measured[name] = measured[name] + std * rng.standard_normal(len(recording.time))
    if recording.errors:
        measured |= _estimated_otherwise(recording, measured, rng)
    if QUATERNION[0] in measured:
        norm = np.linalg.norm([measured[name] for name in QUATERNION], axis=0)
        measured |= {name: measured[name] / norm for name in QUATERNION}
    return replace(recording, columns=measured)


def _estimated_otherwise(
    recording: Recording, measured: Mapping[str, FloatArray], rng: np.random.Generator
) -> dict[str, FloatArray]:
    """The base's columns, off by what the estimate may be wrong by: for about a window one way."""
    time = recording.time
    knots = np.arange(time[0], time[-1] + 2 * _ONE_WAY, _ONE_WAY)

    def off(name: str) -> FloatArray:
        values = np.interp(time, knots, rng.standard_normal(len(knots)))
        # Between two knots a mean of both varies less.
        part = (time - time[0]) / _ONE_WAY % 1
        wrong: FloatArray = recording.errors[name] * values / np.hypot(part, 1 - part)
        return wrong

    found = {name: measured[name] + off(name) for name in (*LINEAR, *ANGULAR)}
    turned = Rotation.from_rotvec(
        np.stack([off(f"base/{axis}") for axis in ORIENTATIONS[:2]] + [np.zeros(len(time))], axis=1)
    )
    own = np.stack([measured[name] for name in QUATERNION], axis=1)
    other = Rotation.from_quat(np.roll(own, -1, axis=1)) * turned
    return found | dict(zip(QUATERNION, np.roll(other.as_quat(), 1, axis=1).T, strict=True))


class MeasuredState:
    """Smoothed positions and velocities of some joints.

    Args:
        recording: the log.
        joints: names of joints with a measured position.

    Attributes:
        recording: the log.
    """

    @classmethod
    def shared(cls, recording: Recording, joints: Sequence[str]) -> MeasuredState:
        """The same object for all who ask for it while one of them has it: it is as long as a log.

        Args:
            recording: the log.
            joints: names of joints with a measured position.
        """
        key = id(recording), tuple(joints)
        with _LOCK:
            found = _SHARED.get(key)
            # What is in use keeps its recording, so that no other has its id.
            if found is None:
                found = _SHARED[key] = cls(recording, joints)
        return found

    def __init__(self, recording: Recording, joints: Sequence[str]):
        self.recording = recording
        columns = np.stack([recording.columns[f"{joint}/position"] for joint in joints])
        self._smoothed = Smoothed(recording.time, columns, noise.each(columns))

    def at(self, time: FloatArray, ahead: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """The state at some instants, held at the ends of the recording.

        Args:
            time: (n,) instants [s].
            ahead: how much earlier the velocities are [s].

        Returns:
            qpos, qvel: (n, n_joints) each [rad, rad/s; m, m/s on slide joints].
        """
        return self._smoothed.at(time), self._smoothed.slope_at(time - ahead)

    def fast_at(self, time: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether a joint moves so fast at (n,) instants that few samples tell its state."""
        return self._smoothed.fast_at(time)

    def errors_at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Standard deviations of the state at (n,) instants, (n, n_joints) each, as `at` has it."""
        return self._smoothed.errors_at(time)

    @property
    def qvel(self) -> FloatArray:
        """(n_joints, n) velocities on a uniform grid [rad/s]."""
        return self._smoothed.slopes

    @property
    def step(self) -> float:
        """Spacing of that grid [s]."""
        return self._smoothed.step


_LOCK = threading.Lock()
_SHARED: WeakValueDictionary[tuple[int, tuple[str, ...]], MeasuredState] = WeakValueDictionary()
