"""Replay: the recorded commands through the simulation, from the measured state.

    replay = Replay(robot, segments, channels, n_threads=2)
    predicted = replay.predict(Trials(robot, n=1))      # (1, rows, channels)
    gap = predicted[0] - replay.measured

All segments and all trials run in lock step. Histories of delayed actuators are filled with the
recorded past commands; a trial that diverges predicts NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drive import Drive
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.simulation.commands import Hold, Route, between_samples, routes
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import memory, rest, start_state
from walkerkit.gap.simulation.steploop import law_arguments, rollout_with_laws
from walkerkit.gap.simulation.trials import Trials
from walkerkit.walkers.batch import LockStep

FloatArray = NDArray[np.float64]

_LONGEST_DELAY = 0.3  # s of past commands kept before each segment
_LENGTH_RATIO = 0.8  # segments share a batch when the shortest is at least this part of the longest
_CHUNK_BYTES = 2**28
_RECORDS = {"position": "qpos", "velocity": "qvel", "effort": "qfrc_actuator"}


@dataclass(frozen=True, kw_only=True, order=True)
class Channel:
    """One measured signal of one joint."""

    joint: str
    signal: str


class _Group:
    """Segments of about one length, prepared once."""

    def __init__(
        self, robot: Robot, segments: Sequence[Segment], rows: Sequence[slice], hold: Hold
    ):
        self.robot = robot
        self.hold = hold
        self.segments = segments
        self.rows = rows
        step = robot.model.opt.timestep
        longest = max(segment.duration for segment in segments)
        self.steps = int(np.ceil(longest / step - 1e-6)) + 1
        self.memory = memory(robot.model)
        self.past = int(np.ceil(_LONGEST_DELAY / step)) + self.memory
        self.joints = segments[0].recording.joints
        self.routes = [routes(robot, segment.recording) for segment in segments]
        self.states = {
            id(segment.recording): MeasuredState(segment.recording, self.joints)
            for segment in segments
        }
        n = len(segments)
        # One more step than is simulated, so that a delay can be interpolated at the end.
        offsets = step * np.arange(-self.past, self.steps + self.past + 1)
        self.ctrl = np.tile(rest(robot.model).ctrl, (n, len(offsets), 1))
        self.applied = np.zeros((n, len(offsets), robot.model.nv))
        self.drives: dict[int, tuple[str, Drive]] = {}
        for s, segment in enumerate(segments):
            for route in self.routes[s]:
                self._fill(s, segment, route, segment.start + offsets)

    def _fill(self, s: int, segment: Segment, route: Route, time: FloatArray) -> None:
        values = between_samples(segment.recording, route.column, time, self.hold)
        if route.drive is None:
            self.applied[s, :, route.joint.dof] += values
        else:
            self.ctrl[s, :, route.drive.ctrl] = route.drive.control(values)
            self.drives[route.drive.ctrl] = route.joint.name, route.drive


class Replay:
    """The measured segments of one robot, ready to be simulated under any trials.

    Args:
        robot: the robot.
        segments: what to simulate; their recordings measure the same joints.
        channels: what to compare.
        hold: what the targets are between their samples.
        n_threads: threads of the simulation, 0 for all cores.

    Attributes:
        measured: (rows, channels), NaN where a recording lacks the channel.
        segment_of_row: (rows,) index into `segments`.
        time_of_row: (rows,) time within the segment [s].
    """

    def __init__(
        self,
        robot: Robot,
        segments: Sequence[Segment],
        channels: Sequence[Channel],
        *,
        hold: Hold = "zero_order",
        n_threads: int = 0,
    ):
        self.robot = robot
        self.segments = tuple(segments)
        self.channels = tuple(channels)
        self.n_threads = n_threads
        lengths = [segment.last - segment.first for segment in segments]
        ends = np.cumsum(lengths)
        rows = [slice(int(e - n), int(e)) for e, n in zip(ends, lengths, strict=True)]
        self.segment_of_row = np.repeat(np.arange(len(lengths)), lengths)
        self.time_of_row = np.concatenate(
            [s.recording.time[s.first : s.last] - s.start for s in segments]
        )
        self.measured = np.full((int(ends[-1]), len(self.channels)), np.nan)
        for segment, span in zip(segments, rows, strict=True):
            for c, channel in enumerate(self.channels):
                column = segment.recording.signal(channel.joint, channel.signal)
                if column is not None:
                    self.measured[span, c] = column[segment.first : segment.last]
        self._groups = [
            _Group(robot, [segments[i] for i in members], [rows[i] for i in members], hold)
            for members in _similar_lengths(segments)
        ]

    @property
    def steps(self) -> int:
        """Simulation steps that one trial takes."""
        return sum(len(group.segments) * group.steps for group in self._groups)

    def predict(self, trials: Trials) -> FloatArray:
        """Simulates every segment under every trial.

        Args:
            trials: n variants of the robot.

        Returns:
            (n, rows, channels) what the log would show; NaN where a simulation failed.
        """
        predicted = np.full((trials.n, *self.measured.shape), np.nan)
        model = self.robot.model
        for group in self._groups:
            row_bytes = 8 * group.steps * (model.nq + 2 * model.nv + model.nu)
            chunk = max(1, _CHUNK_BYTES // (row_bytes * len(group.segments)))
            for start in range(0, trials.n, chunk):
                rows = np.arange(start, min(start + chunk, trials.n))
                active = trials.with_laws[rows]
                for some in (rows[~active], rows[active]):
                    if some.size:
                        predicted[some] = self._simulate(group, trials.rows(some), predicted[some])
        return predicted

    def _simulate(self, group: _Group, trials: Trials, out: FloatArray) -> FloatArray:
        """Fills in the rows and channels of a group; variants with laws and without do not mix."""
        model, n, n_segments = self.robot.model, trials.n, len(group.segments)
        step = model.opt.timestep
        joints = [self.robot.joints[name] for name in group.joints]
        delay = np.stack([trials.position_delay[joint.name] for joint in joints], axis=1)
        # The oldest joint's log at the segment's start shows the robot this much earlier. Whole
        # steps, so that controls change when they changed and efforts are read when they were.
        lead = step * np.ceil(delay.max(axis=1) / step - 1e-9)
        steps = group.steps + round(lead.max() / step)

        qpos, qvel = self._initial_state(group, delay - lead[:, None])
        fields = dict(trials.fields)
        lawful = bool(trials.with_laws.any())
        shift = np.tile(lead[:, None], model.nu)
        for index, (name, drive) in group.drives.items():
            shift[:, index] += trials.command_delay[name]
            later = (trials.command_delay[name] != 0) | lawful
            if model.actuator_delay[drive.actuator] and later.any():
                # As one delay: two interpolations between steps would smooth twice. And laws have
                # to see what the drive sees.
                own = fields.get("actuator_delay", trials.own("actuator_delay")).copy()
                shift[later, index] += own[later, drive.actuator]
                own[later, drive.actuator] = 0
                fields["actuator_delay"] = own
        remembered = group.memory
        ctrl = _delayed(group.ctrl, group.past - remembered, remembered + steps, shift / step)
        state = start_state(
            model,
            ctrl[:, :, :remembered],
            qpos,
            qvel,
            ([joint.qpos for joint in joints], [joint.dof for joint in joints]),
        )

        record = sorted({_RECORDS[channel.signal] for channel in self.channels})
        batch = LockStep(
            model,
            n * n_segments,
            fields={k: np.repeat(v, n_segments, axis=0) for k, v in fields.items()},
            n_threads=self.n_threads,
        )
        applied = self._applied(group, trials, lead, steps)
        start = state.reshape(n * n_segments, -1)
        controls = ctrl[:, :, remembered:].reshape(n * n_segments, steps, -1)
        beside = None if applied is None else applied.reshape(n * n_segments, steps, -1)
        changed = None
        if lawful:
            rollout, changed = rollout_with_laws(
                batch,
                start,
                ctrl=controls,
                qfrc_applied=beside,
                record=record,
                joints=joints,
                **law_arguments(model, joints, fields, trials, n_segments),
            )
            changed = changed.reshape(n, n_segments, steps, -1)
        else:
            rollout = batch.rollout(start, ctrl=controls, qfrc_applied=beside, record=record)
        records = {
            name: values.reshape(n, n_segments, steps, -1)
            for name, values in rollout.records.items()
        }
        for c, channel in enumerate(self.channels):
            if channel.joint not in group.joints:
                continue
            k = group.joints.index(channel.joint)
            joint = joints[k]
            series = records[_RECORDS[channel.signal]]
            if channel.signal == "effort":
                scale = trials.effort_scale[joint.name][:, None, None]
                offset = trials.effort_offset[joint.name][:, None, None]
                # Effort is recorded as of the beginning of a step, the state as of its end.
                series, age = series[..., joint.dof], lead
                if applied is not None:  # the same drive makes it, so its log shows it
                    series = series + applied[..., joint.dof]
                if changed is not None:
                    series = series + changed[..., k]
                series = scale * series + offset
            else:
                column = joint.qpos if channel.signal == "position" else joint.dof
                first = (qpos if channel.signal == "position" else qvel)[:, :, k, None]
                series = np.concatenate([first, series[..., column]], axis=2)
                age = lead - delay[:, k]
            for s, span in enumerate(group.rows):
                out[:, span, c] = _at(series[:, s], (self.time_of_row[span] + age[:, None]) / step)
        return out

    def _applied(
        self, group: _Group, trials: Trials, lead: FloatArray, steps: int
    ) -> FloatArray | None:
        """Feed-forward effort, (n, n_segments, steps, nv), or None where there is none."""
        if not group.applied.any():
            return None
        step = self.robot.model.opt.timestep
        nv = self.robot.model.nv
        applied = _delayed(group.applied, group.past, steps, np.tile(lead[:, None] / step, nv))
        applied = np.array(applied)
        for name in group.joints:
            applied[..., self.robot.joints[name].dof] /= trials.effort_scale[name][:, None, None]
        return applied

    def _initial_state(self, group: _Group, shift: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Measured states at each segment's start, (n, n_segments, n_joints), shifted per joint."""
        n, n_joints = shift.shape
        qpos = np.empty((n, len(group.segments), n_joints))
        qvel = np.empty_like(qpos)
        for s, segment in enumerate(group.segments):
            state = group.states[id(segment.recording)]
            for k in range(n_joints):
                q, v = state.at(segment.start + shift[:, k])
                qpos[:, s, k], qvel[:, s, k] = q[:, k], v[:, k]
        return qpos, qvel


def _similar_lengths(segments: Sequence[Segment]) -> list[list[int]]:
    """Indices of segments that may share a batch, longest first."""
    groups: list[list[int]] = []
    for i in sorted(range(len(segments)), key=lambda i: -segments[i].duration):
        head = segments[groups[-1][0]] if groups else None
        if (
            head is not None
            and segments[i].duration >= _LENGTH_RATIO * head.duration
            and segments[i].recording.joints == head.recording.joints
        ):
            groups[-1].append(i)
        else:
            groups.append([i])
    return [sorted(group) for group in groups]


def _delayed(values: FloatArray, past: int, steps: int, shift: FloatArray) -> FloatArray:
    """Commands of each trial, interpolated linearly between steps as MuJoCo's own delay does.

    Args:
        values: (n_segments, past + ..., width) held commands; index `past` is the start.
        past: steps before the start.
        steps: steps wanted.
        shift: (n, width) age in steps.

    Returns:
        (n, n_segments, steps, width).
    """
    n, width = shift.shape
    if not shift.any():
        return np.broadcast_to(values[None, :, past : past + steps], (n, *values[:, :steps].shape))
    out = np.empty((n, values.shape[0], steps, width))
    for row in range(n):
        for column in range(width):
            position = past - min(float(shift[row, column]), float(past))
            whole = int(np.floor(position))
            part = position - whole
            early = values[:, whole : whole + steps, column]
            late = values[:, whole + 1 : whole + 1 + steps, column]
            out[row, :, :, column] = (1 - part) * early + part * late
    return out


def _at(series: FloatArray, index: FloatArray) -> FloatArray:
    """Linear interpolation of (n, steps) rows at fractional (n, rows) or (1, rows) indices."""
    last = series.shape[1] - 1
    index = np.clip(index, 0, last)
    if (index == index[:1]).all():
        index = index[:1]
        whole = np.minimum(index[0].astype(np.int64), last - 1)
        part = index[0] - whole
        early, late = series[:, whole], series[:, whole + 1]
    else:
        whole = np.minimum(index.astype(np.int64), last - 1)
        part = index - whole
        early = np.take_along_axis(series, whole, axis=1)
        late = np.take_along_axis(series, whole + 1, axis=1)
    between: FloatArray = early * (1 - part) + late * part
    return between
