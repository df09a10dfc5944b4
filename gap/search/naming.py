"""Naming: which effects explain the held-out recordings, how sure each is, and what else could be.

Each round looks at every effect on top of those already named (`signatures`), and fits the singles
and pairs that promise most: two right effects can hide behind the compromise of a wrong single one.
An effect is named when it makes the held-out gaps smaller by more than chance (block bootstrap) and
by a margin that matters: above the measurement's noise and above the simulation's own numerical
error. Then the places that do not need it are dropped, everything is fitted jointly, and effects
that are no longer needed leave again. At the end each named effect meets its rivals in the company
of the others: a better one takes its place, those as good are its confusion set.
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
from walkerkit.gap.search.fit import Fit, Progress, certainty, evaluate, fit
from walkerkit.gap.search.journal import digest, finished, packed, unpacked
from walkerkit.gap.search.objective import Case, Objective
from walkerkit.gap.search.places import places_needed, refit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.scan import scanned
from walkerkit.gap.search.signatures import View, look
from walkerkit.gap.search.structure import Structure, Term, candidate_terms, carried, merged
from walkerkit.gap.search.worth import close_to, confidence, least_gain, one_sided, tied, worth_it

FloatArray = NDArray[np.float64]
_Key = frozenset[tuple[str, tuple[str, ...], bool]]  # effects, their sites, and whether shared

MOST_EFFECTS = 5
_AT_FLOOR = 1.15  # gaps within this factor of the noise leave nothing to explain
_BLURRED = 1.4  # as far as numerical errors raise that noise, at most
_LEFT_OF_THE_GAP = 0.6  # of a joint's, where most of it was numerical
_FAR_ABOVE, _OF_THE_MOTION = 10.0, 0.01  # of the noise, and of how far a joint moves
_REFITS = 4
_PASSES = 2  # of fitting and finding the numerical error again
_SETTLED = 0.05  # of a parameter's scale
_MOST_FINALISTS = 3
_IN_REACH = 0.5  # of the best gain
_WARM, _KEPT_WARM = 2, 2  # steps, and how many take the second for each that is raced
_MOST_WARM, _HOPE = 24, 0.3  # that take the first, and what they promise of the least that matters
_OF_THE_BEST = 0.2  # of its gain, which others have to reach by then
_FEWEST_SINGLES, _MOST_SINGLES, _MOST_PAIRS = 3, 6, 4
_MORE_THAN_ONE = 0.3  # that a pair promises beyond the best single, summed over the channels
_MOST_EXCHANGES = 3
_CERTAIN = 2.0  # standard errors from where a value leaves the robot unchanged
_MOST_RIVALS = 5
_LIKE = 0.25  # of an effect's promise, which another has to reach to stand in for it
_NEAR = 2.0  # of a score, summed over the channels
_NO_MORE = 0.05  # of a promise, summed over the channels


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One effect of one round.

    Attributes:
        term: the effect at all its sites.
        gain: how much it lowers the score of the held-out recordings.
        close: it explains the recordings as well as the one that was named.
        fit: the effect on top of the others.
    """

    term: Term
    gain: float
    close: bool
    fit: Fit


@dataclass(frozen=True, kw_only=True)
class Round:
    """One step of the explanation.

    Attributes:
        candidates: the effects that were fitted in the company of the other named ones, best
            first.
        named: the term that was added, or None where nothing was worth it.
        confidence: how often resampled recordings prefer it, ties shared.
        fit: everything named so far, fitted jointly.
        evidence: what the recordings say of that fit, in the light of its own numerical error.
        one_sided: the recordings that are fitted speak for something of which those that are held
            out know nothing, or the other way round.
    """

    candidates: tuple[Candidate, ...]
    named: Term | None
    confidence: float
    fit: Fit
    evidence: Evidence
    one_sided: bool = False


def name_effects(
    problem: Problem, effects: Sequence[Effect], progress: Progress | None = None
) -> tuple[Round, ...]:
    """Names effects until nothing more is worth it.

    Args:
        problem: what is to be explained.
        effects: the catalogue.
        progress: called now and then.

    Returns:
        A round for each named effect, and one in which nothing more was named; its fit is the
        explanation. Never empty.
    """
    return _Search(problem, effects, progress).run()


@dataclass(frozen=True, kw_only=True)
class _Tried:
    """What was fitted on top of some terms: singles and pairs, and what recordings say of them."""

    fits: tuple[Fit, ...]
    evidence: Evidence


@dataclass(frozen=True, kw_only=True)
class _Contest:
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


class _Search:
    """One search; remembers what it has tried on top of which terms."""

    def __init__(
        self, problem: Problem, effects: Sequence[Effect], progress: Progress | None
    ) -> None:
        self._problem = problem
        self._effects = effects
        self._progress = progress
        self._tried: dict[tuple[_Key, frozenset[str] | None], _Tried] = {}
        self._promised: dict[_Key, dict[str, float]] = {}  # in the order in which they were seen

    def run(self) -> tuple[Round, ...]:
        nothing = evaluate(self._problem.fit.objective, [(self._problem.nothing, np.zeros(0))])[0]
        current, base = self._settled(self._simulated_well(nothing))
        exchanges = 0
        while True:
            grown = self._grown(current, base)
            if grown is not None:
                current, base = grown
                continue
            contests = [self._contest(current, term) for term in current.structure.terms]
            better = next((c.better for c in contests if c.better is not None), None)
            if better is None or exchanges == _MOST_EXCHANGES:
                break
            exchanges += 1
            current, base = self._settled(self._kept(better, [better.structure.terms[-1].effect]))
        self._refine(current)
        return self._told(current, base, contests)

    def _simulated_well(self, nothing: Fit) -> Fit:
        """The robot as it is, or in a simulation that is good enough for these recordings.

        The numerical error is taken out of every comparison. Where it is most of a joint's gap, far
        above the noise and a part of the motion that matters, it is an effect of its own, and the
        model is to be simulated otherwise.
        """
        problem = self._problem
        terms = [
            term
            for term in candidate_terms(self._effects, problem.robots, problem.joints)
            if not term.effect.fitted
        ]
        objective = problem.held.objective
        before = objective.as_it_is([_case(nothing)])[0][0]
        motion = np.nanstd(objective.measured, axis=0)
        of_position = np.array([channel.signal == "position" for channel in objective.channels])
        least = np.maximum(_FAR_ABOVE * problem.noise, _OF_THE_MOTION * motion)
        best = nothing
        for term in terms:
            structure = nothing.structure.with_term(term)
            magnitudes = zip(*(slot.parameter.starts for slot in structure.slots), strict=True)
            values = np.array(list(magnitudes))
            tried = objective.as_it_is([Case(structure=structure, values=values)])[0]
            k = int(np.argmin(objective.score(tried)))
            gained = np.sqrt(np.maximum(before - tried[k], 0.0))
            most = tried[k] < _LEFT_OF_THE_GAP**2 * before
            if (most & (gained > least) & of_position).any():
                (best,) = evaluate(problem.fit.objective, [(structure, values[k])])
        return best

    def _grown(self, current: Fit, base: Evidence) -> tuple[Fit, Evidence] | None:
        """The fit with one or two more effects, or None where nothing is worth it."""
        tried = self._try(current, base)
        fits, evidence = list(tried.fits), Evidence.joined([base, tried.evidence])
        # The numerical error was that of the current model; those who could win get their own.
        for i in _finalists(evidence):
            fits[i], own = self._finalist(fits[i])
            evidence = evidence.replaced(i + 1, own)
        winner = self._winner(current, fits, evidence)
        if winner is None:
            self._refine(current)
            return None
        added = fits[winner].structure.terms[len(current.structure.terms) :]
        found = self._kept(fits[winner], [term.effect for term in added])
        if (_key(found.structure), None) in self._tried:  # what was added does not hold
            self._refine(current)
            return None
        return self._settled(found)

    def _winner(self, current: Fit, fits: Sequence[Fit], evidence: Evidence) -> int | None:
        """The best fit that is worth its number of effects and of values.

        A simpler one keeps its place unless another is worth more than it.
        """
        size = [_size(one) for one in fits]
        order = sorted(range(len(fits)), key=lambda i: (size[i], evidence.both[i + 1]))
        winner = None
        for i in order:
            if not self._worth_it(fits[i], evidence, i + 1):
                continue
            if winner is None or (
                evidence.both[i + 1] < evidence.both[winner + 1]
                and (
                    size[i] == size[winner] or self._worth_it(fits[i], evidence, i + 1, winner + 1)
                )
            ):
                winner = i
        return winner

    def _try(
        self, current: Fit, base: Evidence | None, only: frozenset[str] | None = None
    ) -> _Tried:
        """Fits what promises most on top of a fit; nothing where that is at the floor.

        Args:
            current: the fit.
            base: what the recordings say of it, where that is known.
            only: names of the effects that are looked at, one by one; None for all, and pairs.
        """
        problem, count = self._problem, len(current.structure.terms)
        everything = _key(current.structure), None
        key = everything if everything in self._tried else (everything[0], only)
        if key in self._tried:
            return self._tried[key]
        if base is None:
            self._refine(current)
            base = weigh(problem, [current])
        none = _Tried(fits=(), evidence=base.some([]))
        terms = self._terms(current.structure)
        if only is not None:
            terms = [term for term in terms if term.effect.name in only]
        if not terms or self._at_floor(current, base) or count >= MOST_EFFECTS:
            self._tried[key] = none
            return none
        stage = f"effect {count + 1}: {{}} {len(terms)} candidates"
        if self._progress:
            self._progress(stage.format("screening"), 0.0)
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
            near=current,
            progress=self._progress,
            stage=stage.format("fitting"),
        )
        self._tried[key] = _Tried(fits=tuple(tried), evidence=weigh(problem, tried))
        return self._tried[key]

    def _promising(
        self, current: Fit, terms: Sequence[Term], *, alone: bool
    ) -> tuple[dict[str, float], list[tuple[Structure, FloatArray]]]:
        """What effects promise on top of a fit, and where the best singles and pairs begin."""
        view = look(self._problem.screen, current, terms)
        starts = self._starters(view, current)
        if starts and not alone and len(current.structure.terms) + 1 < MOST_EFFECTS:
            starts += [view.start(pair) for pair in _pairs(view)]
        return _promised(view), starts

    def _start(self, current: Fit, added: Any, values: Any) -> tuple[Structure, FloatArray]:
        """A start as a journal has it."""
        effects = {effect.name: effect for effect in self._effects}
        structure = current.structure
        for name, sites, shared in added:
            term = Term(effect=effects[name], sites=tuple(sites), shared=shared)
            structure = structure.with_term(term)
        return structure, unpacked(values)[0]

    def _at_floor(self, current: Fit, base: Evidence) -> bool:
        """Whether a fit leaves nothing to explain, in stretches or in what the gap is told of.

        Each stretch starts from a smoothed state, whose error is all that is left of the gap where
        a log has no noise, as one of another simulator.
        """
        held, noise = self._problem.held, self._problem.noise
        told = Objective(held.told, self._problem.channels, held.objective.floor)
        as_told = told.as_it_is([_case(current)])[0][0]
        # What half the timestep changes is taken out already, though not to the last digit.
        blurred = np.minimum(np.hypot(noise, held.objective.numerical_size()), _BLURRED * noise)
        return bool(
            (np.sqrt(as_told) <= _AT_FLOOR * noise).all()
            or (np.sqrt(base.mean_square[0]) <= _AT_FLOOR * blurred).all()
        )

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
        for _ in range(_WARM):
            further = fit(objective, [warm[k] for k in chosen], iterations=1, near=current)
            for k, one in zip(chosen, further, strict=True):
                warm[k] = one
            chosen.sort(key=lambda k: warm[k].score)
            least = view.score - _OF_THE_BEST * (view.score - warm[chosen[0]].score)
            near = [k for k in chosen if warm[k].score < least]
            chosen = max(near, chosen[:_FEWEST_SINGLES], key=len)[: _KEPT_WARM * _MOST_SINGLES]
        chosen = list(dict.fromkeys([*chosen[:_MOST_SINGLES], *by_promise[:_FEWEST_SINGLES]]))
        return [(warm[k].structure, warm[k].values) for k in chosen]

    def _terms(self, structure: Structure) -> list[Term]:
        """Every effect where it could be added: those present only at places without them."""
        present = {term.effect.name: term for term in structure.terms}
        found = []
        for term in candidate_terms(self._effects, self._problem.robots, self._problem.joints):
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

    def _contest(self, current: Fit, term: Term) -> _Contest:
        """Compares an effect with those that could be in its place."""
        problem, objective = self._problem, self._problem.fit.objective
        others = current.structure.without_term(term)
        (alone,) = refit(problem, current, [others])
        rivals = self._rivals(alone, term.effect) if term.effect.fitted else []
        self._refine(current)
        mine = others.with_term(term)
        starts = [(mine, carried(current.values, current.structure, mine))]
        own, *fits = evaluate(
            objective, [*starts, *((one.structure, one.values) for one in rivals)]
        )
        # Those that come near get what the named one has had: a fit to all recordings.
        near = [
            k
            for k, one in enumerate(fits)
            if len(problem.channels) * (one.score - own.score) < _NEAR
        ]
        fitted = fit(objective, [fits[k] for k in near], iterations=_REFITS, near=own)
        for k, one in zip(near, fitted, strict=True):
            fits[k] = one
        evidence = weigh(problem, [own, *fits, alone])
        contest = evidence.some(range(len(fits) + 1))
        better = [
            k
            for k, one in enumerate(fits, start=1)
            if self._is_better(contest, k, _size(one) > _size(own))
            or (_more_ordinary(one, own) and tied(contest, len(problem.channels), k))
        ]
        return _Contest(
            fits=(own, *fits),
            evidence=evidence,
            close=tuple(close_to(contest, len(problem.channels))),
            better=fits[min(better, key=lambda k: contest.both[k]) - 1] if better else None,
        )

    def _rivals(self, alone: Fit, effect: Effect) -> list[Fit]:
        """The best effects in place of one, on top of the others; few generalisations of it."""
        tried = self._try(alone, None, self._likes(alone.structure, effect))
        singles = [
            i
            for i in np.argsort(tried.evidence.both, kind="stable").tolist()
            if len(tried.fits[i].structure.terms) == len(alone.structure.terms) + 1
            and _is_rival(tried.fits[i].structure.terms[-1].effect, effect)
        ]
        return [tried.fits[i] for i in singles[:_MOST_RIVALS]]

    def _likes(self, others: Structure, effect: Effect) -> frozenset[str] | None:
        """Effects that promised enough, when last seen without this one, to stand in for it."""
        best: dict[str, float] = {}
        for key, promised in self._promised.items():
            if effect.name in promised and {name for name, _, _ in key} <= set(_names(others)):
                best = promised
        if best.get(effect.name, 0.0) <= 0:
            return None
        least = _LIKE * best[effect.name]
        return frozenset(name for name, promise in best.items() if promise >= least)

    def _is_better(self, contest: Evidence, k: int, larger: bool) -> bool:
        if 0 in close_to(contest, len(self._problem.channels), first=k):
            return False
        better = bool(contest.both[k] < contest.both[0])
        return better and (not larger or worth_it(self._problem, contest, k))

    def _told(
        self, current: Fit, base: Evidence, contests: Sequence[_Contest]
    ) -> tuple[Round, ...]:
        """The explanation effect by effect, and what was tried in vain after it."""
        problem, terms = self._problem, current.structure.terms
        firsts = [Structure(terms[: k + 1], problem.robots) for k in range(len(terms) - 1)]
        fits = [*refit(problem, current, firsts), current][: len(terms)]
        rounds = []
        for one, term, contest in zip(fits, terms, contests, strict=True):
            held = contest.evidence.held
            order = sorted(range(1, len(contest.fits)), key=lambda k: contest.evidence.both[k])
            rounds.append(
                Round(
                    candidates=tuple(
                        Candidate(
                            term=contest.fits[k].structure.terms[-1],
                            gain=float(held[-1] - held[k]),
                            close=k in contest.close,
                            fit=contest.fits[k],
                        )
                        for k in (0, *order)
                    ),
                    named=term,
                    confidence=confidence(
                        contest.evidence.some(range(len(contest.fits))), len(problem.channels)
                    ),
                    fit=one,
                    evidence=weigh(problem, [one]),
                )
            )
        tried = self._try(current, base)
        order = np.argsort(tried.evidence.both, kind="stable").tolist()
        vain = [i for i in order if len(tried.fits[i].structure.terms) == len(terms) + 1]
        rounds.append(
            Round(
                candidates=tuple(
                    Candidate(
                        term=tried.fits[i].structure.terms[-1],
                        gain=float(base.held[0] - tried.evidence.held[i]),
                        close=False,
                        fit=tried.fits[i],
                    )
                    for i in vain
                ),
                named=None,
                confidence=0.0,
                fit=current,
                evidence=base,
                one_sided=bool(tried.fits)
                and one_sided(problem, Evidence.joined([base, tried.evidence])),
            )
        )
        return tuple(rounds)

    def _settled(self, current: Fit) -> tuple[Fit, Evidence]:
        """The fit in the light of its own numerical error, which the problem has from then on."""
        objective = self._problem.fit.objective
        for _ in range(_PASSES):
            before = current.values
            self._refine(current)
            start = evaluate(objective, [(current.structure, before)])[0]
            current = fit(objective, [start], iterations=_REFITS)[0]
            moved = np.abs(current.values - before) / current.structure.scale
            if not (moved > _SETTLED).any():
                break
        base = weigh(self._problem, [current])
        if not self._at_floor(current, base):
            better = scanned(self._problem, current)
            if better is not current:
                self._refine(better)
                current, base = better, weigh(self._problem, [better])
        return current, base

    def _finalist(self, current: Fit) -> tuple[Fit, Evidence]:
        """As the present explanation was: fitted to all recordings, its numerical error its own."""
        objective = self._problem.fit.objective
        self._refine(current)
        (start,) = evaluate(objective, [(current.structure, current.values)])
        (current,) = fit(objective, [start], iterations=_REFITS)
        return current, weigh(self._problem, [current])

    def _refine(self, current: Fit) -> None:
        for half in (self._problem.fit, self._problem.held):
            half.refine(current)

    def _kept(self, current: Fit, added: Sequence[Effect]) -> Fit:
        """The fit with the added effects where they are needed, and others while they still are."""
        one_each = merged(current.structure)
        values = carried(current.values, current.structure, one_each)
        current = replace(current, structure=one_each, values=values)
        self._problem.race.refine(current)
        self._refine(current)
        for effect in added:
            term = next(term for term in current.structure.terms if term.effect is effect)
            current = places_needed(self._problem, current, term)
        return self._without_the_uncertain(self._without_the_needless(current))

    def _without_the_needless(self, current: Fit) -> Fit:
        """The fit without effects that those named after them have made superfluous."""
        for term in current.structure.terms:
            if len(current.structure.terms) == 1 or not term.effect.fitted:
                continue
            (smaller,) = refit(self._problem, current, [current.structure.without_term(term)])
            if not self._worth_it(current, weigh(self._problem, [smaller, current]), 1):
                current = smaller
        return current

    def _without_the_uncertain(self, current: Fit) -> Fit:
        """The fit of several effects without those none of whose values is known to be there."""
        problem = self._problem
        while len(current.structure.terms) > 1:
            (one,) = evaluate(problem.fit.objective, [(current.structure, current.values)])
            sure = certainty(problem.fit.objective, one, problem.noise)
            known = {
                term: float(sure[one.structure.columns(term)].max())
                for term in one.structure.terms
                if term.effect.fitted
            }
            least = min(known, key=known.__getitem__, default=None)
            if least is None or known[least] >= _CERTAIN:
                break
            (current,) = refit(problem, current, [current.structure.without_term(least)])
        return current

    def _worth_it(self, one: Fit, evidence: Evidence, k: int, base: int = 0) -> bool:
        """Whether a fit, the `k`th of the evidence, is worth it over the one at `base`."""
        effects = len(one.structure.terms)
        return worth_it(self._problem, evidence, k, base, effects=effects)


def _is_rival(other: Effect, effect: Effect) -> bool:
    """Whether another effect could be what an effect was taken for."""
    only_larger = effect.name in other.extends and effect.name not in other.usually
    return other is not effect and not only_larger


def _case(one: Fit) -> Case:
    return Case(structure=one.structure, values=one.values[None])


def _key(structure: Structure) -> _Key:
    return frozenset(structure.key)


def _more_ordinary(one: Fit, other: Fit) -> bool:
    """Whether the last effect of a fit is one that every model has a little wrong."""
    return one.structure.terms[-1].effect.ordinary and not other.structure.terms[-1].effect.ordinary


def _names(structure: Structure) -> list[str]:
    return [term.effect.name for term in structure.terms]


def _promised(view: View) -> dict[str, float]:
    """Effect to what it promises to take off the score."""
    found: dict[str, float] = {}
    for i, candidate in enumerate(view.candidates):
        name = candidate.term.effect.name
        found[name] = max(found.get(name, 0.0), view.score - view.promise([i]))
    return found


def _size(one: Fit) -> tuple[int, int]:
    """Number of effects, and of the last one's values at a place."""
    terms = one.structure.terms
    return len(terms), len(one.values)


def _finalists(evidence: Evidence) -> list[int]:
    """Candidates that could still win, best first; the first fit of the evidence is the base."""
    gain = evidence.both[0] - evidence.both[1:]
    order = np.argsort(-gain, kind="stable")[:_MOST_FINALISTS]
    return [int(i) for i in order if gain[i] > max(0.0, _IN_REACH * gain.max())]


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
