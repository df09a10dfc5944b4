"""Growth: rare effects come on top of the ground, and meet what could be in their place.

    search = Search(problem, book, effort, progress)
    search.rare(effects, plain)       # enters into the book what it wants of them
    told = search.compare()           # what of the best is told

One by one or in pairs, as long as the table prefers a structure with one more.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.book import Book
from walkerkit.gap.search.by_itself import (
    fitted_alone,
    fitted_without,
    only_needed,
    without_stand_ins,
)
from walkerkit.gap.search.compare import Member
from walkerkit.gap.search.decision import LEAST_GAIN
from walkerkit.gap.search.effort import Effort, Progress
from walkerkit.gap.search.fit import CONVERGED, evaluate, polished
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.propose import proposals
from walkerkit.gap.search.settle import PASSES, REFITS, settled, without_the_wild
from walkerkit.gap.search.slopes import normal_equations
from walkerkit.gap.search.structure import Fit, Structure, Term, carried, extended
from walkerkit.gap.search.unseen import by_unseen

MOST_RARE = 4  # at once
_EXCHANGES = 2  # of passes in which each rare effect meets what could be in its place
_NTH = ("a first", "a second", "a third", "a fourth")


class Search:
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
        self._needed: dict[tuple[Fit, Hashable], Fit] = {}  # of a structure what is told

    def rare(self, effects: Sequence[Effect], current: Fit) -> None:
        """Enters into the book what the table wants of some rare effects, and their rivals."""
        current = self._worth_their_names(current)
        begun = current.structure.rare  # of a floating base, which no other met
        self._aside = current.structure.rare_names
        current = self._grown(effects, current)
        for _ in range(_EXCHANGES):
            self._exchange(effects, current, begun)
            best = self._best.fit
            if best.structure.key == current.structure.key:
                break
            current, begun = self._grown(effects, self._ended(best)), ()

    def compare(self) -> Fit:
        """Has what may be the best fitted by itself.

        Returns:
            What of the best is told: that without what it does not need or cannot know. Where
            another is better than what is left of it, they are compared as they would be told.
        """
        book = self._book
        leaned: dict[frozenset[str], Fit] = {}
        while True:
            book.fit_what_is_in_the_running(self._alone)
            if book.was_chosen_by_all(book.best):
                self._choose_again(book.best)
            elif told := self._as_told(leaned):
                self._problem.fit.refine(told)
                return told

    def _as_told(self, leaned: dict[frozenset[str], Fit]) -> Fit | None:
        """What is told, as it is told; None where the best is another since some of it came down.

        Args:
            leaned: by names of rare effects, what is told of what has or had them; is added to.
        """
        book = its = self._book
        best, others = book.best, book.to_be_told(book.best)
        told: dict[frozenset[str], Fit] = {}
        while (names := best.fit.structure.rare_names) not in told:
            one = leaned.get(names) or self._only_needed(best, its)
            needed = one.structure.rare_names
            leaned[needed] = one
            if needed != names:
                gone = [t for t in best.fit.structure.rare if t.effect.name not in needed]
                book.came_down(best, fitted_without(self._problem, best.fit, gone))
                return None
            told[names] = one
            if one.structure.key != best.fit.structure.key:
                others.came_down(best, one)
                if others.table.best.fit.structure.rare_names not in told:
                    others.fit_what_is_in_the_running(self._alone)
            best, its = others.best, others
        return told[names]

    def _alone(self, member: Member) -> Fit:
        return fitted_alone(self._problem, member)

    def _only_needed(self, best: Member, book: Book) -> Fit:
        """What of the best structure of a book is told; found once.

        What is ordinary is there unless that is improbable: the best loses what it does not need or
        cannot know once it has all of that.
        """
        full = book.in_full(best)
        found = full.fit, full.key
        if found not in self._needed:
            alone = best.fit if full is best else self._alone(full)
            self._needed[found] = only_needed(self._problem, alone)
        return self._needed[found]

    def once_more(
        self, effects: Sequence[Effect], grown: Fit, nothing: Fit, plain: Fit, told: Fit
    ) -> Fit:
        """Looks for rare effects again, where much or all that was grown is not known to be there.

        What is ordinary may follow a rare effect by numbers of which none is known: beside them it
        promises nothing, and without them much. So rare effects have the model as given to
        themselves, and what is ordinary comes on top.
        """
        problem, book = self._problem, self._book
        known = book.best.fit
        others = known.structure.rare_names - grown.structure.rare_names
        as_good = known.score < grown.score + LEAST_GAIN
        if problem.on_feet or (known.structure.terms and (others or as_good)):
            return told
        found = self._grown(effects, nothing, known=[known.structure.key])
        if found is nothing:
            return self.compare()  # what was told with what else was found
        has = {term.effect.name for term in found.structure.terms}
        more = [t for t in plain.structure.terms if t.effect.name not in has]
        problem.fit.refine(found)
        both = refitted(problem, found, extended(found, more).structure)
        self._enter(both)
        if book.best.fit.structure.key == both.structure.key:
            self._exchange(effects, book.best.fit, ())
        return self.compare()

    @property
    def _best(self) -> Member:
        """What the table prefers, once looks that all blocks chose are chosen without them."""
        while self._book.was_chosen_by_all(self._book.best):
            self._choose_again(self._book.best)
        return self._book.best

    def _choose_again(self, member: Member) -> None:
        self._book.choose_again(member, by_unseen(self._problem, member.fit))

    def _grown(
        self, effects: Sequence[Effect], current: Fit, *, known: Collection[Hashable] = ()
    ) -> Fit:
        """The structure that the table prefers, with as many rare effects as it wants.

        Args:
            effects: the rare effects.
            current: what they come on top of.
            known: keys of structures beside which nothing more was found; where the table prefers
                one of these, there is an end.
        """
        problem, book = self._problem, self._book
        met: set[Hashable] = {*known}
        while not problem.leaves_nothing(current):
            count = self._beside_the_ground(current)
            if count >= MOST_RARE or not self._effort.allows(f"{_NTH[count]} rare effect"):
                break
            met.add(current.structure.key)
            self._propose(effects, current)
            best = self._best.fit
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
            others = refitted(self._problem, current, current.structure.without_term(term))
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
        Of two fits of one structure the likelier enters.
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
        fits = found(problem, current, near, always=always)
        if problem.on_feet:
            for one in fits:
                self._enter(one, beside)
            fits = []
            tamed = tamed and book.best.fit.structure.rare == before
        tame = without_the_wild(problem, current) if tamed else None
        if tame is not None:
            its = near.trusting(tame.fit.objective, current)
            again = found(tame, tame.fit.by_own_error(current), its)
            problem.fit.refine(current)
            starts = [(one.structure, one.values) for one in again]
            fits = book.likeliest([*fits, *evaluate(problem.fit.objective, starts)], current)
        for one in fits:
            self._enter(one, beside)

    def _ended(self, one: Fit) -> Fit:
        """A fit that others are to come on top of, at its end; on feet, as it is.

        It was proposed by slopes and with a numerical error of another fit, and may have far to go:
        what it lacks there others would seem to bring.
        """
        problem, book = self._problem, self._book
        if problem.on_feet or not one.structure.rare:
            return one
        found = settled(problem.fit, one, passes=PASSES, iterations=REFITS)
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
        new = one.structure.rare_names - (beside.structure.rare_names if beside else frozenset())
        known = without_stand_ins(problem, one, for_the_sake_of=new)
        if known.structure.rare and known.structure.key != one.structure.key:
            book.add(known, beside=beside)


def _left_out(problem: Problem, one: Fit, term: Term) -> Fit:
    """A fit with one of its terms left out, and all else as it is."""
    fewer = one.structure.without_term(term)
    (found,) = evaluate(problem.fit.objective, [(fewer, carried(one.values, one.structure, fewer))])
    return found


def _is_more(one: Fit, current: Fit) -> bool:
    """Whether a fit has more rare effects than another, or others."""
    more = len(one.structure.rare) > len(current.structure.rare)
    return more or not one.structure.rare_names <= current.structure.rare_names


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
    smaller = refitted(problem, full, full.structure.replaced(term, fewer))
    return book.add(smaller, beside=full, smaller=True)


def refitted(problem: Problem, source: Fit, structure: Structure) -> Fit:
    """Another structure, fitted from the values that it has in common with a fit."""
    objective = problem.fit.objective
    start = structure, carried(source.values, source.structure, structure)
    (found,) = polished(objective, evaluate(objective, [start]), iterations=REFITS)
    return found
