"""Everything a search needs: robots, recordings to fit and to hold out, noise, numerical error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import Effect
from walkerkit.gap.recordings import noise
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import Segment, cut, stretches
from walkerkit.gap.search.beliefs import NOTHING, Beliefs
from walkerkit.gap.search.decision import NUMERICAL_LEFT
from walkerkit.gap.search.excerpt import Gaps, representative, spread
from walkerkit.gap.search.half import STRETCH, Half, Remake, Searched, other_ways
from walkerkit.gap.search.numerical_error import OF_READING, Way
from walkerkit.gap.search.objective import Objective, refine
from walkerkit.gap.search.recent import Recent
from walkerkit.gap.search.restarts import by_chance, of_restarts
from walkerkit.gap.search.structure import Case, Fit, Structure, Term
from walkerkit.gap.simulation.branches import largest, met
from walkerkit.gap.simulation.channel import Channel, base_channels, estimate_error
from walkerkit.gap.simulation.commands import Hold
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.latest import Latest
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]

# Velocity comes from the same encoder and adds its filter's lag.
_SCORED = (
    *("position", "effort"),
    *("base_position", "base_orientation", "base_angular_velocity"),
)
# A branch of many joints has many channels, which tell as much in less time, and of which each
# number moves all, so that each has to be simulated on its own: steps go down as joints go up.
_MOST_STEPS, _OF_SO_FEW_JOINTS = 40_000, 3
_TIMESTEP = 2e-3  # s, MuJoCo's own; parts are simulated no finer where that tells as much
_MOST_WHOLE = 2.0  # times what is fitted in stretches
_FEWEST, _FEWEST_OF_ALL = 3, 8  # of a robot's stretches, whatever their steps; of several robots'
_RESOLUTION = 1e-7  # of single precision, in which many machines log
_VALUES_OF_A_STEP = 12  # of parts that are looked at, in the mean; a leg has fewer
_APART = 0.01  # s; how far apart these are at most
_MOST_PARTS = 8  # that are kept, with their numerical errors
_RATHER = 0.5  # of what another way to read or to start changes, which is then the one told of
_AT_FLOOR = 1.15  # gaps within this factor of the floor leave nothing to propose for
_FLOOR = 0.5  # of the noise; keeps a misjudged noise from deciding


@dataclass(frozen=True, kw_only=True, repr=False)
class Problem:
    """What is to be explained.

    Attributes:
        robots: the robots; the effects' values are shared by all.
        joints: joints that the recordings measure.
        fit: recordings that are fitted.
        held: recordings that are held out.
        searched: parts of what is fitted.
        noise: (n_scored,) noise of the scored channels, and of the states of a floating base that
            replays restart from.
        hold: what the targets are between their samples.
        window: seconds after which replays restart, or None for whole rollouts.
        n_threads: threads of the simulation, 0 for all cores.
        beliefs: what the user knows or doubts.
    """

    robots: tuple[Robot, ...]
    joints: tuple[str, ...]
    fit: Half
    held: Half
    searched: Searched
    noise: FloatArray
    hold: Hold
    window: float | None
    n_threads: int
    beliefs: Beliefs = NOTHING

    def __repr__(self) -> str:
        robots = ", ".join(robot.source for robot in self.robots)
        fit, held = (
            ", ".join(dict.fromkeys(r.name for group in half.recordings for r in group))
            for half in (self.fit, self.held)
        )
        return (
            f"<Problem: {robots}; joints {', '.join(self.joints)}; fitted: {fit}; held out: {held}>"
        )

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """Those of all robots, what is fitted first."""
        return tuple(r for half in (self.fit, self.held) for g in half.recordings for r in g)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The scored channels."""
        return self.fit.objective.channels

    @property
    def excerpt(self) -> Half:
        """What candidates are first fitted on: `fit`, or a part of it where it is long."""
        return self.searched.excerpt

    @property
    def screen(self) -> Half:
        """Short parts of `fit`, on which every effect is tried."""
        return self.searched.screen

    @property
    def parts(self) -> tuple[Half, ...]:
        """The screen and the excerpt, or the one half that both are."""
        return (self.screen,) if self.screen is self.excerpt else (self.screen, self.excerpt)

    @cached_property
    def whole(self) -> Half:
        """`fit` over the horizon that the gap is told of, where that is not too long.

        Each stretch starts from a measured state, whose noise draws the values a little.
        """
        fitted = sum(replay.steps for replay in self.fit.objective.replays)
        long = sum(replay.steps for replay in self.fit.told) > _MOST_WHOLE * fitted
        if self.window is not None or long:
            return self.fit
        told = self.fit.told

        def finer() -> Mapping[Way, Objective]:
            return {
                way: self._objective([one.on(remake(one.robot), self.channels) for one in told])
                for way, remake in other_ways(self.robots, self.channels, self.hold).items()
            }

        return replace(self.fit, objective=self._objective(told), make_finer=finer)

    def _objective(self, replays: Sequence[Replay]) -> Objective:
        known = self.fit.objective
        return Objective(
            replays,
            self.channels,
            known.floor,
            n_threads=self.n_threads,
            jumps=known.jumps,
            recent=known.recent,
        )

    def as_told(self, explained: Fit) -> Problem:
        """The same as it is told of, read and started as suits a fit better.

        Efforts may be read before targets, and restarts may take the velocities of a log that a
        simulation made in these very steps.
        """
        problem = self
        if any(channel.signal == "effort" for channel in self.channels):
            self.refine(explained)
            # What is missing may look like it where it shows, in one half alone.
            first, age = (min(self._factors(way, explained)) for way in OF_READING)
            if first + age > _RATHER:
                problem = self._remade(lambda robot: robot.reading_earlier(age))
        return problem._remade(_as_stepped) if self._starts_as_stepped(explained) else problem

    def _factors(self, way: Way, explained: Fit) -> list[float]:
        return [half.objective.factor(way, explained.case) for half in (self.fit, self.held)]

    def _starts_as_stepped(self, explained: Fit) -> bool:
        """Whether restarts as stepped leave less than half of what a fit leaves."""
        if self.window is None:
            return False
        own = self.fit.objective
        stepped = self._objective([one.on(_as_stepped(one.robot)) for one in own.replays])
        (after,), (before,) = (one.as_it_is([explained.case]) for one in (stepped, own))
        return bool(np.sum(after / self.noise**2) < _RATHER**2 * np.sum(before / self.noise**2))

    def _remade(self, remake: Remake) -> Problem:
        """The same of robots made of these."""
        robots = {id(robot): remake(robot) for robot in self.robots}

        def read(half: Half) -> Half:
            return replace(half, told=tuple(one.on(robots[id(one.robot)]) for one in half.told))

        return replace(
            self, robots=tuple(robots.values()), fit=read(self.fit), held=read(self.held)
        )

    def terms(self, effects: Sequence[Effect]) -> tuple[Term, ...]:
        """Each of some effects wherever it may be, as far as the user leaves that open."""
        return self.beliefs.terms(effects, self.robots, self.joints)

    @property
    def on_feet(self) -> bool:
        """Whether a base floats, so that each number changes all channels."""
        return any(robot.base is not None for robot in self.robots)

    @property
    def nothing(self) -> Structure:
        """The structure that adds nothing."""
        return Structure((), self.robots)

    def leaves_nothing(self, current: Fit) -> bool:
        """Whether a fit leaves nothing to explain, in stretches or in whole rollouts.

        In stretches the numerical error is taken out, though not to the last digit.
        """
        left = NUMERICAL_LEFT * self.fit.objective.numerical_size()
        most = _AT_FLOOR
        if self.on_feet:
            # One restart is wrong one way for all of its window, in each channel.
            windows = sum(len(replay.segments) for replay in self.fit.objective.replays)
            most = max(most, by_chance(windows, len(self.channels)))
        in_stretches = np.sqrt(current.mean_square) <= most * np.hypot(self.noise, left)
        whole = self.whole.objective.as_it_is([current.case])[0][0]
        return bool(in_stretches.all() or (np.sqrt(whole) <= _AT_FLOOR * self.noise).all())

    def refine(self, current: Fit) -> None:
        """Takes the numerical error at a fit as that of all that will be simulated."""
        halves = self.fit, self.held
        refine([(half.objective, half.finer, current.case) for half in halves])


def forgets(problem: Problem) -> str | None:
    """The joint whose replays stray furthest by the noise of where they restart alone.

    None where joints move further than that, as root mean squares over all joints and windows.
    """
    if problem.window is None:
        return None
    objective = problem.fit.objective
    strayed = problem.noise
    if not problem.on_feet:  # where it is in the noise
        every = objective.replays[0].channels
        strayed = of_restarts(objective.replays, problem.n_threads)
        strayed = strayed[[every.index(channel) for channel in objective.channels]]
    of_joints = np.array([c.signal == "position" for c in objective.channels])
    of_joints &= np.isfinite(objective.measured).any(axis=0)  # others are held out alone
    spans, _ = objective.spans
    moved = np.concatenate([objective.measured[s] - objective.measured[s.start] for s in spans])
    further = np.where(of_joints, strayed**2 - objective.mean_square(np.nan_to_num(moved)), 0.0)
    return objective.channels[int(np.argmax(further))].joint if further.sum() > 0 else None


def build(
    robots: Sequence[Robot],
    fitted: Sequence[Sequence[Recording]],
    held_out: Sequence[Sequence[Recording]],
    *,
    window: float | None,
    walks: bool = False,
    hold: Hold,
    n_threads: int,
) -> Problem:
    """Prepares recordings for comparison.

    Args:
        robots: one per condition.
        fitted: recordings of each robot that are fitted; a robot may have none.
        held_out: recordings of each robot that are held out; a robot may have none.
        window: seconds after which replays restart, or None for whole rollouts.
        walks: feet lift off and touch down.
        hold: what the targets are between their samples.
        n_threads: threads of the simulation, 0 for all cores.

    Returns:
        The problem.
    """
    making = _Making(
        robots, fitted, held_out, window=window, walks=walks, hold=hold, n_threads=n_threads
    )
    fit, parts = making.fitted(), Latest(_MOST_PARTS)

    def part(most: int, stretch: float, gaps: Gaps, longer: int) -> Half:
        most = most * making.enough // _MOST_STEPS  # as much of what is fitted as of few joints
        small = making.share(fitted, most)
        if small == 1:
            return fit
        some = making.picked(fitted, small, stretch, gaps)
        where = tuple(tuple((s.recording.name, s.first) for s in mine) for mine in some)
        key = stretch, longer, where

        def made() -> Half:
            return making.half(fitted, some, fit.told, longer, making.thinned(some, most))

        return parts.get(key, made)

    return Problem(
        robots=making.robots,
        joints=making.joints,
        fit=fit,
        held=making.half(held_out, making.picked(held_out, making.share(held_out, making.enough))),
        searched=Searched(fit, part, longer=making.longer),
        noise=making.floor,
        hold=hold,
        window=window,
        n_threads=n_threads,
    )


class _Making:
    """Makes halves of the recordings of some robots.

    Args:
        robots, fitted, held_out, window, walks, hold, n_threads: as for `build`.

    Attributes:
        robots: the robots, with how far their joints went in what is fitted.
        joints: joints that the recordings measure.
        floor: (n_scored,) noise of the scored channels; once `fitted` was called, of a floating
            base with that of the states that replays restart from.
        enough: steps that may be simulated again and again.
    """

    def __init__(
        self,
        robots: Sequence[Robot],
        fitted: Sequence[Sequence[Recording]],
        held_out: Sequence[Sequence[Recording]],
        *,
        window: float | None,
        walks: bool,
        hold: Hold,
        n_threads: int,
    ):
        self._given, self._fitted = robots, fitted
        self._window, self._hold, self._n_threads = window, hold, n_threads
        self._walks = walks
        everything = [r for group in (*fitted, *held_out) for r in group]
        self.joints = tuple(dict.fromkeys(joint for r in everything for joint in r.joints))
        self._channels = tuple(
            Channel(joint=joint, signal=signal)
            for signal in ("position", "velocity", "effort")
            for joint in self.joints
            if any(r.signal(joint, signal) is not None for r in everything)
        ) + base_channels(everything)
        self._scored = tuple(c for c in self._channels if c.quantity in _SCORED)
        # Nothing of what is held out reaches what is fitted, not even its noise or its range.
        seen = [r for group in fitted for r in group]
        self.floor = np.array([channel_noise(seen, channel).std for channel in self._scored])
        self.robots = tuple(
            replace(
                robot,
                excursions=excursions(robot, fit or seen, self.joints),
                met=met(robot, fit or seen),
            )
            for robot, fit in zip(robots, fitted, strict=True)
        )
        self._on_feet = any(robot.base for robot in self.robots)
        joined = max(largest(robot) for robot in self.robots)
        self.enough = _MOST_STEPS * _OF_SO_FEW_JOINTS // max(_OF_SO_FEW_JOINTS, joined)
        self._recent = Recent()

    @property
    def longer(self) -> int:
        """How many times as long steps may be in parts that are looked at."""
        if any(robot.programs for robot in self._given):
            return 1  # a law in Python runs once in each step, and may shake in longer ones
        return int(_TIMESTEP / max(robot.model.opt.timestep for robot in self._given) + 1e-9)

    def fitted(self) -> Half:
        """What is fitted, as much of it as may be simulated again and again."""
        gaps, told = None, None
        if self._on_feet:
            # Few of so many windows are fitted, and a foot may slip in others.
            told = self._replays([cut(r, self._window) for r in self._fitted])
            every = self._objective(told)
            as_given = Case(structure=Structure((), self.robots), values=np.zeros((1, 0)))
            gaps = Gaps.of(every, every.simulated([as_given])[0][0])
        chosen = self.picked(self._fitted, self.share(self._fitted, self.enough), gaps=gaps)
        if self._on_feet:
            restarts = of_restarts(self._replays(chosen, kept=self._scored), self._n_threads)
            self.floor = np.hypot(self.floor, restarts)
        return self.half(self._fitted, chosen, told)

    def half(
        self,
        recordings: Sequence[Sequence[Recording]],
        chosen: Sequence[Sequence[Segment]],
        told: tuple[Replay, ...] | None = None,
        longer: int = 1,
        every: int = 1,
    ) -> Half:
        """Recordings of each robot, of which some stretches are compared.

        Args:
            recordings: of each robot.
            chosen: their stretches.
            told: their replays over the horizon that the gap is told of, where they are known.
            longer: how many times as long the steps are.
            every: of how many samples one is compared.
        """

        def stepped(robot: Robot) -> Robot:
            return robot.coarsened(longer) if longer > 1 else robot

        def finer() -> Mapping[Way, Objective]:
            def made(remake: Remake) -> Objective:
                replays = self._replays(
                    chosen, lambda one: remake(stepped(one)), self._scored, every
                )
                return self._objective(replays)

            ways = other_ways(self._given, self._scored, self._hold)
            return {way: made(remake) for way, remake in ways.items()}

        if told is None:
            told = self._replays([cut(r, self._window) for r in recordings])
        return Half(
            recordings=tuple(tuple(r) for r in recordings),
            told=told,
            objective=self._objective(self._replays(chosen, stepped, every=every)),
            make_finer=finer,
        )

    def thinned(self, chosen: Sequence[Sequence[Segment]], most: int) -> int:
        """Of how many samples one is enough, where many channels are looked at.

        On feet all are: what touches down shows in single samples.

        Args:
            chosen: stretches of each robot's recordings.
            most: steps that they are at most.
        """
        segments = [segment for mine in chosen for segment in mine]
        samples = sum(segment.last - segment.first for segment in segments)
        apart = sum(segment.duration for segment in segments) / samples
        enough = samples * len(self._scored) // (_VALUES_OF_A_STEP * most)
        return 1 if self._on_feet else max(1, min(enough, int(_APART / apart)))

    def share(self, recordings: Sequence[Sequence[Recording]], most: int) -> float:
        """What of recordings may be simulated again and again, in so many steps."""
        step = float(min(robot.model.opt.timestep for robot in self._given))
        seconds = sum(float(r.time[-1] - r.time[0]) for group in recordings for r in group)
        return min(1.0, most * step / seconds)

    def picked(
        self,
        recordings: Sequence[Sequence[Recording]],
        share: float,
        stretch: float = STRETCH,
        gaps: Gaps | None = None,
    ) -> tuple[tuple[Segment, ...], ...]:
        """Stretches of each robot's recordings, spread over them.

        Args:
            recordings: of each robot.
            share: what of them.
            stretch: how long, where whole rollouts are compared [s].
            gaps: what every stretch leaves, of which those picked are to be like all.
        """
        found: list[tuple[Segment, ...]] = []
        for k, mine in enumerate(recordings):
            every = cut(mine, self._window)
            if self._window is None:
                every = tuple(s for one in mine for s in stretches(one, stretch))
            # Each robot contributes other parts, so that few of many say something of everything.
            phase = (k + 0.5) / len(self.robots)
            if not every:
                found.append(())
                continue
            some: Sequence[int] = spread(len(every), share=share, phase=phase, fewest=self._fewest)
            if gaps is not None:
                some = representative(every, some, gaps)
            found.append(tuple(every[k] for k in some))
        return tuple(found)

    @property
    def _fewest(self) -> int:
        """Stretches of a robot at least, as long together where they are shorter."""
        few = min(_FEWEST, -(-_FEWEST_OF_ALL // len(self.robots)))
        return math.ceil(few * STRETCH / self._window) if self._window and self._on_feet else few

    def _replays(
        self,
        chosen: Sequence[Sequence[Segment]],
        remade: Remake = lambda robot: robot,
        kept: Sequence[Channel] | None = None,
        every: int = 1,
    ) -> tuple[Replay, ...]:
        return tuple(
            Replay(
                remade(robot),
                mine,
                self._channels if kept is None else kept,
                hold=self._hold,
                # Robots are side by side.
                n_threads=self._n_threads if len(self.robots) == 1 else 1,
                every=every,
            )
            for robot, mine in zip(self.robots, chosen, strict=True)
            if mine
        )

    def _objective(self, simulated: Sequence[Replay]) -> Objective:
        return Objective(
            simulated,
            self._scored,
            _FLOOR * self.floor,
            n_threads=self._n_threads,
            # The state of a floating base has so many numbers that what each changes would take
            # too long.
            free_starts=self._window is not None and not self._on_feet,
            jumps=self._walks,
            recent=self._recent,
        )


def channel_noise(recordings: Sequence[Recording], channel: Channel) -> noise.Noise:
    """Noise of a channel over all recordings that have it; never 0, even where nothing moves."""
    columns = [channel.measured(r) for r in recordings]
    present = [column for column in columns if column is not None]
    found = noise.estimate(present)
    largest = max([1.0, *(float(np.abs(column).max()) for column in present)])
    std = float(np.hypot(found.std, estimate_error(recordings, channel)))
    return replace(found, std=max(std, _RESOLUTION * largest))


def _as_stepped(robot: Robot) -> Robot:
    return replace(robot, starts_as_stepped=True)
