"""Naming: which effects explain the held-out recordings, how sure each is, and what else could be.

Each round tries every effect on top of those already named (`trying`). One is named when it makes
the held-out gaps smaller by more than chance (block bootstrap) and by a margin that matters: above
the measurement's noise and above the simulation's own numerical error. Then the places that do not
need it are dropped, everything is fitted jointly, and effects that are no longer needed leave again
(`keeping`). At the end each named effect meets its rivals (`contest`): a better one takes its
place, those as good are its confusion set. What is left is fitted over whole rollouts.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.contest import Contest, contests, plainer, size_of
from walkerkit.gap.search.evidence import Evidence, weigh, weigh_as_told
from walkerkit.gap.search.fit import Progress, evaluate
from walkerkit.gap.search.keeping import finalists, kept, over_whole, settled, where_certain
from walkerkit.gap.search.places import refit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Case, Fit, Structure, Term, candidate_terms
from walkerkit.gap.search.trying import Key, Tried, Tries, key_of
from walkerkit.gap.search.worth import confidence, one_sided, only_fitted, tied, worth_it

_LEFT_OF_THE_GAP = 0.6  # of a joint's, where most of it was numerical
_NEARLY_NOTHING = 0.1  # of all joints', where it was nothing else
_FAR_ABOVE, _OF_THE_MOTION = 10.0, 0.007  # of the noise, and of how far a joint moves
_MOST_FINALISTS = 3
_IN_REACH = 0.5  # of the best gain
_CHANCE = 0.05
_MOST_EXCHANGES = 3
_SEEN, _MOST_AHEAD = 0.25, 2  # of the gaps of what was fitted; how many are looked beyond


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
        whole: the fit is one to whole rollouts, not to stretches of them.
    """

    candidates: tuple[Candidate, ...]
    named: Term | None
    confidence: float
    fit: Fit
    evidence: Evidence
    one_sided: bool = False
    whole: bool = False


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
    tries = Tries(problem, effects, progress)
    (nothing,) = evaluate(problem.fit.objective, [(problem.nothing, np.zeros(0))])
    current, base = settled(problem, _simulated_well(problem, effects, nothing))
    exchanges, been = 0, set[Key]()
    while True:
        been.add(key_of(current.structure))
        grown = _grown(problem, tries, current, base, been)
        if grown is not None:
            current, base = grown
            continue
        met = contests(problem, tries, current)
        exchanged = _exchanged(problem, tries, base, met) if exchanges < _MOST_EXCHANGES else None
        if exchanged is not None:
            exchanges += 1
            current, base = exchanged
            continue
        problem.refine(current)
        certain = where_certain(problem, current, effects, whole=True)
        if certain is current:
            break
        current, base = settled(problem, certain)
    whole = over_whole(problem, current)
    if whole is not None:
        current = whole
        problem.refine(current)
        base = weigh(problem, [current])
    return _told(problem, tries, current, base, met, whole=whole is not None)


def _simulated_well(problem: Problem, effects: Sequence[Effect], nothing: Fit) -> Fit:
    """The robot as it is, or in a simulation that is good enough for these recordings.

    The numerical error is taken out of every comparison. Where it is most of a joint's gap, far
    above the noise and a part of the motion that matters, it is an effect of its own, and the
    model is to be simulated otherwise. That has to show at the finest timestep, too, unless hardly
    anything is left, as of a log of another simulator: another integrator may stand in for what is
    really missing, as a drive's damping.
    """
    terms = [
        term
        for term in candidate_terms(effects, problem.robots, problem.joints)
        if not term.effect.fitted
    ]
    objective = problem.held.objective
    before = objective.as_it_is([nothing.case])[0][0]
    before = np.where(np.isnan(before), np.inf, before)  # a model that diverges
    motion = np.nanstd(objective.measured, axis=0)
    of_position = np.array([channel.signal == "position" for channel in objective.channels])
    least = np.maximum(_FAR_ABOVE * problem.noise, _OF_THE_MOTION * motion)
    best = nothing
    for term in terms:
        structure = nothing.structure.with_term(term)
        magnitudes = zip(*(slot.parameter.starts for slot in structure.slots), strict=True)
        values = np.array(list(magnitudes))
        tried = objective.as_it_is([Case(structure=structure, values=values)])[0]
        gained = np.sqrt(np.maximum(before - tried, 0.0)) > least
        most = (gained & (tried < _LEFT_OF_THE_GAP**2 * before) & of_position).any(axis=1)
        nearly_all = (tried < _NEARLY_NOTHING**2 * before)[:, of_position].all(axis=1)
        finest = values[:, 0] == values[:, 0].min()
        right = most & (nearly_all | most[finest].any())
        if right.any():
            k = int(np.argmin(np.where(right, objective.score(tried), np.inf)))
            (best,) = evaluate(problem.fit.objective, [(structure, values[k])])
    return best


def _grown(
    problem: Problem, tries: Tries, current: Fit, base: Evidence, been: Collection[Key]
) -> tuple[Fit, Evidence] | None:
    """The fit with some more effects, none of those that have `been`; None if none is worth it.

    Each of two effects may need the other before it helps with recordings that no fit has seen. So
    where nothing is worth it, the search goes on from what helps much with those that were fitted.
    """
    tried = tries.on_top_of(current, base)
    found = _worthy(problem, tries.effects, current, base, tried, been)
    for one in _seen(current, base, tried):
        if found is None:
            ahead = tries.on_top_of(one, None)
            found = _worthy(problem, tries.effects, current, base, ahead, been)
    if found is None:
        problem.refine(current)
    return found


def _seen(current: Fit, base: Evidence, tried: Tried) -> list[Fit]:
    """The single effects that make the gaps of what was fitted much smaller, best first."""
    fitted, count = tried.evidence.fitted, len(current.structure.terms) + 1
    seen = [
        i
        for i, one in enumerate(tried.fits)
        if len(one.structure.terms) == count and base.fitted[0] - fitted[i] >= _SEEN
    ]
    return [tried.fits[i] for i in sorted(seen, key=lambda i: fitted[i])[:_MOST_AHEAD]]


def _worthy(
    problem: Problem,
    effects: Sequence[Effect],
    current: Fit,
    base: Evidence,
    tried: Tried,
    been: Collection[Key],
) -> tuple[Fit, Evidence] | None:
    """The best of what was tried, with what of it is needed, where it is worth more than a fit."""
    fits, evidence = list(tried.fits), Evidence.joined([base, tried.evidence])
    refined: set[int] = set()

    def with_own_numerical_error(some: Sequence[int]) -> None:
        nonlocal evidence
        for i, (one, found) in zip(some, finalists(problem, [fits[i] for i in some]), strict=True):
            fits[i], evidence = one, evidence.replaced(i + 1, found)
            refined.add(i)

    # The numerical error was that of the current model; those who could win get their own.
    with_own_numerical_error(_could_win(fits, evidence))
    open_to = list(range(len(fits)))
    for _ in range(_MOST_FINALISTS):
        winner = _winner(problem, fits, evidence, open_to)
        while winner is not None and winner not in refined:
            with_own_numerical_error([winner])
            winner = _winner(problem, fits, evidence, open_to)
        if winner is None:
            break
        added = fits[winner].structure.terms[len(current.structure.terms) :]
        found = kept(problem, fits[winner], [term.effect for term in added], effects)
        if key_of(found.structure) not in been:
            found, own = settled(problem, found)
            count = len(found.structure.terms)
            if worth_it(problem, Evidence.joined([base, own]), 1, effects=count):
                return found, own
        # What was added does not hold, or not where it is needed.
        open_to.remove(winner)
    return None


def _exchanged(
    problem: Problem, tries: Tries, base: Evidence, contests: Sequence[Contest]
) -> tuple[Fit, Evidence] | None:
    """A fit with a better effect in another's place, or None where none holds.

    It was found better by the numerical error of the other, and before what it does not need was
    dropped; by its own it may be worse, and the other would be found better again.
    """
    every = [better for one in contests for better in one.better]
    for better in sorted(every, key=lambda one: one.score):
        known = better.than.structure.terms
        added = [term.effect for term in better.fit.structure.terms if term not in known]
        found, evidence = settled(problem, kept(problem, better.fit, added, tries.effects))
        both = Evidence.joined([base, evidence])
        if (
            both.both[1] < both.both[0]
            or tied(both, len(problem.channels), 1)
            or (plainer(better.fit, better.than) and not worth_it(problem, both, 0, base=1))
        ):
            return found, evidence
    return None


def _winner(
    problem: Problem, fits: Sequence[Fit], evidence: Evidence, open_to: Sequence[int]
) -> int | None:
    """The best of some fits that is worth its number of effects and of values.

    A simpler one keeps its place unless another is worth more than it, in stretches or in whole
    rollouts: a stretch starts where the robot was, and forgives what has led elsewhere by then.
    """

    def worth(i: int, base: int) -> bool:
        effects = len(fits[i].structure.terms)
        return worth_it(problem, evidence, i + 1, base, effects=effects)

    def worth_more(i: int, than: int) -> bool:
        if worth(i, than + 1):
            return True
        if not problem.told_soon(problem.held):
            return False
        told = weigh_as_told(problem, [fits[than], fits[i]])
        return worth_it(problem, told, 1, effects=len(fits[i].structure.terms))

    size = [size_of(one) for one in fits]
    order = sorted(open_to, key=lambda i: (size[i], evidence.both[i + 1]))
    winner = None
    for i in order:
        if not worth(i, 0):
            continue
        if winner is None or (
            evidence.both[i + 1] < evidence.both[winner + 1]
            and (size[i] == size[winner] or worth_more(i, winner))
        ):
            winner = i
    return winner


def _told(
    problem: Problem,
    tries: Tries,
    current: Fit,
    base: Evidence,
    contests: Sequence[Contest],
    *,
    whole: bool,
) -> tuple[Round, ...]:
    """The explanation effect by effect, and what was tried in vain after it."""
    terms = current.structure.terms
    firsts = [Structure(terms[: k + 1], problem.robots) for k in range(len(terms) - 1)]
    fits = [*refit(problem, current, firsts), current][: len(terms)]
    rounds = []
    for one, term, met in zip(fits, terms, contests, strict=True):
        held = met.evidence.held
        order = sorted(range(1, len(met.fits)), key=lambda k: met.evidence.both[k])
        rounds.append(
            Round(
                candidates=tuple(
                    Candidate(
                        term=met.fits[k].structure.terms[-1],
                        gain=float(held[-1] - held[k]),
                        close=k in met.close,
                        fit=met.fits[k],
                    )
                    for k in (0, *order)
                ),
                named=term,
                confidence=confidence(
                    met.evidence.some(range(len(met.fits))), len(problem.channels)
                ),
                fit=one,
                evidence=weigh(problem, [one]),
            )
        )
    tried = tries.on_top_of(current, base)
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
            one_sided=one_sided(problem, Evidence.joined([base, tried.evidence]))
            if tried.fits
            else only_fitted(problem, base),
            whole=whole,
        )
    )
    return tuple(rounds)


def _could_win(fits: Sequence[Fit], evidence: Evidence) -> list[int]:
    """Candidates that could still win, best first; the first fit of the evidence is the base.

    One that is behind the best by more than chance can win only if it is simpler.
    """
    gain = evidence.both[0] - evidence.both[1:]
    order = [int(i) for i in np.argsort(-gain, kind="stable")[:_MOST_FINALISTS]]
    resampled = evidence.both_resampled[:, 1:]

    def in_reach(i: int) -> bool:
        best = order[0]
        ahead = np.mean(resampled[:, i] <= resampled[:, best])
        return size_of(fits[i]) < size_of(fits[best]) or bool(ahead > _CHANCE)

    least = max(0.0, _IN_REACH * gain.max(initial=0.0))
    return [i for i in order if gain[i] > least and in_reach(i)]
