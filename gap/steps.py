"""The steps of the workflow, one by one.

    from walkerkit import gap

    problem = gap.load("leg.xml", ["a.csv", "b.csv", "c.csv"])   # robots and recordings, checked
    replayed = gap.replay(problem)                               # simulated beside measured
    gap.locate(replayed)                                         # which joint, in which regime
    fitted = gap.fit(problem, {"coulomb_friction": ["knee"]})    # a structure that is known
    print(fitted)                                                # parameters with errors, the gap

`gap.diagnose` does all of them, and finds the structure itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.blas import on_one_thread
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.fitted import Fitted, FittedEffect
from walkerkit.gap.recordings.given import OneOrMore
from walkerkit.gap.report.diagnosis import Trace
from walkerkit.gap.report.estimates import estimates
from walkerkit.gap.report.gaps import Gap, Location
from walkerkit.gap.report.locate import locate as rank
from walkerkit.gap.report.quantity import quantity
from walkerkit.gap.report.replayed import Replayed, gap_of, replay_half, traces, unit_of
from walkerkit.gap.search.buildable import why_not
from walkerkit.gap.search.certainty import covariance
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.search.fit import evaluate, polish
from walkerkit.gap.search.fit import fit as improve
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.scan import scanned
from walkerkit.gap.search.screen import screen
from walkerkit.gap.search.slopes import Slopes
from walkerkit.gap.search.structure import Fit, Structure, Term, candidate_terms
from walkerkit.gap.simulation.commands import Hold
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.workflow import effect_names, prepare

FloatArray = NDArray[np.float64]


@on_one_thread
def load(
    model: str | Path,
    recordings: OneOrMore = (),
    *,
    held_out: OneOrMore = (),
    skip: Sequence[str] = (),
    column_map: str | Path | None = None,
    window: float | None = None,
    hold: Hold | None = None,
    n_threads: int = 0,
    allow_code: bool = False,
    allow_outside: bool = False,
) -> Problem:
    """Loads robots and recordings, checks that they fit each other, and splits the recordings.

    Args:
        model: MJCF file, `package.module:callable`, or a manifest `experiments.toml`.
        recordings: files or recordings of that model, or one; none with a manifest.
        held_out: which of them no fit may see; by default some are chosen.
        skip: spans of time that are left out, as for `diagnose`.
        column_map: as for `diagnose`.
        window: as for `diagnose`.
        hold: what the targets are between their samples: `zero_order`, `linear` or `next`; by
            default what the model's `actuators.json` says, else they are held (`zero_order`).
        n_threads: threads of the simulation, and processes of its laws, 0 for all cores. Results
            do not depend on it.
        allow_code: a manifest may name `package.module:callable` as a model.
        allow_outside: a model's meshes and included files may lie outside of its folder.

    Returns:
        What the other steps take: its `robots`, `joints`, `noise` (of each of its `channels`), and
        the recordings that are fitted (`fit`) and held out (`held`). Whether efforts were read
        before the targets beside them acted is decided as by `compare`.

    Raises:
        InputError: the model, a recording, `window` or `hold` cannot be used.
    """
    if hold is not None and hold not in get_args(Hold):
        raise InputError(f"hold is {hold!r}; give one of {', '.join(map(repr, get_args(Hold)))}.")
    experiments = load_experiments(
        model,
        recordings,
        held_out=held_out,
        skip=skip,
        column_map=column_map,
        allow_code=allow_code,
        allow_outside=allow_outside,
    )
    setup = prepare(experiments, window=window, n_threads=n_threads, allow_outside=allow_outside)
    known = next((robot.hold for robot in setup.robots if robot.hold is not None), None)
    problem = setup.problem(hold or known or "zero_order")
    (nothing,) = evaluate(problem.fit.objective, [(problem.nothing, np.zeros(0))])
    return problem.as_told(nothing)


@dataclass(frozen=True, kw_only=True, repr=False)
class Comparison:
    """Recordings, and what robots make of their commands.

    Attributes:
        problem: what was loaded.
        before: by `fit` and `held`, replayed by the robots as they were given.
        after: the same by the robots that are compared with them; `before` where there are none.
    """

    problem: Problem
    before: Mapping[str, Replayed]
    after: Mapping[str, Replayed]

    @property
    def gap(self) -> Gap:
        """Root-mean-square errors of the recordings that are held out."""
        return gap_of(self.problem, self.before["held"], self.after["held"])

    def __repr__(self) -> str:
        positions = [one for one in self.problem.channels if one.signal == "position"]
        unit = unit_of(self.problem, positions)
        before, after = (
            quantity(half["held"].rms(positions), unit) for half in (self.before, self.after)
        )
        sizes = before if self.after is self.before else f"{before} before and {after} after"
        return (
            f"<Comparison: joints {', '.join(self.problem.joints)}; the position error on "
            f"held-out recordings is {sizes}>"
        )

    @property
    def traces(self) -> tuple[Trace, ...]:
        """Every signal of every recording over time: measured, simulated before and after."""
        return traces(self.problem, self.before, self.after)


@on_one_thread
def replay(problem: Problem, robots: Sequence[Robot] | None = None) -> Comparison:
    """Simulates the recorded commands, from the measured state.

    Args:
        problem: what `load` returned.
        robots: one for each of the problem's, such as those of a fit; by default its own.

    Returns:
        Measured and simulated signals, and the gap between them.

    Raises:
        ValueError: there are more or fewer robots than the problem has.
    """
    if robots is not None and len(robots) != len(problem.robots):
        raise ValueError(
            f"{len(robots)} robots for {len(problem.robots)} experiments; give one for each"
        )
    before = {half: replay_half(problem, half, problem.robots) for half in ("fit", "held")}
    after = (
        before
        if robots is None
        else {half: replay_half(problem, half, robots) for half in ("fit", "held")}
    )
    return Comparison(problem=problem, before=before, after=after)


def locate(replayed: Comparison) -> tuple[Location, ...]:
    """Says where the gap lives that the compared robots leave: which joint, in which regime.

    Args:
        replayed: what `replay` returned.

    Returns:
        Joints and regimes that hold more of the squared position gap than of the samples, the
        largest excess first; then every joint's `everywhere`. Empty where there is no gap.
    """
    halves = [replayed.after[half] for half in ("fit", "held")]
    replays = [one for half in halves for one in half.replays]
    residuals = [residual for half in halves for residual in half.residuals()]
    return rank(replays, residuals, replayed.problem.joints)


@on_one_thread
def fit(
    problem: Problem,
    effects: Mapping[str, Sequence[str] | str] | Sequence[str] | str,
    *,
    progress: Progress | None = None,
) -> Fitted:
    """Fits a structure that is known: named effects at given places, and nothing else.

    Args:
        problem: what `load` returned.
        effects: name of each effect to the joints or bodies that have it, each with values of its
            own; `"*"` for everywhere that it can act, with one value for all where one cause
            usually acts on all joints (a bus, a filter). Names alone, or one, are everywhere.
        progress: called with what is being done and how far it is.

    Returns:
        The parameters with their standard errors, the gap before and after, the mended robots.

    Raises:
        InputError: an effect is not in the catalogue, or cannot act where it is to act.
    """
    if not isinstance(effects, Mapping):
        effects = dict.fromkeys(effect_names(effects) or (), EVERYWHERE)
    terms = [_term(problem, name, sites) for name, sites in effects.items()]
    found, slopes = _settled(problem, _begun(problem, terms, progress), progress)
    robots = tuple(
        mend(found.structure.trials(robot, found.values[None])) for robot in problem.robots
    )
    variance, sensitivity = np.zeros((0, 0)), np.zeros(0)
    if effects:
        whole, part = problem.whole.objective, problem.screen.objective
        problem.screen.refine(found)
        variance, sensitivity = covariance(whole, found, problem.noise, slopes, part)
    order = list(effects)
    terms = sorted(found.structure.terms, key=lambda term: order.index(term.effect.name))
    return Fitted(
        effects=tuple(
            FittedEffect(
                effect=term.effect.name,
                places=term.places,
                parameters=estimates(found, term, variance, sensitivity, told=terms),
            )
            for term in terms
        ),
        robots=robots,
        problem=problem,
        fit=found,
    )


def _begun(problem: Problem, terms: Sequence[Term], progress: Progress | None) -> Fit:
    """A fit to little of the recordings, on which a step costs least."""
    objective = problem.screen.objective
    objective.leave_as_simulated()
    # Together, since they would take each other's place if they came one by one.
    ordinary = tuple(term for term in terms if term.effect.ordinary)
    structure = Structure(ordinary, problem.robots)
    first = np.array([slot.parameter.starts[0] for slot in structure.slots])
    starts = [(structure, np.clip(v, *structure.bounds)) for v in (structure.zero, first)]
    start = min(evaluate(objective, starts), key=lambda one: one.score)
    found, _ = polish(objective, start, near_enough=True, progress=progress)
    left = [term for term in terms if not term.effect.ordinary]
    objective = problem.excerpt.objective
    while left:
        if progress:
            progress("screening", 1 - len(left) / len(terms))
        problem.excerpt.refine(found)
        (found,) = evaluate(objective, [(found.structure, found.values)])
        # What explains most comes first: the start of the others is then judged beside it.
        tried = improve(objective, screen(objective, found, left), iterations=2)
        best = int(np.argmin([one.score for one in tried]))
        (found,) = improve(objective, [tried[best]], progress=progress)
        found = scanned(objective, found)
        del left[best]
    return found


def _term(problem: Problem, name: str, sites: Sequence[str] | str) -> Term:
    effect_names(name)
    problem_of_it = why_not(CATALOGUE[name], problem.robots, problem.joints)
    if problem_of_it is not None:
        raise InputError(
            f"{name} cannot be built for {problem.robots[0].source}: {problem_of_it}. Leave it out."
        )
    possible = candidate_terms([CATALOGUE[name]], problem.robots, problem.joints)
    everywhere = possible[0].sites if possible else ()
    wanted = (sites,) if isinstance(sites, str) else tuple(sites)
    if wanted == (EVERYWHERE,) and possible:
        return possible[0]
    for site in wanted:
        if site not in everywhere:
            where = ", ".join(map(repr, everywhere)) or "nowhere on this robot"
            raise InputError(
                f"{name} cannot act at {site!r}{closest(site, everywhere)}; it can at {where}."
            )
    if len(set(wanted)) < max(1, len(wanted)):
        raise InputError(f"{name}: its places are {list(wanted)}; name one at least, each once.")
    return Term(effect=CATALOGUE[name], sites=wanted)


def _settled(problem: Problem, found: Fit, progress: Progress | None) -> tuple[Fit, Slopes]:
    """The fit to all recordings; in the light of its numerical error where that promises more."""
    whole = problem.whole
    whole.objective.leave_as_simulated()
    found, slopes = polish(whole.objective, found, progress=progress)
    whole.refine(found, slopes.residual)
    slopes.correct(whole.objective)
    return polish(whole.objective, found, slopes, progress=progress)
