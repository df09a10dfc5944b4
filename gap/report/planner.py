"""The next experiment: the safe one that would best tell a confusion set apart.

Every member's model is simulated in every experiment of the battery: the excitations on the robot
as it is, and some of them with a changed set-up (`set_ups`). What leaves the room that the
recordings have reached, or asks for more effort than they have shown, is made smaller or left out.
Where the predicted logs differ most is where to measure next; a changed set-up is more trouble, so
it is proposed only where the robot as it is would not do.

A robot on its feet is not moved joint by joint: its battery is that of `gap.standing`, what it
comes through upright however its model may be wrong.

The difference is counted in standard deviations of what the explanation leaves of the recordings,
with as many independent samples as their errors' autocorrelation allows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.base_state import BASE, ORIENTATIONS
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.report.diagnosis import NextExperiment
from walkerkit.gap.report.independence import Independence, independence
from walkerkit.gap.report.set_ups import RELEASE, SetUp, can_be_held, held_amplitude, set_ups, takes
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.replay import Replay, predict_together
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials
from walkerkit.gap.standing.battery import standing_battery
from walkerkit.gap.standing.safety import BOUNDS, effort_limit
from walkerkit.tasks.excitation import BATTERY

FloatArray = NDArray[np.float64]

FILE, MODEL = "next_experiment.csv", "next_experiment.xml"
_SECONDS = 10.0
_LEAST_RATE, _MOST_RATE = 100.0, 1000.0  # Hz
_SEED = 20260102
_WORTH_IT = 1.0  # standard deviations; less is no experiment
_CLEARLY = 6.0  # standard deviations; more needs no more trouble
_SIZES = (1.0, 0.6, 0.35)  # of the room
_BEYOND = 0.25  # of the range, or of the effort, that has been reached
_EFFORT_NOISE = 0.02  # of the peak, where no effort was logged to tell it


@dataclass(frozen=True, kw_only=True)
class Plan:
    """An experiment with what it takes.

    Attributes:
        experiment: what the diagnosis says of it.
        targets: what to send.
        robot: the robot as it is given with the changed set-up, or None where it is as it was.
    """

    experiment: NextExperiment
    targets: Recording
    robot: Robot | None


@dataclass(frozen=True, kw_only=True)
class _Choice:
    """One experiment of the battery, and how far the nearest two members are apart in it."""

    set_up: SetUp
    excitation: str
    separation: float
    targets: Recording


def next_experiment(problem: Problem, members: Sequence[Fit]) -> Plan | None:
    """Chooses the experiment that parts the members best.

    Args:
        problem: what was explained.
        members: fits of the members of a confusion set, the named one first.

    Returns:
        The experiment; None where there is none for such a robot, or none parts the members.
    """
    robot = problem.robots[0]
    if len(members) < 2 or obstacle(problem):
        return None
    tried: list[_Choice] = []
    for alike in _choices(_Bench(problem, members)):
        tried += alike
        if any(one.separation >= _CLEARLY for one in tried):
            break
    for best in sorted(tried, key=lambda one: -one.separation):
        if best.separation < _WORTH_IT:
            break
        try:
            changed = best.set_up.changed(robot) if best.set_up.changes_robot else None
        except RuntimeError:  # the model's own settings undo this change
            continue
        experiment = NextExperiment(
            excitation=best.excitation,
            # One effect at several places is named once.
            between=tuple(dict.fromkeys(fit.structure.terms[-1].effect.name for fit in members)),
            separation=best.separation,
            file=FILE,
            set_up=best.set_up.name,
            instruction=best.set_up.instruction,
            model=MODEL if changed is not None else None,
        )
        return Plan(experiment=experiment, targets=best.targets, robot=changed)
    return None


class _Bench:
    """The members of a confusion set, ready to be put through experiments."""

    def __init__(self, problem: Problem, members: Sequence[Fit]):
        self.problem = problem
        self.robot = problem.robots[0]
        self.members = members
        self.joints = problem.joints
        self.takes = takes(self.robot, problem.joints)
        # A log is read by its samples: where delays are in doubt, slower ones would tell less.
        fastest = max(recording.rate for recording in problem.recordings)
        self.rate = float(np.clip(round(fastest), _LEAST_RATE, _MOST_RATE))
        self.concerned = _concerned(self.robot, problem.joints, members)
        self.watched = tuple(
            Channel(joint=joint, signal=signal)
            for signal in ("position", "effort")
            for joint in problem.joints
        )
        self.motions: dict[str, Recording] = {}
        if self.robot.base is not None and self.takes == "position":
            self.motions = standing_battery(
                self.robot, seconds=_SECONDS, rate=self.rate, n_threads=problem.n_threads
            )
        tilts = tuple(Channel(joint=BASE, signal=name) for name in ORIENTATIONS[:2])
        self.tilts = tilts if self.motions else ()
        self.channels = tuple(dict.fromkeys((*problem.channels, *self.watched, *self.tilts)))
        self.efforts = any(channel.signal == "effort" for channel in problem.channels)
        self.spread = independence(problem, members[0])
        self.with_play = any(np.any(values) for values in self._trials().plays.values())

    def predict(self, logs: Sequence[Recording], changes: Sequence[SetUp]) -> list[FloatArray]:
        """Of each log, set up so, (n_members, rows, channels) what each member's would show."""
        hold, threads = self.problem.hold, self.problem.n_threads
        replays = [
            Replay(self.robot, whole(log), self.channels, hold=hold, n_threads=threads)
            for log in logs
        ]
        trials = [self._trials() for _ in logs]
        for set_up, own in zip(changes, trials, strict=True):
            set_up.change(own)
        return predict_together(replays, trials, threads)

    def _trials(self) -> Trials:
        return Trials.joined(
            [fit.structure.trials(self.robot, fit.values[None]) for fit in self.members]
        )

    def is_safe(self, predicted: FloatArray, set_up: SetUp) -> bool:
        """Whether no member's robot leaves what the recordings have reached, or its limits."""
        if not np.isfinite(predicted).all():
            return False
        for channel in self.watched:
            series = predicted[:, :, self.channels.index(channel)]
            if self.motions:
                if not self._within_limits(channel, series):
                    return False
                continue
            excursion, joint = self.robot.excursion(channel.joint), self.robot.joints[channel.joint]
            if channel.signal == "effort":
                if np.abs(series).max() > (1 + _BEYOND) * excursion.effort:
                    return False
                continue
            limited = self.robot.model.jnt_limited[joint.id]
            # A slide whose stops the model does not know may have them right there.
            margin = _BEYOND * excursion.range if limited or not joint.slide else 0.0
            low, high = excursion.lower - margin, excursion.upper + margin
            if channel.joint in set_up.released and not joint.slide:
                # It may swing through: all that a hinge can do is what its stops leave it.
                low, high = -np.inf, np.inf
            if limited:
                stops = self.robot.model.jnt_range[joint.id]
                low, high = max(low, float(stops[0])), min(high, float(stops[1]))
            if series.min() < low or series.max() > high:
                return False
        return all(
            np.ptp(predicted[:, :, self.channels.index(tilt)], axis=1).max() < 2 * BOUNDS["tilt"]
            for tilt in self.tilts
        )

    def _within_limits(self, channel: Channel, series: FloatArray) -> bool:
        """Whether a joint of a robot on its feet stays within its range and its drive's limit."""
        joint, model = self.robot.joints[channel.joint], self.robot.model
        if channel.signal == "effort":
            limit = BOUNDS["effort"] * effort_limit(self.robot, joint)
            return bool(np.abs(series).max() <= limit)
        if not model.jnt_limited[joint.id]:
            return True
        low, high = model.jnt_range[joint.id]
        return bool(series.min() >= low and series.max() <= high)

    def separation(self, predicted: FloatArray, set_up: SetUp) -> float:
        """How far the nearest two members are apart [standard deviations]."""
        columns, deviations, seconds = [], [], []
        for channel in self.channels:
            known: Independence | None = self.spread.get(channel)
            if known is None and set_up.more_effort and channel.signal == "effort":
                peak = self.robot.excursion(channel.joint).effort
                similar = self.spread[Channel(joint=channel.joint, signal="position")]
                known = Independence(std=_EFFORT_NOISE * peak, seconds=similar.seconds)
            if known is not None:
                columns.append(self.channels.index(channel))
                deviations.append(known.std)
                seconds.append(known.seconds)
        # So many standard deviations is one sample's difference worth.
        worth = 1 / (np.array(deviations) * np.sqrt(self.rate * np.array(seconds)))
        scaled = predicted[:, :, columns] * worth
        return min(
            _distance(a, b, any_instant=bool(set_up.released)) for a, b in combinations(scaled, 2)
        )


def _choices(bench: _Bench) -> Iterator[list[_Choice]]:
    """The battery as far as it is safe, what is as much trouble together, the least first."""
    changes = set_ups(
        bench.robot,
        bench.joints,
        concerned=bench.concerned,
        efforts=bench.efforts,
        excitations=tuple(bench.motions or BATTERY),
    )
    # The log of a joint that cannot move shows nothing else; a motor with play moves.
    useful = [one for one in changes if not one.held or (bench.efforts and not bench.with_play)]
    for _, alike in groupby(useful, key=lambda one: one.trouble):
        every = [(set_up, excitation) for set_up in alike for excitation in set_up.excitations]
        chosen: dict[int, _Choice] = {}
        for size in _SIZES:
            if bench.motions and size != _SIZES[0]:
                break  # they are as large as they can be, and no smaller
            left = [k for k in range(len(every)) if k not in chosen]
            logs = [_targets(bench, *every[k], size) for k in left]
            for k, log, predicted in zip(
                left, logs, bench.predict(logs, [every[k][0] for k in left]), strict=True
            ):
                set_up, excitation = every[k]
                if bench.is_safe(predicted, set_up):
                    chosen[k] = _Choice(
                        set_up=set_up,
                        excitation=excitation,
                        separation=bench.separation(predicted, set_up),
                        targets=log,
                    )
        yield [chosen[k] for k in sorted(chosen)]


def _targets(bench: _Bench, set_up: SetUp, excitation: str, size: float) -> Recording:
    """What to send: targets about the middle of each joint's room, or effort about none."""
    if excitation in bench.motions:
        return bench.motions[excitation]
    time = np.arange(0.0, _SECONDS, 1 / bench.rate)
    at = [bench.robot.excursion(joint) for joint in bench.joints]
    middle = np.array([0.5 * (a.lower + a.upper) for a in at])
    half = 0.5 * size * np.array([a.range for a in at])
    held = [held_amplitude(bench.robot, j) if j in set_up.held else np.inf for j in bench.joints]
    most = size * np.array(held)
    if excitation == RELEASE:
        position = np.tile(middle + half * np.isin(bench.joints, set_up.released), (len(time), 1))
        sent = position if bench.takes == "position" else 0 * position
    else:
        # Positions to move through, but what else a clamped joint takes is played as it is.
        plain = np.isfinite(most) & (bench.takes != "position")
        reach = np.minimum(most, np.where(plain, np.inf, half))
        centre = np.where(plain, 0.0, middle)
        limits = (
            None if bench.takes == "effort" else np.where(plain, np.inf, [a.velocity for a in at])
        )
        sent = BATTERY[excitation](
            time,
            lower=centre - reach,
            upper=centre + reach,
            rng=np.random.default_rng(_SEED),
            max_velocity=limits,
        )
        position = np.where(plain, middle, sent)
        if bench.takes == "velocity":
            sent = np.where(plain, sent, np.gradient(sent, time, axis=0))
    columns: dict[str, FloatArray] = {}
    for k, joint in enumerate(bench.joints):
        # Only the first sample of the positions is used: the start.
        columns[f"{joint}/position"] = position[:, k]
        columns[f"{joint}/{bench.takes}_target"] = sent[:, k]
    return Recording(name=excitation, time=time, columns=columns | _standing(bench, len(time)))


def obstacle(problem: Problem) -> str:
    """Why no experiment can be put to a robot, a sentence; "" where the battery can be tried."""
    kind = takes(problem.robots[0], problem.joints)
    undriven = [joint for joint in problem.joints if not is_driven(problem, joint)]
    if kind is None or (kind == "effort" and undriven):
        return (
            "No next experiment can be proposed for this robot: that takes joints which are all "
            "sent positions, all velocities, or all efforts."
        )
    if kind == "effort" and not can_be_held(problem.robots[0], problem.joints):
        return (
            "No next experiment can be proposed for this robot: joints that are sent efforts have "
            "to be let go or clamped, which is for one or two joints on a base that stands still."
        )
    return ""


def is_driven(problem: Problem, joint: str) -> bool:
    """Whether a joint has a drive, or was sent effort that the model has no actuator for."""
    return bool(problem.robots[0].joints[joint].drives) or any(
        recording.signal(joint, "effort_target") is not None for recording in problem.recordings
    )


def _recordings(problem: Problem) -> Iterator[Recording]:
    """Those of the first robot."""
    return (r for half in (problem.fit, problem.held) for r in half.recordings[0])


def _standing(bench: _Bench, n: int) -> dict[str, FloatArray]:
    """The base where it first stood in the recordings, for a robot that floats."""
    if bench.robot.base is None:
        return {}
    return {
        name: np.full(n, column[0])
        for recording in list(_recordings(bench.problem))[:1]
        for name, column in recording.columns.items()
        if name.startswith("base/") and "velocity" not in name
    }


def _concerned(robot: Robot, joints: Sequence[str], members: Sequence[Fit]) -> tuple[str, ...]:
    """The joints that the effects in question act on, or all."""
    found: list[str] = []
    for fit in members:
        term = fit.structure.terms[-1]
        if term.effect.kind == "joint" and not term.shared:
            found += [site for site in term.sites if site in joints]
    return tuple(dict.fromkeys(found)) or tuple(joints)


def _distance(a: FloatArray, b: FloatArray, *, any_instant: bool) -> float:
    """Length of what differs between two predictions, in standard deviations.

    Args:
        a: (rows, channels) standard deviations.
        b: the other.
        any_instant: nobody knows when it began, so that what a shift in time makes up is nothing.
    """
    difference = a - b
    if any_instant:
        slope = np.gradient(0.5 * (a + b), axis=0)
        size = float(np.sum(slope**2))
        if size > 0:
            difference = difference - slope * (float(np.sum(slope * difference)) / size)
    return float(np.linalg.norm(difference))
