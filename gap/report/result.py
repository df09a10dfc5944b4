"""From the search to the diagnosis: gaps, estimates, verdict, notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.report.diagnosis import (
    Considered,
    Diagnosis,
    Gap,
    NamedEffect,
    NextExperiment,
    Verdict,
)
from walkerkit.gap.report.estimates import estimates
from walkerkit.gap.report.notes import notes
from walkerkit.gap.report.planner import next_experiment
from walkerkit.gap.report.replayed import (
    Replayed,
    gap_of,
    gap_with,
    locations,
    replay_half,
    traces,
)
from walkerkit.gap.search.fit import Fit, covariance
from walkerkit.gap.search.naming import Round
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Term
from walkerkit.gap.simulation.mended import Mended, mended_by_name, only
from walkerkit.gap.simulation.robot import Robot

if TYPE_CHECKING:
    from walkerkit.walkers import MjcfWalker
    from walkerkit.walkers.actions import ActionTerm
    from walkerkit.walkers.drivetrain import Randomization
    from walkerkit.walkers.saved import SavedActuators

FloatArray = NDArray[np.float64]

_AT_FLOOR = 1.5  # a gap within this factor of noise and numerical error together is none
_MOST_RIVALS = 4


@dataclass(frozen=True, kw_only=True)
class Result:
    """A diagnosis together with what it is about.

    Attributes:
        diagnosis: what was found.
        robots: the mended robots, one per experiment.
        problem: the comparison it was found with.
        fit: the named effects with their values.
        next_targets: the targets of the next experiment, where there is one.
    """

    diagnosis: Diagnosis
    robots: tuple[Robot, ...]
    problem: Problem
    fit: Fit
    next_targets: Recording | None

    def __str__(self) -> str:
        from walkerkit.gap.report.console import as_text

        return as_text(self.diagnosis)

    @property
    def mended(self) -> Mapping[str, Mended]:
        """The mended robots by the names of their models, to go on with."""
        return mended_by_name(self.robots)

    @property
    def model(self) -> mujoco.MjModel:
        """The mended model, compiled.

        Raises:
            ValueError: there are several; take one from `mended`, here and in the next two.
        """
        return only(self.mended).model

    @property
    def actuators(self) -> SavedActuators:
        """What MJCF cannot say of it: actuator configs and drivetrain laws, ready for a walker."""
        return only(self.mended).actuators

    def walker(
        self,
        *,
        name: str | None = None,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        home: str | Mapping[str, float] | ArrayLike | None = None,
        floating: bool | None = None,
        randomizations: Sequence[Randomization] = (),
    ) -> MjcfWalker:
        """A composer walker of the mended model, with its actuators; see `Mended.walker`."""
        return only(self.mended).walker(
            name=name,
            action=action,
            home=home,
            floating=floating,
            randomizations=randomizations,
        )

    def report(self, path: str | Path) -> Path:
        """Writes the report.

        Args:
            path: the HTML file; one that is there is replaced.

        Returns:
            The file.
        """
        from walkerkit.gap.report.page import write_report

        title = self.robots[0].stem
        write_report(self.diagnosis, path, title=title, catalogue=CATALOGUE)
        return Path(path)

    def save(self, folder: str | Path) -> Path:
        """Writes diagnosis.json, report.html, the mended models and actuators.json.

        Args:
            folder: made if it is missing; files of the same names are replaced.

        Returns:
            The folder.

        Raises:
            InputError: the folder cannot be written.
        """
        from walkerkit.gap.report.output import save

        return save(self, Path(folder))


def summarise(
    problem: Problem,
    rounds: Sequence[Round],
    mended: Sequence[Robot],
    *,
    seconds: float,
    searched: bool = True,
) -> Result:
    """Puts a finished search into words and numbers.

    Args:
        problem: what was explained.
        rounds: the search.
        mended: the robots with everything that was named.
        seconds: wall time so far.
        searched: whether effects were looked for.

    Returns:
        The result.
    """
    final = rounds[-1].fit
    before = {half: replay_half(problem, half, problem.robots) for half in ("fit", "held")}
    after = {half: replay_half(problem, half, mended) for half in ("fit", "held")}
    gap = gap_of(problem, before["held"], after["held"])
    effects = _effects(problem, rounds, after["held"])
    verdict = _verdict(gap, bool(effects))
    both = [before[half] for half in ("fit", "held")]
    left = [after[half] for half in ("fit", "held")]
    everything = [r for half in (problem.fit, problem.held) for g in half.recordings for r in g]
    following = _next_experiment(problem, rounds)
    diagnosis = Diagnosis(
        verdict=verdict,
        gap=gap,
        locations=locations(problem, both),
        remaining=locations(problem, left) if verdict != "no_gap" else (),
        effects=effects,
        considered=tuple(
            Considered(
                round=number,
                effect=candidate.term.effect.name,
                improvement=float(1 - np.exp(-candidate.gain)),
                verdict="indistinguishable"
                if candidate.close
                else "named"
                if one.named is not None and candidate.term.effect is one.named.effect
                else "lost",
            )
            for number, one in enumerate(rounds, start=1)
            for candidate in one.candidates
        ),
        next_experiment=following[0] if following else None,
        recordings=tuple(dict.fromkeys(recording.whole.name for recording in everything)),
        notes=notes(problem, gap, effects, verdict, searched=searched),
        traces=traces(problem, before, after),
        seconds=seconds,
        searched=searched,
    )
    return Result(
        diagnosis=diagnosis,
        robots=tuple(replace(robot, hold=problem.hold) for robot in mended),
        problem=problem,
        fit=final,
        next_targets=following[1] if following else None,
    )


def _verdict(gap: Gap, named: bool) -> Verdict:
    floor = np.hypot(gap.position.noise_floor, gap.numerical_floor)
    if named:
        return "explained" if gap.position.after <= _AT_FLOOR * floor else "partly_explained"
    return "no_gap" if gap.position.before <= _AT_FLOOR * floor else "unexplained"


def _effects(problem: Problem, rounds: Sequence[Round], after: Replayed) -> tuple[NamedEffect, ...]:
    """The terms of the final structure, with the round that named each."""
    final = rounds[-1].fit
    if not final.structure.terms:
        return ()
    variance, sensitivity = covariance(problem.fit.objective, final)
    named = {one.named.effect.name: one for one in rounds if one.named is not None}
    found = []
    for count, term in enumerate(final.structure.terms, start=1):
        one = named[term.effect.name]
        last = count == len(final.structure.terms)
        found.append(
            NamedEffect(
                effect=term.effect.name,
                joints=() if term.effect.kind == "body" else _shown_joints(term),
                bodies=term.sites if term.effect.kind == "body" else (),
                confidence=one.confidence,
                parameters=estimates(final, term, variance, sensitivity),
                gap_after=after.rms(
                    [c for c in after.replays[0].channels if c.signal == "position"]
                )
                if last
                else gap_with(problem, one.fit),
                indistinguishable_from=tuple(
                    rival.structure.terms[-1].effect.name for rival in _rivals(one, final)
                ),
            )
        )
    return tuple(found)


def _shown_joints(term: Term) -> tuple[str, ...]:
    return (EVERYWHERE,) if term.shared else term.sites


def _rivals(one: Round, final: Fit) -> list[Fit]:
    """Fits that explained as well as the one that a round named, and were not named after it."""
    present = {term.effect.name for term in final.structure.terms}
    return [
        candidate.fit
        for candidate in one.candidates
        if candidate.close and candidate.term.effect.name not in present
    ]


def _next_experiment(
    problem: Problem, rounds: Sequence[Round]
) -> tuple[NextExperiment, Recording] | None:
    """For the first effect that has rivals, what would part them."""
    final = rounds[-1].fit
    kept = {term.effect.name for term in final.structure.terms}
    for one in rounds:
        rivals = _rivals(one, final)
        if one.named is not None and one.named.effect.name in kept and rivals:
            return next_experiment(problem, [one.fit, *rivals[:_MOST_RIVALS]])
    return None
