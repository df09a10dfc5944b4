"""The ground: what every model has a little wrong, fitted before any rare effect is looked for.

    start = ground(problem, effects)      # damping, dry friction, armature, servo gains, one delay

Every structure that is compared stands on it. Its numbers are shrunk to zero by their priors where
the recordings do not want them, so that it uses up no name.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from walkerkit.gap.effects import Effect, Parameter
from walkerkit.gap.search.compare import Member
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.search.fit import polished
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.like_joints import Tied, tied
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import needed
from walkerkit.gap.search.settle import robustly, settled, trust_in_the_light_of
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit, Structure, Term, carried, extended

_STEPS, _FIRST_STEPS = 8, 4  # of a fit to a part, the most, and up to the first answer
_PASSES = 2  # of fitting and finding the numerical error again
_LOOKS = 2  # at what single joints need besides what their kinds do
_STAGE = "ordinary effects"


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
        Their most probable values, on all recordings that are fitted.
    """
    ordinary = [effect for effect in effects if effect.ordinary]
    terms = problem.terms(ordinary)
    if not terms:
        return nothing
    found = extended(nothing, terms)
    problem.searched.look_at(nothing.case)
    floats = any(robot.base is not None for robot in problem.robots)
    few = tied(found) if floats else None
    if few is not None:
        return _where_kinds_differ(problem, few, found, progress, first)
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
    progress: Progress | None,
    first: Callable[[Fit], None] | None,
) -> Fit:
    """A fit of a number for each kind of joint, and then of what single joints need besides.

    On a floating base each number moves all channels, and takes simulations of its own: which of
    them single joints need is read off the slopes at what their kinds have.
    """
    alike = _fitted_to_a_part(problem.screen, few.start(start), progress, first, few.apart)
    found, known = few.apart(alike), None
    for _ in range(_LOOKS):
        values = carried(found.values, found.structure, start.structure)
        there = problem.fit.by_own_error(replace(start, values=values))
        slopes = linearised(problem.fit.objective, there)
        member = needed(problem.fit.objective, there, slopes, problem.noise)
        places = {place for some in member.effects.values() for place in some}
        if known is not None and places <= known:
            break
        known = places | (known or set())
        found = settled(
            problem.fit, _at(known, there, member), passes=_PASSES, progress=progress, stage=_STAGE
        )
        if problem.leaves_nothing(found):
            break
    return found


def _at(places: Collection[str], one: Fit, member: Member) -> Fit:
    """A fit at some places alone, where it begins with what a member of it has."""
    terms = [
        term if term.shared else replace(term, sites=tuple(s for s in term.sites if s in places))
        for term in one.structure.terms
    ]
    structure = Structure(tuple(term for term in terms if term.sites), one.structure.robots)
    begun = one.structure.zero.copy()
    begun[member.kept] = member.values[member.kept]
    values = np.clip(carried(begun, one.structure, structure), *structure.bounds)
    return replace(one, structure=structure, values=values)


def _fitted_to_a_part(
    part: Half,
    start: Fit,
    progress: Progress | None,
    first: Callable[[Fit], None] | None,
    told: Callable[[Fit], Fit] = lambda fit: fit,
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
        first(told(found))
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
