"""Recordings replayed by robots as they are, numerical error and all: the gap, and where it is.

replayed = replay_half(problem, "held", problem.robots)
gap = gap_of(problem, replayed, replayed)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.report.diagnosis import Trace
from walkerkit.gap.report.gaps import Gap, GapMap, GapSize
from walkerkit.gap.report.locate import gap_map
from walkerkit.gap.report.regimes import regimes
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.problem import Problem, channel_noise
from walkerkit.gap.search.restarts import DRAWS, by_chance, restarted
from walkerkit.gap.search.structure import Fit
from walkerkit.gap.simulation.branches import descends
from walkerkit.gap.simulation.replay import Channel, Replay, as_they_are, predict_together
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]

_QUARTER = 4  # of the timestep, at which the numerical floor is taken
_LONGEST_TRACE = 20000  # samples
_AND = " and "  # between units


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """All replays of one half under one set of robots, with the predictions.

    Attributes:
        replays: one for each robot that has recordings.
        predicted: of each, (rows, n_channels) what its log would show.
    """

    replays: tuple[Replay, ...]
    predicted: tuple[FloatArray, ...]

    def residuals(self) -> list[FloatArray]:
        """Predicted minus measured of every replay, (rows, n_channels)."""
        return [p - r.measured for p, r in zip(self.predicted, self.replays, strict=True)]

    def rms(self, channels: Sequence[Channel]) -> float:
        """Root mean square over all samples of some channels."""
        return _rms(self.replays, self.residuals(), channels)


def replay_half(problem: Problem, half_name: str, robots: Sequence[Robot]) -> Replayed:
    """Replays a half on robots as they are, numerical error and all.

    Args:
        problem: what the recordings are of.
        half_name: `fit` or `held`.
        robots: one for each of the problem's.
    """
    half: Half = getattr(problem, half_name)
    with_any = [robot for robot, some in zip(robots, half.recordings, strict=True) if some]
    replays = tuple(
        told if robot is told.robot else told.on(robot)
        for robot, told in zip(with_any, half.told, strict=True)
    )
    return Replayed(replays=replays, predicted=tuple(as_they_are(replays, problem.n_threads)))


def gap_of(problem: Problem, before: Replayed, after: Replayed) -> Gap:
    """How large the gap is before and after, in all and joint by joint, and how small it can be."""
    channels = before.replays[0].channels
    floor = {c: channel_noise(problem.recordings, c).std for c in channels}

    positions = [c for c in channels if c.signal == "position"]
    finer, drier = _nearest(problem, after, positions)
    again = [] if problem.window is None else restarted(after.replays, problem.n_threads)
    restarts = [Replayed(replays=after.replays, predicted=tuple(one)) for one in again]
    misread = [] if problem.window is None else _misread(problem, after)

    def own_noise(chosen: Sequence[Channel]) -> float:
        return float(np.sqrt(np.mean([floor[c] ** 2 for c in chosen])))

    def size(chosen: Sequence[Channel]) -> GapSize:
        of_restarts = max(_rms_change(after, some, chosen) for some in (restarts, misread))
        noise = math.hypot(own_noise(chosen), of_restarts)
        # One restart is wrong one way for all of its window, at each joint of its own.
        times = by_chance(_restarts(after, chosen), len(positions) if len(chosen) == 1 else 1)
        most = math.hypot(own_noise(chosen), times * of_restarts)
        return GapSize(
            unit=unit_of(problem, chosen),
            before=before.rms(chosen),
            after=after.rms(chosen),
            noise_floor=noise,
            numerical_floor=_changed(after, finer, chosen),
            by_chance=most / noise if noise else 1.0,
        )

    signals = dict.fromkeys(c.quantity for c in channels)
    position = size(positions)
    joints = beside_each_other(problem.robots[0], {c.joint: size([c]) for c in positions})
    finer_position, finer_joints = None, {}
    # The timestep's error is the same each time, where that of restarts comes by chance.
    if position.numerical_floor > own_noise(positions):
        finer_before = finer if after is before else _finer(problem, before, drier)[0]

        def at_finer(coarse: GapSize, chosen: Sequence[Channel]) -> GapSize:
            return replace(
                coarse,
                before=finer_before.rms(chosen),
                after=finer.rms(chosen),
                numerical_floor=coarse.numerical_floor / (_QUARTER - 1),
                numerical_near=coarse.numerical_near / (_QUARTER - 1),
            )

        finer_position = at_finer(position, positions)
        finer_joints = {c.joint: at_finer(joints[c.joint], [c]) for c in positions}
    return Gap(
        position=position,
        horizon=problem.window,
        finer_position=finer_position,
        joints=joints,
        finer_joints=finer_joints,
        signals={name: size([c for c in channels if c.quantity == name]) for name in signals},
        scored=tuple(dict.fromkeys(c.quantity for c in problem.channels)),
        drier=drier,
    )


def gaps_of(replayed: Replayed) -> dict[str, float]:
    """The gap of every signal over all joints."""
    channels = replayed.replays[0].channels
    signals = dict.fromkeys(channel.quantity for channel in channels)
    return {name: replayed.rms([c for c in channels if c.quantity == name]) for name in signals}


def gaps_with(problem: Problem, fits: Sequence[Fit]) -> list[dict[str, float]]:
    """The held-out gap of every signal with each of some fits, numerical error and all."""
    replays = problem.held.told
    trials = [one.structure.trials(r.robot, one.values[None]) for one in fits for r in replays]
    predicted = predict_together([*replays] * len(fits), trials, problem.n_threads)
    return [
        gaps_of(Replayed(replays=replays, predicted=tuple(one[0] for one in its)))
        for its in _apart(predicted, len(replays))
    ]


def gap_maps(
    problem: Problem, before: Mapping[str, Replayed], after: Mapping[str, Replayed]
) -> tuple[GapMap, ...]:
    """Where the gaps of position and effort live, over all recordings.

    Args:
        problem: what the recordings are of.
        before: both halves by name, with the model as it was given.
        after: the same as it was mended.
    """
    replays = [replay for half in before.values() for replay in half.replays]
    masks = [regimes(replay, problem.joints) for replay in replays]
    residuals = [
        [residual for half in which.values() for residual in half.residuals()]
        for which in (before, after)
    ]
    found = []
    for signal in ("position", "effort"):
        channels = [c for c in replays[0].channels if c.signal == signal]
        if channels:
            unit = unit_of(problem, channels)
            # A radian and a meter are not alike; how far above their noise they are, is.
            noise = {c.joint: channel_noise(problem.recordings, c).std for c in channels}
            per = noise if _AND in unit else None
            old, new = (gap_map(masks, replays, r, problem.joints, signal, per) for r in residuals)
            found.append(GapMap(signal=signal, unit=unit, before=old, after=new))
    return tuple(found)


def traces(
    problem: Problem, before: Mapping[str, Replayed], after: Mapping[str, Replayed]
) -> tuple[Trace, ...]:
    """Every measured channel of every recording, held-out recordings first.

    Args:
        problem: what the recordings are of.
        before: both halves by name, as the model was given.
        after: the same as it was mended.
    """
    found = []
    for half in ("held", "fit"):
        pairs = zip(
            before[half].replays,
            before[half].predicted,
            after[half].predicted,
            strict=True,
        )
        for replay, old, new in pairs:
            segments = replay.segments
            names = dict.fromkeys(segment.recording.name for segment in segments)
            owner = np.array([segment.recording.name for segment in segments])
            for name in names:
                rows = np.flatnonzero(owner[replay.segment_of_row] == name)
                rows = rows[:: max(1, len(rows) // _LONGEST_TRACE)]
                start = np.array([segment.start for segment in segments])
                part = replay.segment_of_row[rows]
                time = replay.time_of_row[rows] + start[part]
                restarts = np.flatnonzero(np.diff(part)) + 1
                for c, channel in enumerate(replay.channels):
                    if np.isnan(replay.measured[rows, c]).all():
                        continue
                    target = _target(replay, channel, name, time)
                    found.append(
                        Trace(
                            recording=name,
                            joint=channel.joint,
                            signal=channel.signal,
                            unit=unit_of(problem, [channel]),
                            held_out=half == "held",
                            time=time,
                            measured=replay.measured[rows, c],
                            before=old[rows, c],
                            after=new[rows, c],
                            target=target,
                            restarts=restarts,
                        )
                    )
    return tuple(found)


def _target(replay: Replay, channel: Channel, name: str, time: FloatArray) -> FloatArray | None:
    """What was commanded of a signal at some instants of a recording."""
    recording = next(s.recording for s in replay.segments if s.recording.name == name)
    target = recording.columns.get(f"{channel.joint}/{channel.signal}_target")
    return None if target is None else np.interp(time, recording.time, target)


def unit_of(problem: Problem, channels: Sequence[Channel]) -> str:
    """The unit of some channels of one signal; both where hinges and slides are among them."""
    joints = problem.robots[0].joints
    slides = {not c.of_base and joints[c.joint].slide for c in channels}
    return _AND.join(channels[0].unit(slide=slide) for slide in sorted(slides))


def _nearest(
    problem: Problem, replayed: Replayed, positions: Sequence[Channel]
) -> tuple[Replayed, bool]:
    """The same replays with less numerical error, and whether their dry friction is drier.

    It is where that comes nearer to what was measured: MuJoCo's own creeps, which a machine's does
    not, but a log of MuJoCo does.
    """
    if not any(robot.has_dry_friction for robot in problem.robots):
        return _finer(problem, replayed, False)[0], False
    finer, dry = _finer(problem, replayed, False, True)
    nearer = dry.rms(positions) < finer.rms(positions)
    return (dry, True) if nearer else (finer, False)


def _finer(problem: Problem, replayed: Replayed, *drier: bool) -> list[Replayed]:
    """The same replays at a quarter of the timestep; `drier` with friction as dry as it goes."""
    each = [
        tuple(r.on(r.robot.refined(_QUARTER, as_dry_as_it_goes=one)) for r in replayed.replays)
        for one in drier
    ]
    predicted = as_they_are([replay for fine in each for replay in fine], problem.n_threads)
    its = _apart(predicted, len(replayed.replays))
    return [Replayed(replays=fine, predicted=own) for fine, own in zip(each, its, strict=True)]


def _apart(predicted: Sequence[FloatArray], count: int) -> list[tuple[FloatArray, ...]]:
    """What was predicted of several sets of so many replays, set by set."""
    return [tuple(predicted[k : k + count]) for k in range(0, len(predicted), count)]


def _misread(problem: Problem, replayed: Replayed) -> list[Replayed]:
    """The same replays from states that are off by their errors.

    Besides the noise these have what smoothing takes off a motion that is fast for it.
    """
    rng = np.random.default_rng(0)
    trials = []
    for replay in replayed.replays:
        trials.append(Trials(replay.robot, DRAWS))
        for errors in trials[-1].start_errors.values():
            errors += rng.standard_normal(errors.shape)
    predicted = predict_together(replayed.replays, trials, problem.n_threads)
    draws = [tuple(one[k] for one in predicted) for k in range(DRAWS)]
    return [
        Replayed(replays=replayed.replays, predicted=one)
        for one in draws
        if all(np.isfinite(some).all() for some in one)
    ]


def _rms_change(one: Replayed, others: Sequence[Replayed], channels: Sequence[Channel]) -> float:
    """Root mean square of the changes to several others; 0 of none."""
    changed = np.array([_changed(one, other, channels) for other in others])
    return math.sqrt(np.mean(np.square(changed))) if changed.size else 0.0


def beside_each_other(robot: Robot, joints: Mapping[str, GapSize]) -> dict[str, GapSize]:
    """The gaps of joints, with what the timestep leaves at those on the way to or from each.

    Where a joint moves that another carries, this one moves no further than by the root of the
    ratio of their inertias (M_ij² ≤ M_ii M_jj): a finger that shakes hardly moves the wrist.
    """
    model = robot.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    own = {name: inertia[robot.joints[name].dof, robot.joints[name].dof] for name in joints}
    body = {name: int(model.jnt_bodyid[robot.joints[name].id]) for name in joints}

    def follows(name: str, other: str) -> float:
        if descends(model, body[name], body[other]):
            return 1.0
        carried = descends(model, body[other], body[name])
        return min(1.0, math.sqrt(own[other] / own[name])) if carried else 0.0

    def near(name: str) -> float:
        return max(
            size.numerical_floor * follows(name, other)
            for other, size in joints.items()
            if size.unit == joints[name].unit
        )

    return {name: replace(size, numerical_near=near(name)) for name, size in joints.items()}


def _restarts(replayed: Replayed, channels: Sequence[Channel]) -> int:
    """How many windows have samples of some channels; what is wrong at one may move them all."""
    found = 0
    for replay in replayed.replays:
        chosen = [c for c, channel in enumerate(replay.channels) if channel in channels]
        measured = ~np.isnan(replay.measured[:, chosen]).all(axis=1)
        found += len(np.unique(replay.segment_of_row[measured]))
    return found


def _changed(one: Replayed, other: Replayed, channels: Sequence[Channel]) -> float:
    """Root-mean-square change of some channels from some replays to others of the same."""
    changes = [b - a for a, b in zip(one.predicted, other.predicted, strict=True)]
    return _rms(one.replays, changes, channels)


def _rms(
    replays: Sequence[Replay], differences: Sequence[FloatArray], channels: Sequence[Channel]
) -> float:
    """Root mean square over all that was measured of some channels; 0 where nothing was."""
    squares, count = 0.0, 0
    for replay, difference in zip(replays, differences, strict=True):
        for c, channel in enumerate(replay.channels):
            if channel in channels:
                known = ~np.isnan(replay.measured[:, c])
                squares += float(np.square(difference[known, c]).sum())
                count += int(known.sum())
    return float(np.sqrt(squares / count)) if count else 0.0
