"""The ground of a floating base: what its joints, the base and the floor under it need.

    fit = on_feet(problem, effects, few, start)

On a floating base each number moves all channels, and takes simulations of its own. Few are fitted:
like joints have one number at first; what single joints need is read off the slopes of everything
at once, which are found once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.compare import Member
from walkerkit.gap.search.decision import LEAST_GAIN
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.search.fit import evaluate, polish, polished
from walkerkit.gap.search.like_joints import Tied
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import Reduction
from walkerkit.gap.search.screen import tries
from walkerkit.gap.search.settle import settled
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit, Term, Unit, carried, extended

FloatArray = NDArray[np.float64]

_FIRST_STEPS, _STEPS = 4, 8  # of a fit to a part, up to the first answer and beyond
_BY_SLOPES = 3  # steps of a fit of everything everywhere, by slopes that are found once
_PASSES = 2  # of fitting and finding the numerical error again
_LOOKS = 2  # at what single joints need
_STAGE = "ordinary effects"
_UNDER = ("payload", "com_offset", "base_tilt", "ground_friction", "ground_compliance")


def on_feet(
    problem: Problem,
    effects: Sequence[Effect],
    few: Tied,
    start: Fit,
    *,
    progress: Progress | None = None,
    first: Callable[[Fit], None] | None = None,
) -> Fit:
    """Fits what is needed of all that is ordinary, and of what the base and the ground may have.

    A trunk that is too light bends all joints: fitted without it, their gains stand in for it.

    Args:
        problem: what is to be explained.
        effects: the catalogue, or a part of it.
        few: all that is ordinary, like joints alike.
        start: all that is ordinary, everywhere, where it begins.
        progress: called before each step.
        first: called with a plain fit to a few stretches, which is there in seconds.

    Returns:
        The fit, to all recordings that are fitted.
    """
    everywhere = extended(start, _of_base_and_ground(problem, effects))
    values = _alike(problem, few, start, everywhere, progress, first)
    found: Fit | None = None
    known: set[Unit] = set()
    for _ in range(_LOOKS):
        everything, member = _needed(problem, replace(everywhere, values=values), progress)
        wanted = member.units
        if found is not None and wanted <= known:
            break
        known |= wanted
        found = settled(
            problem.fit,
            _at(known, everywhere, member),
            passes=_PASSES,
            progress=progress,
            stage=_STAGE,
        )
        # What single joints could have besides would not be worth a name.
        if problem.leaves_nothing(found) or found.score < everything.score + LEAST_GAIN:
            break
        values = carried(found.values, found.structure, everywhere.structure)
    return found or start


def _needed(problem: Problem, everywhere: Fit, progress: Progress | None) -> tuple[Fit, Member]:
    """A fit of everything everywhere, by slopes that are found once, and what is needed of it."""
    objective = problem.fit.objective
    there = problem.fit.by_own_error(everywhere)
    there, slopes = polish(
        objective,
        there,
        linearised(objective, there),
        iterations=_BY_SLOPES,
        certain=False,
        progress=progress,
        stage=_STAGE,
    )
    there = problem.fit.by_own_error(there)
    slopes = slopes.at_another_error(objective, there)
    reduction = Reduction(objective, there, slopes, problem.noise, any_may_go=True)
    return there, reduction.best(few=True)


def _alike(
    problem: Problem,
    few: Tied,
    start: Fit,
    everywhere: Fit,
    progress: Progress | None,
    first: Callable[[Fit], None] | None,
) -> FloatArray:
    """(n_parameters,) values of a fit of everything to a part, like joints alike.

    The better of two: one begins where the plain fit ends, which may stand in for the others, one
    at nothing. The plain fit is the first answer. What feet touch down on is tried at several
    sizes, as slopes tell little of it from afar.
    """
    part = problem.screen

    def improved(starts: Sequence[Fit], steps: int) -> Fit:
        fits = polished(
            part.objective,
            evaluate(part.objective, [(one.structure, one.values) for one in starts]),
            iterations=steps,
            near_enough=True,
            progress=progress,
            stage=_STAGE,
        )
        return min(fits, key=lambda one: one.score)

    plain = few.apart(improved([few.start(start)], _FIRST_STEPS))
    if first is not None:
        first(plain)
    part.refine(plain)
    values = carried(plain.values, plain.structure, everywhere.structure)
    more = Tied(everywhere.structure.terms, everywhere.structure.robots, few.kinds)
    starts = [
        more.start(_on_better_ground(part.objective, replace(everywhere, values=own)))
        for own in (values, everywhere.values)
    ]
    return more.apart(improved(starts, _STEPS)).values


def _on_better_ground(objective: Objective, one: Fit) -> Fit:
    """A start, or where the ground is that of the trial sizes on which it leaves least."""
    structure = one.structure
    for term in structure.terms:
        if term.effect.part != "ground":
            continue
        rows = tries(structure, term, one.values)
        fits = evaluate(objective, [(structure, row) for row in rows])
        one = min(fits, key=lambda each: each.score)
    return one


def _of_base_and_ground(problem: Problem, effects: Sequence[Effect]) -> list[Term]:
    """What a floating base and the ground under it may have otherwise, whatever the drives do."""
    bases = {robot.base.body for robot in problem.robots if robot.base}
    found = []
    for term in problem.terms([effect for effect in effects if effect.name in _UNDER]):
        sites = tuple(s for s in term.sites if s in bases) if term.effect.kind == "body" else ()
        if term.effect.kind != "body" or sites:
            found.append(replace(term, sites=sites or term.sites))
    return found


def _at(wanted: Collection[Unit], everywhere: Fit, member: Member) -> Fit:
    """What is wanted of a fit of everything everywhere, beginning with what a member has of it."""
    structure = everywhere.structure.at(wanted)
    whole = member.fit.structure
    begun = whole.zero.copy()
    begun[member.kept] = member.values[member.kept]
    values = np.clip(carried(begun, whole, structure), *structure.bounds)
    return replace(everywhere, structure=structure, values=values)
