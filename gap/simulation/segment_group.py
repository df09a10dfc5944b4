"""Segments of about one length, which are simulated in lock step: what is known of them at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drive import Drive
from walkerkit.actuators.drivetrain import CommandDelay
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.simulation.commands import Hold, Route, between_samples, routes
from walkerkit.gap.simulation.floating import FloatingBase
from walkerkit.gap.simulation.interpolate import delayed, made_delay, one_if_alike
from walkerkit.gap.simulation.mount import resting
from walkerkit.gap.simulation.programs import rest_controls
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.gap.simulation.start import HELD, ROUNDED, memory
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]
ModelFields = Callable[[str], NDArray[Any]]

_LONGEST_DELAY = 0.3  # s of past commands kept before each segment
_CONTROLLED = 1.0  # s of them that controllers which remember targets see besides
_LENGTH_RATIO = 0.8  # segments share a batch when the shortest is at least this part of the longest
MOST_STEPS = 1_000_000  # of the segments of a batch together; what is longer has one of its own
_ROUNDED = 1e-9  # of the largest command; what changes less does not
_APART = 0.01  # s; velocities so far apart tell the acceleration


class Group:
    """Segments of about one length, prepared once.

    Args:
        robot: the robot.
        segments: of recordings that measure the same joints.
        spans: rows of each segment among all that a replay predicts.
        hold: what the targets are between their samples.

    Attributes:
        rows: (n_rows,) those of all segments.
        segment: (n_rows,) which segment each is of.
        durations: (n_segments,) [s].
        elapsed: (n_segments,) from the log's beginning, when its clock was right [s].
        clock: (n_segments,) the same in whole steps, as between targets that change with steps [s].
        steps: of the simulation, from a segment's start on.
        memory: steps of past commands that the model's delays remember.
        controlled: steps of them that controllers see besides.
        past: steps of them that are kept.
        joints: names of the measured joints.
        routes: of each segment, what its targets drive.
        states: measured states, by the recording's identity.
        base: the base, where it floats.
        ctrl: (n_segments, past + steps + past + 1, width) commands, from `past` steps before it.
        applied: feed-forward effort, shape (…, nv) [N·m].
        drives: address in ctrl to the joint and its drive.
        played: joints with a play that nothing measures, and those of a mount.
        starts: where there are such, positions, velocities and accelerations at the starts.
    """

    def __init__(
        self, robot: Robot, segments: Sequence[Segment], spans: Sequence[slice], hold: Hold
    ):
        self.robot = robot
        self.hold = hold
        self.segments = segments
        self.rows = np.concatenate([np.arange(span.start, span.stop) for span in spans])
        lengths = [span.stop - span.start for span in spans]
        self.segment = np.repeat(np.arange(len(segments)), lengths)
        step = robot.model.opt.timestep
        self.durations = np.array([segment.duration for segment in segments])
        self.elapsed = np.array(
            [segment.start - float(segment.recording.whole.time[0]) for segment in segments]
        )
        self.clock = step * np.round(self.elapsed / step)
        self.steps = int(np.ceil(self.durations.max() / step - 1e-6)) + 1
        self.memory = memory(robot.model)
        self.controlled = int(np.ceil(_CONTROLLED / step))
        self.past = int(np.ceil(_LONGEST_DELAY / step)) + self.memory + self.controlled
        self.joints = segments[0].recording.joints
        self.routes = [routes(robot, segment.recording) for segment in segments]
        # Windows share their recordings.
        recordings = {id(segment.recording): segment.recording for segment in segments}
        self.states = {
            key: MeasuredState.shared(recording, self.joints)
            for key, recording in recordings.items()
        }
        self.base = (
            None if robot.base is None else FloatingBase(robot, robot.base, segments, self.states)
        )
        n = len(segments)
        # One more step than is simulated, so that a delay can be interpolated at the end.
        offsets = step * np.arange(-self.past, self.steps + self.past + 1)
        self.ctrl = np.tile(rest_controls(robot), (n, len(offsets), 1))
        self.applied = np.zeros((n, len(offsets), robot.model.nv))
        self.drives: dict[int, tuple[str, Drive]] = {}
        for s, segment in enumerate(segments):
            for route in self.routes[s]:
                self._fill(s, segment, route, segment.start + offsets)
        joints = [robot.joints[name] for name in self.joints]
        # A play that is measured itself starts as measured.
        parted = [*(joint for joint in joints if joint.play is not None), *resting(robot)]
        self.played = [j for j in parted if j.play is not None and j.play.name not in self.joints]
        self.starts = self._measured_states() if self.played else ()

    def _measured_states(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, velocities, accelerations at the starts, (n_segments, n_joints) each."""
        rows = []
        for segment in self.segments:
            state, time = self.states[id(segment.recording)], segment.recording.time
            around = np.clip(segment.start + np.array([-_APART, 0, _APART]), time[0], time[-1])
            qpos, qvel = state.at(around)
            rows.append((qpos[1], qvel[1], (qvel[2] - qvel[0]) / (around[2] - around[0])))
        qpos, qvel, qacc = (np.stack(parts) for parts in zip(*rows, strict=True))
        return qpos, qvel, qacc

    def _fill(self, s: int, segment: Segment, route: Route, time: FloatArray) -> None:
        step = self.robot.model.opt.timestep
        if route.drive is not None and route.drive.late:
            time = time - route.drive.late
        values = between_samples(segment.recording, route.column, time, self.hold, step)
        if route.drive is not None:
            self.ctrl[s, :, route.drive.ctrl] = route.drive.control(values)
            if route.joint is not None:
                self.drives[route.drive.ctrl] = route.joint.name, route.drive
        elif route.joint is not None:
            self.applied[s, :, route.joint.dof] += values

    def feed_forward(self, trials: Trials, lead: FloatArray, steps: int) -> FloatArray | None:
        """Feed-forward effort, (n, n_segments, steps, nv), or None where there is none.

        It comes with a joint's other targets, and so as late.
        """
        if not self.applied.any():
            return None
        step = self.robot.model.opt.timestep
        joints = [self.robot.joints[name] for name in self.joints]
        late = np.tile(lead[..., None], self.robot.model.nv)
        for joint in joints:
            late[..., joint.dof] += self._late(joint, trials)[:, None]
        applied = np.array(delayed(self.applied, self.past, steps, late / step))
        for joint in joints:
            applied[..., joint.dof] /= trials.effort_scale[joint.name][:, None, None]
        return applied

    def _late(self, joint: Joint, trials: Trials) -> FloatArray:
        """(n,) how late a joint's drives get its targets, on whatever way there [s]."""
        own, step = trials.fields.get("actuator_delay"), self.robot.model.opt.timestep
        known = self.robot.model.actuator_delay[None] if own is None else own
        late = np.array(trials.command_delay[joint.name])
        late += trials.laws.get((CommandDelay, joint.name, "delay"), 0.0)
        if joint.drives:
            each = [made_delay(known[:, one.actuator], step) + one.late for one in joint.drives]
            late += np.min(each, axis=0)
        return late

    def voltage(self, lead: FloatArray, steps: int) -> FloatArray:
        """Voltage of the supply, (n · n_segments, steps, 1) [V]; NaN where it was not logged.

        Args:
            lead: (n, n_segments) by which the simulation begins before a segment [s].
            steps: that it takes.
        """
        clock = self.robot.model.opt.timestep * np.arange(steps)
        found = np.full((*lead.shape, steps), np.nan)
        for s, segment in enumerate(self.segments):
            whole = segment.recording.whole
            logged = whole.columns.get("voltage")
            if logged is not None:
                known = np.isfinite(logged)
                at = segment.start - lead[:, s, None] + clock
                found[:, s] = np.interp(at, whole.time[known], logged[known])
        return found.reshape(-1, steps, 1)

    def jumps(
        self, joint: Joint, ctrl: FloatArray, applied: FloatArray | None, fields: ModelFields
    ) -> FloatArray | None:
        """How far a joint's effort jumps as its targets do.

        Args:
            joint: the joint.
            ctrl: (n, n_segments, before + steps, nu) controls, with some before the start.
            applied: (n, n_segments, steps, nv) feed-forward effort, if there is any.
            fields: a model field's name → its (n, *shape) values.

        Returns:
            (n or 1, n_segments, before + steps) by how much the effort is more than before a step
            for the sake of its targets [N·m, or N], but for its limits; or None where targets are
            not held between their samples.
        """
        if self.hold == "linear":
            return None
        model = self.robot.model
        delay, gain = fields("actuator_delay"), fields("actuator_gainprm")
        if applied is None and not ctrl.strides[0] and _alike(delay) and _alike(gain):
            ctrl, delay, gain = ctrl[:1], delay[:1], gain[:1]  # all trials do the same
        found = np.zeros(ctrl.shape[:3])
        for index, (name, drive) in self.drives.items():
            a = drive.actuator
            if name != joint.name:
                continue
            gears = _per_control(model, drive, gain[:, a])
            gears = gears * model.actuator_gear[model.actuator_outadr[a], 0]
            steps = gears[:, None, None] * _steps(ctrl[..., index])
            late = made_delay(delay[:, a], model.opt.timestep) / model.opt.timestep
            if model.actuator_history[a, 1] == HELD:
                late = np.ceil(late - ROUNDED)
            for age in np.unique(late):
                rows, whole = np.flatnonzero(late == age), math.floor(age)
                for shift, part in ((whole, 1 - age + whole), (whole + 1, age - whole)):
                    if part:
                        found[rows, :, shift:] += part * steps[rows, :, : steps.shape[2] - shift]
        if applied is not None:
            found[:, :, -applied.shape[2] :] += _steps(applied[..., joint.dof])
        return found

    def at_limit(self, joint: Joint, effort: FloatArray, fields: ModelFields) -> NDArray[np.bool_]:
        """Where a joint's drive makes all that it can, of (n, n_segments, steps) efforts."""
        found = np.zeros(effort.shape, dtype=bool)
        for drive in joint.drives:
            a = drive.actuator
            if self.robot.model.actuator_forcelimited[a]:
                gear = self.robot.model.actuator_gear[self.robot.model.actuator_outadr[a], 0]
                ends = np.sort(fields("actuator_forcerange")[:, a] * gear)
                lower, upper = ends.T[:, :, None, None]
                found |= (effort <= lower) | (effort >= upper)
            limit = self.robot.number(joint.name, "effort_limit")
            if limit is not None:
                found |= np.abs(effort) >= limit
        return found

    def initial_state(self, shift: FloatArray, off: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Measured states at each segment's start, each (n, n_segments, n_joints).

        Args:
            shift: (n, n_segments, n_joints) by which it is shifted [s].
            off: (n, n_joints, 2) by which positions and velocities are off, in their errors.
        """
        (variants,) = one_if_alike(shift)
        qpos = np.empty(variants.shape)
        qvel = np.empty_like(qpos)
        for s, segment in enumerate(self.segments):
            state = self.states[id(segment.recording)]
            alike = (variants[:, s] == variants[:, s, :1]).all()
            for k in range(1 if alike else shift.shape[2]):
                q, v = state.at(segment.start + variants[:, s, k], self.robot.velocity_ahead)
                which = slice(None) if alike else k
                qpos[:, s, which], qvel[:, s, which] = q[:, which], v[:, which]
        if off.any():
            errors = [
                self.states[id(one.recording)].errors_at(np.array([one.start]))
                for one in self.segments
            ]
            of_qpos, of_qvel = (np.concatenate(part) for part in zip(*errors, strict=True))
            qpos = qpos + off[:, None, :, 0] * of_qpos
            qvel = qvel + off[:, None, :, 1] * of_qvel
        return np.broadcast_to(qpos, shift.shape), np.broadcast_to(qvel, shift.shape)


def _slope(drive: Drive) -> float:
    """Effort of a law in Python per unit of its target, about rest."""
    return {"position": drive.stiffness, "velocity": drive.damping}.get(drive.kind, 1.0)


def _per_control(model: mujoco.MjModel, drive: Drive, gain: FloatArray) -> FloatArray:
    """How far a drive's force jumps with its control, (n,), of its (n, 10) gain parameters."""
    a, none = drive.actuator, np.zeros(len(gain))
    if drive.law == "affine":
        if model.actuator_actnum[a]:
            return none  # an activation does not jump
        return gain[:, 0] * (_slope(drive) if drive.in_python else 1.0)
    if drive.law == "pid":
        by_kind = dict(zip(("position", "velocity"), -model.actuator_biasprm[a, 1:3], strict=True))
        return none + float(by_kind.get(drive.kind, 1.0))
    resistance, constant, *_ = gain.T
    if model.actuator_dynprm[a, 0] or model.actuator_dynprm[a, 7]:
        return none  # neither does the current of a winding, nor a target whose slope is limited
    places = {"position": 4, "velocity": 6}
    if drive.kind in places:
        return none + gain[:, places[drive.kind]]
    return none + (constant / resistance if drive.kind == "voltage" else 1.0)


def _alike(values: NDArray[Any]) -> bool:
    return bool((values == values[:1]).all())


def _steps(values: FloatArray) -> FloatArray:
    """By how much each of (n, n_segments, steps) values is more than that before it."""
    found = np.diff(values, prepend=values[..., :1])
    found[np.abs(found) <= _ROUNDED * np.abs(values).max(initial=0.0)] = 0.0
    return found


def similar_lengths(segments: Sequence[Segment], most: float) -> list[list[int]]:
    """Indices of segments that may share a batch of `most` seconds in all, longest first."""
    groups: list[list[int]] = []
    for i in sorted(range(len(segments)), key=lambda i: -segments[i].duration):
        head = segments[groups[-1][0]] if groups else None
        if (
            head is not None
            and segments[i].duration >= _LENGTH_RATIO * head.duration
            and segments[i].recording.joints == head.recording.joints
            and (1 + len(groups[-1])) * head.duration <= most
        ):
            groups[-1].append(i)
        else:
            groups.append([i])
    return [sorted(group) for group in groups]
