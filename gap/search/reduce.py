"""What of a fit the recordings want: the rest is dropped, by linear algebra alone.

    reduction = Reduction(objective, fit, slopes, noise)
    for member in reduction.members():
        member.effects        # the fit with what they want, and with each of that left out
    reduction.best(few=True)  # and without what is worth no name

A fit has damping, dry friction, armature, gains and a delay everywhere. Which of these numbers the
recordings want is read off its slopes: what dropping some costs when the others follow. The most
probable set is found by dropping the cheapest again and again; what each of its effects is worth,
by dropping that one first. A rare effect is needed at one of its places at least: the structure
without it is another fit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from copy import deepcopy

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.compare import Member, in_the_running, is_worth_a_name, price_of_kind
from walkerkit.gap.search.decision import LEAST_GAIN, PRICE_PLACE, TEMPERATURE
from walkerkit.gap.search.fit import Promise
from walkerkit.gap.search.foretold import Foretold
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.score import Scoring, memory_of
from walkerkit.gap.search.slopes import Slopes, posterior_equations
from walkerkit.gap.search.structure import Fit, Slot, Structure, Unit

FloatArray = NDArray[np.float64]

_SINGULAR = 1e-12  # of a number's variance, below which what is left of it is none


def ordinary(member: Member) -> list[str]:
    """The ordinary effects that a member has."""
    return [name for name in member.effects if name in CATALOGUE and CATALOGUE[name].ordinary]


class Reduction:
    """The structures within a fit.

    Args:
        objective: the recordings.
        one: the fit, to them.
        slopes: its slopes there.
        noise: (n_scored,) of the measurement.
        any_may_go: rare effects, too, may be dropped altogether.

    Attributes:
        units: what may be dropped, to its numbers' indices.
        lost: by how much the score rises without each of them, once all else has followed.
    """

    def __init__(
        self,
        objective: Objective,
        one: Fit,
        slopes: Slopes,
        noise: FloatArray,
        *,
        any_may_go: bool = False,
    ):
        self._fit, self._foretold = one, Foretold(objective, slopes)
        self._any_may_go = any_may_go
        self._scoring = Scoring(objective, one, self._foretold, noise)
        self._memory = memory_of(objective, slopes.residual)
        normal, _ = posterior_equations(objective, one, slopes)
        away = (one.values - one.structure.zero) / one.structure.scale
        self._given = _Values(away, _inverse(normal))
        self._joints = [channel.joint for channel in objective.channels]
        self._alike = TEMPERATURE / objective.samples
        may_go = {
            term.effect.name
            for term in one.structure.terms
            if term.effect.name in CATALOGUE
            and (
                term.effect.ordinary
                or (term.effect.fitted and (any_may_go or len(term.places) > 1))
            )
        }
        units = one.structure.units
        self.units = {unit: own for unit, own in units.items() if unit[0] in may_go}

        full = self._score([])
        # What slopes take for nothing, since they know no bounds of the numerical error.
        self.lost = {unit: self._score([unit]) - full for unit in self.units}
        self._alone = {unit: lost if lost > LEAST_GAIN else 0.0 for unit, lost in self.lost.items()}

    def _score(self, dropped: Sequence[Unit]) -> float:
        """The score without some units, with the numerical error within its bounds."""
        return self._foretold.score(self._without(dropped).away - self._given.away)

    @property
    def whole(self) -> Member:
        """The structure of the fit."""
        return self._each_lacking([([], self._given.away)])[0]

    def lacking(self, units: Sequence[Unit]) -> Member:
        """The structure without some units, to which the others have followed."""
        return self._each_lacking([(units, self._without(units).away)])[0]

    def members(self) -> list[Member]:
        """The most probable structure, and those without each of its ordinary effects."""
        best = self.best()
        each = ([unit for unit in self.units if unit[0] == name] for name in ordinary(best))
        return [best, *map(self.best, each)]

    def best(self, first: Sequence[Unit] = (), *, few: bool = False) -> Member:
        """The most probable structure that lacks some units.

        What is worth a name stays as long as the structure with it is in the running, too.

        Args:
            first: what it lacks.
            few: it also lacks what is worth no name, though it may be more probable with that.
        """
        dropped, values = list(first), self._without(first)
        less = [([*dropped], values.away.copy())]
        left = [unit for unit in self.units if unit not in dropped]
        while left := [unit for unit in left if self._may_go(unit, dropped)]:
            cost = [max(values.cost_without(self.units[u]), self._alone[u]) for u in left]
            # Of those that may as well go, the least usual goes first.
            may_go = [u for u, c in zip(left, cost, strict=True) if c <= min(cost) + self._alike]
            cheapest = max(may_go, key=self._rank)
            left.remove(cheapest)
            dropped.append(cheapest)
            values.leave_out(self.units[cheapest])
            less.append(([*dropped], values.away.copy()))
        members = self._each_lacking(less)
        worth = np.array([self._worth(member) for member in members])
        # Of those as probable the smallest.
        k = len(worth) - 1 - int(np.argmax(worth[::-1]))
        running = in_the_running(worth, worth[k])
        while k and running[k - 1] and self._worth_a_name(members[k], members[k - 1]):
            k -= 1
        if not few:
            return members[k]
        enough = [one for one in members[k + 1 :] if not self._worth_a_name(one, members[k])]
        return enough[-1] if enough else members[k]

    def _worth_a_name(self, smaller: Member, fuller: Member) -> bool:
        return is_worth_a_name(smaller, fuller, self._joints)

    def _without(self, units: Iterable[Unit]) -> _Values:
        values = deepcopy(self._given)
        for unit in units:
            values.leave_out(self.units[unit])
        return values

    def _may_go(self, unit: Unit, dropped: Sequence[Unit]) -> bool:
        """Whether it is ordinary, or its effect is at other places, too, or anything may go."""
        if self._any_may_go:
            return True
        others = (other for other in self.units if other[0] == unit[0] and other != unit)
        return CATALOGUE[unit[0]].ordinary or any(other not in dropped for other in others)

    def _worth(self, member: Member) -> float:
        # Slopes at a fit with all that is ordinary say little of what each recording tells alone.
        return (
            float(member.scores.elpd_nearby(member.scores).sum()) / TEMPERATURE + member.log_prior
        )

    def _rank(self, unit: Unit) -> int:
        return tuple(CATALOGUE).index(unit[0])  # the most usual first

    def _each_lacking(self, less: Sequence[tuple[Sequence[Unit], FloatArray]]) -> list[Member]:
        """Structures, of which each lacks some units, and has (n_parameters,) numbers that far."""
        slots, given = self._fit.structure.slots, self._given.away
        gone = [[k for unit in dropped for k in self.units[unit]] for dropped, _ in less]
        kept = [np.setdiff1d(np.arange(len(slots)), own) for own in gone]
        moved = [away - given for _, away in less]
        made_of = [self._foretold.far(step) for step in moved]
        scores = self._scoring.scores([*zip(made_of, kept, strict=True)], self._memory)
        return [
            Member(
                effects=_effects([slots[k] for k in own]),
                scores=its,
                fit=self._fit,
                kept=own,
                values=self._fit.values + step * self._fit.structure.scale,
            )
            for own, step, its in zip(kept, moved, scores, strict=True)
        ]


def hoped_for(structure: Structure, hope: Promise, samples: float) -> float:
    """The log weight of the most probable structure within a fit, by what one step promises.

    Roughly: on the recordings that are fitted, by a quadratic of the score.

    Args:
        structure: that of the fit.
        hope: what one step promises.
        samples: independent ones that the score is of.
    """
    rest = _Values((hope.values - structure.zero) / structure.scale, _inverse(hope.normal))
    units = structure.units
    free = {(t.effect.name, p) for t in structure.terms for p in t.places if t.doubts(p)}
    kinds = sum(price_of_kind(term.effect.name) for term in structure.rare)
    left, best = [*units], -np.inf
    while True:
        values = structure.zero + rest.away * structure.scale
        kept = [k for unit in left for k in units[unit] if not structure.slots[k].parameter.choice]
        prices = kinds + PRICE_PLACE * sum(unit not in free for unit in left)
        prices += float(structure.surprise(values)[kept].sum())
        best = max(best, -samples / TEMPERATURE * (hope.score + rest.cost) - prices)
        names = Counter(name for name, _ in left)
        may_go = [unit for unit in left if CATALOGUE[unit[0]].ordinary or names[unit[0]] > 1]
        if not may_go:
            return best
        cheapest = min(may_go, key=lambda unit: rest.cost_without(units[unit]))
        left.remove(cheapest)
        rest.leave_out(units[cheapest])


def _inverse(normal: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.pinv(normal, rcond=_SINGULAR, hermitian=True), dtype=np.float64)


class _Values:
    """A fit's values, of which some are left out while the others follow, by linear algebra.

    Args:
        away: (n_parameters,) how far each is from its zero, in scales.
        covariance: (n_parameters, n_parameters) of them.

    Attributes:
        away: the same, without those that are left out.
        cost: by how much the score has risen.
    """

    def __init__(self, away: FloatArray, covariance: FloatArray):
        self.away, self.cost = away, 0.0
        self._covariance = covariance
        self._least = np.maximum(_SINGULAR * np.diag(covariance), np.finfo(float).tiny)

    def cost_without(self, k: NDArray[np.intp]) -> float:
        """By how much the score has risen once some more are left out."""
        return self.cost + 0.5 * float(self.away[k] @ self._inverse(k) @ self.away[k])

    def leave_out(self, k: NDArray[np.intp]) -> None:
        """Takes some values to their zero."""
        self.cost = self.cost_without(k)
        across = self._covariance[:, k] @ self._inverse(k)
        self.away -= across @ self.away[k]
        self._covariance -= across @ self._covariance[k]
        self.away[k] = self._covariance[k] = self._covariance[:, k] = 0.0

    def _inverse(self, k: NDArray[np.intp]) -> FloatArray:
        """Of the covariance of some values, but for what those that are left out tell of them."""
        own, least = self._covariance[np.ix_(k, k)], self._least[k]
        if len(k) == 1:
            return np.where(own > least, 1 / np.maximum(own, least), 0.0)
        scale = np.outer(np.sqrt(least), np.sqrt(least)) / _SINGULAR
        size, along = np.linalg.eigh(own / scale)
        size = np.where(size > _SINGULAR, 1 / np.maximum(size, _SINGULAR), 0.0)
        found: FloatArray = (along * size) @ along.T / scale
        return found


def _effects(slots: Sequence[Slot]) -> dict[str, tuple[str, ...]]:
    found: dict[str, dict[str, None]] = {}
    for slot in slots:
        found.setdefault(slot.term.effect.name, {})[slot.place] = None
    return {name: tuple(places) for name, places in found.items()}
