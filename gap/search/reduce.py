"""What of a fit it needs: the rest is dropped, by linear algebra alone.

    for member in members(objective, fit, slopes, noise):
        member.effects        # the fit with what it needs, and with each of that left out

A fit has damping, dry friction, armature, gains and a delay everywhere. Which of these numbers the
recordings want is read off its slopes: what dropping some costs when the others follow. The most
probable set is found by dropping the cheapest again and again; what each of its effects is worth,
by dropping that one first. A rare effect is needed at one of its places at least: the structure
without it is another fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.compare import Member, is_worth_a_name
from walkerkit.gap.search.decision import LEAST_GAIN, TEMPERATURE
from walkerkit.gap.search.foretold import Foretold
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.score import Scoring, memory_of
from walkerkit.gap.search.slopes import Slopes, posterior_equations
from walkerkit.gap.search.structure import Fit, Slot, Unit

FloatArray = NDArray[np.float64]


def members(
    objective: Objective,
    one: Fit,
    slopes: Slopes,
    noise: FloatArray,
    *,
    without: Sequence[Unit] = (),
    whole: bool = False,
) -> list[Member]:
    """The most probable structure within a fit, and those without each of its ordinary effects.

    Args:
        objective: the recordings.
        one: the fit, to them.
        slopes: its slopes there.
        noise: (n_scored,) of the measurement.
        without: what none of them has.
        whole: also the fit with all that it has.
    """
    reduction = _Reduction(objective, one, slopes, noise)
    best = reduction.best(without)
    found = [best]
    if whole and len(best.kept) < len(one.values):
        found.append(reduction.whole)
    for name in ordinary(best):
        units = [unit for unit in reduction.units if unit[0] == name or unit in without]
        if any(unit not in without for unit in units):
            found.append(reduction.best(units))
    return found


def reduced(objective: Objective, one: Fit, slopes: Slopes, noise: FloatArray) -> Member:
    """The most probable structure within a fit, of which whatever it does not need is gone."""
    return _Reduction(objective, one, slopes, noise, any_may_go=True).best([])


def ordinary(member: Member) -> list[str]:
    """The ordinary effects that a member has."""
    return [name for name in member.effects if name in CATALOGUE and CATALOGUE[name].ordinary]


class _Reduction:
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
        self._covariance = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
        self._joints = [channel.joint for channel in objective.channels]
        self._alike = TEMPERATURE / objective.samples
        self._away = (one.values - one.structure.zero) / one.structure.scale
        self.units = {
            (term.effect.name, place): one.structure.columns(term, place)
            for term in one.structure.terms
            if term.effect.name in CATALOGUE
            and (
                term.effect.ordinary
                or (term.effect.fitted and (any_may_go or len(term.places) > 1))
            )
            for place in term.places
        }

        full = self._score([])
        # What slopes take for nothing, since they know no bounds of the numerical error.
        alone = {unit: self._score([unit]) - full for unit in self.units}
        self._alone = {unit: lost if lost > LEAST_GAIN else 0.0 for unit, lost in alone.items()}

    def _score(self, dropped: Sequence[Unit]) -> float:
        """The score without some units, with the numerical error within its bounds."""
        return self._foretold.score(self._moved(dropped))

    @property
    def whole(self) -> Member:
        """The structure of the fit."""
        return self._member([])

    def best(self, first: Sequence[Unit]) -> Member:
        """The most probable structure that lacks some units."""
        dropped = list(first)
        best = most = self._member(dropped)
        left = [unit for unit in self.units if unit not in dropped]
        while left := [unit for unit in left if self._may_go(unit, dropped)]:
            cost = [max(self._cost([*dropped, unit]), self._alone[unit]) for unit in left]
            # Of those that may as well go, the least usual goes first.
            may_go = [u for u, c in zip(left, cost, strict=True) if c <= min(cost) + self._alike]
            cheapest = max(may_go, key=self._rank)
            left.remove(cheapest)
            dropped.append(cheapest)
            member = self._member(dropped)
            if self._worth(member) >= self._worth(most):
                best = most = member
            elif not is_worth_a_name(member, most, self._joints):
                best = member
        return best

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

    def _columns(self, units: Iterable[Unit]) -> NDArray[np.intp]:
        return np.array([k for unit in units for k in self.units[unit]], dtype=np.intp)

    def _cost(self, dropped: Sequence[Unit]) -> float:
        """By how much the score rises, by the slopes, without some units."""
        k = self._columns(dropped)
        own = self._covariance[np.ix_(k, k)]
        return 0.5 * float(self._away[k] @ np.linalg.lstsq(own, self._away[k], rcond=1e-12)[0])

    def _rank(self, unit: Unit) -> int:
        return tuple(CATALOGUE).index(unit[0])  # the most usual first

    def _moved(self, dropped: Sequence[Unit]) -> FloatArray:
        """(n_parameters,) by how much values move, in scales, where some are at their zero."""
        k = self._columns(dropped)
        if not len(k):
            return np.zeros(len(self._away))
        own = self._covariance[np.ix_(k, k)]
        follow = np.linalg.lstsq(own, self._away[k], rcond=1e-12)[0]
        moved: FloatArray = -self._covariance[:, k] @ follow
        moved[k] = -self._away[k]
        return moved

    def _member(self, dropped: Sequence[Unit]) -> Member:
        gone = self._columns(dropped)
        kept = np.setdiff1d(np.arange(len(self._away)), gone)
        moved = self._moved(dropped)
        far = self._foretold.far(moved)
        return Member(
            effects=_effects([self._fit.structure.slots[k] for k in kept]),
            scores=self._scoring.scores(far, kept, self._memory),
            fit=self._fit,
            kept=kept,
            values=self._fit.values + moved * self._fit.structure.scale,
        )


def _effects(slots: Sequence[Slot]) -> dict[str, tuple[str, ...]]:
    found: dict[str, dict[str, None]] = {}
    for slot in slots:
        found.setdefault(slot.term.effect.name, {})[slot.place] = None
    return {name: tuple(places) for name, places in found.items()}
