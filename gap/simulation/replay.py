"""Replay: the recorded commands through the simulation, from the measured state.

    replay = Replay(robot, segments, channels, n_threads=2)
    predicted = replay.predict(Trials(robot, n=1))      # (1, rows, channels)
    gap = predicted[0] - replay.measured

All segments and all trials run in lock step. Histories of delayed actuators are filled with the
recorded past commands; a trial that diverges predicts NaN.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import IntegralAction
from walkerkit.gap.recordings.base_state import SIGNALS, TURNING
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.simulation.channel import Channel as Channel
from walkerkit.gap.simulation.commands import Hold
from walkerkit.gap.simulation.gear_play import bend, loads
from walkerkit.gap.simulation.interpolate import (
    at_index,
    delayed,
    jumps_at,
    made_delay,
    nearest_step,
)
from walkerkit.gap.simulation.latest import Latest
from walkerkit.gap.simulation.law_memory import Past, integral_at_start, measured_past
from walkerkit.gap.simulation.laws import Laws
from walkerkit.gap.simulation.mount import mounts
from walkerkit.gap.simulation.reading import Reading
from walkerkit.gap.simulation.rebuild import Rebuild, Rebuilt, rebuilds, rebuilt_as
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.gap.simulation.segment_group import MOST_STEPS, Group, similar_lengths
from walkerkit.gap.simulation.side_by_side import advanced
from walkerkit.gap.simulation.start import rest, start_state
from walkerkit.gap.simulation.together import (
    Asked,
    Commanded,
    controlled,
    first_controls,
    together,
)
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]
Predicting = Generator[Asked | Commanded, Any, FloatArray]

_WARM = 0.15  # s of the measured past that laws see
_CHUNK_BYTES = 2**28
_MOST_REBUILT = 24  # robots kept for variants that need another compilation
_RECORDS = {"position": "qpos", "velocity": "qvel", "effort": "qfrc_actuator"}


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
        self._hold: Hold = hold
        self._rebuilt = Latest(_MOST_REBUILT)
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
                column = channel.measured(segment.recording)
                if column is not None:
                    self.measured[span, c] = column[segment.first : segment.last]
        self._groups = [
            Group(robot, [segments[i] for i in members], [rows[i] for i in members], hold)
            for members in similar_lengths(segments, MOST_STEPS * robot.model.opt.timestep)
        ]

    @property
    def steps(self) -> int:
        """Simulation steps that one trial takes."""
        return sum(len(group.segments) * group.steps for group in self._groups)

    @property
    def longest(self) -> int:
        """Steps of its longest segment."""
        return max((group.steps for group in self._groups), default=0)

    def of_segments(self, which: Iterable[int]) -> Replay:
        """Some of the segments alone."""
        return self.of([self.segments[k] for k in which])

    def of(self, segments: Sequence[Segment]) -> Replay:
        """The same of other segments, which measure the same joints."""
        return Replay(
            self.robot, segments, self.channels, hold=self._hold, n_threads=self.n_threads
        )

    def on(self, robot: Robot, channels: Sequence[Channel] | None = None) -> Replay:
        """The same segments on another robot; of other channels where these are given."""
        return Replay(
            robot,
            self.segments,
            self.channels if channels is None else channels,
            hold=self._hold,
            n_threads=self.n_threads,
        )

    def predict(self, trials: Trials) -> FloatArray:
        """Simulates every segment under every trial.

        Args:
            trials: n variants of the robot.

        Returns:
            (n, rows, channels) what the log would show; NaN where a simulation failed.
        """
        (predicted,) = predict_together([self], [trials], self.n_threads)
        return predicted

    def predicting(self, trials: Trials) -> list[tuple[NDArray[np.intp], Predicting]]:
        """As `predict`, in parts that ask for what others may ask for too.

        They are to be sent what `together` makes of the rollouts and `controlled` of the commands
        that they yield.

        Returns:
            Rows of the trials, rising, and what finds those.
        """
        parts: list[tuple[NDArray[np.intp], Predicting]] = []
        for rebuild, rows in rebuilds(trials):
            own = trials if rows.size == trials.n else trials.rows(rows)
            if rebuild.needed:
                rebuilt, replay = self._rebuilt_as(rebuild)
                found = replay.predicting(rebuilt.trials(own))
                parts += [(rows[some], part) for some, part in found]
                continue
            lawful, stepwise = own.with_laws, own.stepwise
            for acting in (~lawful, lawful & ~stepwise, stepwise):
                if acting.all():
                    parts.append((rows, self._predicting(own)))
                elif acting.any():
                    some = np.flatnonzero(acting)
                    parts.append((rows[some], self._predicting(own.rows(some))))
        return parts

    def _rebuilt_as(self, rebuild: Rebuild) -> tuple[Rebuilt, Replay]:
        """The same segments on this robot rebuilt; those used last are kept."""

        def make() -> tuple[Rebuilt, Replay]:
            rebuilt = rebuilt_as(rebuild, self.robot)
            return rebuilt, self.on(rebuilt.robot)

        return self._rebuilt.get(rebuild, make)

    def _predicting(self, trials: Trials) -> Predicting:
        """One part: variants on this robot itself, all with laws of a kind or all without."""
        predicted = np.full((trials.n, *self.measured.shape), np.nan)
        model = self.robot.model
        for group in self._groups:
            row_bytes = 8 * (group.steps + group.past) * (model.nq + 2 * model.nv + model.nu)
            chunk = max(1, _CHUNK_BYTES // (row_bytes * len(group.segments)))
            for start in range(0, trials.n, chunk):
                rows = np.arange(start, min(start + chunk, trials.n))
                if rows.size == trials.n:
                    yield from self._simulating(group, trials, predicted)
                else:
                    predicted[rows] = yield from self._simulating(
                        group, trials.rows(rows), predicted[rows]
                    )
        return predicted

    def _simulating(self, group: Group, trials: Trials, out: FloatArray) -> Predicting:
        """Fills in the rows and channels of a group."""
        model, n, n_segments = self.robot.model, trials.n, len(group.segments)
        step = model.opt.timestep
        joints = [self.robot.joints[name] for name in group.joints]
        delay, rate = _clocks(trials, group.joints)
        prompt = (1 - rate) * group.elapsed[:, None]  # how late the log is but for its delays
        behind = prompt + rate * delay
        # The oldest joint's log at the segment's start shows the robot this much earlier. Whole
        # steps, so that controls change when they changed and efforts are read when they were.
        lead = step * np.ceil(np.maximum(behind.max(axis=2), 0) / step - 1e-9)
        early = ((rate - 1) * group.durations[:, None] - prompt).max()
        steps = group.steps + round(lead.max() / step) + int(np.ceil(max(early, 0) / step - 1e-9))

        later = (behind - lead[..., None]) / rate  # than a segment's first sample it starts
        off = np.stack([trials.start_errors[name] for name in group.joints], axis=1)
        first_shown = group.initial_state(later, off)
        readings = [_reading(trials, name) for name in group.joints]
        first = [
            reading.joint(first_shown[0][..., [k]], first_shown[1][..., [k]])
            for k, reading in enumerate(readings)
        ]
        qpos, qvel = (np.concatenate(parts, axis=2) for parts in zip(*first, strict=True))
        places = [joint.qpos for joint in joints], [joint.dof for joint in joints]
        start_qpos, start_qvel = qpos, qvel
        if group.base is not None:
            pose, velocity = group.base.start(lead)
            start_qpos = np.concatenate([qpos, pose], axis=2)
            start_qvel = np.concatenate([qvel, velocity], axis=2)
            for some, more in zip(places, group.base.addresses, strict=True):
                some.extend(more)
        fields = dict(trials.fields)
        lawful = bool(trials.with_laws.any())
        shift = np.tile(lead[..., None], self.robot.width)
        for index, (name, drive) in group.drives.items():
            shift[..., index] += trials.command_delay[name][:, None]
            merged = (trials.command_delay[name] != 0) | lawful
            if model.actuator_delay[drive.actuator] and merged.any():
                # As one delay: two interpolations between steps would smooth twice. And laws have
                # to see what the drive sees.
                own = fields.get("actuator_delay", trials.own("actuator_delay")).copy()
                shift[merged, :, index] += made_delay(own[merged, drive.actuator, None], step)
                own[merged, drive.actuator] = 0
                fields["actuator_delay"] = own
        laws = Laws(model, joints, fields, trials, n_segments, {*group.drives}) if lawful else None
        before = group.memory + (group.controlled if lawful else 0)
        ctrl = delayed(group.ctrl, group.past - before, before + steps, shift / step)
        clock = (group.elapsed - lead).reshape(-1)
        ahead = None
        if laws is not None and laws.of_targets:
            sent = ctrl.reshape(n * n_segments, before + steps, -1)
            sent, ahead = yield Commanded(laws=laws, ctrl=sent, time=clock - step * before)
            ctrl, ahead = sent.reshape(ctrl.shape), None if ahead is None else ahead[:, before:]
        if self.robot.loops.any:
            start_qpos, start_qvel, places = self._closed(start_qpos, start_qvel, places)
        state = start_state(
            model,
            ctrl[:, :, before - group.memory : before],
            start_qpos,
            start_qvel,
            places,
        )

        if group.played:
            driven = group.ctrl[:, group.past, : model.nu], group.applied[:, group.past]
            carried = loads(trials, group.played, joints, group.starts, driven)
            bend(state, trials, fields, group.played, carried)
        of_base = [c for c, channel in enumerate(self.channels) if channel.of_base]
        turns = any(self.channels[c].signal in TURNING for c in of_base)
        needed = {_RECORDS[c.signal] for c in self.channels if not c.of_base}
        record = sorted({"qpos", *needed, *(["qvel"] if turns else [])})
        each = {name: np.repeat(values, n_segments, axis=0) for name, values in fields.items()}
        stepwise = laws is not None and laws.runs
        applied = group.feed_forward(trials, lead, steps)
        asked = Asked(
            model=model,
            fields=each,
            state=state.reshape(n * n_segments, -1),
            ctrl=ctrl[:, :, before:].reshape(n * n_segments, steps, -1),
            applied=None if applied is None else applied.reshape(n * n_segments, steps, -1),
            record=tuple(record),
            n_threads=self.n_threads,
            laws=laws if stepwise else None,
            time=clock,
            ahead=ahead if stepwise else None,
            voltage=group.voltage(lead, steps) if laws is not None and laws.of_supply else None,
        )
        if group.base is not None:
            raised = group.base.settle(asked.batch(), asked.state, first_controls(asked), each)
        if laws is not None and stepwise:
            remembers = laws.programs is not None and laws.programs.memory
            warm = before if remembers else min(int(np.ceil(_WARM / step)), before)
            q, qd, unknown = measured_past(
                group.segments,
                [group.states[id(segment.recording)] for segment in group.segments],
                later,
                readings,
                step * np.arange(-warm, 0),
            )
            integral = None
            if group.base is None and any(law is IntegralAction for law, _ in laws.stepwise):
                integral = integral_at_start(
                    laws, asked.batch(), asked.state, group.segments, group.routes, asked.ctrl[:, 0]
                )
            sent_before = ctrl[:, :, before - warm : before].reshape(len(q), warm, -1)
            past = Past(ctrl=sent_before, q=q, qd=qd, unknown=unknown, integral=integral)
            asked = replace(asked, past=past)
        rollout, changed = yield asked
        if not stepwise and laws is not None and ahead is not None and "qfrc_actuator" in record:
            made = rollout.records["qfrc_actuator"][..., [joint.dof for joint in joints]]
            changed = laws.shown(made, asked.ctrl, ahead)
        if changed is not None:
            changed = changed.reshape(n, n_segments, steps, -1)
        records = {
            name: values.reshape(n, n_segments, steps, -1)
            for name, values in rollout.records.items()
        }
        if group.base is not None:
            poses = records["qpos"][..., group.base.addresses[0]]
            poses[..., 2] -= raised.reshape(n, n_segments, 1)
            poses = np.concatenate([pose[:, :, None], poses], axis=2)
            spins = np.zeros((*poses.shape[:3], 3))
            if turns:
                simulated = records["qvel"][..., group.base.addresses[1][3:]]
                spins = np.concatenate([velocity[:, :, None, 3:], simulated], axis=2)
            which = [SIGNALS.index(self.channels[c].signal) for c in of_base]
            for s, span in enumerate(group.rows):
                at = (self.time_of_row[span] + lead[:, [s]]) / step
                out[:, span, of_base] = group.base.shown(poses[:, s], spins[:, s], s, at)[
                    ..., which
                ]

        def field(name: str) -> NDArray[Any]:
            return fields[name] if name in fields else trials.own(name)

        for c, channel in enumerate(self.channels):
            if channel.of_base or channel.joint not in group.joints:
                continue
            k = group.joints.index(channel.joint)
            joint = joints[k]
            series, jumps = records[_RECORDS[channel.signal]], None
            if channel.signal == "effort":
                scale = trials.effort_scale[joint.name][:, None, None]
                offset = trials.effort_offset[joint.name][:, None, None]
                # Effort is recorded as of the beginning of a step, the state as of its end.
                made, age = series[..., joint.dof], lead - prompt[..., k]
                series, jumps = made, group.jumps(joint, ctrl, applied, field)
                if applied is not None:  # the same drive makes it, so its log shows it
                    series = series + applied[..., joint.dof]
                if changed is not None:
                    series = series + changed[..., k]
                series = scale * series + offset
                if jumps is not None:
                    jumps = scale * jumps[:, :, before:]
                    if self.robot.reads_effort_first:
                        jumps = _within_limits(jumps, series, group.at_limit(joint, made, field))
            else:
                place = np.concatenate(
                    [qpos[..., [k]], _at_encoder(trials, joint, records["qpos"], "qpos")], axis=2
                )
                if channel.signal == "position":
                    series = readings[k].position(place)
                else:
                    speed = np.concatenate(
                        [qvel[..., [k]], _at_encoder(trials, joint, series, "dof")], axis=2
                    )
                    series = readings[k].velocity(place, speed)
                age = lead - behind[..., k]
            for s, span in enumerate(group.rows):
                clocks = np.stack([rate[:, 0, k], age[:, s], lead[:, s]])
                if (clocks == clocks[:, :1]).all():
                    clocks = clocks[:, :1]
                time = self.time_of_row[span]
                at = (clocks[0, :, None] * time + clocks[1, :, None]) / step
                if channel.signal != "effort":
                    out[:, span, c] = at_index(series[:, s], at)
                else:
                    stamp = (time + clocks[2, :, None]) / step
                    own_jumps = None if jumps is None else jumps[:, s]
                    out[:, span, c] = self._effort_shown(series[:, s], at, own_jumps, stamp)
        return out

    def _effort_shown(
        self, series: FloatArray, at: FloatArray, jumps: FloatArray | None, stamp: FloatArray
    ) -> FloatArray:
        """What rows show of an effort, (n, rows).

        Args:
            series: (n, steps) of the effort.
            at: (n or 1, rows) steps at which it was read, as if at once.
            jumps: (n or 1, steps) by which targets move it; None where they do not jump.
            stamp: as `at`, the steps with which the rows are stamped.
        """
        if jumps is None:
            jumps = np.zeros((1, series.shape[1]))
        # What is logged with a target is after it, however the stamps jitter.
        instant = nearest_step(stamp) + at - stamp
        shown = at_index(series, at, jumps != 0, instant)
        if self.robot.reads_effort_first:
            shown -= jumps_at(jumps, instant)
        if self.robot.effort_age:
            # Of a step before it is what was after its target.
            age = self.robot.effort_age / self.robot.model.opt.timestep
            ago = max(age, 1.0)
            earlier = at_index(series, at - ago, jumps != 0, instant - ago)
            shown += min(age, 1.0) * (earlier - shown)
        return shown

    def _closed(
        self, qpos: FloatArray, qvel: FloatArray, places: tuple[list[int], list[int]]
    ) -> tuple[FloatArray, FloatArray, tuple[list[int], list[int]]]:
        """Whole states in which the model's loops are closed, with their addresses.

        Args:
            qpos: (n, n_segments, n_known) positions that are measured.
            qvel: their velocities.
            places: their addresses.
        """
        model, known = self.robot.model, list(places[1])
        # What lies between a motor and its link is bent later, by what it carries.
        known += [one.play.dof for one in self.robot.joints.values() if one.play is not None]
        known += [one.dof for one in mounts(self.robot)]
        shape = qpos.shape[:2]
        whole_qpos = np.tile(rest(model).qpos, (*shape, 1))
        whole_qvel = np.zeros((*shape, model.nv))
        whole_qpos[..., places[0]], whole_qvel[..., places[1]] = qpos, qvel
        rows = shape[0] * shape[1]
        closed = self.robot.loops.closed(
            whole_qpos.reshape(rows, -1), whole_qvel.reshape(rows, -1), known
        )
        every = list(range(model.nq)), list(range(model.nv))
        return closed[0].reshape(whole_qpos.shape), closed[1].reshape(whole_qvel.shape), every


def predict_together(
    replays: Sequence[Replay], trials: Sequence[Trials], n_threads: int
) -> list[FloatArray]:
    """What each of several replays predicts of its trials, of robots that may be in one batch.

    Args:
        replays: the replays.
        trials: of each, variants of its robot.
        n_threads: threads of the simulation, 0 for all cores.
    """
    parts = [replay.predicting(own) for replay, own in zip(replays, trials, strict=True)]
    runs = [run for some in parts for _, run in some]
    predicted: dict[int, FloatArray] = {}
    sent: dict[int, Any] = dict.fromkeys(range(len(runs)))
    waiting: dict[int, Asked] = {}
    while sent or waiting:
        asked = advanced(runs, sent, predicted)
        waiting.update({k: one for k, one in asked.items() if isinstance(one, Asked)})
        commanded = {k: one for k, one in asked.items() if isinstance(one, Commanded)}
        if commanded:
            sent = dict(zip(commanded, controlled(list(commanded.values())), strict=True))
        else:  # all that can be in one batch has been asked for
            sent = dict(zip(waiting, together(list(waiting.values()), n_threads), strict=True))
            waiting = {}
    found = (predicted.pop(k) for k in range(len(runs)))
    return [
        _assembled([(rows, next(found)) for rows, _ in some], (own.n, *replay.measured.shape))
        for replay, own, some in zip(replays, trials, parts, strict=True)
    ]


def _assembled(
    parts: Sequence[tuple[NDArray[np.intp], FloatArray]], shape: tuple[int, ...]
) -> FloatArray:
    """What was found of some rows each, as one array."""
    if len(parts) == 1:
        return parts[0][1]
    whole = np.full(shape, np.nan)
    for rows, values in parts:
        whole[rows] = values
    return whole


def as_they_are(replays: Sequence[Replay], n_threads: int) -> list[FloatArray]:
    """What each of several replays predicts, (rows, channels), of its robot as it is."""
    trials = [Trials(replay.robot, 1) for replay in replays]
    return [one[0] for one in predict_together(replays, trials, n_threads)]


def _within_limits(jumps: FloatArray, series: FloatArray, limited: NDArray[np.bool_]) -> FloatArray:
    """How far an effort jumps with its target, which is less where it is cut off on either side.

    All are (n, n_segments, steps); `limited` says where the drive makes all that it can.
    """
    cut = limited.copy()
    cut[..., 1:] |= limited[..., :-1]
    step = np.diff(series, axis=2, prepend=series[..., :1])
    return np.where(cut & (jumps != 0), step, jumps)


def _clocks(trials: Trials, joints: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Delays of the logged positions [s], and seconds per second on the log's clock.

    Both are (n, 1, n_joints).
    """
    delay = np.stack([trials.position_delay[name] for name in joints], axis=1)
    skew = np.stack([trials.clock_skew[name] for name in joints], axis=1)
    return delay[:, None], 1 / (1 + skew[:, None])


def _reading(trials: Trials, joint: str) -> Reading:
    """A joint's encoder in every trial, for arrays (n, n_segments, steps)."""
    return Reading(
        trials.encoder_gain[joint][:, None, None], trials.position_error[joint][:, None, None]
    )


def _at_encoder(
    trials: Trials, joint: Joint, series: FloatArray, address: Literal["qpos", "dof"]
) -> FloatArray:
    """What a joint's encoder sees, (n, n_segments, steps), of the model's positions or speeds."""
    motor: FloatArray = series[..., getattr(joint, address)]
    share = trials.load_side[joint.name][:, None, None]
    if joint.play is None or not share.any():
        return motor
    return motor + share * series[..., getattr(joint.play, address)]
