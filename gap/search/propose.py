"""Proposals: which rare effects are worth a fit on top of what is there, alone or in pairs.

    proposals(problem, current, slopes, effects)    # fitted to all recordings, best first

What every effect would change is seen at little cost (`signatures`); those that promise most are
fitted together with everything that is there. A proposal decides nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Hashable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.afresh import afresh, as_given, that_leave_least
from walkerkit.gap.search.certainty import ran_away
from walkerkit.gap.search.decision import LEAST_GAIN
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.search.fit import (
    CONVERGED,
    Promise,
    evaluate,
    fit,
    polished,
    promise,
    promises,
)
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import hoped_for
from walkerkit.gap.search.signatures import View, look
from walkerkit.gap.search.slopes import Slopes, slopes_to_carry
from walkerkit.gap.search.structure import Fit, Structure, Term, carried

FloatArray = NDArray[np.float64]

_BY_PROMISE, _BY_START, _PAIRS = 8, 4, 3  # that are fitted to little of the recordings
_FEWEST = 3  # by promise, however little that is
_WARM = 2  # steps of a fit to little of the recordings
_FITTED, _REFITS = 4, 4  # structures of those that promise most of all, and steps of a fit to it
_RIVALS = 2  # structures of those that could take the place of what is ordinary
_OF_THE_LEAST = 0.7  # of the smallest gain worth a name, which more recordings may make up
_MORE_THAN_ONE = 0.2  # by which two together promise more than any one, summed over the channels
_HOPE = 0.5  # of the smallest gain worth a name, which a promise may fall short of
_UNMOVED = 1e-6  # scales that a number that does nothing may have moved
_STANDS_IN = 0.5  # of what an effect brings, that what could be in its place has to promise
_FROM_AFAR = 0.2  # of that, by a straight line from where it is left out


def proposals(
    problem: Problem,
    current: Fit,
    near: Slopes | None,
    effects: Sequence[Effect],
    progress: Progress | None = None,
    *,
    always: Collection[str] = (),
    instead_of: Fit | None = None,
    aside: Collection[str] = (),
) -> list[Fit]:
    """Fits the effects that promise most on top of a fit.

    Args:
        problem: what is to be explained.
        current: the fit.
        near: its slopes on all recordings that are fitted, for others to begin with.
        effects: those that may be added.
        progress: called now and then.
        always: names of effects that are fitted whatever they promise.
        instead_of: the fit with an effect that these are to stand in for: what promises little of
            what that brings is not fitted.
        aside: names of rare effects that came with the ground. Where the fit has no others, effects
            also begin on the model as given, without these.

    Returns:
        Fits to all recordings that are fitted, best first.
    """
    terms = _addable(problem, current.structure, effects)
    if not terms:
        return []
    stage = f"{len(terms)} candidates beside {len(current.structure.rare)} named"
    if progress:
        progress(stage, 0.0)
    starts, there = _started(problem, current, terms, always, instead_of, aside, progress, stage)
    if not starts:
        return []
    problem.fit.refine(current)
    objective = problem.fit.objective
    best = _promising(problem, current, near, starts, there, always, instead_of)
    best = [
        _where_it_stays_within_bounds(objective, with_all_of_it(objective, one, near), near)
        for one in polished(objective, best, near, iterations=_REFITS, certain=False)
    ]
    first: dict[object, Fit] = {}
    for one in sorted(best, key=lambda one: one.score):
        first.setdefault(one.structure.key, one)
    return [*first.values()]


def _started(
    problem: Problem,
    current: Fit,
    terms: Sequence[Term],
    always: Collection[str],
    instead_of: Fit | None,
    aside: Collection[str],
    progress: Progress | None,
    stage: str,
) -> tuple[list[Fit], Fit]:
    """Fits to little of the recordings of what may promise most, and what is there on that."""
    problem.searched.look_at(current.case)
    problem.screen.refine(current)
    screen = problem.screen.objective
    least = _FROM_AFAR * _brought(screen, current, instead_of)
    view = look(problem.screen, current, terms, least)
    chosen = _chosen(problem, view, always, least)
    if instead_of is None:
        chosen += [view.start(pair) for pair in _pairs(view)]
        if current.structure.rare_names <= {*aside}:
            chosen += _afresh(problem, current, terms)
    if not chosen:
        return [], current
    *begun, there = evaluate(screen, [*chosen, (current.structure, current.values)])
    near = slopes_to_carry(screen, current)
    if problem.on_feet:  # each number takes simulations of its own: its slopes are carried along
        starts = polished(screen, begun, near, iterations=_WARM, progress=progress, stage=stage)
    else:
        starts = fit(
            screen,
            begun,
            iterations=_WARM,
            leader=there.score,
            near=near,
            progress=progress,
            stage=stage,
        )
    return starts, there


def _afresh(
    problem: Problem, current: Fit, terms: Sequence[Term]
) -> list[tuple[Structure, FloatArray]]:
    """Where the effects begin that leave least on the model as given."""
    if not problem.on_feet:
        return afresh(problem.screen, current, terms, most=_BY_START)
    # One joint moves all others, so that each effect is seen place by place.
    objective, given = problem.screen.objective, as_given(current)
    (given,) = evaluate(objective, [(given.structure, given.values)])
    problem.screen.refine(given)
    starts = _chosen(problem, look(problem.screen, given, terms), (), 0.0)
    problem.screen.refine(current)
    return that_leave_least(objective, starts, _BY_START)


def _promising(
    problem: Problem,
    current: Fit,
    near: Slopes | None,
    starts: Sequence[Fit],
    there: Fit,
    always: Collection[str],
    instead_of: Fit | None,
) -> list[Fit]:
    """Of fits to little of the recordings those that promise most of all of them.

    Args:
        problem: what is to be explained, refined at the fit that is there.
        current: that fit.
        near: its slopes on all recordings that are fitted.
        starts: the fits.
        there: what is there, on as little as they are fitted to.
        always: as for `proposals`.
        instead_of: as for `proposals`.
    """
    objective = problem.fit.objective
    (own,) = evaluate(objective, [(current.structure, current.values)])
    # What gains nothing of little needs no slopes on everything.
    hopeful = [one for one in starts if one.score < there.score]
    each = promises(objective, hopeful, near)
    promised = [np.inf if one is None else one.score for one in each]
    order = each_once(hopeful, promised)
    worth = max(_OF_THE_LEAST * least_gain(problem), _brought(objective, own, instead_of))
    reach = own.score - worth
    best = of_so_many_structures([hopeful[k] for k in order if promised[k] < reach], _FITTED)
    best += [one for one in _rivals(objective, own, near, hopeful, each) if one not in best]
    # A general law promises more than its plain case, to which it may have to give way.
    plain = {name for one in best for name in one.structure.terms[-1].effect.extends}
    single = 1 + len(current.structure.terms)
    best += [
        one
        for one in starts
        if one not in best
        and (_is_of(one, always) or (_is_of(one, plain) and len(one.structure.terms) == single))
    ]
    return best


def _rivals(
    objective: Objective,
    own: Fit,
    near: Slopes | None,
    starts: Sequence[Fit],
    promised: Sequence[Promise | None],
) -> list[Fit]:
    """Of some starts those with which less of what is ordinary is wanted, most probable first.

    What is ordinary may have taken up what they would bring, by many numbers together.

    Args:
        objective: the recordings.
        own: the fit that is there.
        near: its slopes.
        starts: with one effect more.
        promised: what each promises.
    """
    if near is None:
        return []
    least = hoped_for(own.structure, promise(objective, own, near), objective.samples)
    hopes = [
        -np.inf if one is None else hoped_for(start.structure, one, objective.samples)
        for start, one in zip(starts, promised, strict=True)
    ]
    order = sorted(range(len(starts)), key=hopes.__getitem__, reverse=True)
    return of_so_many_structures([starts[k] for k in order if hopes[k] > least], _RIVALS)


def of_so_many_structures(fits: Sequence[Fit], most: int) -> list[Fit]:
    """The first of some fits, of so many structures; one may begin at several places."""
    found, seen = list[Fit](), set[Hashable]()
    for one in fits:
        seen.add(one.structure.key)
        if len(seen) > most:
            break
        found.append(one)
    return found


def each_once(fits: Sequence[Fit], promised: Sequence[float]) -> list[int]:
    """The order of fits by their promises, of those that ended at the same but one."""
    kept: list[int] = []
    for k in sorted(range(len(fits)), key=promised.__getitem__):
        same = (fits[i].structure.key == fits[k].structure.key for i in kept)
        near = (promised[k] - promised[i] < CONVERGED for i in kept)
        if not any(a and b for a, b in zip(same, near, strict=True)):
            kept.append(k)
    return kept


def with_all_of_it(objective: Objective, one: Fit, near: Slopes | None) -> Fit:
    """A fit with numbers of its newest effect where they act, if they began where they do nothing.

    No slope leads away from there: a joint that runs into its lower stop says nothing of one above
    until that is tried.
    """
    structure = one.structure
    own = structure.columns(structure.terms[-1])
    while True:
        moved = np.abs(one.values - structure.zero) / structure.scale
        idle = [k for k in own if moved[k] <= _UNMOVED]
        starts = [
            (structure, np.where(np.arange(len(one.values)) == k, value, one.values))
            for k in idle
            for value in {*structure.slots[k].parameter.starts} - {structure.zero[k]}
        ]
        begun = evaluate(objective, starts) if starts else []
        better = min(begun, key=lambda each: each.score, default=one)
        if better.score >= one.score - CONVERGED:
            return one
        (one,) = polished(objective, [better], near, iterations=_REFITS, certain=False)


def _where_it_stays_within_bounds(objective: Objective, one: Fit, near: Slopes | None) -> Fit:
    """A fit without its newest effect at places where that ran into a bound, if there are others.

    What stands in for something else at many places runs away at some; there it is not known.
    """
    while True:
        structure, term = one.structure, one.structure.terms[-1]
        stopped = ran_away(one)
        places = tuple(p for p in term.places if not stopped[structure.columns(term, p)].any())
        if not places or len(places) == len(term.places):
            return one
        fewer = structure.replaced(term, replace(term, sites=places))
        start = replace(one, structure=fewer, values=carried(one.values, structure, fewer))
        (one,) = polished(objective, [start], near, iterations=_REFITS, certain=False)


def _brought(objective: Objective, without: Fit, one: Fit | None) -> float:
    """What part of the gain of a fit beside another what stands in for it has to promise."""
    if one is None:
        return 0.0
    before, after = evaluate(objective, [(f.structure, f.values) for f in (without, one)])
    return max(0.0, _STANDS_IN * (before.score - after.score))


def _is_of(one: Fit, names: Collection[str]) -> bool:
    return one.structure.terms[-1].effect.name in names


def least_gain(problem: Problem) -> float:
    """By how much of a score gaps of one joint are smaller that are worth a name."""
    joints = [channel.joint for channel in problem.channels]
    fewest = min(joints.count(joint) for joint in joints)
    return LEAST_GAIN * fewest / len(joints)


def _addable(problem: Problem, structure: Structure, effects: Sequence[Effect]) -> list[Term]:
    """Effects that are fitted, at the places that do not have them."""
    present = {term.effect.name: term for term in structure.terms}
    found = []
    for term in problem.terms(effects):
        known = present.get(term.effect.name)
        if not term.effect.fitted or (known is not None and known.shared):
            continue
        if known is not None:
            sites = tuple(site for site in term.sites if site not in known.sites)
            term = replace(term, sites=sites, shared=False)
        if term.sites:
            found.append(term)
    return found


def _chosen(
    problem: Problem, view: View, always: Collection[str], least: float
) -> list[tuple[Structure, FloatArray]]:
    """Where the singles that promise most begin, of those that promise enough."""
    able = [i for i, one in enumerate(view.candidates) if one.tries]
    promised = {i: view.promise([i]) for i in able}
    named = [i for i in able if view.candidates[i].term.effect.name in always]
    hope = max(least, _HOPE * least_gain(problem))
    order = sorted(able, key=promised.__getitem__)
    hopeful = [i for i in order if view.score - promised[i] > hope]
    by_promise = hopeful[:_BY_PROMISE] or ([] if least else order[:_FEWEST])
    # A promise is a straight line, which leads astray where the model is far from the robot.
    started = evaluate(problem.screen.objective, [view.start([i]) for i in able])
    score = {i: one.score for i, one in zip(able, started, strict=True)}
    by_start = [i for i in sorted(able, key=score.__getitem__) if score[i] < view.score - least]
    kept = dict.fromkeys([*named, *by_promise, *by_start[:_BY_START]])
    shared = [view.shared_out(i) for i in kept]
    begun = evaluate(problem.screen.objective, shared)
    better = [
        start
        for i, start, one in zip(kept, shared, begun, strict=True)
        if one.score < min(score[i], view.score - least)
    ]
    instead = (view.instead(i) for i in kept)
    others = (one for one in instead if one is not None)
    return [*(view.start([i]) for i in kept), *better, *others]


def _pairs(view: View) -> list[tuple[int, int]]:
    """The pairs that promise most, and much more than any single."""
    able = [i for i, one in enumerate(view.candidates) if one.columns]
    if not able:
        return []
    least = min(view.promise([i]) for i in able) - _MORE_THAN_ONE / view.channels
    found = sorted(
        (promise, pair)
        for pair in itertools.combinations(able, 2)
        if view.candidates[pair[0]].term.effect is not view.candidates[pair[1]].term.effect
        and (promise := view.promise(pair)) < least
    )
    return [pair for _, pair in found[:_PAIRS]]
