"""The comparison: one table of all structures that were fitted, and how much weight each has.

    table = Table(members)
    table.weights                    # (n,) posterior weights, pseudo-BMA+
    table.confidence([{"payload"}])  # the weight of all structures that have it
    print(table.frame())             # structures, elpd, difference, its standard error, weight

A structure's weight goes with its prior times exp(elpd / T), where elpd is that of draws of the
blocks (the Bayesian bootstrap), so that what a few blocks say does not make it certain: pseudo-BMA+
of Yao, Vehtari, Simpson and Gelman, Bayesian Analysis 13, 2018.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.decision import (
    CONFUSION,
    LEAST_CHANGE,
    LEAST_GAIN,
    PRICE_PLACE,
    PRICE_RARE,
    PRICE_UNKNOWN,
    TEMPERATURE,
)
from walkerkit.gap.search.free_effort import FREE_EFFORT
from walkerkit.gap.search.score import Scores
from walkerkit.gap.search.structure import Fit, Structure, Unit, merged

FloatArray = NDArray[np.float64]
Places = Mapping[str, tuple[str, ...]]
Rare = frozenset[tuple[str, tuple[str, ...]]]
Ways = Collection[Set[str]]
"""Names of an effect, and of those that are it together: the recordings cannot tell which."""

_DRAWS, _SEED = 1000, 20260101


@dataclass(frozen=True, kw_only=True, eq=False)
class Member:
    """A structure of the table.

    Attributes:
        effects: names of the effects that it has, to where; of the ordinary ones those it needs.
        scores: how it predicts blocks that its fit has not seen.
        fit: the fit that it is of, with all ordinary effects.
        kept: indices of those values of the fit that it has.
        values: (n_parameters,) those of the fit, when what it lacks is left out.
        too_good: (n_blocks,) of its log densities, what is owed to a choice that saw all blocks.
    """

    effects: Places
    scores: Scores
    fit: Fit
    kept: NDArray[np.intp]
    values: FloatArray
    too_good: FloatArray | float = 0.0

    @property
    def key(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """What it has, in one order."""
        return tuple(sorted(self.effects.items()))

    @property
    def units(self) -> frozenset[Unit]:
        """Its effects at each of their places."""
        return frozenset((name, place) for name, places in self.effects.items() for place in places)

    def has(self, ways: Ways) -> bool:
        """Whether it has an effect by any of its names."""
        return any(way <= self.effects.keys() for way in ways)

    @property
    def rare(self) -> Rare:
        """Of that what is rare."""
        return frozenset(one for one in self.effects.items() if not _ordinary(one[0]))

    @cached_property
    def log_prior(self) -> float:
        """Log prior odds: of its kinds and places, and of how large its numbers are.

        What is rare costs more than what every model has a little wrong, and a large number more
        than a small one.
        """
        structure = self.fit.structure
        doubted = {(t.effect.name, p) for t in structure.terms for p in t.places if t.doubts(p)}
        kinds = sum(
            log_prior(name, sum((name, place) not in doubted for place in places))
            for name, places in self.effects.items()
        )
        sized = [k for k in self.kept if not structure.slots[k].parameter.choice]
        return kinds - float(structure.surprise(self.values)[sized].sum())


def log_prior(effect: str, places: int) -> float:
    """Log prior odds of an effect at so many places that are not doubted."""
    return -PRICE_PLACE * places - (price_of_kind(effect) if places else 0.0)


def price_of_kind(effect: str) -> float:
    """Log prior odds against an effect, wherever it is."""
    if effect == FREE_EFFORT.name:
        return PRICE_UNKNOWN
    return 0.0 if _ordinary(effect) else PRICE_RARE


def rare_effects(structure: Structure) -> Rare:
    """The rare effects of a structure and where they are, as those of a member."""
    return frozenset((term.effect.name, term.places) for term in merged(structure).rare)


def _ordinary(effect: str) -> bool:
    return effect in CATALOGUE and CATALOGUE[effect].ordinary


@dataclass(frozen=True, eq=False)
class Table:
    """All structures that were fitted.

    Attributes:
        members: in the order in which they were fitted.
    """

    members: tuple[Member, ...]

    @cached_property
    def blocks(self) -> FloatArray:
        """(n, n_blocks) elpd of each block, all by the scale of the one with the smallest gaps."""
        sizes = [np.log(np.hypot(m.scores.size, m.scores.floor)).mean() for m in self.members]
        scale = self.members[int(np.argmin(sizes))].scores
        return np.stack([member.scores.elpd(scale) - member.too_good for member in self.members])

    @cached_property
    def worth(self) -> FloatArray:
        """(n,) logs of the weights by all blocks, but for a constant."""
        prior = np.array([member.log_prior for member in self.members])
        worth: FloatArray = self.blocks.sum(axis=1) / TEMPERATURE + prior
        return worth

    def worth_of(self, member: Member) -> float:
        """That of one member."""
        return float(self.worth[self.members.index(member)])

    @cached_property
    def once(self) -> NDArray[np.bool_]:
        """(n,) the best of those that are the same structure, which may end several fits."""
        best: dict[Hashable, int] = {}
        for k in np.argsort(-self.worth, kind="stable"):
            best.setdefault(self.members[k].key, int(k))
        return np.isin(np.arange(len(self.members)), [*best.values()])

    @cached_property
    def weights(self) -> FloatArray:
        """(n,) posterior weights; they add up to 1, and each structure has its own once."""
        prior = np.array([member.log_prior for member in self.members])
        prior[~self.once] = -np.inf
        count = self.blocks.shape[1]
        drawn = np.random.default_rng(_SEED).dirichlet(np.ones(count), size=_DRAWS)
        logs = count * self.blocks @ drawn.T / TEMPERATURE + prior[:, None]
        logs -= logs.max(axis=0)
        weights = np.exp(logs)
        found: FloatArray = (weights / weights.sum(axis=0)).mean(axis=1)
        return found

    @property
    def best(self) -> Member:
        """The structure that is worth most; of those that hardly differ, the smallest.

        Members of a fit come with what is most usual first.
        """
        return self.best_of(None)

    def best_of(self, keys: Collection[Hashable] | None) -> Member:
        """The same among members of some keys; None for all."""
        worth = self.worth
        if keys is not None:
            worth = np.where([member.key in keys for member in self.members], worth, -np.inf)
        return self.best_by(worth)

    def best_by(self, worth: FloatArray) -> Member:
        """The same by another (n,) worth of each."""
        near = np.flatnonzero(worth >= worth.max() - 0.5 * PRICE_PLACE)
        return min((self.members[k] for k in near), key=lambda member: len(member.kept))

    def confidence(self, ways: Ways) -> float:
        """The weight of all structures that have an effect by any of its names."""
        has = [member.has(ways) for member in self.members]
        return float(min(1.0, self.weights[has].sum()))

    def share(self, ways: Ways, quantities: Sequence[str]) -> float:
        """What of the gap of the smallest structure comes back without an effect.

        Of blocks that fits have not seen, as in the comparison. Squared gaps of all channels of a
        quantity are added up, as in the gap that is told, so that joints with small gaps count
        little; of quantities the mean.

        Args:
            ways: its names.
            quantities: (n_scored,) that of each channel.

        Returns:
            By the best structure that lacks it; infinity where none was fitted.
        """
        lacks = [not member.has(ways) for member in self.members]
        if not any(lacks):
            return np.inf
        without = self.members[int(np.argmax(np.where(lacks, self.worth, -np.inf)))]
        smallest = min(self.members, key=lambda member: len(member.effects))
        squares = np.stack([m.scores.unseen.sum(axis=0) for m in (without, self.best, smallest)])
        shares = []
        for quantity in dict.fromkeys(quantities):
            back, left, whole = squares[:, [own == quantity for own in quantities]].sum(axis=1)
            shares.append((back - left) / max(whole, np.finfo(float).tiny))
        return float(np.mean(shares))

    def exchanges(self, effect: str, told: Set[str], ways: Ways = ()) -> dict[str, Member]:
        """What could be in an effect's place.

        Args:
            effect: its name.
            told: names of all that is told.
            ways: its names. What has it by another one has nothing else in its place.

        Returns:
            Of the structures that hold `CONFUSION` of the weight those that lack nothing else of
            what is told, by the name of what they have instead, most probable first. What has yet
            more instead than another has that for something that is not told. In place of a rare
            effect, what is ordinary may follow otherwise.
        """
        order = np.argsort(-self.weights, kind="stable")
        within = int(np.searchsorted(np.cumsum(self.weights[order]), CONFUSION)) + 1
        rivals = [self.members[k] for k in order[:within]]
        follows = set() if _ordinary(effect) else {*filter(_ordinary, told)}
        rivals = [
            one
            for one in rivals
            if told - one.effects.keys() - follows == {effect} and not one.has(ways)
        ]
        full, found = self._best_having(told), dict[str, Member]()
        instead = [one.effects.keys() - full.effects.keys() for one in rivals]
        for one, names in zip(rivals, instead, strict=True):
            if not any(other and other < names for other in instead):
                for name in one.effects:  # a set of names has another order in each process
                    if name in names:
                        found.setdefault(name, one)
        return found

    def _best_having(self, told: Set[str]) -> Member:
        """The best that has all that is told, which is reduced to that."""
        best, having = self.best, [one for one in self.members if told <= one.effects.keys()]
        return best if best in having or not having else max(having, key=self.worth_of)

    def frame(self) -> pd.DataFrame:
        """A row a structure: what it has, elpd, difference to the best with its se, weight."""
        best = self.blocks[int(np.argmax(self.worth))]
        difference = self.blocks - best
        table = pd.DataFrame(
            {
                "structure": [described(member.effects) for member in self.members],
                "elpd": self.blocks.sum(axis=1),
                "difference": difference.sum(axis=1),
                "se": np.sqrt(difference.shape[1] * difference.var(axis=1)),
                "log_prior": [member.log_prior for member in self.members],
                "weight": self.weights,
            }
        )
        table = table[self.once]
        return table.sort_values("weight", ascending=False, kind="stable", ignore_index=True)


def in_the_running(worth: FloatArray, most: float) -> NDArray[np.bool_]:
    """(n,) which structures have more than 1 − `CONFUSION` of the weight of another.

    Args:
        worth: (n,) logs of their weights.
        most: that of the other.
    """
    running: NDArray[np.bool_] = worth >= most + np.log(1 - CONFUSION)
    return running


def is_worth_a_name(before: Member, after: Member, joints: Sequence[str]) -> bool:
    """Whether a structure leaves gaps that are smaller by what is worth a name.

    Args:
        before: the structure without what is to be named.
        after: that with it.
        joints: (n_scored,) joint of each channel.
    """
    count, floor = before.scores.count, before.scores.floor
    explained = np.sqrt(np.maximum(before.scores.size**2 - after.scores.size**2, 0))
    if not (explained >= LEAST_CHANGE * floor).any():
        return False
    squares = (before.scores.squares, after.scores.squares)
    return leaves_smaller_gaps(*squares, count=count, floor=floor, joints=joints)


def leaves_smaller_gaps(
    before: FloatArray,
    after: FloatArray,
    *,
    count: FloatArray,
    floor: FloatArray,
    joints: Sequence[str],
) -> bool:
    """Whether gaps are smaller by what is worth a name.

    In the mean of the channels, or twice as much at some joint. Over all blocks, or in the typical
    one: a few wild blocks hold most of a root mean square. What is below the floor is as small as
    the floor.

    Args:
        before: (n_blocks, n_scored) sums of squares of the gaps.
        after: the same with what is to be named.
        count: (n_blocks, n_scored) measured samples.
        floor: (n_scored,) below which a gap says nothing.
        joints: (n_scored,) joint of each channel.
    """
    there = count > 0
    before, after = (np.maximum(squares, count * floor**2) for squares in (before, after))
    each = [squares / np.maximum(count, 1) + floor**2 for squares in (before, after)]
    typical = np.sum(0.5 * np.log(each[0] / each[1]) * there, axis=0)
    typical /= np.maximum(there.sum(axis=0), 1)
    samples = np.maximum(count.sum(axis=0), 1)
    whole = [squares.sum(axis=0) / samples + floor**2 for squares in (before, after)]
    in_all = 0.5 * np.log(whole[0] / whole[1])
    of_joint = [[j == joint for j in joints] for joint in dict.fromkeys(joints)]
    return any(
        float(gain.mean()) >= LEAST_GAIN
        or max(float(gain[own].mean()) for own in of_joint) >= 2 * LEAST_GAIN
        for gain in (typical, in_all)
    )


def described(effects: Places) -> str:
    """Effects and where they are, in a line."""
    parts = (
        name if "*" in places else f"{name} ({', '.join(places)})"
        for name, places in effects.items()
    )
    return " + ".join(parts) or "nothing"
