"""From the search to the diagnosis: gaps, estimates, verdict, notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.wiring_errors import named_errors
from walkerkit.gap.report.constant_errors import effort_scales, position_offsets
from walkerkit.gap.report.diagnosis import Diagnosis, NamedEffect, Verdict
from walkerkit.gap.report.experiments import next_experiments
from walkerkit.gap.report.gaps import Gap, Location
from walkerkit.gap.report.locate import standing_out
from walkerkit.gap.report.misfits import misfits
from walkerkit.gap.report.named import confusion_set, considered, named_effects, rivals
from walkerkit.gap.report.notes import notes
from walkerkit.gap.report.output import save, title
from walkerkit.gap.report.planner import Plan, next_experiment, obstacle
from walkerkit.gap.report.replayed import Replayed, gap_maps, gap_of, replay_half, traces
from walkerkit.gap.report.replayed_motion import motions
from walkerkit.gap.report.wording import telling
from walkerkit.gap.search.compare import Table
from walkerkit.gap.search.naming import Explanation
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit
from walkerkit.gap.simulation.mended import Mended, mended_by_name, only
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.stopgap.learned_drive import LearnedDrive

if TYPE_CHECKING:
    from walkerkit.walkers import MjcfWalker
    from walkerkit.walkers.actions import ActionTerm
    from walkerkit.walkers.drivetrain import Randomization
    from walkerkit.walkers.saved import SavedActuators

FloatArray = NDArray[np.float64]

_MOST_RIVALS = 4


@dataclass(frozen=True, kw_only=True, repr=False)
class Result:
    """A diagnosis together with what it is about.

    Attributes:
        diagnosis: what was found.
        robots: the mended robots, one per experiment.
        problem: the comparison it was found with.
        fit: the named effects with their values.
        table: every structure that was fitted.
        following: the next experiment with its targets, where there is one.
        stopgaps: learned drives, where no effect of the catalogue fits.
    """

    diagnosis: Diagnosis
    robots: tuple[Robot, ...]
    problem: Problem
    fit: Fit
    table: Table
    following: Plan | None
    stopgaps: tuple[LearnedDrive, ...] = ()

    def __repr__(self) -> str:
        named = ", ".join(one.effect for one in self.effects) or "nothing named"
        return f"<Result: {self.verdict}; {named}>"

    def __str__(self) -> str:
        from walkerkit.gap.report.console import as_text

        return as_text(self.diagnosis)

    @property
    def verdict(self) -> Verdict:
        """The verdict of the diagnosis, of which the next four are, too."""
        return self.diagnosis.verdict

    @property
    def comparison(self) -> pd.DataFrame:
        """A row for each structure of the table, the most probable first.

        What it has, its elpd, the difference to the best with its standard error, its log prior and
        its weight.
        """
        return self.table.frame()

    @property
    def gap(self) -> Gap:
        """Root-mean-square errors of the recordings that were held out, before and after."""
        return self.diagnosis.gap

    @property
    def locations(self) -> tuple[Location, ...]:
        """Where the gap was before anything was named."""
        return self.diagnosis.locations

    @property
    def effects(self) -> tuple[NamedEffect, ...]:
        """The named effects, in the order in which they were added."""
        return self.diagnosis.effects

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know of the logs and of what was found."""
        return self.diagnosis.notes

    @property
    def next_experiments(self) -> str:
        """An experiments.toml with what is here and what to record next; "" where it needs none."""
        wanted = self.diagnosis.next_experiment
        if wanted is None or wanted.model is None:
            return ""
        return next_experiments(self.problem, wanted.model)

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
            path: the HTML file; one that is there is replaced, a folder that is missing made.

        Returns:
            The file.

        Raises:
            InputError: the file cannot be written.
        """
        from walkerkit.gap.report.page import write_report

        path = Path(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_report(
                self.diagnosis,
                path,
                title=title(self.robots),
                catalogue=CATALOGUE,
                models=(),
                experiments=self.next_experiments,
            )
        except OSError as error:
            raise InputError(
                f"{path}: cannot be written ({error.strerror}). Give another file."
            ) from None
        return path

    def save(self, folder: str | Path, *, overwrite: bool = True) -> Path:
        """Writes diagnosis.json, report.html, the mended models and actuators.json.

        Args:
            folder: made if it is missing.
            overwrite: whether files of the same names are replaced.

        Returns:
            The folder.

        Raises:
            InputError: the folder cannot be written, or has such files and none may be replaced.
        """
        return save(self, Path(folder), overwrite=overwrite)


def summarise(
    problem: Problem,
    explanation: Explanation,
    mended: Sequence[Robot],
    *,
    seconds: float,
    searched: bool = True,
    only: tuple[str, ...] | None = None,
    held_out_only: bool = False,
) -> Result:
    """Puts a finished search into words and numbers.

    Args:
        problem: what was explained.
        explanation: what the search found.
        mended: the robots with everything that was named.
        seconds: wall time so far.
        searched: whether effects were looked for.
        only: their names, where it was not the whole catalogue.
        held_out_only: whether the gap is that of what is held out even where nothing was fitted,
            so that the other recordings tell as much of it.

    Returns:
        The result.
    """
    members = confusion_set(problem, explanation, _MOST_RIVALS)
    following = next_experiment(problem, members)
    diagnosis = _diagnosis(problem, explanation, mended, searched, only, held_out_only)
    return Result(
        diagnosis=replace(
            diagnosis,
            next_experiment=following.experiment if following else None,
            rivals=rivals(problem, members),
            seconds=seconds,
        ),
        robots=tuple(replace(robot, hold=problem.hold) for robot in mended),
        problem=problem,
        fit=explanation.fit,
        table=explanation.table,
        following=following,
    )


def _diagnosis(
    problem: Problem,
    explanation: Explanation,
    mended: Sequence[Robot],
    searched: bool,
    only: tuple[str, ...] | None,
    held_out_only: bool,
) -> Diagnosis:
    """What `summarise` says, but for the time that it took and what to do next."""
    before = {half: replay_half(problem, half, problem.robots) for half in ("fit", "held")}
    after = before
    if explanation.fit.structure.terms:
        after = {half: replay_half(problem, half, mended) for half in ("fit", "held")}
    gap = gap_of(problem, before["held"], after["held"])
    effects = named_effects(problem, explanation, after["held"], mended)
    verdict = verdict_on(gap, named=bool(effects))
    if verdict == "no_gap" and not held_out_only:
        other = gap_of(problem, before["fit"], before["fit"])
        if verdict_on(other, named=False) != verdict:
            gap, verdict = replace(other, held_out=False), "unexplained"
    maps = gap_maps(problem, before, after)
    of = {one.signal: one for one in maps}
    map_told = of.get(telling(gap)[0], of.get("position"))
    everything = problem.recordings
    return Diagnosis(
        verdict=verdict,
        gap=gap,
        locations=standing_out(map_told.before) if map_told else (),
        remaining=standing_out(map_told.after) if map_told and verdict != "no_gap" else (),
        maps=maps,
        effects=effects,
        unknown=explanation.unknown,
        considered=considered(explanation),
        next_experiment=None,
        obstacle=obstacle(problem),
        recordings=tuple(dict.fromkeys(recording.whole.name for recording in everything)),
        notes=_notes(
            problem, gap, effects, verdict, [*after.values()], searched=searched, only=only
        ),
        wiring=named_errors(everything),
        traces=traces(problem, before, after),
        motions=motions(problem, before, after),
        seconds=0.0,
        searched=searched,
        only=only,
        held_out=tuple(dict.fromkeys(r.name for group in problem.held.recordings for r in group)),
    )


def _notes(
    problem: Problem,
    gap: Gap,
    effects: Sequence[NamedEffect],
    verdict: Verdict,
    halves: Sequence[Replayed],
    *,
    searched: bool,
    only: Sequence[str] | None,
) -> tuple[str, ...]:
    """What a reader should know, of halves that were replayed as far as they are explained."""
    return (
        *notes(
            problem,
            gap,
            effects,
            verdict,
            scales=effort_scales(halves, gap),
            offsets=position_offsets(halves, gap),
            searched=searched,
            only=only,
        ),
        *misfits(problem, halves),
    )


def verdict_on(gap: Gap, *, named: bool) -> Verdict:
    """The verdict on a gap, with something named or not.

    The position's is that at a finer timestep where the model's own leaves more. What is named
    explains nothing where it makes every gap larger on the recordings that no fit has seen.
    """
    besides = gap.besides.values()
    if not named:
        nothing = gap.position_at_floor and all(size.at_floor for size in besides)
        return "no_gap" if nothing else "unexplained"
    if gap.position_at_floor and all(size.mostly_closed for size in besides):
        return "explained"
    return "unexplained" if gap.grown else "partly_explained"
