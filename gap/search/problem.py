"""Everything a search needs: robots, recordings to fit and to hold out, noise, numerical error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings import noise
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import cut
from walkerkit.gap.search.fit import Fit
from walkerkit.gap.search.objective import Case, Objective
from walkerkit.gap.search.structure import Structure
from walkerkit.gap.simulation.commands import Hold
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]

REFINEMENT = 2  # how many times finer the timestep is that shows the numerical error
_SCORED = ("position", "effort")  # velocity comes from the same encoder and adds its filter's lag
_RACE_STEPS, _RACE_WINDOW = 25_000, 4.0  # s
_RESOLUTION = 1e-7  # of single precision, in which many machines log
_FLOOR = 0.5  # of the noise; keeps a misjudged noise from deciding


@dataclass(frozen=True, kw_only=True)
class Half:
    """Recordings of one role, of all robots.

    Attributes:
        recordings: per robot.
        objective: their comparison with the simulation.
        finer: the same at a finer timestep, and then with another integrator too.
    """

    recordings: tuple[tuple[Recording, ...], ...]
    objective: Objective
    finer: tuple[Objective, ...]

    def refine(self, fit: Fit) -> None:
        """Finds the simulation's numerical error at a fit."""
        self.objective.refine(self.finer, Case(structure=fit.structure, values=fit.values[None]))


@dataclass(frozen=True, kw_only=True)
class Problem:
    """What is to be explained.

    Attributes:
        robots: the robots; the effects' values are shared by all.
        joints: joints that the recordings measure.
        fit: recordings that are fitted.
        race: what candidates are first tried on: `fit`, or a part of it where it is long.
        held: recordings that are held out.
        noise: (n_scored,) noise of the scored channels.
        hold: what the targets are between their samples.
        window: seconds after which replays restart, or None for whole rollouts.
        n_threads: threads of the simulation, 0 for all cores.
    """

    robots: tuple[Robot, ...]
    joints: tuple[str, ...]
    fit: Half
    race: Half
    held: Half
    noise: FloatArray
    hold: Hold
    window: float | None
    n_threads: int

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The scored channels."""
        return self.fit.objective.channels

    @property
    def nothing(self) -> Structure:
        """The structure that adds nothing."""
        return Structure((), self.robots)


def build(
    robots: Sequence[Robot],
    fitted: Sequence[Sequence[Recording]],
    held_out: Sequence[Sequence[Recording]],
    *,
    window: float | None,
    hold: Hold,
    n_threads: int,
) -> Problem:
    """Prepares recordings for comparison.

    Args:
        robots: one per condition.
        fitted: recordings of each robot that are fitted; a robot may have none.
        held_out: recordings of each robot that are held out; a robot may have none.
        window: seconds after which replays restart, or None for whole rollouts.
        hold: what the targets are between their samples.
        n_threads: threads of the simulation, 0 for all cores.

    Returns:
        The problem.
    """
    everything = [r for group in (*fitted, *held_out) for r in group]
    joints = tuple(dict.fromkeys(joint for r in everything for joint in r.joints))
    channels = tuple(
        Channel(joint=joint, signal=signal)
        for signal in ("position", "velocity", "effort")
        for joint in joints
        if any(r.signal(joint, signal) is not None for r in everything)
    )
    scored = tuple(channel for channel in channels if channel.signal in _SCORED)
    floor = np.array([channel_noise(everything, channel).std for channel in scored])
    sized = [
        replace(robot, excursions=excursions(robot, [*fit, *held], joints))
        for robot, fit, held in zip(robots, fitted, held_out, strict=True)
    ]

    def half(
        recordings: Sequence[Sequence[Recording]], length: float | None = window, every: int = 1
    ) -> Half:
        present = [(robot, r) for robot, r in zip(sized, recordings, strict=True) if r]

        def objective(factor: int, other_integrator: bool) -> Objective:
            replays = [
                Replay(
                    robot
                    if factor == 1
                    else robot.refined(factor, other_integrator=other_integrator),
                    cut(mine, length)[::every],
                    channels if factor == 1 else scored,
                    hold=hold,
                    n_threads=n_threads,
                )
                for robot, mine in present
            ]
            return Objective(replays, scored, _FLOOR * floor)

        return Half(
            recordings=tuple(tuple(r) for r in recordings),
            objective=objective(1, False),
            finer=(objective(REFINEMENT, False), objective(REFINEMENT, True)),
        )

    fit = half(fitted)
    # Windows are alike, so that every second or third tells as much of a candidate.
    every = fit.objective.steps // _RACE_STEPS + 1
    return Problem(
        robots=tuple(sized),
        joints=joints,
        fit=fit,
        race=fit if every == 1 else half(fitted, window or _RACE_WINDOW, every),
        held=half(held_out),
        noise=floor,
        hold=hold,
        window=window,
        n_threads=n_threads,
    )


def channel_noise(recordings: Sequence[Recording], channel: Channel) -> noise.Noise:
    """Noise of a channel over all recordings that have it; never 0, even where nothing moves."""
    columns = [r.signal(channel.joint, channel.signal) for r in recordings]
    present = [column for column in columns if column is not None]
    found = noise.estimate(present)
    largest = max([1.0, *(float(np.abs(column).max()) for column in present)])
    return replace(found, std=max(found.std, _RESOLUTION * largest))
