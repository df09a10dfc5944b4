"""Named effects that may together stand in for one of which the catalogue is silent.

    for group in stand_ins(problem, final):
        print(" and ".join(group))

An unknown law is fitted by known ones as a function is by the first terms of a series: by two of
the same part of a joint, or that fit the same part, by two that mostly undo each other, or by many.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.report.diagnosis import NamedEffect
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Case, Fit, Term, carried

_FEW, _FEW_IN_ALL = 2, 3  # beside what every model has a little wrong, and with it
_SURE_OF_SEVERAL = 0.85  # of any that may be one together
_SURE_OF_NO_SIZE = 0.5  # of one of which no number is known

Pair = tuple[Term, Term]


def stand_ins(problem: Problem, final: Fit) -> tuple[tuple[str, ...], ...]:
    """The names of a fit that may be one together.

    What every model has a little wrong is a part of its own, and does not soon make it many.

    Args:
        problem: what was explained.
        final: the explanation.

    Returns:
        Groups of two names or more; empty for none.
    """
    terms = final.structure.terms
    counted = [term for term in terms if not term.effect.ordinary]
    if len(counted) > _FEW or len(terms) > _FEW_IN_ALL:
        return (tuple(term.effect.name for term in terms),)
    fitted = [term for term in terms if term.effect.fitted]
    pairs = [
        *filter(_same_part, itertools.combinations(counted, 2)),
        *_undoing(problem, final, [*itertools.combinations(fitted, 2)]),
    ]
    return tuple(dict.fromkeys((one.effect.name, other.effect.name) for one, other in pairs))


def most_sure(effects: Sequence[NamedEffect], groups: Sequence[Sequence[str]]) -> dict[str, float]:
    """How sure each name may be at most.

    A spring that may as well be rigid shrinks a gap by how it is simulated, not by what it is.

    Args:
        effects: the named effects.
        groups: names that may be one together.

    Returns:
        Names to confidences, 0 to 1.
    """
    several = {name for group in groups for name in group}
    limits = {one.effect: _SURE_OF_SEVERAL if one.effect in several else 1.0 for one in effects}
    for one in effects:
        if CATALOGUE[one.effect].fitted and not one.determined:
            limits[one.effect] = _SURE_OF_NO_SIZE
    return limits


def _same_part(pair: Pair) -> bool:
    one, other = pair
    sites = {*one.sites} & {*other.sites}
    everywhere = EVERYWHERE in {*one.sites, *other.sites}
    parts = {part for part in (one.effect.part, *one.effect.also_fits) if part}
    others = {other.effect.part, *other.effect.also_fits}
    return not parts.isdisjoint(others) and (everywhere or bool(sites))


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
