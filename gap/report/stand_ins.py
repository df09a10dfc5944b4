"""Named effects that may together stand in for one of which the catalogue is silent.

    for group in stand_ins(problem, final):
        print(" and ".join(group))

An unknown law is fitted by known ones as a function is by the first terms of a series: by two of
the same part of a joint, by two that mostly undo each other, or by many.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from walkerkit.gap.effects import EVERYWHERE
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Case, Fit, Term, carried

_FEW = 2

Pair = tuple[Term, Term]


def stand_ins(problem: Problem, final: Fit) -> tuple[tuple[str, ...], ...]:
    """The names of a fit that may be one together.

    What every model has a little wrong does not make it many, and is a part of its own.

    Args:
        problem: what was explained.
        final: the explanation.

    Returns:
        Groups of two names or more; empty for none.
    """
    terms = final.structure.terms
    counted = [term for term in terms if not term.effect.ordinary]
    if len(counted) > _FEW:
        return (tuple(term.effect.name for term in terms),)
    fitted = [term for term in terms if term.effect.fitted]
    pairs = [
        *filter(_same_part, itertools.combinations(counted, 2)),
        *_undoing(problem, final, [*itertools.combinations(fitted, 2)]),
    ]
    return tuple(dict.fromkeys((one.effect.name, other.effect.name) for one, other in pairs))


def _same_part(pair: Pair) -> bool:
    one, other = pair
    sites = {*one.sites} & {*other.sites}
    everywhere = EVERYWHERE in {*one.sites, *other.sites}
    part = one.effect.part
    return bool(part) and part == other.effect.part and (everywhere or bool(sites))


def _undoing(problem: Problem, final: Fit, pairs: Sequence[Pair]) -> list[Pair]:
    """Pairs of which each changes the held-out recordings more than both together do.

    Causes that have nothing to do with each other do not cancel; the difference of two shapes is
    a third one.
    """
    if not pairs:
        return []
    structure, objective = final.structure, problem.held.objective
    left_out = [*((one,) for one in structure.terms), *pairs]
    cases = []
    for terms in left_out:
        others = structure
        for term in terms:
            others = others.without_term(term)
        values = carried(final.values, structure, others)
        cases.append(Case(structure=others, values=values[None]))
    (own,) = objective.simulated([final.case])
    weights = 1 / (objective.mean_square(own[0]) + objective.floor**2)
    changed = [
        float(objective.mean_square(residual[0] - own[0]) @ weights)
        for group in objective.grouped(cases)
        for residual in objective.simulated(cases[group])
    ]
    size = dict(zip(left_out, changed, strict=True))
    return [pair for pair in pairs if size[pair] < min(size[one,] for one in pair)]
