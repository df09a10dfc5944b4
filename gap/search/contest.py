"""Contests: a named effect against those that could be in its place.

Each is in the company of all other named effects. A better one takes its place, those as good are
its confusion set. What every model has a little wrong (damping, dry friction, armature) is always
among the rivals, each by itself and all together: it is the usual cause, and a rarer effect has to
be worth more than that.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.evidence import Evidence, weigh
from walkerkit.gap.search.fit import evaluate, polished
from walkerkit.gap.search.places import refit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit, Term, carried
from walkerkit.gap.search.trying import Tries, within_reach
from walkerkit.gap.search.worth import close_to, worth_it

_REFITS = 4
_MOST_RIVALS = 5
_OF_GAIN = 0.2  # of what an effect takes off a score, by which a rival's race may stop short


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


@dataclass(frozen=True, kw_only=True)
class _Entered:
    """A named effect and what it meets, before the contest.

    Attributes:
        alone: the others without it.
        own: they with it, its term last.
        rivals: they with a rival instead.
        together: they with all that is ordinary instead, or nothing.
    """

    alone: Fit
    own: Fit
    rivals: tuple[Fit, ...]
    together: tuple[Fit, ...]

    @property
    def fits(self) -> tuple[Fit, ...]:
        """Those that compete, the named one first."""
        return self.own, *self.rivals, *self.together


def contests(problem: Problem, tries: Tries, current: Fit) -> list[Contest]:
    """Compares each effect of a fit with those that could be in its place."""
    entered = [_entered(problem, tries, current, term) for term in current.structure.terms]
    if not entered:
        return []
    problem.refine(current)
    objective, reach = problem.fit.objective, within_reach(len(problem.channels))
    every = [one for met in entered for one in (*met.fits, met.alone)]
    fits = evaluate(objective, [(one.structure, one.values) for one in every])
    firsts = [0, *itertools.accumulate(len(met.fits) + 1 for met in entered)]
    # Those that come near get what the named one has had: a fit to all recordings.
    near = [
        k
        for first, end in itertools.pairwise(firsts)
        for k in range(first + 1, end - 1)
        if fits[k].score - fits[first].score
        < max(reach, _OF_GAIN * (fits[end - 1].score - fits[first].score))
    ]
    if near:
        slopes = linearised(objective, fits[0])
        found = polished(
            objective,
            [fits[k] for k in near],
            slopes,
            iterations=_REFITS,
            certain=False,
            leader=fits[0].score,
        )
        for k, one in zip(near, found, strict=True):
            fits[k] = one
    evidence = weigh(problem, fits)
    return [
        _decided(problem, met, fits[first : end - 1], evidence.some(range(first, end)))
        for met, (first, end) in zip(entered, itertools.pairwise(firsts), strict=True)
    ]


def _entered(problem: Problem, tries: Tries, current: Fit, term: Term) -> _Entered:
    others = current.structure.without_term(term)
    (alone,) = refit(problem, current, [others])
    mine = others.with_term(term)
    values = carried(current.values, current.structure, mine)
    own = replace(current, structure=mine, values=values)
    return _Entered(
        alone=alone,
        own=own,
        rivals=tuple(_rivals(tries, alone, own)) if term.effect.fitted else (),
        together=tuple(_ordinary_together(tries, alone, own)),
    )


def _decided(problem: Problem, met: _Entered, fits: Sequence[Fit], evidence: Evidence) -> Contest:
    """The contest of the fits, of which and of the others alone the evidence is."""
    own, channels = fits[0], len(problem.channels)
    places = range(len(met.rivals) + 1)
    compared = evidence.some(places)
    better = [
        k
        for k in places[1:]
        if _is_better(
            problem, compared, k, size_of(fits[k]) > size_of(own) or plainer(own, fits[k])
        )
        or (plainer(fits[k], own) and not worth_it(problem, compared, 0, base=k))
    ]
    last = len(fits) - 1
    if met.together and evidence.both[last] < evidence.both[0]:
        better.append(last)
    return Contest(
        fits=tuple(fits[: len(places)]),
        evidence=evidence.some([*places, len(fits)]),
        close=tuple(close_to(compared, channels)),
        better=tuple(Better(fit=fits[k], than=own, score=float(evidence.both[k])) for k in better),
    )


def size_of(one: Fit) -> tuple[int, int]:
    """Number of effects, and of the last one's values at a place."""
    terms = one.structure.terms
    return len(terms), len(one.values)


def _rivals(tries: Tries, alone: Fit, own: Fit) -> list[Fit]:
    """The best effects in place of the last one, on top of the others; few generalisations of it.

    Those that are plainer are among them in any case.
    """
    effect = _last(own)
    tried = tries.on_top_of(alone, None, tries.like(alone.structure, effect), own)
    singles = [
        tried.fits[i]
        for i in np.argsort(tried.evidence.both, kind="stable").tolist()
        if len(tried.fits[i].structure.terms) == len(alone.structure.terms) + 1
    ]
    rivals = [one for one in singles if _is_rival(_last(one), effect)][:_MOST_RIVALS]
    met = {_last(one).name for one in rivals}
    plainer = [one for one in tries.effects if _is_plainer(one, effect) and one.name not in met]
    return rivals + tries.each_on_top_of(alone, plainer, own)


def _ordinary_together(tries: Tries, alone: Fit, own: Fit) -> list[Fit]:
    """All that every model has a little wrong in place of the last effect, if that is rarer."""
    effect = _last(own)
    if effect.ordinary or not effect.fitted:
        return []
    return tries.together_on_top_of(alone, [one for one in tries.effects if one.ordinary], own)


def _is_better(problem: Problem, compared: Evidence, k: int, larger: bool) -> bool:
    # One that diverges is close to nothing.
    better = compared.both[k] < compared.both[0]
    if not better or 0 in close_to(compared, len(problem.channels), first=k):
        return False
    return not larger or worth_it(problem, compared, k)


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
