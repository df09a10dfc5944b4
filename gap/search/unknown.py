"""What the catalogue does not have: a free effort at each joint, beside what is told.

    found = beside_what_has_no_name(problem, told)
    found.weight                  # of a free effort beside what is told
    found.confidence["payload"]   # of a name, where there is one

What is told is compared, by the score that decides on names, with the same and a free effort beside
it, and with each effect of it left out in favour of the free effort. So a name has to say more than
that some effort is missing. All are fitted on the parts of the recordings on which effects are
tried.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.compare import Member, Table, is_worth_a_name
from walkerkit.gap.search.fit import evaluate, polish_each
from walkerkit.gap.search.free_effort import FREE_EFFORT
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import Reduction
from walkerkit.gap.search.slopes import Slopes, near_slopes
from walkerkit.gap.search.structure import Fit, Term, carried, extended

FloatArray = NDArray[np.float64]

_STEPS = 12  # of a fit
_LEAST_TOLD = 0.01  # of a weight


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """A free effort against what is told.

    Attributes:
        weight: of all structures that have a free effort.
        confidence: effect to the part of that weight that structures with it have.
    """

    weight: float = 0.0
    confidence: Mapping[str, float] = field(default_factory=dict)

    def beside(self, effect: str, confidence: float) -> float:
        """How sure a name is that was so sure before a free effort was thought of."""
        return (1 - self.weight) * confidence + self.weight * self.confidence.get(effect, 1.0)


def beside_what_has_no_name(problem: Problem, told: Fit) -> Unknown | None:
    """Weighs a free effort, and each told effect beside one.

    Args:
        problem: what is explained; only recordings that are fitted are looked at.
        told: what is told of it.

    Returns:
        The weights; None where no effort can be told, as of a base that floats.
    """
    if any(robot.base is not None for robot in problem.robots):
        return None
    if problem.leaves_nothing(told):
        return Unknown()
    half, joints = problem.screen, tuple(channel.joint for channel in problem.channels)
    half.refine(told)
    objective = half.objective
    ((as_told, slopes),) = _fitted(objective, [told])
    named = _reduction(problem, objective, as_told, slopes).whole
    free = Term(effect=FREE_EFFORT, sites=tuple(problem.joints))
    ((beside, slopes),) = _fitted(objective, [extended(as_told, [free])])
    reduction = _reduction(problem, objective, beside, slopes)
    whole = reduction.whole
    if not is_worth_a_name(named, whole, joints):
        return Unknown()
    # What is ordinary is near where slopes say that it goes, what is rare need not be.
    rare, usual = told.structure.rare, [t for t in told.structure.terms if t.effect.ordinary]
    effects = [*usual, *rare]
    near = [*([term] for term in usual), *([effects] if len(effects) > 1 else [])]
    members = [whole]
    for gone, near_enough in ((near, True), ([[term] for term in rare], False)):
        weights = _at_most(named, whole, gone)
        tried = [terms for terms, w in zip(gone, weights, strict=True) if w >= _LEAST_TOLD]
        starts = [_without(reduction, beside, terms) for terms in tried]
        found = _fitted(objective, starts, slopes, near_enough=near_enough)
        members += [_reduction(problem, objective, *one).whole for one in found]
    weights = Table((named, *members)).weights[1:]
    free_at_all = max(float(weights.sum()), np.finfo(float).tiny)
    confidence = {}
    for term in effects:
        has = [term.effect.name in member.effects for member in members]
        confidence[term.effect.name] = min(1.0, float(weights[has].sum()) / free_at_all)
    return Unknown(weight=min(1.0, free_at_all), confidence=confidence)


def _at_most(named: Member, beside: Member, gone: Sequence[Sequence[Term]]) -> FloatArray:
    """(n,) weights without some effects each, as if a free effort made up for all of them."""
    members, slots = [named, beside], beside.fit.structure.slots
    for terms in gone:
        names = {term.effect.name for term in terms}
        kept = beside.kept[[slots[k].term.effect.name not in names for k in beside.kept]]
        effects = {name: places for name, places in beside.effects.items() if name not in names}
        members.append(replace(beside, effects=effects, kept=kept))
    return Table(tuple(members)).weights[2:]


def _fitted(
    objective: Objective,
    starts: Sequence[Fit],
    near: Slopes | None = None,
    *,
    near_enough: bool = False,
) -> list[tuple[Fit, Slopes]]:
    """Fits from starts, and their slopes; those of a fit beside them are enough to begin with."""
    begun = evaluate(objective, [(one.structure, one.values) for one in starts])
    slopes = [None] * len(begun) if near is None else [*near_slopes(objective, near, begun)]
    return polish_each(
        *([objective] * len(begun), begun, slopes),
        iterations=_STEPS,
        certain=False,
        near_enough=near_enough,
    )


def _reduction(problem: Problem, objective: Objective, one: Fit, slopes: Slopes) -> Reduction:
    return Reduction(objective, one, slopes, problem.noise, any_may_go=True)


def _without(reduction: Reduction, one: Fit, terms: Sequence[Term]) -> Fit:
    """A start without some effects, to where slopes say that the others go."""
    names = [term.effect.name for term in terms]
    values = reduction.lacking([unit for unit in reduction.units if unit[0] in names]).values
    kept = tuple(term for term in one.structure.terms if term.effect.name not in names)
    structure = replace(one.structure, terms=kept)
    start = np.clip(carried(values, one.structure, structure), *structure.bounds)
    return replace(one, structure=structure, values=start)
