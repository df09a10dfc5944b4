"""How many kinds of effects would pass for one that is told, if nobody had listed them.

    found = lookalikes(problem, told, effects)["payload"]
    found.share                 # of the gap, that the payload makes up for
    found.passing["base_tilt"]  # the part of its sizes of which it would make up for as much
    found.odds                  # that what is there is of a kind that is not listed

What is told may be the nearest name of something that the catalogue does not have. How near such
things come is seen on the catalogue itself: each effect that is not told is simulated where the
told one is, at a few sizes, as if it were not listed. Beside all else that is told, the told one
makes up for a part of what that changes. Where this part is as large as that of the gap, it would
pass for it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import EVERYWHERE, Effect
from walkerkit.gap.effects.equivalences import carriers
from walkerkit.gap.search.compare import price_of_kind
from walkerkit.gap.search.decision import (
    LEAST_CHANGE,
    NUMERICAL_LEFT,
    PRICE_UNKNOWN,
)
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.signatures import Tries, tries_of
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Case, Fit, Term

FloatArray = NDArray[np.float64]

_SIZES = 3  # of an effect, that are simulated at most
_SINGULAR = 1e-3  # of the largest direction of what some changes span


@dataclass(frozen=True, kw_only=True)
class Lookalikes:
    """What would pass for a told effect.

    Attributes:
        price: log prior odds against the told effect, but for its places.
        share: part of the gap, above the noise, that it makes up for.
        passing: effect that is not told to the part of its sizes of which it makes up for as much.
    """

    price: float
    share: float
    passing: Mapping[str, float]

    @property
    def odds(self) -> float:
        """That what is told is of a kind that is not listed.

        Such kinds are taken to be as varied as those that are.
        """
        return sum(self.passing.values()) * math.exp(self.price - PRICE_UNKNOWN)

    @property
    def names(self) -> tuple[str, ...]:
        """Effects that would pass for it at most of their sizes, first those that always do."""
        most = [name for name, part in self.passing.items() if part > 0.5]
        return tuple(sorted(most, key=lambda name: -self.passing[name]))

    def without(self, names: Collection[str]) -> Lookalikes:
        """The same without what is no other thing than what is told."""
        passing = {name: part for name, part in self.passing.items() if name not in names}
        return replace(self, passing=passing)


def lookalikes(problem: Problem, told: Fit, effects: Sequence[Effect]) -> dict[str, Lookalikes]:
    """What would pass for each told effect.

    Args:
        problem: what is explained; only parts of recordings that are fitted are looked at.
        told: what is told of it.
        effects: the catalogue, or a part of it.

    Returns:
        Name of each told effect whose numbers are fitted to what would pass for it; empty where
        nothing is left, as nothing would.
    """
    terms = [term for term in told.structure.terms if term.effect.fitted]
    if not terms or problem.leaves_nothing(told):
        return {}
    problem.screen.refine(told)
    seen = _Seen(problem, told)
    present = {term.effect.name for term in terms}
    others = problem.terms([e for e in effects if e.fitted and e.name not in present])
    beside = {term.effect.name: _Beside(seen, term) for term in terms}
    passing: dict[str, dict[str, float]] = {name: {} for name in beside}
    at = {term.effect.name: _where(problem, term, others) for term in terms}
    for there in dict.fromkeys(at.values()):
        for other, changes in seen.of(there):
            for name in (name for name, own in at.items() if own == there):
                shares = beside[name].shares(changes)
                if len(shares):
                    part = float(np.mean(shares >= beside[name].share))
                    passing[name][other.effect.name] = part
    return {
        term.effect.name: Lookalikes(
            price=0.0 if _doubted(term) else price_of_kind(term.effect.name),
            share=beside[term.effect.name].share,
            passing=passing[term.effect.name],
        )
        for term in terms
    }


class _Seen:
    """What a fit leaves of parts of the recordings, and what its numbers change there.

    Changes and residuals are weighted by channel, as in the score.

    Args:
        problem: what is explained.
        told: the fit.

    Attributes:
        left: (1, rows, n_scored) what it leaves.
        slopes: (n_parameters, rows, n_scored) what its numbers change.
        numerical: (n, rows, n_scored) what other ways to simulate change.
        of_noise: (n_scored,) sums of squares of what the noise leaves.
        least: (n_scored,) those of the least change that is worth a name.
    """

    def __init__(self, problem: Problem, told: Fit):
        self.objective, self.told = problem.screen.objective, told
        slopes = linearised(self.objective, told)
        weights = self.objective.weights(self.objective.mean_square(slopes.residual))
        self._root = np.sqrt(weights)
        (self._simulated,) = self.objective.freed([told.case])[0]
        self.left = slopes.residual[None] * self._root
        self.slopes = slopes.jacobian * self._root
        self.numerical = self.objective.numerical.changes * self._root
        numerical = NUMERICAL_LEFT * self.objective.numerical_size()
        noise = np.square(problem.noise) + np.square(numerical)
        self.of_noise = weights * self.objective.count * noise
        self.least = LEAST_CHANGE**2 * self.of_noise

    def changes(self, cases: Sequence[Case]) -> list[FloatArray]:
        """(n, rows, n_scored) what each row of each case changes; without those that diverge."""
        found = [(block - self._simulated) * self._root for block in self.objective.freed(cases)]
        return [one[np.isfinite(one).all(axis=(1, 2))] for one in found]

    def of(self, terms: Sequence[Term]) -> Iterator[tuple[Term, FloatArray]]:
        """What effects change on top of the fit, at some of their sizes at all places at once."""
        cases = [_some(tries_of(self.told, term)).at_once(self.told) for term in terms]
        for group in self.objective.grouped(cases):
            yield from zip(terms[group], self.changes(cases[group]), strict=True)


class _Beside:
    """What a told effect makes up for, beside all else that is told.

    Args:
        seen: what the fit leaves.
        term: the effect.

    Attributes:
        share: of the gap in its channels, above the noise.
    """

    def __init__(self, seen: _Seen, term: Term):
        structure, values = seen.told.structure, seen.told.values.copy()
        own = structure.columns(term)
        values[own] = structure.zero[own]
        (gone,) = seen.changes([Case(structure=structure, values=values[None])])
        if not len(gone):  # without it the simulation diverges
            away = (values - seen.told.values)[own] / structure.scale[own]
            gone = np.tensordot(away[None], seen.slopes[own], 1)
        joints = [channel.joint for channel in seen.objective.channels]
        self._shown = np.isin(joints, term.places)
        if not self._shown.any():
            self._shown = (np.square(gone).sum(axis=1) >= seen.least).any(axis=0)
        self._least = seen.least[self._shown]
        self._rest = _span(np.concatenate([np.delete(seen.slopes, own, axis=0), seen.numerical]))
        explained = self._apart(gone)
        self._its = _span(np.concatenate([self._apart(seen.slopes[own]), explained]))
        left = _size(_off(self._its, self._apart(seen.left))).sum()
        left = max(left - seen.of_noise[self._shown].sum(), 0.0)
        size = _size(explained).sum()
        self.share = float(size / max(size + left, np.finfo(float).tiny))

    def _apart(self, changes: FloatArray) -> FloatArray:
        """What the rest does not follow of changes, in the channels of the effect."""
        return _off(self._rest, changes)[:, :, self._shown]

    def shares(self, changes: FloatArray) -> FloatArray:
        """(n,) that it makes up for of changes that are large enough to be felt."""
        felt = self._apart(changes)
        felt = felt[(np.square(felt).sum(axis=1) >= self._least).any(axis=1)]
        shares: FloatArray = 1 - _size(_off(self._its, felt)) / _size(felt)
        return shares


def _some(tries: Tries) -> Tries:
    """A few of an effect's sizes, the first and the last of each place among them."""
    many = len(tries.places) // len(tries.term.places)
    sizes = np.unique(np.linspace(0, many - 1, min(many, _SIZES)).astype(int))
    firsts = many * np.arange(len(tries.term.places))
    return tries.some((firsts[:, None] + sizes).ravel().tolist())


def _where(problem: Problem, told: Term, others: Sequence[Term]) -> tuple[Term, ...]:
    """Effects where a told one is: at its joints, and at the bodies that these carry."""
    robot = problem.robots[0]
    if told.effect.kind == "body":
        joints = {*carriers(robot, told.sites)}
    else:
        joints = {*(problem.joints if EVERYWHERE in told.sites else told.sites)}
    found = []
    for other in others:
        sites = other.sites
        if other.effect.kind == "joint":
            sites = tuple(site for site in sites if site in joints)
        elif other.effect.kind == "body":
            at = [{*carriers(robot, [site])} & joints or site in told.sites for site in sites]
            sites = tuple(site for site, there in zip(sites, at, strict=True) if there)
        if sites:
            found.append(replace(other, sites=sites, shared=other.shared and len(sites) > 1))
    return tuple(found)


def _doubted(term: Term) -> bool:
    return all(term.doubts(place) for place in term.places)


def _size(changes: FloatArray) -> FloatArray:
    """(n, ...) changes → (n,) sums of their squares."""
    flat = _flat(changes)
    size: FloatArray = np.einsum("ij,ij->i", flat, flat)
    return size


def _span(changes: FloatArray) -> FloatArray:
    """(n, ...) changes → (size of one, up to n) orthonormal directions that they span."""
    flat = _flat(changes)
    size = np.linalg.norm(flat, axis=1)
    flat = flat[size > 0] / size[size > 0, None]
    along, strength, _ = np.linalg.svd(flat.T, full_matrices=False)
    found: FloatArray = along[:, strength > _SINGULAR * strength.max(initial=0.0)]
    return found


def _off(span: FloatArray, changes: FloatArray) -> FloatArray:
    """(n, ...) changes without what some directions follow of them."""
    flat = _flat(changes)
    left: FloatArray = (flat - (flat @ span) @ span.T).reshape(changes.shape)
    return left


def _flat(changes: FloatArray) -> FloatArray:
    return changes.reshape(len(changes), math.prod(changes.shape[1:]))
