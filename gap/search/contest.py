"""Contests: a named effect against those that could be in its place.

Each is in the company of all other named effects. A better one takes its place, those as good are
its confusion set.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.evidence import Evidence, weigh
from walkerkit.gap.search.fit import evaluate, polished
from walkerkit.gap.search.places import refit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit, Term, carried
from walkerkit.gap.search.trying import Tries
from walkerkit.gap.search.worth import close_to, tied, worth_it

_REFITS = 4
_MOST_RIVALS = 5
_NEAR = 2.0  # of a score, summed over the channels


@dataclass(frozen=True, kw_only=True)
class Contest:
    """A named effect and its rivals, each in the company of all others.

    Attributes:
        fits: that with the named effect, its term last, and those with a rival instead.
        evidence: of the fits, and last of the others alone.
        close: indices of rivals that explain as much.
        better: a rival that explains more, or None.
    """

    fits: tuple[Fit, ...]
    evidence: Evidence
    close: tuple[int, ...]
    better: Fit | None


def contest(problem: Problem, tries: Tries, current: Fit, term: Term) -> Contest:
    """Compares an effect with those that could be in its place."""
    objective = problem.fit.objective
    others = current.structure.without_term(term)
    (alone,) = refit(problem, current, [others])
    rivals = _rivals(tries, alone, term.effect) if term.effect.fitted else []
    problem.refine(current)
    mine = others.with_term(term)
    starts = [(mine, carried(current.values, current.structure, mine))]
    own, *fits = evaluate(objective, [*starts, *((one.structure, one.values) for one in rivals)])
    # Those that come near get what the named one has had: a fit to all recordings.
    near = [
        k for k, one in enumerate(fits) if len(problem.channels) * (one.score - own.score) < _NEAR
    ]
    slopes = linearised(objective, own) if near else None
    for k in near:
        fits[k] = polished(objective, fits[k], slopes, iterations=_REFITS, certain=False)
    evidence = weigh(problem, [own, *fits, alone])
    compared = evidence.some(range(len(fits) + 1))
    better = [
        k
        for k, one in enumerate(fits, start=1)
        if _is_better(problem, compared, k, size_of(one) > size_of(own))
        or (_more_ordinary(one, own) and tied(compared, len(problem.channels), k))
    ]
    return Contest(
        fits=(own, *fits),
        evidence=evidence,
        close=tuple(close_to(compared, len(problem.channels))),
        better=fits[min(better, key=lambda k: compared.both[k]) - 1] if better else None,
    )


def size_of(one: Fit) -> tuple[int, int]:
    """Number of effects, and of the last one's values at a place."""
    terms = one.structure.terms
    return len(terms), len(one.values)


def _rivals(tries: Tries, alone: Fit, effect: Effect) -> list[Fit]:
    """The best effects in place of one, on top of the others; few generalisations of it."""
    tried = tries.on_top_of(alone, None, tries.like(alone.structure, effect))
    singles = [
        i
        for i in np.argsort(tried.evidence.both, kind="stable").tolist()
        if len(tried.fits[i].structure.terms) == len(alone.structure.terms) + 1
        and _is_rival(tried.fits[i].structure.terms[-1].effect, effect)
    ]
    return [tried.fits[i] for i in singles[:_MOST_RIVALS]]


def _is_better(problem: Problem, compared: Evidence, k: int, larger: bool) -> bool:
    if 0 in close_to(compared, len(problem.channels), first=k):
        return False
    better = bool(compared.both[k] < compared.both[0])
    return better and (not larger or worth_it(problem, compared, k))


def _is_rival(other: Effect, effect: Effect) -> bool:
    """Whether another effect could be what an effect was taken for."""
    only_larger = effect.name in other.extends and effect.name not in other.usually
    return other is not effect and not only_larger


def _more_ordinary(one: Fit, other: Fit) -> bool:
    """Whether the last effect of a fit is one that every model has a little wrong."""
    return one.structure.terms[-1].effect.ordinary and not other.structure.terms[-1].effect.ordinary
