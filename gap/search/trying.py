"""Trying: which effects are worth a fit on top of those named already, and what comes of it.

Every effect is looked at by what it changes (`signatures`). Those that promise most, singles and
pairs, since two right effects can hide behind the compromise of a wrong single one, are raced.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.evidence import Evidence, weigh
from walkerkit.gap.search.fit import Progress, best_of, evaluate, fit
from walkerkit.gap.search.journal import digest, finished, packed, unpacked
from walkerkit.gap.search.keeping import at_floor
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.screen import screen
from walkerkit.gap.search.signatures import View, look
from walkerkit.gap.search.slopes import slopes_to_carry
from walkerkit.gap.search.structure import Case, Fit, Structure, Term, candidate_terms, carried
from walkerkit.gap.search.worth import least_gain

FloatArray = NDArray[np.float64]
Key = frozenset[tuple[str, tuple[str, ...], bool]]  # effects, their sites, and whether shared

MOST_EFFECTS = 5
_WARM, _KEPT_WARM = 2, 2  # steps, and how many take the second for each that is raced
_MOST_WARM, _HOPE = 24, 0.3  # that take the first, and what they promise of the least that matters
_OF_THE_BEST = 0.2  # of its gain, which others have to reach by then
_FEW, _WORSE = 6, 1.0  # numbers; gaps in the mean e times those without, for a start of more
_FEWEST_SINGLES, _MOST_SINGLES, _MOST_PAIRS = 3, 6, 4
_MORE_THAN_ONE = 0.3  # that a pair promises beyond the best single, summed over the channels
_LIKE = 0.25  # of an effect's promise, which another has to reach to stand in for it
_LITTLE = 0.1  # of what an effect promises
_LESS = (0.3, 0.1)  # of a start that is worse than the present fit
_NEAR, _NEAREST = 2.0, 0.7  # of a score, summed over the channels; in their mean, at most
_NO_MORE = 0.05  # of a promise, summed over the channels


@dataclass(frozen=True, kw_only=True)
class Tried:
    """What was fitted on top of some terms: singles and pairs, and what recordings say of them."""

    fits: tuple[Fit, ...]
    evidence: Evidence


class Tries:
    """What has been tried on top of which terms.

    Args:
        problem: what is to be explained.
        effects: the catalogue.
        progress: called now and then.

    Attributes:
        effects: the catalogue.
    """

    def __init__(
        self, problem: Problem, effects: Sequence[Effect], progress: Progress | None
    ) -> None:
        self._problem = problem
        self.effects = tuple(effects)
        self._progress = progress
        self._tried: dict[tuple[Key, frozenset[str] | None, Key | None], Tried] = {}
        self._promised: dict[Key, dict[str, float]] = {}  # in the order in which they were seen

    def on_top_of(
        self,
        current: Fit,
        base: Evidence | None,
        only: frozenset[str] | None = None,
        instead_of: Fit | None = None,
    ) -> Tried:
        """Fits what promises most on top of a fit; nothing where that is at the floor.

        Args:
            current: the fit.
            base: what the recordings say of it, where that is known.
            only: names of the effects that are looked at, one by one; None for all, and pairs.
            instead_of: a fit with another effect; what is far behind that goes no further.
        """
        problem, count = self._problem, len(current.structure.terms)
        everything = key_of(current.structure), None, None
        rival = None if instead_of is None else key_of(instead_of.structure)
        key = everything if everything in self._tried else (everything[0], only, rival)
        if key in self._tried:
            return self._tried[key]
        if base is None:
            problem.refine(current)
            base = weigh(problem, [current])
        none = Tried(fits=(), evidence=base.some([]))
        looked_at = [one for one in self.effects if only is None or one.name in only]
        terms = self.terms(current.structure, looked_at)
        if not terms or at_floor(problem, current, base) or count >= MOST_EFFECTS:
            self._tried[key] = none
            return none
        stage = f"effect {count + 1}: {{}} {len(terms)} candidates"
        if self._progress:
            self._progress(stage.format("screening"), 0.0)
        problem.searched.look_at(current.case)
        for half in problem.parts:
            half.refine(current)
        promised, starts = finished(
            digest(repr((current.structure.key, only and sorted(only))), current.values),
            lambda: self._promising(current, terms, alone=only is not None),
            lambda found: [found[0], [[s.key[count:], packed([v])] for s, v in found[1]]],
            lambda content: (content[0], [self._start(current, *one) for one in content[1]]),
        )
        if only is None:
            self._promised[key[0]] = promised
        if not starts:
            self._tried[key] = none
            return none
        race = problem.race.objective
        tried = fit(
            race,
            evaluate(race, starts),
            race=[len(structure.terms) for structure, _ in starts],
            near=slopes_to_carry(race, current),
            leader=_to_come_near(race, instead_of),
            progress=self._progress,
            stage=stage.format("fitting"),
        )
        self._tried[key] = Tried(fits=tuple(tried), evidence=weigh(problem, tried))
        return self._tried[key]

    def each_on_top_of(
        self, current: Fit, effects: Sequence[Effect], instead_of: Fit | None = None
    ) -> list[Fit]:
        """Each of some effects fitted on top of a fit, whatever it promises."""
        terms = self.terms(current.structure, effects)
        if not terms:
            return []
        race = self._race(current)
        (own,) = evaluate(race, [(current.structure, current.values)])
        return fit(race, screen(race, own, terms), leader=_to_come_near(race, instead_of))

    def together_on_top_of(
        self, current: Fit, effects: Sequence[Effect], instead_of: Fit
    ) -> list[Fit]:
        """Some effects fitted on top of a fit all at once; nothing where they are not several."""
        terms = self.terms(current.structure, effects)
        if len(terms) < 2:
            return []
        structure = current.structure
        for term in terms:
            structure = structure.with_term(term)
        start = carried(current.values, current.structure, structure)
        race = self._race(current)
        starts = evaluate(race, [(structure, start)])
        return fit(race, starts, leader=_to_come_near(race, instead_of))

    def _race(self, current: Fit) -> Objective:
        self._problem.race.refine(current)
        return self._problem.race.objective

    def like(self, others: Structure, effect: Effect) -> frozenset[str] | None:
        """Effects that promised enough, when last seen without this one, to stand in for it."""
        best: dict[str, float] = {}
        names = {name for name, _, _ in others.key}
        for key, promised in self._promised.items():
            if effect.name in promised and {name for name, _, _ in key} <= names:
                best = promised
        if best.get(effect.name, 0.0) <= 0:
            return None
        least = _LIKE * best[effect.name]
        return frozenset(name for name, promise in best.items() if promise >= least)

    def _promising(
        self, current: Fit, terms: Sequence[Term], *, alone: bool
    ) -> tuple[dict[str, float], list[tuple[Structure, FloatArray]]]:
        """What effects promise on top of a fit, and where the best singles and pairs begin."""
        view = look(self._problem.screen, current, terms)
        starts = self._starters(view, current)
        if starts and not alone and len(current.structure.terms) + 1 < MOST_EFFECTS:
            starts += self._paired(view, current, starts)
        return _promised(view), starts

    def _start(self, current: Fit, added: Any, values: Any) -> tuple[Structure, FloatArray]:
        """A start as a journal has it."""
        effects = {effect.name: effect for effect in self.effects}
        structure = current.structure
        for name, sites, shared in added:
            term = Term(effect=effects[name], sites=tuple(sites), shared=shared)
            structure = structure.with_term(term)
        return structure, unpacked(values)[0]

    def _starters(self, view: View, current: Fit) -> list[tuple[Structure, FloatArray]]:
        """The singles that are worth a race, from where a few steps have taken them.

        A promise is a straight line from the present model. Where that is far from the robot the
        line leads astray, so that all with any hope get the first steps of a fit.
        """
        objective = self._problem.screen.objective
        every = range(len(view.candidates))
        able = [i for i in every if view.candidates[i].tries and not _outdone(view, i)]
        if not able:
            return []
        warm = evaluate(objective, [view.start([i]) for i in able])
        promised = [view.promise([i]) for i in able]
        hope = _HOPE * least_gain(self._problem) / view.channels
        least = view.score - max(hope, _OF_THE_BEST * (view.score - min(promised)))
        by_promise = sorted(range(len(able)), key=lambda k: promised[k])
        by_start = sorted(range(len(able)), key=lambda k: warm[k].score)
        chosen = [k for k in by_promise[:_MOST_WARM] if promised[k] < least]
        chosen += [k for k in by_start[:_MOST_SINGLES] if warm[k].score < least]
        chosen = list(dict.fromkeys([*chosen, *by_promise[:_FEWEST_SINGLES]]))
        overshot = [k for k in chosen if warm[k].score > view.score]
        for k, less in zip(overshot, self._lessened([warm[k] for k in overshot]), strict=True):
            if less.score < view.score:
                warm[k] = less
        near = slopes_to_carry(objective, current)
        for _ in range(_WARM):
            further = fit(objective, [warm[k] for k in chosen], iterations=1, near=near)
            for k, one in zip(chosen, further, strict=True):
                warm[k] = one
            chosen.sort(key=lambda k: warm[k].score)
            least = view.score - _OF_THE_BEST * (view.score - warm[chosen[0]].score)
            good = [k for k in chosen if warm[k].score < least]
            chosen = max(good, chosen[:_FEWEST_SINGLES], key=len)[: _KEPT_WARM * _MOST_SINGLES]
        chosen = list(dict.fromkeys([*chosen[:_MOST_SINGLES], *by_promise[:_FEWEST_SINGLES]]))
        return _worth_a_race(view, current, [warm[k] for k in chosen])

    def _lessened(self, starts: Sequence[Fit]) -> list[Fit]:
        """Starts with less of their last effect, or of the first number of it, or at one place."""
        cases = []
        for one in starts:
            term = one.structure.terms[-1]
            columns = one.structure.columns(term)
            first = np.array([one.structure.columns(term, place)[0] for place in term.places])
            away = one.values - one.structure.zero
            rows = []
            for some in (columns, first):
                for part in _LESS:
                    rows.append(one.values.copy())
                    rows[-1][some] -= (1 - part) * away[some]
            # Of many places that move at once, those that need not hide the one that does.
            for place in term.places if len(term.places) > 1 else ():
                rows.append(one.values.copy())
                others = np.setdiff1d(columns, one.structure.columns(term, place))
                rows[-1][others] = one.structure.zero[others]
            cases.append(Case(structure=one.structure, values=np.array(rows)))
        return best_of(self._problem.screen.objective, cases)

    def _paired(
        self, view: View, current: Fit, singles: Sequence[tuple[Structure, FloatArray]]
    ) -> list[tuple[Structure, FloatArray]]:
        """The pairs that are worth a race, each from the best of some starts.

        Both members as they promise overshoot where they explain the same. So each is also tried
        as it was fitted alone, beside the other as it promises, and beside little of it.
        """
        cases = []
        for pair in _pairs(view):
            structure, both = view.start(pair)
            little = structure.zero + _LITTLE * (both - structure.zero)
            rows = [both]
            for single, values in singles:
                alone = carried(values, single, structure)
                for one, other in itertools.permutations(structure.terms[-2:]):
                    if single.terms[-1].effect is one.effect:
                        columns = structure.columns(other)
                        for beside in (both, little):
                            rows.append(alone.copy())
                            rows[-1][columns] = beside[columns]
            cases.append(Case(structure=structure, values=np.array(rows)))
        return _worth_a_race(view, current, best_of(self._problem.screen.objective, cases))

    def terms(self, structure: Structure, effects: Sequence[Effect]) -> list[Term]:
        """Effects where they could be added: those present only at places without them."""
        present = {term.effect.name: term for term in structure.terms}
        found = []
        for term in candidate_terms(effects, self._problem.robots, self._problem.joints):
            known = present.get(term.effect.name)
            if not term.effect.fitted:
                continue
            if known is None:
                found.append(term)
            elif not known.shared:
                sites = tuple(site for site in term.sites if site not in known.sites)
                if sites:
                    found.append(replace(term, sites=sites, shared=False))
        return found


def within_reach(channels: int) -> float:
    """By how much of a score, on so many channels, a fit is behind one that it may come up to."""
    return min(_NEAR / channels, _NEAREST)


def _to_come_near(objective: Objective, one: Fit | None) -> float:
    """The score from which on a rival comes near a fit; infinity where there is none."""
    if one is None:
        return np.inf
    (own,) = evaluate(objective, [(one.structure, one.values)])
    return own.score + within_reach(len(objective.channels))


def _worth_a_race(
    view: View, current: Fit, starts: Sequence[Fit]
) -> list[tuple[Structure, FloatArray]]:
    """Starts that can win: few numbers come back from far off, many are dear and do not."""
    count, worst = len(current.values) + _FEW, view.score + _WORSE
    return [
        (one.structure, one.values)
        for one in starts
        if len(one.values) <= count or one.score < worst
    ]


def key_of(structure: Structure) -> Key:
    """What tells structures apart, in whichever order their terms are."""
    return frozenset(structure.key)


def _promised(view: View) -> dict[str, float]:
    """Effect to what it promises to take off the score."""
    found: dict[str, float] = {}
    for i, candidate in enumerate(view.candidates):
        name = candidate.term.effect.name
        found[name] = max(found.get(name, 0.0), view.score - view.promise([i]))
    return found


def _pairs(view: View) -> list[tuple[int, int]]:
    """Pairs that promise more than any single; no effect is in too many of them."""
    promised = [view.promise([i]) for i in range(len(view.candidates))]
    able = [i for i, one in enumerate(view.candidates) if one.columns and not _outdone(view, i)]
    least = min(promised) - _MORE_THAN_ONE / view.channels
    pairs = sorted(
        (promise, pair)
        for pair in itertools.combinations(able, 2)
        if view.candidates[pair[0]].term.effect is not view.candidates[pair[1]].term.effect
        and (promise := view.promise(pair)) < least
    )
    often: dict[int, int] = {}
    chosen: list[tuple[int, int]] = []
    for _, pair in pairs:
        if len(chosen) < _MOST_PAIRS and all(often.get(i, 0) < _MOST_PAIRS // 2 for i in pair):
            chosen.append(pair)
            often.update({i: often.get(i, 0) + 1 for i in pair})
    return chosen


def _outdone(view: View, i: int) -> bool:
    """Whether one value for all promises as much as this candidate's one for each."""
    mine = view.candidates[i].term
    return not mine.shared and any(
        other.term.shared
        and other.term.effect is mine.effect
        and view.channels * (view.promise([k]) - view.promise([i])) < _NO_MORE
        for k, other in enumerate(view.candidates)
    )
