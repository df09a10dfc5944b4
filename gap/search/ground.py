"""The ground: what every model has a little wrong, fitted before any rare effect is looked for.

    start = ground(problem, effects)      # damping, dry friction, armature, servo gains, one delay

Every structure that is compared stands on it. Its numbers are shrunk to zero by their priors where
the recordings do not want them, so that it uses up no name.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import EVERYWHERE, Effect, Parameter
from walkerkit.gap.search.compare import Member
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.search.fit import evaluate, polish, polished
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.like_joints import Tied, tied
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import needed
from walkerkit.gap.search.settle import robustly, settled, trust_in_the_light_of
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit, Structure, Term, carried, extended

FloatArray = NDArray[np.float64]

_STEPS, _FIRST_STEPS = 8, 4  # of a fit to a part, the most, and up to the first answer
_PASSES = 2  # of fitting and finding the numerical error again
_BY_SLOPES = 3  # steps of a fit of everything everywhere, by slopes that are found once
_LOOKS = 2  # at what single joints need besides what their kinds do
_STAGE = "ordinary effects"
_UNDER = ("payload", "com_offset", "base_tilt", "ground_friction", "ground_compliance")


def ground(
    problem: Problem,
    effects: Sequence[Effect],
    nothing: Fit,
    progress: Progress | None = None,
    first: Callable[[Fit], None] | None = None,
) -> Fit:
    """Fits all ordinary effects at all joints together.

    Args:
        problem: what is to be explained.
        effects: the catalogue; its ordinary effects are the ground.
        nothing: what they come on top of.
        progress: called before each step.
        first: called with their values on a few stretches, which are there in seconds.

    Returns:
        Their most probable values, on all recordings that are fitted; of a floating base with what
        that and the ground under it need besides.
    """
    ordinary = [effect for effect in effects if effect.ordinary]
    terms = problem.terms(ordinary)
    if not terms:
        return nothing
    found = extended(nothing, terms)
    problem.searched.look_at(nothing.case)
    few = tied(found.structure) if problem.on_feet else None
    if few is not None:
        others = _of_base_and_ground(problem, effects)
        return _where_kinds_differ(problem, few, found, others, progress, first)
    for part in problem.parts:
        if part is not problem.fit:
            found, first = _fitted_to_a_part(part, found, progress, first), None
    found = settled(problem.fit, found, passes=_PASSES, progress=progress, stage=_STAGE)
    if trust_in_the_light_of(problem.fit, found, problem.noise) is not None:
        slopes = linearised(problem.fit.objective, found)
        found = robustly(problem.fit, found, slopes, problem.noise)
    if first is not None:
        first(found)
    return found


def _where_kinds_differ(
    problem: Problem,
    few: Tied,
    start: Fit,
    others: Sequence[Term],
    progress: Progress | None,
    first: Callable[[Fit], None] | None,
) -> Fit:
    """A fit of a number for each kind of joint, and then of what single joints need besides.

    On a floating base each number moves all channels, and takes simulations of its own: which of
    them single joints need is read off the slopes at what their kinds have, beside what the base
    and the ground could do. A trunk that is too light bends all joints, so that what is needed of
    these is kept.
    """
    everywhere = extended(start, others)
    values = _alike(problem, few, start, everywhere, progress, first)
    found: Fit | None = None
    known: set[tuple[str, str]] = set()
    for _ in range(_LOOKS):
        member = _needed(problem, replace(everywhere, values=values), progress)
        wanted = {(name, place) for name, places in member.effects.items() for place in places}
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
        if problem.leaves_nothing(found):
            break
        values = carried(found.values, found.structure, everywhere.structure)
    return found or start


def _needed(problem: Problem, everywhere: Fit, progress: Progress | None) -> Member:
    """What is needed of a fit of everything everywhere, by slopes that are found once."""
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
    return needed(objective, there, slopes.at_another_error(objective, there), problem.noise)


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
    at nothing. The plain fit is the first answer.
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
    starts = [more.start(replace(everywhere, values=own)) for own in (values, everywhere.values)]
    return more.apart(improved(starts, _STEPS)).values


def _of_base_and_ground(problem: Problem, effects: Sequence[Effect]) -> list[Term]:
    """What a floating base and the ground under it may have otherwise, whatever the drives do."""
    bases = {robot.base.body for robot in problem.robots if robot.base}
    found = []
    for term in problem.terms([effect for effect in effects if effect.name in _UNDER]):
        sites = tuple(s for s in term.sites if s in bases) if term.effect.kind == "body" else ()
        if term.effect.kind != "body" or sites:
            found.append(replace(term, sites=sites or term.sites))
    return found


def _at(wanted: Collection[tuple[str, str]], everywhere: Fit, member: Member) -> Fit:
    """What is wanted of a fit of everything everywhere, beginning with what a member has of it."""
    terms = []
    for term in everywhere.structure.terms:
        its = tuple(
            site
            for site in term.sites
            if (term.effect.name, EVERYWHERE if term.shared else site) in wanted
        )
        terms += [replace(term, sites=its)] if its else []
    structure = Structure(tuple(terms), everywhere.structure.robots)
    whole = member.fit.structure
    begun = whole.zero.copy()
    begun[member.kept] = member.values[member.kept]
    values = np.clip(carried(begun, whole, structure), *structure.bounds)
    return replace(everywhere, structure=structure, values=values)


def _fitted_to_a_part(
    part: Half, start: Fit, progress: Progress | None, first: Callable[[Fit], None] | None
) -> Fit:
    """A fit to little of the recordings; the first answer is that of a few steps as simulated."""

    def improved(one: Fit, steps: int = _STEPS) -> Fit:
        (found,) = polished(
            part.objective,
            [one],
            iterations=steps,
            near_enough=True,
            progress=progress,
            stage=_STAGE,
        )
        return found

    found = start
    if first is not None:
        found = improved(start, _FIRST_STEPS)
        first(found)
    part.refine(start)
    return _late_last_too(improved, start, found)


def _late_last_too(improved: Callable[[Fit], Fit], start: Fit, further: Fit) -> Fit:
    """The better of a fit of all at once, from further on, and one of delays last, from a start.

    A delay stands in for friction and gains where it is let loose first, and may not come back.
    """
    structure, found = start.structure, improved(further)
    prompt = [t for t in structure.terms if not any(p.is_delay for p in _parameters(structure, t))]
    if not 0 < len(prompt) < len(structure.terms):
        return found
    fewer = replace(structure, terms=tuple(prompt))
    values = carried(start.values, structure, fewer)
    without = improved(replace(start, structure=fewer, values=values))
    values = carried(without.values, fewer, structure)
    late_last = improved(replace(start, structure=structure, values=values))
    return min(found, late_last, key=lambda one: one.score)


def _parameters(structure: Structure, term: Term) -> list[Parameter]:
    return [structure.slots[k].parameter for k in structure.columns(term)]
