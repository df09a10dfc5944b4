"""What a log shows of simulations: late, by its own clock, through its encoders and efforts.

timing = Timing.of(group, trials)       # when to start them, for the log to have its rows
shown = Shown(group=group, trials=trials, timing=timing, records=records, ...)
shown.joint(channel)                    # (n, n_rows)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.base_state import SIGNALS, TURNING
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.floating import FloatingBase
from walkerkit.gap.simulation.interpolate import at_index, jumps_at, nearest_step, one_if_alike
from walkerkit.gap.simulation.reading import Reading
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.gap.simulation.segment_group import Group
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]

_RECORDS = {"position": "qpos", "velocity": "qvel", "effort": "qfrc_actuator"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Timing:
    """When the simulations of a group start, and how late their log is.

    Attributes:
        rate: (n, 1, n_joints) seconds per second on the log's clock.
        prompt: (n, n_segments, n_joints) how late the log is but for its delays [s].
        behind: (n, n_segments, n_joints) how late it is [s].
        lead: (n, n_segments) how long before its segment a simulation starts [s].
        steps: of the simulations.
    """

    rate: FloatArray
    prompt: FloatArray
    behind: FloatArray
    lead: FloatArray
    steps: int

    @classmethod
    def of(cls, group: Group, trials: Trials) -> Timing:
        """That of a group under some trials."""
        step = group.robot.model.opt.timestep
        delay = np.stack([trials.position_delay[name] for name in group.joints], axis=1)[:, None]
        skew = np.stack([trials.clock_skew[name] for name in group.joints], axis=1)
        rate = 1 / (1 + skew[:, None])
        prompt = (1 - rate) * group.elapsed[:, None]
        behind = prompt + rate * delay
        # The oldest joint's log at the segment's start shows the robot this much earlier. Whole
        # steps, so that controls change when they changed and efforts are read when they were.
        lead = step * np.ceil(np.maximum(behind.max(axis=2), 0) / step - 1e-9)
        early = ((rate - 1) * group.durations[:, None] - prompt).max()
        steps = group.steps + round(lead.max() / step) + int(np.ceil(max(early, 0) / step - 1e-9))
        return cls(rate=rate, prompt=prompt, behind=behind, lead=lead, steps=steps)

    @property
    def later(self) -> FloatArray:
        """(n, n_segments, n_joints) from a segment's first sample to the start, by the log [s]."""
        return (self.behind - self.lead[..., None]) / self.rate


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """Simulations of a group, to be read as their log would show them.

    Attributes:
        group: the group.
        trials: under which it was simulated.
        timing: when.
        fields: model fields of which each trial has its own, (n, *shape).
        readings: of each joint.
        first: positions and velocities of the joints at the start, (n, n_segments, n_joints) each.
        ctrl: (n, n_segments, before + steps, nu) controls, with some before the start.
        applied: (n, n_segments, steps, nv) effort applied beside them, or None.
        changed: (n, n_segments, steps, n_joints) what laws changed of the effort, or None.
        records: (n, n_segments, steps, size) what was recorded after every step.
        time: (rows,) of all rows, within their segments [s].
    """

    group: Group
    trials: Trials
    timing: Timing
    fields: Mapping[str, NDArray[Any]]
    readings: Sequence[Reading]
    first: tuple[FloatArray, FloatArray]
    ctrl: FloatArray
    applied: FloatArray | None
    changed: FloatArray | None
    records: Mapping[str, FloatArray]
    time: FloatArray

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.group.robot

    def joint(self, channel: Channel) -> FloatArray:
        """What the group's rows show of a joint's signal, (n, n_rows)."""
        k, timing, step = self.group.joints.index(channel.joint), self.timing, self._step
        jumps = None
        if channel.signal == "effort":
            series, jumps = self._effort(k)
            # Effort is recorded as of the beginning of a step, the state as of its end.
            age = timing.lead - timing.prompt[..., k]
        else:
            series, age = self._encoded(k, channel.signal), timing.lead - timing.behind[..., k]
        rate, age, lead = one_if_alike(timing.rate[..., k], age, timing.lead)
        at = (rate * self._time + age[:, self.group.segment]) / step
        if channel.signal != "effort":
            return at_index(series, self.group.segment, at)
        stamp = (self._time + lead[:, self.group.segment]) / step
        return self._effort_shown(series, at, jumps, stamp)

    def base(
        self,
        base: FloatingBase,
        channels: Sequence[Channel],
        start: tuple[FloatArray, FloatArray],
        raised: FloatArray,
    ) -> FloatArray:
        """What the group's rows show of the base, (n, n_rows, n_channels).

        Args:
            base: the base.
            channels: its own.
            start: its pose and velocity as they were measured.
            raised: (n * n_segments,) by how much it started higher than that [m].
        """
        pose, velocity = start
        poses = self.records["qpos"][..., base.addresses[0]]
        poses[..., 2] -= raised.reshape(*poses.shape[:2], 1)
        poses = np.concatenate([pose[:, :, None], poses], axis=2)
        spins = np.zeros((*poses.shape[:3], 3))
        if any(channel.signal in TURNING for channel in channels):
            simulated = self.records["qvel"][..., base.addresses[1][3:]]
            spins = np.concatenate([velocity[:, :, None, 3:], simulated], axis=2)
        which = [SIGNALS.index(channel.signal) for channel in channels]
        (lead,) = one_if_alike(self.timing.lead)
        at = (self._time + lead[:, self.group.segment]) / self._step
        shown: FloatArray = base.shown(poses, spins, self.group.segment, at)[..., which]
        return shown

    @property
    def _time(self) -> FloatArray:
        time: FloatArray = self.time[self.group.rows]
        return time

    @property
    def _step(self) -> float:
        return float(self.robot.model.opt.timestep)

    def _field(self, name: str) -> NDArray[Any]:
        return self.fields[name] if name in self.fields else self.trials.own(name)

    def _effort(self, k: int) -> tuple[FloatArray, FloatArray | None]:
        """A joint's logged effort, (n, n_segments, steps), and by how much targets move it."""
        joint, trials = self.robot.joints[self.group.joints[k]], self.trials
        scale = trials.effort_scale[joint.name][:, None, None]
        offset = trials.effort_offset[joint.name][:, None, None]
        series = made = self.records["qfrc_actuator"][..., joint.dof]
        jumps = self.group.jumps(joint, self.ctrl, self.applied, self._field)
        if self.applied is not None:  # the same drive makes it, so its log shows it
            series = series + self.applied[..., joint.dof]
        if self.changed is not None:
            series = series + self.changed[..., k]
        series = scale * series + offset
        if jumps is not None:
            jumps = scale * jumps[:, :, -series.shape[2] :]
            if self.robot.reads_effort_first:
                limited = self.group.at_limit(joint, made, self._field)
                jumps = _within_limits(jumps, series, limited)
        return series, jumps

    def _encoded(self, k: int, signal: str) -> FloatArray:
        """A joint's position or velocity as its encoder reads it, from the start on."""
        joint = self.robot.joints[self.group.joints[k]]
        qpos, qvel = (values[..., [k]] for values in self.first)
        place = np.concatenate(
            [qpos, _at_encoder(self.trials, joint, self.records["qpos"], "qpos")], axis=2
        )
        if signal == "position":
            return self.readings[k].position(place)
        speed = np.concatenate(
            [qvel, _at_encoder(self.trials, joint, self.records["qvel"], "dof")], axis=2
        )
        return self.readings[k].velocity(place, speed)

    def _effort_shown(
        self, series: FloatArray, at: FloatArray, jumps: FloatArray | None, stamp: FloatArray
    ) -> FloatArray:
        """What rows show of an effort, (n, n_rows).

        Args:
            series: (n, n_segments, steps) of the effort.
            at: (n or 1, n_rows) steps at which it was read, as if at once.
            jumps: (n or 1, n_segments, steps) by which targets move it; None where none does.
            stamp: as `at`, the steps with which the rows are stamped.
        """
        if jumps is None:
            jumps = np.zeros((1, *series.shape[1:]))
        segment = self.group.segment
        # What is logged with a target is after it, however the stamps jitter.
        instant = nearest_step(stamp) + at - stamp
        shown = at_index(series, segment, at, jumps != 0, instant)
        if self.robot.reads_effort_first:
            shown -= jumps_at(jumps, segment, instant)
        if self.robot.effort_age:
            # Of a step before it is what was after its target.
            age = self.robot.effort_age / self._step
            ago = max(age, 1.0)
            earlier = at_index(series, segment, at - ago, jumps != 0, instant - ago)
            shown += min(age, 1.0) * (earlier - shown)
        return shown


def recorded(channels: Sequence[Channel]) -> tuple[str, ...]:
    """The fields that have to be recorded after every step for these channels."""
    needed = {_RECORDS[channel.signal] for channel in channels if not channel.of_base}
    turns = any(channel.of_base and channel.signal in TURNING for channel in channels)
    return tuple(sorted({"qpos", *needed, *(["qvel"] if turns else [])}))


def readings(trials: Trials, joints: Sequence[str]) -> list[Reading]:
    """Some joints' encoders in every trial, for arrays (n, n_segments, steps)."""
    return [
        Reading(
            trials.encoder_gain[name][:, None, None], trials.position_error[name][:, None, None]
        )
        for name in joints
    ]


def _within_limits(jumps: FloatArray, series: FloatArray, limited: NDArray[np.bool_]) -> FloatArray:
    """How far an effort jumps with its target, which is less where it is cut off on either side.

    All are (n, n_segments, steps); `limited` says where the drive makes all that it can.
    """
    cut = limited.copy()
    cut[..., 1:] |= limited[..., :-1]
    step = np.diff(series, axis=2, prepend=series[..., :1])
    return np.where(cut & (jumps != 0), step, jumps)


def _at_encoder(
    trials: Trials, joint: Joint, series: FloatArray, address: Literal["qpos", "dof"]
) -> FloatArray:
    """What a joint's encoder sees, (n, n_segments, steps), of the model's positions or speeds."""
    motor: FloatArray = series[..., getattr(joint, address)]
    share = trials.load_side[joint.name][:, None, None]
    if joint.play is None or not share.any():
        return motor
    return motor + share * series[..., getattr(joint.play, address)]
