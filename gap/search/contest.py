"""Contests: a named effect against those that could be in its place.

Each is in the company of all other named effects. A better one takes its place, those as good are
its confusion set. What every model has a little wrong (damping, dry friction, armature) is always
among the rivals, each by itself and all together: it is the usual cause, and a rarer effect has to
be worth more than that.
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
from walkerkit.gap.search.worth import close_to, worth_it

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
        better: fits with another effect or several in its place that are to be named rather.
    """

    fits: tuple[Fit, ...]
    evidence: Evidence
    close: tuple[int, ...]
    better: tuple[Better, ...]


@dataclass(frozen=True, kw_only=True)
class Better:
    """A fit that is to be named rather than another.

    Attributes:
        fit: the fit.
        than: the other.
        score: the mean of its scores on what is fitted and what is held out.
    """

    fit: Fit
    than: Fit
    score: float


def contest(problem: Problem, tries: Tries, current: Fit, term: Term) -> Contest:
    """Compares an effect with those that could be in its place."""
    objective, channels = problem.fit.objective, len(problem.channels)
    others = current.structure.without_term(term)
    (alone,) = refit(problem, current, [others])
    rivals = _rivals(tries, alone, term.effect) if term.effect.fitted else []
    together = _ordinary_together(tries, alone, term.effect)
    problem.refine(current)
    mine = others.with_term(term)
    starts = [(mine, carried(current.values, current.structure, mine))]
    starts += [(one.structure, one.values) for one in (*rivals, *together)]
    own, *fits = evaluate(objective, starts)
    # Those that come near get what the named one has had: a fit to all recordings.
    near = [k for k, one in enumerate(fits) if channels * (one.score - own.score) < _NEAR]
    slopes = linearised(objective, own) if near else None
    for k in near:
        fits[k] = polished(objective, fits[k], slopes, iterations=_REFITS, certain=False)
    evidence = weigh(problem, [own, *fits, alone])
    places = range(len(rivals) + 1)
    compared = evidence.some(places)
    better = [
        k
        for k in places[1:]
        if _is_better(
            problem, compared, k, size_of(fits[k - 1]) > size_of(own) or plainer(own, fits[k - 1])
        )
        or (plainer(fits[k - 1], own) and not worth_it(problem, compared, 0, base=k))
    ]
    if together and evidence.both[len(fits)] < evidence.both[0]:
        better.append(len(fits))
    return Contest(
        fits=(own, *fits[: len(rivals)]),
        evidence=evidence.some([*places, len(fits) + 1]),
        close=tuple(close_to(compared, channels)),
        better=tuple(
            Better(fit=fits[k - 1], than=own, score=float(evidence.both[k])) for k in better
        ),
    )


def size_of(one: Fit) -> tuple[int, int]:
    """Number of effects, and of the last one's values at a place."""
    terms = one.structure.terms
    return len(terms), len(one.values)


def _rivals(tries: Tries, alone: Fit, effect: Effect) -> list[Fit]:
    """The best effects in place of one, on top of the others; few generalisations of it.

    Those that are plainer are among them in any case.
    """
    tried = tries.on_top_of(alone, None, tries.like(alone.structure, effect))
    singles = [
        tried.fits[i]
        for i in np.argsort(tried.evidence.both, kind="stable").tolist()
        if len(tried.fits[i].structure.terms) == len(alone.structure.terms) + 1
    ]
    rivals = [one for one in singles if _is_rival(_last(one), effect)][:_MOST_RIVALS]
    met = {_last(one).name for one in rivals}
    plainer = [one for one in tries.effects if _is_plainer(one, effect) and one.name not in met]
    return rivals + tries.each_on_top_of(alone, plainer)


def _ordinary_together(tries: Tries, alone: Fit, effect: Effect) -> list[Fit]:
    """All that every model has a little wrong in place of an effect that is rarer, if any."""
    if effect.ordinary or not effect.fitted:
        return []
    return tries.together_on_top_of(alone, [one for one in tries.effects if one.ordinary])


def _is_better(problem: Problem, compared: Evidence, k: int, larger: bool) -> bool:
    if 0 in close_to(compared, len(problem.channels), first=k):
        return False
    better = bool(compared.both[k] < compared.both[0])
    return better and (not larger or worth_it(problem, compared, k))


def _is_rival(other: Effect, effect: Effect) -> bool:
    """Whether another effect could be what an effect was taken for."""
    only_larger = effect.name in other.extends and effect.name not in other.usually
    return other is not effect and not only_larger


def _is_plainer(one: Effect, other: Effect) -> bool:
    more_ordinary = one.ordinary and not other.ordinary
    return more_ordinary or (one.name in other.extends and one.name not in other.usually)


def plainer(one: Fit, other: Fit) -> bool:
    """Whether the last effect of a fit is to be named before another that explains as much."""
    return _is_plainer(_last(one), _last(other))


def _last(one: Fit) -> Effect:
    return one.structure.terms[-1].effect
