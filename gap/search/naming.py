"""Naming: forward selection of effects on held-out recordings, with a look back.

Each round screens and fits every effect that is left, on top of those already named. One that
usually acts on all joints alike is tried with one value for all and with one each, which must be
worth their number. An effect is named when it makes the held-out gaps smaller by more than chance
(block bootstrap) and by a margin that matters: above the measurement's noise and above the
simulation's own numerical error. Then the places that do not need it are dropped, everything is
fitted jointly, and effects that are no longer needed leave again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.evidence import Evidence, weigh
from walkerkit.gap.search.fit import Fit, Progress, evaluate, fit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.screen import screen
from walkerkit.gap.search.structure import Structure, Term, candidate_terms, carried

FloatArray = NDArray[np.float64]

MOST_EFFECTS = 5
_AT_FLOOR = 1.15  # gaps within this factor of the noise leave nothing to explain
_MARGIN = 0.04  # an effect makes gaps at least four per cent smaller, in the geometric mean
_CHANCE = 0.05
_OVER_NOISE = 0.5  # what an effect explains of some channel, over its noise
_OVER_NUMERICAL = 0.4  # and over what half the timestep changes, which is taken out already
_CLOSE = 0.02  # scores this near are the same explanation
_PLACE = 0.005  # a place whose loss costs less does not need the effect
_REFITS = 4
_PASSES = 2  # of fitting and finding the numerical error again
_SETTLED = 0.05  # of a parameter's scale
_MOST_FINALISTS = 3
_IN_REACH = 0.5  # of the best gain


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One effect of one round.

    Attributes:
        term: the effect at all its sites.
        gain: how much it lowers the score of the held-out recordings.
        close: it explains the recordings as well as the one that was named.
        fit: the effect on top of those named before.
    """

    term: Term
    gain: float
    close: bool
    fit: Fit


@dataclass(frozen=True, kw_only=True)
class Round:
    """One step of the selection.

    Attributes:
        candidates: every effect that was tried, best first.
        named: the term that was added, or None where nothing was worth it.
        confidence: how often resampled recordings prefer it, ties shared.
        fit: everything named so far, fitted jointly.
        evidence: what the recordings say of that fit, in the light of its own numerical error.
    """

    candidates: tuple[Candidate, ...]
    named: Term | None
    confidence: float
    fit: Fit
    evidence: Evidence


def name_effects(
    problem: Problem, effects: Sequence[Effect], progress: Progress | None = None
) -> tuple[Round, ...]:
    """Names effects until nothing more is worth it.

    Args:
        problem: what is to be explained.
        effects: the catalogue.
        progress: called now and then.

    Returns:
        The rounds; the last one's fit is the explanation. Never empty.
    """
    nothing = evaluate(problem.fit.objective, [(problem.nothing, np.zeros(0))])[0]
    state = _settled(problem, nothing)
    rounds: list[Round] = []
    while True:
        step = _round(problem, effects, *state, len(rounds) + 1, progress)
        rounds.append(step)
        if step.named is None or len(rounds) == MOST_EFFECTS:
            _refine(problem, step.fit)
            return tuple(rounds)
        kept = _without_the_needless(problem, step.fit)
        state = step.fit, step.evidence
        if kept is not step.fit:
            state = _settled(problem, kept)
            rounds[-1] = replace(step, fit=state[0], evidence=state[1])


def _round(
    problem: Problem,
    effects: Sequence[Effect],
    current: Fit,
    base: Evidence,
    number: int,
    progress: Progress | None,
) -> Round:
    nothing = Round(candidates=(), named=None, confidence=0.0, fit=current, evidence=base)
    if (np.sqrt(base.mean_square[0]) <= _AT_FLOOR * problem.noise).all():
        return nothing
    present = {term.effect.name for term in current.structure.terms}
    left = [effect for effect in effects if effect.name not in present]
    terms = candidate_terms(left, problem.robots, problem.joints)
    if not terms:
        return nothing
    stage = f"effect {number}: {{}} {len(terms)} candidates"
    if progress:
        progress(stage.format("screening"), 0.0)
    race = problem.race
    if race is not problem.fit:
        race.refine(current)
    (start,) = evaluate(race.objective, [(current.structure, current.values)])
    starts = screen(race.objective, start, [one for term in terms for one in term.variants])
    tried = fit(race.objective, starts, race=True, progress=progress, stage=stage.format("fitting"))
    weighed = weigh(problem, tried)
    kept = _simplest(problem, tried, weighed)
    fits = [tried[i] for i in kept]
    evidence = Evidence.joined([base, *(weighed.only(i) for i in kept)])
    # The numerical error was that of the current model; those who could win get their own.
    for i in _finalists(evidence):
        fits[i], own = _settled(problem, fits[i])
        evidence = evidence.replaced(i + 1, own)
    order = [int(i) for i in np.argsort(evidence.both[1:], kind="stable")]
    acceptable = [i for i in order if _worth_it(problem, evidence, i + 1)]
    if not acceptable:
        return replace(nothing, candidates=_candidates(evidence, fits, order, set()))
    # A rival has to hold on recordings that it was not fitted to, as the winner does.
    winner, rivals = acceptable[0], acceptable[1:]
    settled, own = _settled(problem, fits[winner])
    found = _places_needed(problem, settled)
    if found is not settled:
        found, own = _settled(problem, found)
    contest = Evidence.joined([own, *(evidence.only(i + 1) for i in rivals)])
    close = {rivals[k - 1] for k in _close_to_first(contest)}
    return Round(
        candidates=_candidates(evidence, fits, [winner, *(i for i in order if i != winner)], close),
        named=found.structure.terms[-1],
        confidence=_confidence(contest),
        fit=found,
        evidence=own,
    )


def _simplest(problem: Problem, fits: Sequence[Fit], evidence: Evidence) -> list[int]:
    """Of every effect the first variant, unless one with more values is worth them."""
    chosen: dict[str, int] = {}
    for i, one in enumerate(fits):
        effect = one.structure.terms[-1].effect.name
        if effect not in chosen or _worth_it(
            problem, Evidence.joined([evidence.only(chosen[effect]), evidence.only(i)]), 1
        ):
            chosen[effect] = i
    return list(chosen.values())


def _settled(problem: Problem, current: Fit) -> tuple[Fit, Evidence]:
    """The fit in the light of its own numerical error, which `problem` has from then on."""
    for _ in range(_PASSES):
        before = current.values
        _refine(problem, current)
        start = evaluate(problem.fit.objective, [(current.structure, before)])[0]
        current = fit(problem.fit.objective, [start], iterations=_REFITS)[0]
        moved = np.abs(current.values - before) / current.structure.scale
        if not (moved > _SETTLED).any():
            break
    return current, weigh(problem, [current])


def _refine(problem: Problem, current: Fit) -> None:
    for half in (problem.fit, problem.held):
        half.refine(current)


def _finalists(evidence: Evidence) -> list[int]:
    """Candidates that could still win, best first; the first fit of the evidence is the base."""
    gain = evidence.both[0] - evidence.both[1:]
    order = np.argsort(-gain, kind="stable")[:_MOST_FINALISTS]
    return [int(i) for i in order if gain[i] > max(_MARGIN / 2, _IN_REACH * gain.max())]


def _worth_it(problem: Problem, evidence: Evidence, k: int) -> bool:
    """Whether fit `k` improves on fit 0 by more than chance and by what matters."""
    gain = evidence.held[0] - evidence.held[k]
    by_chance = np.mean(evidence.held_resampled[:, 0] <= evidence.held_resampled[:, k])
    explained = np.sqrt(np.maximum(evidence.mean_square[0] - evidence.mean_square[k], 0))
    floor = _OVER_NOISE * problem.noise
    numerical = problem.held.objective.numerical
    if len(numerical):
        size = np.sqrt(problem.held.objective.mean_square(numerical)[0])
        floor = np.maximum(floor, _OVER_NUMERICAL * size)
    return bool(gain >= _MARGIN and by_chance < _CHANCE and (explained > floor).any())


def _candidates(
    evidence: Evidence,
    fits: Sequence[Fit],
    order: Sequence[int],
    close: set[int],
) -> tuple[Candidate, ...]:
    """Candidates of a round, in an order of theirs."""
    return tuple(
        Candidate(
            term=fits[i].structure.terms[-1],
            gain=float(evidence.held[0] - evidence.held[i + 1]),
            close=i in close,
            fit=fits[i],
        )
        for i in order
    )


def _close_to_first(contest: Evidence) -> list[int]:
    """Fits that explain as well as fit 0: by score, or in more than chance of the resamples."""
    ahead = np.mean(contest.both_resampled <= contest.both_resampled[:, :1], axis=0)
    near = contest.both - contest.both[0] < _CLOSE
    return [k for k in range(1, len(near)) if near[k] or ahead[k] > _CHANCE]


def _confidence(contest: Evidence) -> float:
    """How often fit 0 is best in resampled recordings, ties shared."""
    scores = contest.both_resampled
    best = scores < scores.min(axis=1, keepdims=True) + 0.5 * _CLOSE
    return float((best[:, 0] / best.sum(axis=1)).mean())


def _places_needed(problem: Problem, full: Fit) -> Fit:
    """The fit with its last term only at the places that need it."""
    term = full.structure.terms[-1]
    while len(term.places) > 1:
        without = [
            replace(term, sites=tuple(other for other in term.sites if other != site))
            for site in term.sites
        ]
        fits = [_refit(problem, full, _replaced(full.structure, term, t)) for t in without]
        evidence = weigh(problem, [full, *fits])
        harm = evidence.both[1:] - evidence.both[0]
        needless = [site for site, cost in zip(term.sites, harm, strict=True) if cost < _PLACE]
        if not needless:
            break
        kept = tuple(site for site in term.sites if site not in needless)
        if not kept:  # each can stand in for the others: the one that is missed most stays
            kept = (term.sites[int(np.argmax(harm))],)
        smaller = replace(term, sites=kept)
        found = _refit(problem, full, _replaced(full.structure, term, smaller))
        if weigh(problem, [full, found]).both @ np.array([-1.0, 1.0]) > _PLACE * len(needless):
            # Together they are needed: drop only the one that is missed least.
            k = int(np.argmin(harm))
            smaller, found = without[k], fits[k]
        full, term = found, smaller
    return full


def _replaced(structure: Structure, old: Term, new: Term) -> Structure:
    terms = tuple(new if term is old else term for term in structure.terms)
    return Structure(terms, structure.robots)


def _refit(problem: Problem, source: Fit, structure: Structure) -> Fit:
    """Another structure, fitted from the values that both have."""
    values = carried(source.values, source.structure, structure)
    start = evaluate(problem.fit.objective, [(structure, values)])[0]
    return fit(problem.fit.objective, [start], iterations=_REFITS)[0]


def _without_the_needless(problem: Problem, current: Fit) -> Fit:
    """The fit without effects that those named after them have made superfluous."""
    for term in current.structure.terms[:-1]:
        terms = tuple(other for other in current.structure.terms if other is not term)
        smaller = _refit(problem, current, Structure(terms, problem.robots))
        evidence = weigh(problem, [smaller, current])
        if not _worth_it(problem, evidence, 1):
            current = smaller
    return current
