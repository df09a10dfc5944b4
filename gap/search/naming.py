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
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE, Effect
from walkerkit.gap.effects.equivalences import equivalences
from walkerkit.gap.search.book import Book
from walkerkit.gap.search.by_itself import (
    fitted_alone,
    fitted_without,
    leaves_less,
    only_needed,
    without_stand_ins,
)
from walkerkit.gap.search.compare import Member, Table
from walkerkit.gap.search.decision import LEAST_GAIN
from walkerkit.gap.search.effort import Effort, EnoughError, Progress
from walkerkit.gap.search.fit import CONVERGED, evaluate, polished
from walkerkit.gap.search.numerical import as_simulated_well
from walkerkit.gap.search.ordinary_effects import ground
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.propose import proposals
from walkerkit.gap.search.settle import robustly, settled, without_the_wild
from walkerkit.gap.search.slopes import linearised, normal_equations
from walkerkit.gap.search.structure import (
    Fit,
    Structure,
    Term,
    candidate_terms,
    carried,
    extended,
)
from walkerkit.gap.search.unknown import unknown_weight
from walkerkit.gap.simulation.mend import mend

FloatArray = NDArray[np.float64]

MOST_RARE = 4  # at once
_EXCHANGES = 2  # of passes in which each rare effect meets what could be in its place
_REFITS, _PASSES = 8, 3  # steps of a fit that begins near its end, and how often it goes on
_NTH = ("a first", "a second", "a third", "a fourth")
_LONGEST_WITH_LAWS = 20_000  # steps of a rollout, which come one after the other
_AS_GOOD = 0.02  # of a score


@dataclass(frozen=True, kw_only=True)
class Named:
    """An effect of the explanation.

    Attributes:
        term: where it is.
        confidence: the posterior weight of all structures that have it, or that have what no
            recording of these channels can tell from it.
        exchanges: what could be in its place, by name, most probable first.
        equivalent: those that no recording of these channels can tell from it, with the reason.
    """

    term: Term
    confidence: float
    exchanges: dict[str, Member]
    equivalent: dict[str, str]


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


def name_effects(
    problem: Problem,
    effects: Sequence[Effect],
    progress: Progress | None = None,
    *,
    effort: Effort | None = None,
    begun: Begun | None = None,
) -> Explanation:
    """Names what explains the recordings that are fitted.

    Args:
        problem: what is to be explained.
        effects: the catalogue, or a part of it.
        progress: called now and then.
        effort: how much is tried.
        begun: what `begin` has of it, where that is known.

    Returns:
        The explanation, which is empty where nothing is missing.
    """
    effort = effort or Effort()
    begun = begun or begin(problem, effects, progress, effort=effort)
    book = begun.book
    if not begun.searched:
        return _explanation(problem, book, begun.plain, searched=False)
    search = _Search(problem, book, effort, progress)
    rare = [effect for effect in effects if not effect.ordinary]
    with contextlib.suppress(EnoughError):
        search.rare(rare, begun.plain)
    grown = book.best.fit
    told = search.compare()
    with contextlib.suppress(EnoughError):
        told = search.once_more(rare, grown, begun, told)
    final = by_usual_names(problem, told)
    if not _mends(problem, begun.nothing, final):
        final = begun.nothing
    problem.fit.refine(final)
    found = _explanation(problem, book, final, searched=True)
    return replace(found, untried=tuple(effort.untried))


def _mends(problem: Problem, given: Fit, final: Fit) -> bool:
    """Whether a model with what is named leaves smaller gaps, as it is simulated.

    Without the numerical error both may be told apart by less than it.
    """
    objective = problem.fit.objective
    before, after = (objective.simulated([one.case])[0][0] for one in (given, final))
    return not np.isfinite(before).all() or leaves_less(problem, before, after)


class _Search:
    """What is tried on top of the ground.

    Args:
        problem: what is to be explained.
        book: what was fitted.
        effort: how much is tried.
        progress: called now and then.
    """

    def __init__(self, problem: Problem, book: Book, effort: Effort, progress: Progress | None):
        self._problem, self._book, self._effort = problem, book, effort
        self._progress = effort.checked(progress)
        self._others: dict[str, tuple[Fit, Fit]] = {}  # of an effect: a fit, and that without it
        self._aside: frozenset[str] = frozenset()  # rare effects that came with the ground
        self._met: set[Hashable] = set()  # structures beside which all effects were looked at

    def rare(self, effects: Sequence[Effect], current: Fit) -> None:
        """Enters into the book what the table wants of some rare effects, and their rivals."""
        current = self._worth_their_names(current)
        begun = current.structure.rare  # of a floating base, which no other met
        self._aside = frozenset(term.effect.name for term in begun)
        current = self._grown(effects, current)
        for _ in range(_EXCHANGES):
            self._exchange(effects, current, begun)
            best = self._book.best.fit
            if best.structure.key == current.structure.key:
                break
            current, begun = self._grown(effects, self._ended(best)), ()

    def compare(self) -> Fit:
        """Has what may be the best fitted by itself.

        Returns:
            What of the best is told: that without what it does not need.
        """
        problem, book = self._problem, self._book
        leaned: dict[frozenset[str], Fit] = {}
        while True:
            book.fit_what_is_in_the_running(partial(fitted_alone, problem))
            best = book.best
            names = _rare_names(best.fit)
            told = leaned.get(names) or only_needed(problem, best.fit)
            needed = _rare_names(told)
            if needed == names:
                problem.fit.refine(told)
                return told
            leaned[needed] = told
            gone = [t for t in best.fit.structure.rare if t.effect.name not in needed]
            book.came_down(best, fitted_without(problem, best.fit, gone))

    def once_more(self, effects: Sequence[Effect], grown: Fit, begun: Begun, told: Fit) -> Fit:
        """Looks for rare effects again, where much or all that was grown is not known to be there.

        What is ordinary may follow a rare effect by numbers of which none is known: beside them it
        promises nothing, and without them much. So rare effects have the model as given to
        themselves, and what is ordinary comes on top.
        """
        problem, book = self._problem, self._book
        known = book.best.fit
        others = {t.effect.name for t in known.structure.rare} - {
            t.effect.name for t in grown.structure.rare
        }
        as_good = known.score < grown.score + LEAST_GAIN
        if problem.on_feet or (known.structure.terms and (others or as_good)):
            return told
        found = self._grown(effects, begun.nothing)
        if found is begun.nothing or found is known:
            return told
        has = {term.effect.name for term in found.structure.terms}
        more = [t for t in begun.plain.structure.terms if t.effect.name not in has]
        problem.fit.refine(found)
        (both,) = _refitted(problem, found, [extended(found, more).structure])
        self._enter(both)
        if book.best.fit.structure.key == both.structure.key:
            self._exchange(effects, book.best.fit, ())
        return self.compare()

    def _grown(self, effects: Sequence[Effect], current: Fit) -> Fit:
        """The structure that the table prefers, with as many rare effects as it wants."""
        problem, book = self._problem, self._book
        met: set[object] = set()
        while not problem.leaves_nothing(current):
            count = self._beside_the_ground(current)
            if count >= MOST_RARE or not self._effort.allows(f"{_NTH[count]} rare effect"):
                break
            met.add(current.structure.key)
            self._propose(effects, current)
            best = book.best.fit
            if best.structure.key in met or not _is_more(best, current):
                break
            met.add(best.structure.key)
            current = self._ended(_at_needed_places(problem, book, best))
        return current

    def _beside_the_ground(self, current: Fit) -> int:
        """How many rare effects a fit has that did not come with the ground."""
        return sum(term.effect.name not in self._aside for term in current.structure.rare)

    def _worth_their_names(self, current: Fit) -> Fit:
        """A fit without those of its rare effects that are worth no name."""
        for term in current.structure.rare:
            others = self._without(current, term)
            if self._book.is_enough(others, current):
                current = others
        return current

    def _without(self, current: Fit, term: Term) -> Fit:
        """A fit without one of its terms, in the book; found once while the fit is the same."""
        found = self._others.get(term.effect.name)
        if found is None or found[0] is not current:
            fewer = current.structure.without_term(term)
            (others,) = _refitted(self._problem, current, [fewer])
            found = self._others[term.effect.name] = current, self._book.add(others)
        return found[1]

    def _exchange(self, effects: Sequence[Effect], current: Fit, unmet: Sequence[Term]) -> None:
        """Each rare effect of a fit meets what could be in its place, where all else is now.

        Where it was added what is ordinary may have bent itself far to follow it, so that others
        promised nothing there, and may have gone far since. On feet, where a look takes long, an
        effect meets those that were tried, where all else is fitted without it; or all, if it met
        none when it was added.
        """
        problem, book, found = self._problem, self._book, current.structure.rare
        for term in found:
            name = term.effect.name
            alike = term.effect.extends + (() if problem.on_feet else term.effect.resembles)
            always = [e.name for e in effects if e.name in alike]
            rivals = [effect for effect in effects if effect is not term.effect]
            if problem.on_feet and term not in unmet:
                if term is found[-1]:  # it met the others when it was added
                    continue
                rivals = [e for e in rivals if e.name in always or book.has_tried(e.name)]
            if not self._effort.allows(f"others in the place of {name}"):
                continue
            if problem.on_feet:
                others = self._without(current, term)
                if term in unmet and book.is_enough(others, current):
                    continue  # what is worth no name needs no rivals
            else:
                others = _left_out(problem, current, term)
                if others.structure.key in self._met:  # by what it took the place of
                    continue
                self._met.add(others.structure.key)
            self._propose(rivals, others, instead_of=current, always=always, tamed=False)

    def _propose(
        self,
        effects: Sequence[Effect],
        current: Fit,
        *,
        instead_of: Fit | None = None,
        always: Collection[str] = (),
        tamed: bool = True,
    ) -> None:
        """Enters what some effects promise on top of a fit, or instead of what another has besides.

        If tamed, also where a few wild blocks do not outvote the rest, as they do not in the table;
        on feet, where a look takes long, only if the table prefers no other rare effects by then.
        """
        problem, book = self._problem, self._book
        near, before = book.slopes(current), book.best.fit.structure.rare
        beside = instead_of or current
        if book.has(current):  # it is a fit, too, and not only what is left without an effect
            beside = current
        found = partial(
            proposals,
            effects=effects,
            progress=self._progress,
            instead_of=instead_of,
            aside=self._aside,
        )
        for one in found(problem, current, near, always=always):
            self._enter(one, beside)
        if not tamed or (problem.on_feet and book.best.fit.structure.rare != before):
            return
        tame = without_the_wild(problem, current)
        if tame is None:
            return
        its = near.trusting(tame.fit.objective, current)
        again = found(tame, tame.fit.by_own_error(current), its)
        problem.fit.refine(current)
        starts = [(one.structure, one.values) for one in again]
        for one in evaluate(problem.fit.objective, starts):
            self._enter(one, beside)

    def _ended(self, one: Fit) -> Fit:
        """A fit that others are to come on top of, at its end; on feet, as it is.

        It was proposed by slopes and with a numerical error of another fit, and may have far to go:
        what it lacks there others would seem to bring.
        """
        problem, book = self._problem, self._book
        if problem.on_feet or not one.structure.rare:
            return one
        found = settled(problem.fit, one, passes=_PASSES, iterations=_REFITS)
        return book.add(found) if found.score < one.score - CONVERGED else one

    def _enter(self, one: Fit, beside: Fit | None = None) -> None:
        """Enters a fit into the book, if need be without rare effects that it does not need.

        What stood in for another effect is no estimate any more beside that.

        Args:
            one: the fit.
            beside: a fit without its last effect, or another in its place, that it has to beat;
                without rare effects there is nothing in it that could have stood in.
        """
        problem, book = self._problem, self._book
        one = book.add(one, beside=beside)
        promises = one.score < book.best.fit.score - LEAST_GAIN
        if book.has(one) or (beside is not None and not beside.structure.rare) or not promises:
            return
        met = {t.effect.name for t in beside.structure.rare} if beside else set()
        new = {t.effect.name for t in one.structure.rare} - met
        known = without_stand_ins(problem, one, for_the_sake_of=new)
        if known.structure.rare and known.structure.key != one.structure.key:
            book.add(known, beside=beside)


def _rare_names(one: Fit) -> frozenset[str]:
    return frozenset(term.effect.name for term in one.structure.rare)


def _left_out(problem: Problem, one: Fit, term: Term) -> Fit:
    """A fit with one of its terms left out, and all else as it is."""
    fewer = one.structure.without_term(term)
    (found,) = evaluate(problem.fit.objective, [(fewer, carried(one.values, one.structure, fewer))])
    return found


def _is_more(one: Fit, current: Fit) -> bool:
    """Whether a fit has more rare effects than another, or others."""
    its, known = ({t.effect.name for t in each.structure.rare} for each in (one, current))
    return len(one.structure.rare) > len(current.structure.rare) or not its <= known


def _at_needed_places(problem: Problem, book: Book, full: Fit) -> Fit:
    """The fit with its newest effect only where it is worth a name.

    Tried at the one place where it changes most, then at two, four, and so on; of those that are
    enough each is left out once more.
    """
    term = full.structure.terms[-1]
    if len(term.places) < 2:
        return full
    change = _changes(problem, book, full)
    order = sorted(term.places, key=lambda place: -change[place])
    count, enough = 1, full
    while count < len(order):
        smaller = _at(problem, book, full, term, order[:count])
        if book.is_enough(smaller, full):
            enough = smaller
            break
        count *= 2
    while len(enough.structure.terms[-1].places) > 1 and enough is not full:
        fewer = enough.structure.terms[-1].places
        least = min(fewer, key=change.__getitem__)
        smaller = _at(problem, book, full, term, [p for p in fewer if p != least])
        if not book.is_enough(smaller, full):
            break
        enough = smaller
    return enough


def _changes(problem: Problem, book: Book, one: Fit) -> dict[str, float]:
    """Place of the newest effect to how much its numbers there change, each by itself."""
    structure = one.structure
    normal, _ = normal_equations(problem.fit.objective, one, book.slopes(one))
    away = (one.values - structure.zero) / structure.scale
    size = np.diag(normal) * away**2
    term = structure.terms[-1]
    return {place: float(size[structure.columns(term, place)].max()) for place in term.places}


def _at(problem: Problem, book: Book, full: Fit, term: Term, places: Sequence[str]) -> Fit:
    """A fit with one of its terms at fewer places, in the book."""
    fewer = replace(term, sites=tuple(site for site in term.sites if site in places))
    (smaller,) = _refitted(problem, full, [full.structure.replaced(term, fewer)])
    return book.add(smaller, beside=full, smaller=True)


def _refitted(problem: Problem, source: Fit, structures: Sequence[Structure]) -> list[Fit]:
    """Other structures, fitted from the values that they have in common with a fit."""
    objective = problem.fit.objective
    starts = [(s, carried(source.values, source.structure, s)) for s in structures]
    return polished(objective, evaluate(objective, starts), iterations=_REFITS)


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
    fits = polished(part.objective, evaluate(part.objective, starts), iterations=_REFITS)
    best = min(fits, key=lambda one: one.score)
    return best if np.isfinite(best.score) else None


def _explanation(problem: Problem, book: Book, final: Fit, *, searched: bool) -> Explanation:
    whole = _over_whole(problem, final)
    table = book.table
    named = [_named(problem, table, term, final) for term in final.structure.terms]
    return Explanation(
        fit=final if whole is None else whole,
        named=tuple(sorted(named, key=lambda one: _rank(problem, table, one))),
        table=table,
        gains=book.gains,
        searched=searched,
        unknown=_unknown(problem, final) if searched else None,
        whole=whole is not None,
    )


def _rank(problem: Problem, table: Table, one: Named) -> tuple[float, float]:
    """The surest first; of those as sure, the one without which most of the gap is back."""
    quantities = [channel.quantity for channel in problem.channels]
    share = table.share({one.term.effect.name, *one.equivalent}, quantities)
    return -round(one.confidence, 2), -share


def _unknown(problem: Problem, final: Fit) -> float | None:
    """The weight of an effort without a name beside a fit; 0 where that leaves nothing."""
    if problem.leaves_nothing(final):
        return 0.0
    trials = [final.structure.trials(robot, final.values[None]) for robot in problem.robots]
    return unknown_weight(problem, [mend(trial) for trial in trials])


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
            (told,) = _refitted(problem, final, [structure.with_term(wanted)])
            if told.score < final.score + LEAST_GAIN:
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


def _named(problem: Problem, table: Table, term: Term, final: Fit) -> Named:
    name, present = term.effect.name, {other.effect.name for other in final.structure.terms}
    known = _equivalent(problem, term, final)
    equivalent = {other: why for other, why in known.items() if other not in present}
    return Named(
        term=term,
        confidence=table.confidence({name, *equivalent}) if term.effect.fitted else 1.0,
        exchanges=table.exchanges(name, present),
        equivalent=equivalent,
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
    (found,) = polished(whole.objective, [current], iterations=_REFITS)
    slopes = linearised(whole.objective, found)
    found = robustly(whole, found, slopes, problem.noise)
    problem.fit.refine(current)
    before, after = (
        evaluate(problem.fit.objective, [(one.structure, one.values)])[0]
        for one in (current, found)
    )
    return found if after.score < before.score + _AS_GOOD else None


def _takes_long(problem: Problem, current: Fit) -> bool:
    """Whether laws run step by step over rollouts that are much longer than stretches."""
    trials = [current.structure.trials(robot, current.values[None]) for robot in problem.robots]
    longest = max(replay.longest for replay in problem.fit.told)
    return any(one.laws or one.numbers for one in trials) and longest > _LONGEST_WITH_LAWS
