"""A floating base in a replay: where it starts, and what its log would show.

base = FloatingBase(robot, segments, states)
pose, velocity = base.start(lead)             # (n, n_segments, 7) and (n, n_segments, 6)
base.shown(poses, turning, segment, index)    # (n, rows, 9): base.SIGNALS

In each log the ground is at the height that lets it carry the robot at the starts of the typical
segment (`footing`), under every variant of the robot. So what the base does is compared, and not
where its log has the floor: with logs that were 10 mm off, joints erred by 12 mrad without that and
by 0.8 mrad with it, as with logs that were right.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.recordings.base_state import BaseState, angles, missing, quaternions, turned
from walkerkit.gap.recordings.imu import WHAT_TO_LOG, has_imu, of_feet
from walkerkit.gap.recordings.recording import BASE as BASE_COLUMNS
from walkerkit.gap.recordings.recording import IMU, Recording
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.feet import find_feet
from walkerkit.gap.simulation.footing import Footing
from walkerkit.gap.simulation.interpolate import at_index, one_if_alike
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import rest
from walkerkit.walkers.batch import LockStep

FloatArray = NDArray[np.float64]

_AROUND = 0.02  # s before and after a start, between which the acceleration is taken


class FloatingBase:
    """The base in some segments.

    Args:
        robot: a robot whose base floats.
        segments: their recordings have the base's pose.
        states: the joints' states, by the identity of the recording.

    Attributes:
        addresses: of the base's numbers in qpos and in qvel.
        footing: how high it starts.
        acceleration: (n_segments,) of the centre of mass at the start, upwards [m/s²].
    """

    def __init__(
        self,
        robot: Robot,
        base: Base,
        segments: Sequence[Segment],
        states: Mapping[int, MeasuredState],
    ):
        self.addresses = range(base.qpos, base.qpos + 7), range(base.dof, base.dof + 6)
        self._ahead = robot.velocity_ahead
        self._starts = np.array([segment.start for segment in segments])
        self._recording = np.array([id(segment.recording) for segment in segments])
        recordings = {id(segment.recording): segment.recording for segment in segments}
        # The ground is as high in all parts of a log.
        self._log = np.array([id(segment.recording.whole) for segment in segments])
        self._states = {key: BaseState(recording) for key, recording in recordings.items()}
        measured = {key: quaternions(recording) for key, recording in recordings.items()}
        unwrapped = {key: angles(quaternion) for key, quaternion in measured.items()}
        self._measured, self._angles = (
            np.concatenate([whole[id(s.recording)][s.first : s.last] for s in segments])
            for whole in (measured, unwrapped)
        )
        self.footing = Footing(robot.model, base)
        self.acceleration = np.array([self._acceleration(robot, s, states) for s in segments])

    def start(self, lead: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Measured pose and velocity when the segments' simulations start.

        Args:
            lead: (n, n_segments) how long before the segments' first samples that is [s].

        Returns:
            (n, n_segments, 7) pose and (n, n_segments, 6) velocity.
        """
        (variants,) = one_if_alike(lead)
        pose, velocity = np.empty((*variants.shape, 7)), np.empty((*variants.shape, 6))
        time = self._starts - variants
        for key, state in self._states.items():
            own = self._recording == key
            found = state.at(time[:, own].ravel(), self._ahead)
            for whole, part in zip((pose, velocity), found, strict=True):
                whole[:, own] = part.reshape(len(time), -1, part.shape[1])
        return (
            np.broadcast_to(pose, (*lead.shape, 7)),
            np.broadcast_to(velocity, (*lead.shape, 6)),
        )

    def settle(
        self,
        batch: LockStep,
        state: FloatArray,
        ctrl: FloatArray,
        fields: Mapping[str, NDArray[Any]],
    ) -> FloatArray:
        """Raises or lowers the starts of every variant to where the ground carries it in each log.

        Args:
            batch: the simulations, all segments of each trial.
            state: (n_sims, nstate) where they start, written to.
            ctrl: (n_sims, nu) their first controls.
            fields: model fields of which each has its own.

        Returns:
            (n_sims,) by how much [m].
        """
        every = np.resize(self.acceleration, len(state))
        found = self.footing.raised(batch, state, ctrl, fields, every).reshape(-1, len(self._log))
        raised = np.empty_like(found)
        for log in np.unique(self._log):
            alike = self._log == log
            raised[:, alike] = np.median(found[:, alike], axis=1, keepdims=True)
        state[:, self.footing.height] += raised.ravel()
        return raised.ravel()

    def shown(
        self,
        poses: FloatArray,
        turning: FloatArray,
        segment: NDArray[np.intp],
        index: FloatArray,
    ) -> FloatArray:
        """What the log of the segments would show.

        Args:
            poses: (n, n_segments, steps, 7) simulated.
            turning: as `poses`, (..., 3) angular velocities in the base's frame [rad/s].
            segment: (rows,) which segment each row is of; they are all that the segments have.
            index: (n, rows) or (1, rows) fractional steps of the rows.

        Returns:
            (n, rows, 9) position [m]; roll, pitch and yaw [rad]: the measured ones and, about the
            measured base's own axes, the rotation from there to the simulated orientation; and
            angular velocity [rad/s].
        """
        at, spin = (
            np.stack([at_index(one[..., k], segment, index) for k in range(one.shape[-1])], axis=-1)
            for one in (poses, turning)
        )
        error = turned(self._measured, at[..., 3:])
        return np.concatenate([at[..., :3], self._angles + error, spin], axis=-1)

    def _acceleration(
        self, robot: Robot, segment: Segment, states: Mapping[int, MeasuredState]
    ) -> float:
        recording = segment.recording
        around = segment.start + np.array([-_AROUND, _AROUND])
        around = np.clip(around, recording.time[0], recording.time[-1])
        qpos = np.tile(rest(robot.model).qpos, (2, 1))
        qvel = np.zeros((2, robot.model.nv))
        pose, velocity = self._states[id(recording)].at(around)
        qpos[:, self.addresses[0]], qvel[:, self.addresses[1]] = pose, velocity
        joints = [robot.joints[name] for name in recording.joints]
        qpos[:, [joint.qpos for joint in joints]], qvel[:, [joint.dof for joint in joints]] = (
            states[id(recording)].at(around)
        )
        before, after = self.footing.centre_speed(qpos, qvel)
        return float((after - before) / np.ptp(around))


def suited(robot: Robot, recording: Recording) -> Recording:
    """A recording as the robot can use it: with its base where it floats, else without.

    Raises:
        InputError: the robot floats, and the recording has neither its base's pose nor what that
            could be estimated from.
    """
    feet = of_feet(recording)
    sensors = [f"{foot}/{signal}" for foot, signals in feet.items() for signal in signals]
    if robot.base is None:
        return _without(recording, (*BASE_COLUMNS, *IMU, *sensors))
    lacking = missing(recording)
    if not lacking:
        return _without(recording, (*IMU, *sensors))
    if not has_imu(recording):
        some = [name for name in (*BASE_COLUMNS, *IMU) if name in recording.columns]
        raise InputError(
            f"{recording.source or recording.name}: body {robot.base.body!r} floats in "
            f"{robot.source}, and the recording lacks {lacking[0]!r}"
            + (f" and {len(lacking) - 1} more columns of its pose" if lacking[1:] else "")
            + (f"; {some[0]!r} alone does not tell how it moves" if some else "")
            + f". Log where the base is; or {WHAT_TO_LOG}; or hang the robot up for the recording, "
            "and the model with `walkerkit hang`."
        )
    known = {name for foot in find_feet(robot.model, robot.base) for name in foot.names}
    strangers = [foot for foot in feet if foot not in known]
    if strangers:
        notes = (
            f"no foot of {robot.source} is called {foot!r}{closest(foot, known)}, so its "
            f"{' and '.join(feet[foot])} is not used; feet are {', '.join(sorted(known))}"
            for foot in strangers
        )
        recording = replace(recording, notes=(*recording.notes, *notes))
    # Only the estimate reads these: what is left of a pose would contradict it.
    return _without(
        recording,
        (*BASE_COLUMNS, *(f"{foot}/{signal}" for foot in strangers for signal in feet[foot])),
    )


def _without(recording: Recording, columns: Collection[str]) -> Recording:
    """A recording without some columns, which become `unused`."""
    dropped = tuple(name for name in recording.columns if name in columns)
    if not dropped:
        return recording
    kept = {name: v for name, v in recording.columns.items() if name not in dropped}
    return replace(recording, columns=kept, unused=(*recording.unused, *dropped))
