"""The book of all structures that were fitted, in which each stands once it is worth reading.

book = Book(problem)
book.add(fit)
book.best                # the member that the table prefers
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.certainty import covariance, ran_away
from walkerkit.gap.search.compare import Member, Rare, Table, in_the_running, is_worth_a_name
from walkerkit.gap.search.decision import KNOWN, TEMPERATURE
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import Reduction, ordinary
from walkerkit.gap.search.score import Wildness
from walkerkit.gap.search.slopes import Slopes, linearised, near_slopes
from walkerkit.gap.search.structure import Fit, Term, Unit
from walkerkit.gap.search.unseen import Looks, looks_of

FloatArray = NDArray[np.float64]

_MOST_IN_THE_RUNNING = 4  # structures beside the best that are fitted by themselves
_MOST_BY_THEMSELVES = 12  # and with those that are the best until they are
_OUT_OF_REACH = 3.0  # times T, of a log weight, that leave-one-out could hardly make up


class Book:
    """All structures that were fitted to the recordings of a problem.

    Args:
        problem: what is to be explained.

    Attributes:
        gains: round and name of what was tried to what it takes off the score.
    """

    def __init__(self, problem: Problem):
        self._problem = problem
        self._joints = [channel.joint for channel in problem.channels]
        self._known: tuple[Fit, Slopes] | None = None
        self.gains: dict[tuple[int, str], float] = {}
        self._members: list[Member] = []
        self._table: Table | None = None
        self._among: set[Hashable] | None = None
        self._alone: list[Fit] = []
        self._too_good: dict[Looks, FloatArray] = {}

    @property
    def table(self) -> Table:
        """The comparison of all members."""
        if self._table is None:
            self._table = Table(tuple(self._members))
        return self._table

    @property
    def best(self) -> Member:
        """The member that the table prefers, of those that may be told."""
        return self.table.best_of(self._among)

    def add(self, one: Fit, *, beside: Fit | None = None, smaller: bool = False) -> Fit:
        """Adds a fit to all recordings that are fitted, with what it does not need left out.

        What was not estimated, or brings less than is worth a name, is left out of the table: an
        effect is named only if some number of it is known, none of the others ran into its bound,
        and what is there without it leaves larger gaps.

        Args:
            one: the fit.
            beside: a fit without its last effect, or another in its place, that it has to beat.
            smaller: it is the fit beside it with fewer numbers, which need not beat it.

        Returns:
            The fit, with the score that it has by its own numerical error.
        """
        problem, objective = self._problem, self._problem.fit.objective
        if beside is not None and not smaller:
            self._tried(one, beside)
        if not np.isfinite(one.score):
            return one
        if beside is not None and not smaller and self._out_of_reach(one, beside):
            return one
        problem.fit.refine(one)
        slopes = self._slopes_beside(one, beside)
        one = objective.at(one, slopes.residual)
        if beside is None:
            self._known = one, slopes
        reduction = Reduction(objective, one, slopes, problem.noise)
        found = reduction.members()
        if beside is None:
            self._left_out(found)
        free = beside is None or smaller or not self._members
        worth = free or self._worth_a_name(found[0], self._members)
        if worth and _estimated(problem, reduction.best(few=True), slopes):
            self._members += self._believed(found)
            self._table = None
            if self._among is not None:
                self._among |= {member.key for member in found}
            else:
                self._forget_what_is_worth_no_name()
        return one

    def has(self, one: Fit) -> bool:
        """Whether the table has a fit that was added."""
        return any(member.fit is one for member in self._members)

    def fit_what_is_in_the_running(
        self,
        fitted: Callable[[Member], Fit],
        *,
        most: int = _MOST_BY_THEMSELVES,
    ) -> None:
        """Has the structures that may be the best fitted by themselves, of which `best` then is.

        Until then they are read off slopes of fits with everything ordinary in them, which say
        little of what is far away.

        Those that fell short of what slopes promised tell how far to believe slopes of others with
        the same rare effects that lack as much.

        Args:
            fitted: fits a member by itself.
            most: of them that are fitted. If slopes promise more of others still, it is not
                believed.
        """
        known = [m for m in self._members if any(m.fit is one for one in self._alone)]
        by_itself: set[Hashable] = {m.key for m in known if len(m.kept) == len(m.fit.values)}
        begun = {m.rare for m in known}
        short = _Shortfalls()
        more: dict[Hashable, float] = {}  # than slopes promised is what some are worth
        others, tried = 0, short.rare  # which grows with what fell short
        for _ in range(most):
            table = self.table
            worth = table.worth - [
                0.0 if member.key in by_itself else short.of(member) for member in table.members
            ]
            best = table.best_by(worth)
            # Of the others slopes may promise too little as well.
            promised = worth - [more.get(member.key, 0.0) for member in table.members]
            # One of each that has other rare effects, and always the best.
            running = self._in_reach(worth, promised.max(), begun)
            running = [m for m in (best, *running) if m.key not in by_itself]
            others += best.key in by_itself
            if not running or others == _MOST_IN_THE_RUNNING:
                break
            one = running[0]
            by_itself.add(one.key)
            begun.add(one.rare)
            itself = self._put(one, fitted(one), by_itself)
            by_itself.add(itself.key)
            both = Table((*self._members, one))
            far = both.worth_of(one) - both.worth_of(itself)
            short.add(one, far)
            more[itself.key] = max(0.0, -far)
        else:
            tried = {member.rare for member in self._members}
        self._among = by_itself
        self._forget_what_did_not_come(tried)

    def _in_reach(self, worth: FloatArray, most: float, begun: Collection[Rare]) -> list[Member]:
        """Members that are in the running, best first, but those whose rare effects were begun.

        Args:
            worth: (n_members,) logs of their weights.
            most: that beside which they are in the running.
            begun: rare effects.
        """
        running, members = in_the_running(worth, most), self.table.members
        order = np.argsort(-worth, kind="stable")
        return [members[k] for k in order if running[k] and members[k].rare not in begun]

    def _forget_what_did_not_come(self, tried: Collection[Rare]) -> None:
        """Forgets what slopes promise beyond the best of what was fitted by itself.

        Of others with the same rare effects it did not come.

        Args:
            tried: rare effects of which it is not believed.
        """
        table, known = self.table, self._among or set()
        most = table.worth_of(self.best)
        self._members = [
            member
            for member, worth in zip(table.members, table.worth, strict=True)
            if member.key in known or member.rare not in tried or worth <= most
        ]
        self._table = None

    def _put(self, member: Member, one: Fit, known: Collection[Hashable]) -> Member:
        """Puts a member as it is by itself in the place of the one that was read off slopes.

        Of members whose keys are known slopes say nothing any more.
        """
        objective = self._problem.fit.objective
        self._problem.fit.refine(one)
        self._alone = [*self._alone, one]
        slopes = linearised(objective, one)
        reduction = Reduction(objective, one, slopes, self._problem.noise)
        itself = reduction.whole
        found = [itself, *(other for other in reduction.members() if other.key != itself.key)]
        found = [other for other in found if other is itself or other.key not in known]
        better = {member.key, *(other.key for other in found)}
        kept = [other for other in self._members if other.key not in better]
        itself, *found = self._believed(found)
        self._members = [*kept, itself, *found]
        self._table = None
        return itself

    def in_full(self, best: Member) -> Member:
        """The best with all that is ordinary with which it is in the running, too."""
        table = self.table
        running = in_the_running(table.worth, table.worth_of(best))
        fuller = [
            table.members[k]
            for k in np.flatnonzero(running)
            if table.members[k].rare == best.rare and table.members[k].units > best.units
        ]
        return max([best, *fuller], key=lambda member: len(member.kept))

    def to_be_told(self, best: Member) -> Book:
        """Another book, in which structures may come down to what is told of them.

        What has more rare effects than the best is not in it: that less of the best is known is no
        reason to tell more.
        """
        other = copy(self)
        other._members = [m for m in self._members if len(m.rare) <= len(best.rare)]
        other._table = None
        return other

    def came_down(self, member: Member, one: Fit) -> None:
        """Puts a fit with less in the place of all that have the rare effects of a member."""
        self._members = [other for other in self._members if other.rare != member.rare]
        itself = self._put(member, one, ())
        if self._among is not None:
            self._among = self._among | {itself.key}

    def was_chosen_by_all(self, member: Member) -> bool:
        """Whether a member has looks that nobody chose again without what they are to predict."""
        looks = looks_of(member.fit.structure)
        return bool(looks) and looks not in self._too_good

    def choose_again(self, member: Member, squares: FloatArray | None) -> None:
        """Believes a member's looks, wherever they are, as far as they predict what is unseen.

        Args:
            member: the member.
            squares: (n_blocks, n_scored) of its blocks by fits whose looks these did not choose;
                None where that cannot be said.
        """
        own, scores = looks_of(member.fit.structure), member.scores
        self._too_good[own] = np.zeros(len(scores.squares))
        if squares is not None:
            honest = replace(scores, squares=squares, elsewhere=squares)
            self._too_good[own] += scores.elpd(scores) - honest.elpd(scores)
        self._members = self._believed(self._members)
        self._table = None

    def _believed(self, members: Sequence[Member]) -> list[Member]:
        """Members with what is known of their looks."""
        known = [self._too_good.get(looks_of(one.fit.structure), 0.0) for one in members]
        return [replace(one, too_good=too) for one, too in zip(members, known, strict=True)]

    def is_enough(self, smaller: Fit, full: Fit) -> bool:
        """Whether what a fit has beside a smaller one is not worth a name."""
        found = [next((m for m in self._members if m.fit is one), None) for one in (smaller, full)]
        before, after = found
        if before is None or after is None:
            return after is None and before is not None
        return not is_worth_a_name(before, after, self._joints)

    def has_tried(self, effect: str) -> bool:
        """Whether a rare effect was fitted beside others."""
        return any(name == effect for _, name in self.gains)

    def slopes(self, one: Fit) -> Slopes:
        """Those at a fit, of which the latest are kept."""
        if self._known is None or self._known[0] is not one:
            self._problem.fit.refine(one)
            self._known = one, linearised(self._problem.fit.objective, one)
        return self._known[1]

    def _slopes_beside(self, one: Fit, beside: Fit | None) -> Slopes:
        """Those at a fit; of the numbers that a known fit beside it has, those of that one do."""
        if beside is None or self._known is None or self._known[0] is not beside:
            return self.slopes(one)
        (found,) = near_slopes(self._problem.fit.objective, self._known[1], [one])
        return found

    def _out_of_reach(self, one: Fit, beside: Fit) -> bool:
        """Whether a fit is far behind one beside it, in all blocks and by their density."""
        objective, reach = self._problem.fit.objective, _OUT_OF_REACH * TEMPERATURE
        if (one.score - beside.score) * objective.samples <= reach:
            return False
        before, after = self._densities([beside, one])
        return before - after > reach

    def likeliest(self, fits: Sequence[Fit], current: Fit) -> list[Fit]:
        """Of some fits the likeliest of each structure, by the density of the comparison.

        Args:
            fits: the fits.
            current: one at which the numerical error is known.
        """
        found: dict[Hashable, tuple[float, Fit]] = {}
        _, *densities = self._densities([current, *fits])
        for density, one in zip(densities, fits, strict=True):
            key = one.structure.key
            if key not in found or density > found[key][0]:
                found[key] = density, one
        return [one for _, one in found.values()]

    def _densities(self, fits: Sequence[Fit]) -> list[float]:
        """Log densities of the residuals of some fits, with the memory of the first."""
        objective = self._problem.fit.objective
        residuals = [residual for (residual,) in objective.residuals([one.case for one in fits])]
        wildness = Wildness(objective, residuals[0], self._problem.noise)
        return [wildness.density(residual) for residual in residuals]

    def _tried(self, one: Fit, beside: Fit) -> None:
        rare = one.structure.rare
        key = (1 + len(rare), rare[-1].effect.name)
        self.gains[key] = max(self.gains.get(key, -np.inf), beside.score - one.score)

    def _left_out(self, found: Sequence[Member]) -> None:
        """What each ordinary effect brings that a structure of the ground needs."""
        best = found[0]
        sizes = [np.log(np.hypot(m.scores.size, m.scores.floor)).mean() for m in found]
        for name, size in zip(ordinary(best), sizes[1:], strict=False):
            if (1, name) not in self.gains:
                self.gains[1, name] = float(size - sizes[0])

    def _forget_what_is_worth_no_name(self) -> None:
        """Forgets structures that are worth no name beside others that lack rare effects."""
        kept: list[Member] = []
        for member in sorted(self._members, key=lambda member: len(member.rare)):
            if self._worth_a_name(member, kept):
                kept.append(member)
        self._members = [member for member in self._members if member in kept]
        self._table = None

    def _worth_a_name(self, one: Member, others: Sequence[Member]) -> bool:
        """Whether structures with fewer rare effects that have nothing else leave larger gaps.

        What has something else instead is a rival, between which the table decides.
        """
        plain = [
            other
            for other in others
            if len(other.rare) < len(one.rare) and other.effects.keys() <= one.effects.keys()
        ]
        return not plain or is_worth_a_name(Table(tuple(plain)).best, one, self._joints)


class _Shortfalls:
    """By how much structures by themselves fell short of what slopes had promised.

    What another lacks of the same was as little known from the slopes.
    """

    def __init__(self) -> None:
        self._seen: dict[Rare, list[tuple[frozenset[Unit], float]]] = {}

    @property
    def rare(self) -> Collection[Rare]:
        """The rare effects of those that were fitted by themselves."""
        return self._seen.keys()

    def add(self, member: Member, far: float) -> None:
        """A member, as it was read off slopes, and how far it fell short of that."""
        self._seen.setdefault(member.rare, []).append((member.units, max(0.0, far)))

    def of(self, member: Member) -> float:
        """How far others with the same rare effects fell short that have all that it has; or 0."""
        seen = self._seen.get(member.rare, ())
        return max((far for had, far in seen if had >= member.units), default=0.0)


def _estimated(problem: Problem, member: Member, slopes: Slopes) -> bool:
    """Whether of each rare effect some number is known, and none is at its bound.

    Beside what the member needs: dry friction that it has no more cannot be what bristles carry.
    """
    one, rare = member.fit, member.fit.structure.rare
    if stopped_at_a_bound(one):
        return False
    columns = [one.structure.columns(term) for term in rare]
    left_out = {*range(len(one.values))} - {*member.kept}
    errors = KnownErrors(problem, one, slopes).of(left_out) if rare else np.zeros(0)
    return all(errors[own].max() >= KNOWN for own in columns)


def stopped_at_a_bound(one: Fit) -> list[Term]:
    """The rare effects of a fit of which some number ran into its bound."""
    stopped = ran_away(one)
    return [t for t in one.structure.rare if stopped[one.structure.columns(t)].any()]


def stopped_since(before: Fit, after: Fit) -> list[Term]:
    """The rare effects of a fit that ran into a bound since another, of the same ones or more."""
    known = {term.effect.name for term in stopped_at_a_bound(before)}
    return [term for term in stopped_at_a_bound(after) if term.effect.name not in known]


class KnownErrors:
    """Standard errors between each value of a fit and that which changes nothing.

    In the light of all that the model still lacks; 0 for numbers that change nothing by themselves.

    Args:
        problem: what is to be explained.
        one: a fit.
        slopes: those at it.
    """

    def __init__(self, problem: Problem, one: Fit, slopes: Slopes):
        problem.screen.refine(one)
        self._variance, _ = covariance(
            problem.fit.objective, one, problem.noise, slopes, problem.screen.objective
        )
        shapes = np.array([slot.parameter.shape for slot in one.structure.slots], dtype=bool)
        self._away = np.where(shapes, 0.0, np.abs(one.values - one.structure.zero))

    def of(self, fixed: Collection[int] = ()) -> FloatArray:
        """(n_parameters,) them, where the values of some indices are fixed: of these 0."""
        variance, gone = self._variance, np.array([*fixed], dtype=np.intp)
        if len(gone):
            across = variance[:, gone]
            within = np.linalg.pinv(variance[np.ix_(gone, gone)], rcond=1e-12, hermitian=True)
            variance = variance - across @ within @ across.T
        std = np.sqrt(np.maximum(np.diag(variance), 0.0))
        errors: FloatArray = self._away / np.where(std > 0, std, np.inf)
        errors[gone] = 0.0  # whose variance is left of rounding alone
        return errors
