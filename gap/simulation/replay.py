"""Replay: the recorded commands through the simulation, from the measured state.

    replay = Replay(robot, segments, channels, n_threads=2)
    predicted = replay.predict(Trials(robot, n=1))      # (1, rows, channels)
    gap = predicted[0] - replay.measured

All segments and all trials run in lock step. Histories of delayed actuators are filled with the
recorded past commands; a trial that diverges predicts NaN.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import IntegralAction
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.simulation.channel import Channel as Channel
from walkerkit.gap.simulation.commands import Hold
from walkerkit.gap.simulation.gear_play import bend, loads
from walkerkit.gap.simulation.interpolate import delayed, made_delay
from walkerkit.gap.simulation.latest import Latest
from walkerkit.gap.simulation.law_memory import Past, integral_at_start, measured_past
from walkerkit.gap.simulation.laws import Laws
from walkerkit.gap.simulation.mount import mounts
from walkerkit.gap.simulation.reading import Reading
from walkerkit.gap.simulation.rebuild import Rebuild, Rebuilt, rebuilds, rebuilt_as
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.segment_group import MOST_STEPS, Group, similar_lengths
from walkerkit.gap.simulation.shown import Shown, Timing, readings, recorded
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
_CHUNK_BYTES = 2**25
_MOST_REBUILT = 24  # robots kept for variants that need another compilation
_Known = tuple[FloatArray, FloatArray, tuple[list[int], list[int]]]
"""Positions and velocities of some coordinates, (n, n_segments, n_known), and their addresses."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sent:
    """What the drives of a group are sent.

    Attributes:
        fields: model fields of which each trial has its own, (n, *shape).
        laws: the laws, or None.
        ctrl: (n, n_segments, before + steps, width) commands as the drives receive them.
        before: how many of them are from before the start.
        clock: (n * n_segments,) of the start, by the robot's clock [s].
        ahead: as `rollout_with_laws` takes it.
    """

    fields: dict[str, NDArray[Any]]
    laws: Laws | None
    ctrl: FloatArray
    before: int
    clock: FloatArray
    ahead: FloatArray | None


class Replay:
    """The measured segments of one robot, ready to be simulated under any trials.

    Args:
        robot: the robot.
        segments: what to simulate; their recordings measure the same joints.
        channels: what to compare.
        hold: what the targets are between their samples.
        n_threads: threads of the simulation, 0 for all cores.
        every: of how many samples one is compared.

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
        every: int = 1,
    ):
        self.robot = robot
        self.segments = tuple(segments)
        self.channels = tuple(channels)
        self.n_threads = n_threads
        self._every = every
        self._hold: Hold = hold
        self._rebuilt = Latest(_MOST_REBUILT)
        samples = [slice(segment.first, segment.last, every) for segment in segments]
        times = [
            s.recording.time[some] - s.start for s, some in zip(segments, samples, strict=True)
        ]
        lengths = [len(time) for time in times]
        ends = np.cumsum(lengths)
        rows = [slice(int(e - n), int(e)) for e, n in zip(ends, lengths, strict=True)]
        self.segment_of_row = np.repeat(np.arange(len(lengths)), lengths)
        self.time_of_row = np.concatenate(times)
        self.measured = np.full((int(ends[-1]), len(self.channels)), np.nan)
        for segment, some, span in zip(segments, samples, rows, strict=True):
            for c, channel in enumerate(self.channels):
                column = channel.measured(segment.recording)
                if column is not None:
                    self.measured[span, c] = column[some]
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
        return self._with(self.robot, segments, self.channels)

    def on(self, robot: Robot, channels: Sequence[Channel] | None = None) -> Replay:
        """The same segments on another robot; of other channels where these are given."""
        return self._with(robot, self.segments, self.channels if channels is None else channels)

    def _with(
        self, robot: Robot, segments: Sequence[Segment], channels: Sequence[Channel]
    ) -> Replay:
        return Replay(
            robot,
            segments,
            channels,
            hold=self._hold,
            n_threads=self.n_threads,
            every=self._every,
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
        timing = Timing.of(group, trials)
        encoders = readings(trials, group.joints)
        first = _first_state(group, trials, timing, encoders)
        of_base = None if group.base is None else group.base.start(timing.lead)
        sent = yield from self._commanding(group, trials, timing)
        laws, lawful = sent.laws, sent.laws is not None and sent.laws.runs
        state = self._start_state(group, trials, sent, self._known(group, first, of_base))
        applied = group.feed_forward(trials, timing.lead, timing.steps)
        asked = self._asked(group, timing, sent, state, applied)
        if group.base is not None:
            raised = group.base.settle(
                asked.batch(), asked.state, first_controls(asked), asked.fields
            )
        if laws is not None and lawful:
            asked = replace(asked, past=_past(group, asked, laws, sent, timing, encoders))
        elif laws is not None and laws.stepwise:
            asked = _with_what_is_constant(asked, laws)
        rollout, changed = yield asked
        if laws is not None and not lawful and sent.ahead is not None:
            made = rollout.records.get("qfrc_actuator")
            if made is not None:
                dofs = [joint.dof for joint in laws.joints]
                changed = laws.shown(made[..., dofs], asked.ctrl, sent.ahead)
        shape = trials.n, len(group.segments), timing.steps, -1
        shown = Shown(
            group=group,
            trials=trials,
            timing=timing,
            fields=sent.fields,
            readings=encoders,
            first=first,
            ctrl=sent.ctrl,
            applied=applied,
            changed=None if changed is None else changed.reshape(shape),
            records={name: values.reshape(shape) for name, values in rollout.records.items()},
            time=self.time_of_row,
        )
        if group.base is not None and of_base is not None:
            columns = [c for c, channel in enumerate(self.channels) if channel.of_base]
            channels = [self.channels[c] for c in columns]
            of_it = shown.base(group.base, channels, of_base, raised)
            out[:, group.rows[:, None], columns] = of_it
        for c, channel in enumerate(self.channels):
            if not channel.of_base and channel.joint in group.joints:
                out[:, group.rows, c] = shown.joint(channel)
        return out

    def _commanding(
        self, group: Group, trials: Trials, timing: Timing
    ) -> Generator[Commanded, Any, _Sent]:
        """What a group's drives are sent, with what controllers make of it."""
        step, n_sims = self.robot.model.opt.timestep, trials.n * len(group.segments)
        fields, late = _command_delays(group, trials, timing.lead)
        laws = None
        if trials.with_laws.any():
            joints = [self.robot.joints[name] for name in group.joints]
            drives = {*group.drives}
            laws = Laws(self.robot.model, joints, fields, trials, len(group.segments), drives)
        before = group.memory + (0 if laws is None else group.controlled)
        ctrl = delayed(group.ctrl, group.past - before, before + timing.steps, late / step)
        clock, ahead = (group.clock - timing.lead).reshape(-1), None
        if laws is not None and laws.of_targets:
            flat = ctrl.reshape(n_sims, before + timing.steps, -1)
            flat, ahead = yield Commanded(laws=laws, ctrl=flat, time=clock - step * before)
            ctrl, ahead = flat.reshape(ctrl.shape), None if ahead is None else ahead[:, before:]
        return _Sent(fields=fields, laws=laws, ctrl=ctrl, before=before, clock=clock, ahead=ahead)

    def _known(
        self,
        group: Group,
        first: tuple[FloatArray, FloatArray],
        of_base: tuple[FloatArray, FloatArray] | None,
    ) -> _Known:
        """What is known of the states in which a group starts: all of them where there are loops.

        Args:
            group: the group.
            first: positions and velocities of its joints.
            of_base: pose and velocity of its base, if it floats.
        """
        qpos, qvel = first
        joints = [self.robot.joints[name] for name in group.joints]
        places = [joint.qpos for joint in joints], [joint.dof for joint in joints]
        if group.base is not None and of_base is not None:
            qpos, qvel = (
                np.concatenate([known, more], axis=2)
                for known, more in zip(first, of_base, strict=True)
            )
            for some, more in zip(places, group.base.addresses, strict=True):
                some.extend(more)
        return self._closed(qpos, qvel, places) if self.robot.loops.any else (qpos, qvel, places)

    def _start_state(self, group: Group, trials: Trials, sent: _Sent, known: _Known) -> FloatArray:
        """The states in which a group starts, (n, n_segments, nstate)."""
        model = self.robot.model
        past = sent.ctrl[:, :, sent.before - group.memory : sent.before]
        state = start_state(model, past, *known)
        if group.played:
            driven = group.ctrl[:, group.past, : model.nu], group.applied[:, group.past]
            joints = [self.robot.joints[name] for name in group.joints]
            carried = loads(trials, group.played, joints, group.starts, driven)
            bend(state, trials, sent.fields, group.played, carried)
        return state

    def _asked(
        self,
        group: Group,
        timing: Timing,
        sent: _Sent,
        state: FloatArray,
        applied: FloatArray | None,
    ) -> Asked:
        """The rollout of a group, but for what laws saw before it."""
        n, n_segments, steps = len(state), len(group.segments), timing.steps
        laws, lead = sent.laws, timing.lead
        lawful = laws is not None and laws.runs
        return Asked(
            model=self.robot.model,
            fields={k: np.repeat(values, n_segments, axis=0) for k, values in sent.fields.items()},
            state=state.reshape(n * n_segments, -1),
            ctrl=sent.ctrl[:, :, sent.before :].reshape(n * n_segments, steps, -1),
            applied=None if applied is None else applied.reshape(n * n_segments, steps, -1),
            record=recorded(self.channels),
            n_threads=self.n_threads,
            laws=laws if lawful else None,
            time=sent.clock,
            ahead=sent.ahead if lawful else None,
            voltage=group.voltage(lead, steps) if laws is not None and laws.of_supply else None,
        )

    def _closed(
        self, qpos: FloatArray, qvel: FloatArray, places: tuple[list[int], list[int]]
    ) -> _Known:
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


def _first_state(
    group: Group, trials: Trials, timing: Timing, encoders: Sequence[Reading]
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities of the joints at the start, (n, n_segments, n_joints) each."""
    off = np.stack([trials.start_errors[name] for name in group.joints], axis=1)
    qpos, qvel = group.initial_state(timing.later, off)
    first = [reading.joint(qpos[..., [k]], qvel[..., [k]]) for k, reading in enumerate(encoders)]
    qpos, qvel = (np.concatenate(parts, axis=2) for parts in zip(*first, strict=True))
    return qpos, qvel


def _command_delays(
    group: Group, trials: Trials, lead: FloatArray
) -> tuple[dict[str, NDArray[Any]], FloatArray]:
    """The fields of the trials, and how late commands are: (n, n_segments, width) [s]."""
    model = group.robot.model
    fields, lawful = dict(trials.fields), bool(trials.with_laws.any())
    late = np.tile(lead[..., None], group.robot.width)
    for index, (name, drive) in group.drives.items():
        late[..., index] += trials.command_delay[name][:, None]
        merged = (trials.command_delay[name] != 0) | lawful
        if model.actuator_delay[drive.actuator] and merged.any():
            # As one delay: two interpolations between steps would smooth twice. And laws have
            # to see what the drive sees.
            own = fields.get("actuator_delay", trials.own("actuator_delay")).copy()
            its = made_delay(own[merged, drive.actuator, None], model.opt.timestep)
            late[merged, :, index] += its
            own[merged, drive.actuator] = 0
            fields["actuator_delay"] = own
    return fields, late


def _with_what_is_constant(asked: Asked, laws: Laws) -> Asked:
    """A rollout with what laws add to every step alike, as dry friction and effort of its own."""
    effort, friction = laws.constant()
    dofs = [joint.dof for joint in laws.joints]
    model, name = asked.model, "dof_frictionloss"
    own = asked.fields.get(name)
    dry = np.tile(model.dof_frictionloss, (asked.n_sims, 1)) if own is None else own.copy()
    dry[:, dofs] = np.maximum(dry[:, dofs] + friction, 0.0)
    shape = asked.n_sims, asked.n_steps, model.nv
    applied = np.zeros(shape) if asked.applied is None else asked.applied.copy()
    applied[:, :, dofs] += effort[:, None]
    return replace(asked, fields={**asked.fields, name: dry}, applied=applied)


def _past(
    group: Group,
    asked: Asked,
    laws: Laws,
    sent: _Sent,
    timing: Timing,
    encoders: Sequence[Reading],
) -> Past:
    """What the laws of a rollout saw before it."""
    step, before = asked.model.opt.timestep, sent.before
    remembers = laws.programs is not None and laws.programs.memory
    warm = before if remembers else min(int(np.ceil(_WARM / step)), before)
    q, qd, unknown = measured_past(
        group.segments,
        [group.states[id(segment.recording)] for segment in group.segments],
        timing.later,
        encoders,
        step * np.arange(-warm, 0),
    )
    integral = None
    if group.base is None and any(law is IntegralAction for law, _ in laws.stepwise):
        integral = integral_at_start(
            laws, asked.batch(), asked.state, group.segments, group.routes, asked.ctrl[:, 0]
        )
    ctrl = sent.ctrl[:, :, before - warm : before].reshape(len(q), warm, -1)
    return Past(ctrl=ctrl, q=q, qd=qd, unknown=unknown, integral=integral)
