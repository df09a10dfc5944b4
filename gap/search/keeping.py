"""Keeping: what stays of the effects that were added to a fit, and the fit in its final form.

A fit is settled when it suits all recordings that are fitted, in the light of its own numerical
error. What was added stays only at the places that need it, and what was there before only while
it still is needed. At the end the whole explanation is fitted over whole rollouts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.certainty import certainty
from walkerkit.gap.search.evidence import Evidence, weigh, weigh_by
from walkerkit.gap.search.fit import evaluate, fit, polished
from walkerkit.gap.search.places import places_needed, refit
from walkerkit.gap.search.problem import Problem, refined_apart
from walkerkit.gap.search.scan import scanned
from walkerkit.gap.search.screen import screen
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit, candidate_terms, carried, merged
from walkerkit.gap.search.worth import much_is_lost, much_is_lost_at_a_joint, worth_it

FloatArray = NDArray[np.float64]

_AT_FLOOR = 1.15  # gaps within this factor of the noise leave nothing to explain
_BLURRED = 1.4  # as far as numerical errors raise that noise, at most
_REFITS = 4
_PASSES = 2  # of fitting and finding the numerical error again
_LEAPS = 3  # after each of which the numerical error is another
_SETTLED = 0.05  # of a parameter's scale
_AS_GOOD = 0.02  # of a score
_CERTAIN, _OF_KNOWN_SIGN = 2.0, 1.0  # standard errors from where a value changes nothing


def settled(problem: Problem, current: Fit) -> tuple[Fit, Evidence]:
    """The fit in the light of its own numerical error, which the problem has from then on."""
    for _ in range(_PASSES):
        before = current.values
        current = _refitted(problem, current)
        moved = np.abs(current.values - before) / current.structure.scale
        if not (moved > _SETTLED).any():
            break
    base = weigh(problem, [current])
    for _ in range(_LEAPS):
        if at_floor(problem, current, base):
            break
        problem.race.refine(current)
        better = scanned(problem.fit.objective, current, on=problem.race.objective)
        if better is current:
            break
        problem.refine(better)
        current, base = better, weigh(problem, [better])
    return current, base


def over_whole(problem: Problem, current: Fit) -> Fit | None:
    """The fit over the horizon that the gap is told of; None where that is the same, or misleads.

    Each stretch starts from a measured state, whose noise draws the values a little. But where
    rollouts diverge, as of a robot that is not stable, only stretches tell what is right.
    """
    whole = problem.whole
    if whole is problem.fit or not len(current.values):
        return None
    whole.refine(current)
    (found,) = polished(whole.objective, [current], iterations=_REFITS)
    before, after = weigh(problem, [current, found]).both
    return found if after < before + _AS_GOOD else None


def finalists(problem: Problem, fits: Sequence[Fit]) -> list[tuple[Fit, Evidence]]:
    """As the present explanation was: fitted to all recordings, their numerical errors their own.

    The problem has that of the last.
    """
    if not fits:
        return []
    own = refined_apart([problem] * len(fits), fits)
    problem.refine(fits[-1])  # which is known now
    found = polished(
        problem.fit.objective, fits, iterations=_REFITS, own=[fitted for fitted, _ in own]
    )
    return [
        (one, weigh_by(fitted, held, [one])) for one, (fitted, held) in zip(found, own, strict=True)
    ]


def _refitted(problem: Problem, current: Fit) -> Fit:
    problem.refine(current)
    (found,) = polished(problem.fit.objective, [current], iterations=_REFITS)
    return found


def at_floor(problem: Problem, current: Fit, base: Evidence) -> bool:
    """Whether a fit leaves nothing to explain, in stretches or in what the gap is told of.

    Each stretch starts from a smoothed state, whose error is all that is left of the gap where
    a log has no noise, as one of another simulator.
    """
    noise = problem.noise
    as_told = problem.told.as_it_is([current.case])[0][0]
    # What half the timestep changes is taken out already, though not to the last digit.
    numerical = problem.held.objective.numerical_size()
    blurred = np.minimum(np.hypot(noise, numerical), _BLURRED * noise)
    return bool(
        (np.sqrt(as_told) <= _AT_FLOOR * noise).all()
        or (np.sqrt(base.mean_square[0]) <= _AT_FLOOR * blurred).all()
    )


def kept(problem: Problem, current: Fit, added: Sequence[Effect], effects: Sequence[Effect]) -> Fit:
    """The fit with the added effects where they are needed, and others while they still are.

    Args:
        problem: what is to be explained.
        current: the fit.
        added: those of its effects that are new.
        effects: the catalogue.
    """
    one_each = merged(current.structure)
    values = carried(current.values, current.structure, one_each)
    current = replace(current, structure=one_each, values=values)
    problem.race.refine(current)
    problem.refine(current)
    for effect in added:
        term = next(term for term in current.structure.terms if term.effect is effect)
        current = places_needed(problem, current, term)
    return where_certain(problem, _without_the_needless(problem, current), effects, whole=False)


def _without_the_needless(problem: Problem, current: Fit) -> Fit:
    """The fit without effects that those named after them have made superfluous."""
    slopes = None
    for term in current.structure.terms:
        if len(current.structure.terms) == 1 or not term.effect.fitted:
            continue
        slopes = slopes or linearised(problem.race.objective, current)
        (smaller,) = refit(problem, current, [current.structure.without_term(term)], slopes)
        evidence = weigh(problem, [smaller, current])
        effects = len(current.structure.terms)
        if not (much_is_lost(evidence, 1) or worth_it(problem, evidence, 1, effects=effects)):
            current, slopes = smaller, None
    return current


def where_certain(problem: Problem, current: Fit, effects: Sequence[Effect], *, whole: bool) -> Fit:
    """The fit without effects none of whose values is known to be there.

    Two effects that can do the same leave each other's values open, though something of them is
    there: one of them becomes an effect that it generalises, where that explains as much.

    Args:
        problem: what is to be explained.
        current: the fit.
        effects: the catalogue.
        whole: nothing is to be added, so that places and the only effect may go as well. What an
            explanation still lacks pulls the values that it has.

    Returns:
        The same fit where nothing goes; otherwise one that is to be settled.
    """
    while len(current.structure.terms) > (0 if whole else 1):
        if whole:
            problem.searched.look_at(current.case)
            problem.screen.refine(current)
        (one,) = evaluate(problem.fit.objective, [(current.structure, current.values)])
        objective, part = problem.fit.objective, problem.screen.objective
        sure = certainty(objective, one, problem.noise, part)
        smaller = _at_certain_places(problem, one, sure) if whole else None
        smaller = smaller or _without_one(problem, one, sure, effects)
        if smaller is None:
            break
        current = smaller
    return current


def _without_one(
    problem: Problem, one: Fit, sure: FloatArray, effects: Sequence[Effect]
) -> Fit | None:
    """The fit without the effect that is known least, or in plainer terms; None where all stay.

    What is felt nowhere, and what is known little beside another that is needed all the same, goes
    only where it is not worth it.
    """
    structure = one.structure
    known = {t: _most(sure[structure.columns(t)]) for t in structure.terms if t.effect.fitted}
    doubtful = [term for term in known if not _CERTAIN <= known[term] < np.inf]
    for rank, term in enumerate(sorted(doubtful, key=known.__getitem__)):
        (smaller,) = refit(problem, one, [structure.without_term(term)])
        evidence = weigh(problem, [smaller, one])
        lost = much_is_lost(evidence, 1)
        worth = lost or worth_it(problem, evidence, 1, effects=len(structure.terms))
        if not worth:
            return smaller
        if rank or np.isinf(known[term]):
            continue
        plainer = _in_plainer_terms(problem, one, effects)
        if plainer is not None or not lost:
            return plainer or smaller
    return None


def _at_certain_places(problem: Problem, one: Fit, sure: FloatArray) -> Fit | None:
    """The fit with one of its terms only where it is known to be, or None where all are needed.

    A place that is doubtful stays where it is worth it; one of which not even the direction is
    known stays only where much is lost without it.
    """
    structure = one.structure
    for term in structure.terms:
        known = {s: _most(sure[structure.columns(term, s)]) for s in term.places}
        doubtful = [site for site in known if not _CERTAIN <= known[site] < np.inf]
        if not term.effect.fitted or len(doubtful) in (0, len(known)):
            continue
        doubtful.sort(key=known.__getitem__)
        unknown = [site for site in doubtful if known[site] < _OF_KNOWN_SIGN]
        # All of them, or one by one.
        every = dict.fromkeys([tuple(doubtful), tuple(unknown), *((site,) for site in doubtful)])
        leaving = [sites for sites in every if sites]
        fewer = [
            structure.replaced(term, replace(term, sites=tuple(s for s in known if s not in gone)))
            for gone in leaving
        ]
        fits = refit(problem, one, fewer)
        evidence = weigh(problem, [one, *fits])
        for k, (gone, smaller) in enumerate(zip(leaving, fits, strict=True), start=1):
            needed = much_is_lost_at_a_joint if {*gone} <= {*unknown} else worth_it
            if not needed(problem, evidence, 0, base=k):
                return smaller
    return None


def _most(sure: FloatArray) -> float:
    """The most certain of some values; one that is not felt counts only where none is."""
    felt = sure[np.isfinite(sure)]
    return float(max(felt if felt.size else sure))


def _in_plainer_terms(problem: Problem, current: Fit, effects: Sequence[Effect]) -> Fit | None:
    """The fit with an effect in place of a generalisation of it, or None where each loses by it."""
    objective, terms = problem.race.objective, current.structure.terms
    present = {term.effect.name for term in terms}
    starts = []
    for term in terms:
        named = [e for e in effects if e.name in term.effect.extends and e.name not in present]
        others = current.structure.without_term(term)
        values = carried(current.values, current.structure, others)
        (without,) = evaluate(objective, [(others, values)])
        for plain in candidate_terms(named, problem.robots, problem.joints):
            sites = tuple(site for site in plain.sites if site in term.sites)
            if sites:
                shared = plain.shared and term.shared
                starts += screen(objective, without, [replace(plain, sites=sites, shared=shared)])
    if not starts:
        return None
    fits = [*fit(objective, starts, iterations=_REFITS)]
    evidence = weigh(problem, [current, *fits])
    as_good = [k for k in range(len(fits)) if not worth_it(problem, evidence, 0, base=k + 1)]
    return min((fits[k] for k in as_good), key=lambda one: one.score, default=None)
