"""Naming: proposals are fitted, one table compares them, what it wants is the explanation.

    explanation = name_effects(problem, effects)
    explanation.fit                   # what is named, and nothing else, with its values
    explanation.table.frame()         # every structure that was fitted, with its weight

All stand on the ground of what every model has a little wrong. Rare effects come on top one by one
or in pairs, as long as the table prefers a structure with one more; then each meets what could be
in its place. Nothing here looks at recordings that are held out.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE, Effect
from walkerkit.gap.effects.equivalences import equivalences, spelled_out
from walkerkit.gap.search.book import Book, stopped_since
from walkerkit.gap.search.by_itself import leaves_less, without_stand_ins
from walkerkit.gap.search.compare import Member, Table, Ways
from walkerkit.gap.search.decision import LEAST_GAIN
from walkerkit.gap.search.effort import Effort, EnoughError, Progress
from walkerkit.gap.search.fit import evaluate, polished
from walkerkit.gap.search.growth import Search, refitted
from walkerkit.gap.search.lookalikes import Lookalikes, lookalikes
from walkerkit.gap.search.numerical import as_simulated_well
from walkerkit.gap.search.ordinary_effects import ground
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.settle import REFITS, robustly
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit, Term, candidate_terms, carried
from walkerkit.gap.search.unknown import Unknown, beside_what_has_no_name

FloatArray = NDArray[np.float64]

_LONGEST_WITH_LAWS = 20_000  # steps of a rollout, which come one after the other
_AS_GOOD = 0.02  # of a score


@dataclass(frozen=True, kw_only=True)
class Named:
    """An effect of the explanation.

    Attributes:
        term: where it is.
        confidence: the posterior weight of all structures that have it, or that have what no
            recording of these channels can tell from it; also beside what the catalogue lacks.
        ways: its names, and those of what leaves the same log together.
        exchanges: what could be in its place, by name, most probable first.
        equivalent: those that no recording of these channels can tell from it, with the reason.
        lookalikes: what would pass for it, where something is left and its numbers are fitted.
    """

    term: Term
    confidence: float
    ways: Ways
    exchanges: dict[str, Member]
    equivalent: dict[str, str]
    lookalikes: Lookalikes | None = None


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """What explains the recordings that are fitted.

    Attributes:
        fit: what is named, and nothing else.
        named: its effects, the surest first.
        table: every structure that was fitted.
        gains: round and name of every effect that was tried, to what it takes off the score of the
            fitted recordings: in round 1 each of the ground, by leaving it out; in round 2 rare
            ones beside that; and so on.
        unknown: the weight of what is named with an effort beside it that the catalogue cannot
            name; None where nothing was looked for, or no such effort can be told.
        searched: whether anything was looked for: the model as given leaves a gap.
        whole: the fit is one to whole rollouts, not to stretches of them.
        untried: what the search was not given the time for.
    """

    fit: Fit
    named: tuple[Named, ...]
    table: Table
    gains: Mapping[tuple[int, str], float]
    searched: bool
    unknown: float | None = None
    whole: bool = False
    untried: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Begun:
    """What stands before any rare effect is looked for.

    Attributes:
        book: what was fitted.
        nothing: the fit of the model as given.
        plain: the fit of all that is ordinary, and of what a floating base and its ground need.
        searched: whether anything is to be looked for: the model as given leaves a gap.
    """

    book: Book
    nothing: Fit
    plain: Fit
    searched: bool


def begin(
    problem: Problem,
    effects: Sequence[Effect],
    progress: Progress | None = None,
    *,
    effort: Effort,
    first: Callable[[Fit], None] | None = None,
) -> Begun:
    """Fits the model as given, and all that is ordinary on top of it.

    Args:
        problem: what is to be explained.
        effects: the catalogue, or a part of it.
        progress: called now and then.
        effort: what the plain fit takes is what others are counted against.
        first: called with the plain fit to a few stretches, before it is fitted to the rest.
    """
    (given,) = evaluate(problem.fit.objective, [(problem.nothing, np.zeros(0))])
    book = Book(problem)
    nothing = as_simulated_well(problem, effects, given)
    problem.fit.refine(nothing)
    nothing = book.add(nothing)
    if not effects or problem.leaves_nothing(nothing):
        return Begun(book=book, nothing=nothing, plain=nothing, searched=False)
    plain = nothing
    with contextlib.suppress(EnoughError):
        found = ground(problem, effects, nothing, effort.checked(progress), first)
        if found is not nothing:
            plain = book.add(found)
            if not book.has(plain):  # what else was found with it need not go with it
                plain = book.add(without_stand_ins(problem, plain))
    effort.ground_is_done(on_feet=problem.on_feet)
    return Begun(book=book, nothing=nothing, plain=plain, searched=True)


@dataclass(frozen=True, kw_only=True)
class Found:
    """What a search ends with.

    Attributes:
        fit: what is told, and nothing else.
        book: what was fitted.
        effects: those that were looked for; none where the model as given leaves no gap.
    """

    fit: Fit
    book: Book
    effects: tuple[Effect, ...] = ()


def name_effects(
    problem: Problem,
    effects: Sequence[Effect],
    progress: Progress | None = None,
    *,
    effort: Effort | None = None,
) -> Explanation:
    """Names what explains the recordings that are fitted.

    Args:
        problem: what is to be explained.
        effects: the catalogue, or a part of it.
        progress: called now and then.
        effort: how much is tried.

    Returns:
        The explanation, which is empty where nothing is missing.
    """
    effort = effort or Effort()
    return explained(problem, search(problem, effects, progress, effort=effort), effort)


def search(
    problem: Problem,
    effects: Sequence[Effect],
    progress: Progress | None = None,
    *,
    effort: Effort,
    begun: Begun | None = None,
) -> Found:
    """Finds what is told of the recordings that are fitted.

    Args:
        problem: what is to be explained.
        effects: the catalogue, or a part of it.
        progress: called now and then.
        effort: how much is tried.
        begun: what `begin` has of it, where that is known.

    Returns:
        What was found, which is nothing where nothing is missing.
    """
    begun = begun or begin(problem, effects, progress, effort=effort)
    book = begun.book
    if not begun.searched:
        return Found(fit=begun.plain, book=book)
    growth = Search(problem, book, effort, progress)
    rare = [effect for effect in effects if not effect.ordinary]
    with contextlib.suppress(EnoughError):
        growth.rare(rare, begun.plain)
    grown = book.best.fit
    told = growth.compare()
    with contextlib.suppress(EnoughError):
        told = growth.once_more(rare, grown, begun.nothing, begun.plain, told)
    final = by_usual_names(problem, told)
    if not _mends(problem, begun.nothing, final):
        final = begun.nothing
    return Found(fit=final, book=book, effects=tuple(effects))


def explained(problem: Problem, found: Found, effort: Effort) -> Explanation:
    """How sure each name is of what was found, and its values over whole rollouts."""
    problem.fit.refine(found.fit)
    whole = _over_whole(problem, found.fit)
    table, searched = found.book.table, bool(found.effects)
    unknown = beside_what_has_no_name(problem, found.fit) if searched else None
    passing = lookalikes(problem, found.fit, found.effects) if searched else {}
    named = [
        _named(problem, table, term, found.fit, unknown or Unknown(), passing)
        for term in found.fit.structure.terms
    ]
    return Explanation(
        fit=found.fit if whole is None else whole,
        named=tuple(sorted(named, key=lambda one: _rank(problem, table, one))),
        table=table,
        gains=found.book.gains,
        searched=searched,
        unknown=None if unknown is None else unknown.weight,
        whole=whole is not None,
        untried=tuple(effort.untried),
    )


def _mends(problem: Problem, given: Fit, final: Fit) -> bool:
    """Whether a model with what is named leaves smaller gaps, as it is simulated.

    Without the numerical error both may be told apart by less than it.
    """
    objective = problem.fit.objective
    before, after = (objective.simulated([one.case])[0][0] for one in (given, final))
    return not np.isfinite(before).all() or leaves_less(problem, before, after)


def in_its_place(problem: Problem, explanation: Explanation, term: Term, name: str) -> Fit | None:
    """The explanation with another effect in place of one of its terms, and at its end.

    Args:
        problem: what was explained.
        explanation: of it.
        term: one of its terms.
        name: the other effect's, in the catalogue.

    Returns:
        The best fit to a part of the recordings from any of the other's starts; None where it
        cannot act on these robots.
    """
    final = explanation.fit
    found = candidate_terms([CATALOGUE[name]], problem.robots, problem.joints)
    if not found:
        return None
    (other,) = found
    sites = tuple(site for site in other.sites if site in term.sites)
    if sites and not other.shared:
        other = replace(other, sites=sites)
    part = problem.screen
    part.refine(final)
    structure = final.structure.without_term(term).with_term(other)
    values, new = carried(final.values, final.structure, structure), structure.columns(other)
    parameters = [structure.slots[k].parameter for k in new]
    starts = []
    for k in range(max((len(one.starts) for one in parameters), default=0)):
        start = values.copy()
        start[new] = [one.starts[min(k, len(one.starts) - 1)] for one in parameters]
        starts.append((structure, start))
    if not starts:
        return None
    fits = polished(part.objective, evaluate(part.objective, starts), iterations=REFITS)
    best = min(fits, key=lambda one: one.score)
    return best if np.isfinite(best.score) else None


def _rank(problem: Problem, table: Table, one: Named) -> tuple[float, float]:
    """The surest first; of those as sure, the one without which most of the gap is back."""
    quantities = [channel.quantity for channel in problem.channels]
    share = table.share(one.ways, quantities)
    return -round(one.confidence, 2), -share


def by_usual_names(problem: Problem, final: Fit) -> Fit:
    """The fit with what no channel tells from something more usual told as that.

    What little the recordings have against it is of the simulation, not of the robot.
    """
    usual = tuple(CATALOGUE)
    for term in final.structure.terms:
        for name in _equivalent(problem, term, final) if term.effect.ordinary else ():
            other = next(iter(problem.terms([CATALOGUE[name]])), None)
            if (
                other is None
                or not other.effect.ordinary
                or usual.index(name) > usual.index(term.effect.name)
                or not {*term.sites} <= {*other.sites}
            ):
                continue
            there = [one for one in final.structure.terms if one.effect.name == name]
            sites = {*term.sites, *(site for one in there for site in one.sites)}
            structure = final.structure.without_term(term)
            for one in there:
                structure = structure.without_term(one)
            wanted = replace(other, sites=tuple(site for site in other.sites if site in sites))
            told = refitted(problem, final, structure.with_term(wanted))
            as_good = told.score < final.score + LEAST_GAIN
            if as_good and not stopped_since(final, told):
                return by_usual_names(problem, told)
    return final


def _equivalent(problem: Problem, term: Term, final: Fit) -> dict[str, str]:
    """What no recording of these channels tells from a term of a fit, with the reason."""
    sites = {*term.sites}
    known = equivalences(
        term.effect.name,
        {
            channel.signal
            for channel in problem.channels
            if term.effect.kind != "joint" or channel.joint in sites
        },
        robot=problem.robots[0],
        joints=() if term.effect.kind == "body" else term.places,
        bodies=term.sites if term.effect.kind == "body" else (),
        beside={
            other.effect.name
            for other in final.structure.terms
            if other is not term and (other.shared or sites <= {*other.sites})
        },
    )
    return {name: why for name, why in known.items() if name in CATALOGUE}


def _named(
    problem: Problem,
    table: Table,
    term: Term,
    final: Fit,
    unknown: Unknown,
    passing: Mapping[str, Lookalikes],
) -> Named:
    name, present = term.effect.name, {other.effect.name for other in final.structure.terms}
    known = _equivalent(problem, term, final)
    equivalent = {other: why for other, why in known.items() if other not in present}
    together = [{*pair} for pair in spelled_out(name, beside=present - {name})]
    ways = [{name}, *({other} for other in equivalent), *together]
    confidence = table.confidence(ways) if term.effect.fitted else 1.0
    # A plain case of what is told is no other thing.
    plain = {*equivalent, *term.effect.extends}.union(*spelled_out(name))
    unlisted = passing[name].without(plain) if name in passing else None
    odds = 0.0 if unlisted is None else unlisted.odds
    return Named(
        term=term,
        confidence=unknown.beside(name, confidence) / (1 + odds),
        ways=ways,
        exchanges=table.exchanges(name, present, ways),
        equivalent=equivalent,
        lookalikes=unlisted,
    )


def _over_whole(problem: Problem, current: Fit) -> Fit | None:
    """The fit over the horizon that the gap is told of; None where that is the same, or misleads.

    Each stretch starts from a measured state, whose noise draws the values a little. But where
    rollouts diverge, as of a robot that is not stable, only stretches tell what is right.
    """
    whole = problem.whole
    if whole is problem.fit or not len(current.values) or _takes_long(problem, current):
        return None
    whole.refine(current)
    (found,) = polished(whole.objective, [current], iterations=REFITS)
    slopes = linearised(whole.objective, found)
    found = robustly(whole, found, slopes, problem.noise)
    problem.fit.refine(current)
    before, after = (
        evaluate(problem.fit.objective, [(one.structure, one.values)])[0]
        for one in (current, found)
    )
    misleads = after.score >= before.score + _AS_GOOD or stopped_since(current, found)
    return None if misleads else found


def _takes_long(problem: Problem, current: Fit) -> bool:
    """Whether laws run step by step over rollouts that are much longer than stretches."""
    trials = [current.structure.trials(robot, current.values[None]) for robot in problem.robots]
    longest = max(replay.longest for replay in problem.fit.told)
    return any(one.laws or one.numbers for one in trials) and longest > _LONGEST_WITH_LAWS
