"""What every effect would change, seen from where the search stands, and what that could explain.

    view = look(half, current, terms)
    view.promise([0])            # the score that a fit of the first effect can hope for
    view.promise([0, 3])         # of two together
    view.start([0, 3])           # where such a fit begins

One small step says nothing about limits and dead zones, so each effect is simulated at its own list
of magnitudes, place by place. What those change, beside what the parameters in place could follow
and what a finer timestep would change, explains a part of the gap by least squares: cheap enough
to try every pair of effects and every exchange of one for another. These are promises; what is to
be kept is fitted.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.half import Half
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.slopes import Slopes, linearised
from walkerkit.gap.search.structure import Case, Fit, Structure, Term, carried

FloatArray = NDArray[np.float64]
Single = NDArray[np.float32]

_SWEEPS = 4  # of least squares, each with the weights that the gaps of the last one give
_RIDGE = 1e-6  # of a change's own size
_OF_THE_BEST = 0.5  # of its promise, which an effect has to reach to be looked at joint by joint
_MOST_HOPEFUL, _MOST_APART = 16, 6  # effects that are tried place by place; usually shared ones
_MAGNITUDES = 2  # of an effect, that are tried at each place
_MOST_HIDDEN = 4  # places that are tried though they seem to promise nothing
_MOST_ROWS = 192  # of tries at single places; beyond that one magnitude and fewer effects
_ALIKE = 0.8  # the cosine between what two effects change, from which one can stand in
_NEEDED = 0.02  # a place that promises less, summed over the channels, is left out


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One effect on top of the current structure.

    Attributes:
        term: the effect at the places that promise something.
        tries: place to the values of its parameters there from which to fit.
        columns: indices of its changes in the view; none for what promises nothing.
    """

    term: Term
    tries: dict[str, FloatArray]
    columns: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class _Simulated:
    """An effect at its magnitudes: (n_tries,) places and values, and what they change."""

    term: Term
    places: tuple[str, ...]
    values: tuple[FloatArray, ...]
    changes: Single


class View:
    """The residual at the current fit, and what every effect would change of it.

    Args:
        objective: the recordings that are looked at.
        current: the fit.
        residual: (rows, n_scored) what it leaves, with the numerical error in it.
        nuisance: (k, rows, n_scored) changes that go with every effect, freely or by factors within
            the objective's bounds where they are numerical; those are the last.
        simulated: the effects at their magnitudes.
        slopes: at the current fit.

    Attributes:
        candidates: an entry per effect, in the order given.
        channels: number of the scored channels.
        score: that of the residual, where no effect takes anything of it.
    """

    def __init__(
        self,
        objective: Objective,
        current: Fit,
        residual: FloatArray,
        nuisance: FloatArray,
        simulated: Sequence[_Simulated],
        slopes: Slopes,
    ):
        self._objective = objective
        self._current = current
        self._residual = residual
        self._nuisance = nuisance
        self._bounded = objective.numerical.bounds
        self._rows = len(residual)
        self._square = np.einsum("rc,rc->c", residual, residual)
        self._along = np.zeros((len(objective.channels), 0))
        self._columns = np.zeros((len(objective.channels), 0, len(residual)))
        self._gram = np.zeros((len(objective.channels), 0, 0))
        self._count = 0
        self._append(nuisance)
        self._places: dict[int, tuple[str, FloatArray]] = {}  # of columns of candidates, and values
        away = (current.values - current.structure.zero) / current.structure.scale
        self._ordinary = {
            k: away[k] * slopes.jacobian[k]
            for k, slot in enumerate(current.structure.slots)
            if slot.term.effect.ordinary and away[k]
        }
        self.candidates: list[Candidate] = []
        self.extend(simulated)
        self.channels = len(objective.channels)
        self.score = self._score(range(len(nuisance)))

    def extend(self, simulated: Sequence[_Simulated]) -> None:
        """Adds candidates."""
        for one in simulated:
            self.candidates.append(self._chosen(one))

    def promise(self, members: Sequence[int]) -> float:
        """The score that some candidates together can hope for."""
        columns = [k for member in members for k in self.candidates[member].columns]
        return self._score([*range(len(self._nuisance)), *columns])

    def start(self, members: Sequence[int]) -> tuple[Structure, FloatArray]:
        """The current structure with some candidates, at the values that promise most."""
        structure, values = self._current.structure, self._current.values
        for member in members:
            candidate = self.candidates[member]
            extended = structure.with_term(candidate.term)
            values = carried(values, structure, extended)
            for place, own in candidate.tries.items():
                values[extended.columns(candidate.term, place)] = own
            structure = extended
        return structure, np.clip(values, *structure.bounds)

    def shared_out(self, member: int) -> tuple[Structure, FloatArray]:
        """As `start` of one, with as much of it at each place as goes best with the other places.

        Where one place moves all others, all of it everywhere is far from what is right.
        """
        structure, values = self.start([member])
        candidate = self.candidates[member]
        _, x = self._solved([*range(len(self._nuisance)), *candidate.columns])
        for column, share in zip(candidate.columns, x[len(self._nuisance) :], strict=True):
            self._give(structure, values, candidate.term, column, share)
        return structure, np.clip(values, *structure.bounds)

    def _give(
        self, structure: Structure, values: FloatArray, term: Term, column: int, share: float
    ) -> None:
        """Writes so much of what a column of a candidate is into the values at its place."""
        place, at = self._places[column]
        own = structure.columns(term, place)
        values[own] = structure.zero[own] + share * (at - structure.zero[own])

    def instead(self, member: int) -> tuple[Structure, FloatArray] | None:
        """As `start` of one, in place of what of the ordinary changes the same of the residual.

        From beside that, a fit would have to cross what neither explains.

        Returns:
            None where nothing ordinary does.
        """
        structure, values = self.start([member])
        candidate, moved = self.candidates[member], False
        root = np.sqrt(self._objective.weights(self._objective.mean_square(self._residual)))
        for column in candidate.columns:
            change = (self._columns[:, column].T * root).ravel()
            size = float(change @ change)
            shares = {
                k: share
                for k, made in self._ordinary.items()
                if abs(share := float((part := (made * root).ravel()) @ change) / size)
                >= _ALIKE * np.linalg.norm(part) / math.sqrt(size)
            }
            k, share = max(shares.items(), key=lambda one: abs(one[1]), default=(-1, 0.0))
            if not share:
                continue
            self._give(structure, values, candidate.term, column, share)
            values[k] = structure.zero[k]
            moved = True
        return (structure, np.clip(values, *structure.bounds)) if moved else None

    def _chosen(self, one: _Simulated) -> Candidate:
        """The magnitude at each place that goes best with the residual, of places that matter.

        Its change promises by as much of it as goes best; a fit starts with all of one.
        """
        offset = self._count
        explained, taken = self._explained(one.changes) if one.places else (np.zeros(0),) * 2
        best = _best_at_each(one.places, explained)
        start = {
            place: k if taken[k] > 0 else best[place]
            for place, k in _best_at_each(one.places, taken).items()
        }
        picked = [(place, k) for place, k in best.items() if explained[k] > 0]
        self._append(one.changes[[k for _, k in picked]])
        self._places |= {offset + n: (place, one.values[k]) for n, (place, k) in enumerate(picked)}
        own = list(range(offset, offset + len(picked)))
        free = list(range(len(self._nuisance)))
        total = len(self._objective.channels)
        while len(own) > 1:
            full = self._score([*free, *own])
            cost = [total * (self._score([*free, *(c for c in own if c != k)]) - full) for k in own]
            if min(cost) >= _NEEDED:
                break
            own.pop(int(np.argmin(cost)))
        # What promises nothing anywhere can still be fitted from where it does least harm.
        kept = [picked[k - offset][0] for k in own] or list(best)
        term = one.term
        if not term.shared and kept:
            sites = tuple(site for site in term.sites if site in kept)
            term = replace(term, sites=sites)
        return Candidate(
            term=term,
            tries={place: one.values[start[place]] for place in kept},
            columns=tuple(own),
        )

    def _explained(self, changes: Single) -> tuple[FloatArray, FloatArray]:
        """Squared gaps, weighted, that as much of each change takes away as is best, and all of it.

        Returns:
            (n,) and (n,).
        """
        root, r, basis = self._weighted
        a = (changes * root).reshape(len(changes), -1)
        a = a - (a @ basis) @ basis.T
        along = -(a @ r).astype(np.float64)
        size = np.einsum("ij,ij->i", a, a).astype(np.float64)
        return np.sign(along) * along**2 / np.maximum(size, 1e-300), 2 * along - size

    @cached_property
    def _weighted(self) -> tuple[Single, Single, Single]:
        """Roots of the channels' weights; by these the residual, without what goes freely with it.

        And (rows × n_scored, n) an orthonormal basis of that.
        """
        weights = self._objective.weights(self._objective.mean_square(self._residual))
        root = np.sqrt(weights).astype(np.float32)
        r = (self._residual.astype(np.float32) * root).ravel()
        free = self._nuisance[: len(self._nuisance) - len(self._bounded)]
        basis, _ = np.linalg.qr((free.astype(np.float32) * root).reshape(len(free), r.size).T)
        return root, r - basis @ (basis.T @ r), basis

    def _append(self, changes: FloatArray | Single) -> None:
        """Adds columns, (k, rows, n_scored), and their products with those that are there."""
        first, self._count = self._count, self._count + len(changes)
        if self._count > self._columns.shape[1]:
            more = self._count + self._columns.shape[1]
            self._columns = _enlarged(self._columns, (len(self._columns), more, self._rows))
            self._gram = _enlarged(self._gram, (len(self._gram), more, more))
        new = slice(first, self._count)
        self._columns[:, new] = changes.transpose(2, 0, 1)
        known = self._columns[:, : self._count]
        cross = self._columns[:, new] @ known.transpose(0, 2, 1)
        self._gram[:, new, : self._count] = cross
        self._gram[:, : self._count, new] = cross.transpose(0, 2, 1)
        along = np.einsum("ckr,cr->ck", self._columns[:, new], self._residual.T)
        self._along = np.concatenate([self._along, along], axis=1)

    def _score(self, columns: Sequence[int]) -> float:
        mean_square, _ = self._solved(columns)
        return float(self._objective.score(mean_square))

    def _solved(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """(n_scored,) mean squares beside as much of some columns as goes best, (k,) of each."""
        gram, along, square = self._gram, self._along, self._square
        objective = self._objective
        mean_square = square / objective.count
        k, x = np.asarray(columns, dtype=np.intp), np.zeros(len(columns))
        if k.size:
            gram, along = gram[:, k[:, None], k], along[:, k]
            first = len(self._nuisance) - len(self._bounded)
            bounded = (k >= first) & (k < len(self._nuisance))
            low, high = self._bounded.T
            for _ in range(_SWEEPS):
                weights = objective.weights(mean_square)
                matrix = np.einsum("c,cij->ij", weights, gram)
                matrix += np.diag(_RIDGE * np.diag(matrix) + 1e-300)
                target = -weights @ along
                x = np.linalg.solve(matrix, target)
                if bounded.any():
                    x = _within(matrix, target, x, bounded, low, high)
                left = square + 2 * along @ x + np.einsum("i,cij,j->c", x, gram, x)
                mean_square = np.maximum(left, 0) / objective.count
        return mean_square, x


def _enlarged(values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    larger = np.empty(shape)
    larger[tuple(slice(n) for n in values.shape)] = values
    return larger


def _best_at_each(places: Sequence[str], merit: FloatArray) -> dict[str, int]:
    """Place to the index of its best try, in the order of the places."""
    best: dict[str, int] = {}
    for k, place in enumerate(places):
        if place not in best or merit[k] > merit[best[place]]:
            best[place] = k
    return best


def _within(
    matrix: FloatArray,
    target: FloatArray,
    x: FloatArray,
    bounded: NDArray[np.bool_],
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """The x of least squares with some of its numbers within bounds, from the one without."""
    if (np.clip(x[bounded], low, high) == x[bounded]).all():
        return x
    free = ~bounded
    others, coupling = matrix[np.ix_(free, free)], matrix[np.ix_(free, bounded)]
    rest = np.linalg.solve(others, np.column_stack([target[free], coupling]))
    size = matrix[np.ix_(bounded, bounded)] - coupling.T @ rest[:, 1:]
    held = _best_within(size, target[bounded] - coupling.T @ rest[:, 0], low, high)
    x = x.copy()
    x[bounded], x[free] = held, rest[:, 0] - rest[:, 1:] @ held
    return x


def _best_within(
    matrix: FloatArray, target: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Minimises ½ xᵀAx − bᵀx within bounds, of few numbers: each is free or at one of its two."""
    which = np.array(list(itertools.product((0, -1, 1), repeat=len(target))))
    at_bound = np.where(which < 0, low, high)
    rows = np.where((which == 0)[:, :, None], matrix, np.eye(len(target)))
    x = np.linalg.solve(rows, np.where(which == 0, target, at_bound)[:, :, None])[:, :, 0]
    x = np.where(which == 0, x, at_bound)  # to the last digit
    cost = 0.5 * np.einsum("ni,ij,nj->n", x, matrix, x) - x @ target
    cost[((x < low) | (x > high)).any(axis=1)] = np.inf
    best: FloatArray = x[int(np.argmin(cost))]
    return best


def look(half: Half, current: Fit, terms: Sequence[Term], least: float = 0.0) -> View:
    """Simulates every term at its magnitudes on top of a fit.

    Args:
        half: the recordings, refined at the fit.
        current: what is already explained.
        terms: the effects. One that all joints share is also looked at with a value for each,
            where what it changes of each joint, by as much as suits that joint, promises anything.
        least: what has to be taken off the score for an effect to be looked at place by place.

    Returns:
        The view, with a candidate per term in their order, and then those with a value for each.
    """
    objective = half.objective
    own = current.case
    (simulated,) = objective.freed([own])[0]
    slopes = linearised(objective, current)
    felt = slopes.jacobian[np.square(slopes.jacobian).sum(axis=(1, 2)) > 0]
    nuisance = np.concatenate([felt, objective.numerical.changes])
    follow = _followers(felt)
    left = _without(follow, slopes.residual[None].astype(np.float32))[0]
    known = objective, current, simulated, left, follow
    hopeful = _hopeful(*known, terms, _MOST_HOPEFUL, least)
    found = _simulate(objective, current, simulated, hopeful)
    view = View(objective, current, simulated, nuisance, found, slopes)
    best = view.channels * (view.score - min(view.promise([i]) for i in range(len(terms))))
    half_of_it = max(_NEEDED, _OF_THE_BEST * best)
    apart = [
        replace(term, shared=False)
        for term, one in zip(terms, found, strict=True)
        if term.shared
        and _promise_apart(objective, left, _without(follow, one.changes)) > half_of_it
    ]
    hopeful = _hopeful(*known, apart, _MOST_APART, least)
    view.extend(_simulate(objective, current, simulated, hopeful))
    return view


def _promise_apart(objective: Objective, residual: Single, changes: Single) -> float:
    """What a change of all joints takes off the score, by another multiple in every channel."""
    return float(max(_promises(objective, residual, changes).sum(axis=1), default=0.0))


def _hopeful(
    objective: Objective,
    current: Fit,
    simulated: FloatArray,
    left: Single,
    follow: Sequence[Single],
    terms: Sequence[Term],
    count: int,
    least: float,
) -> list[Tries]:
    """The magnitudes of every term that are worth a simulation of their own at each place.

    An effect of many places is first tried at all of them at once. What then promises least, for
    whatever multiple of the change each channel may take, is not tried further; nor at joints
    whose own channels promise nothing.

    Args:
        objective: the recordings.
        current: what is already explained.
        simulated: (rows, n_scored) what it leaves, with the numerical error in it.
        left: (rows, n_scored) the same without, and without what the values in place can follow.
        follow: as `_followers` has it.
        terms: the effects.
        count: how many effects of many places are tried at each.
        least: what such an effect has to take off the score.
    """
    tries = [tries_of(current, term) for term in terms]
    several = [k for k, one in enumerate(tries) if len(one.term.places) > 1]
    cases = [tries[k].at_once(current) for k in several]
    joints = [channel.joint for channel in objective.channels]
    of_joint = np.array([[joint == own for own in joints] for joint in dict.fromkeys(joints)])
    promised: dict[int, FloatArray] = {}
    for group in objective.grouped(cases):
        for k, block in zip(several[group], objective.freed(cases[group]), strict=True):
            changes = _without(follow, (block - simulated).astype(np.float32))
            promised[k] = _promises(objective, left, changes)
    # What one joint lacks is not to drown in what the others would take of their noise.
    most = {k: _largest(one @ of_joint.T) for k, one in promised.items()}
    enough = {k for k, one in promised.items() if _largest(one.mean(axis=1)) >= least}
    ordered = sorted(enough, key=lambda k: (-most[k], k))
    hopeful = [k for k in ordered[:count] if most[k] > 0]
    for magnitudes in range(_MAGNITUDES, 0, -1):
        some = {
            k: tries[k].some(_best_magnitudes(tries[k], promised[k], joints, magnitudes))
            for k in hopeful
        }
        moves = [objective.moves(one.branches) for one in some.values()]
        rows = np.cumsum([1 + one.row.max(initial=-1) for one in moves])
        if not (rows > _MOST_ROWS).any():
            break
    kept = hopeful[: max(1, int(np.sum(rows <= _MOST_ROWS)))]
    for k in several:
        tries[k] = some[k] if k in kept else tries[k].some([])
    return tries


def _best_magnitudes(
    tries: Tries, promised: FloatArray, joints: Sequence[str | None], count: int
) -> list[int]:
    """Indices of the tries that promise most in the channels of their own place, few for each.

    With the best of those that go the other way, where none of them does. Of many places only the
    first few are tried where their own channels promise less than is needed: what all others change
    besides may hide one of them, though not from behind so many.

    Args:
        tries: the tries.
        promised: (n_magnitudes, n_scored) what each takes off, at all places at once.
        joints: (n_scored,) whose channel each is.
        count: how many magnitudes.
    """
    kept: dict[str, list[int]] = {}
    most: dict[str, float] = {}
    for place in dict.fromkeys(tries.places):
        here = [k for k, other in enumerate(tries.places) if other == place]
        own = [joint == place for joint in joints]
        merit = promised[: len(here), own if any(own) else slice(None)].sum(axis=1)
        order = np.argsort(-np.nan_to_num(merit, nan=np.inf), kind="stable").tolist()
        best = order[:count]
        # What the other places change besides may hide which way this one is off.
        ways = [np.sign(tries.values[k]).tolist() for k in here]
        opposite = [k for k in order if all(ways[k] == [-s for s in ways[b]] for b in best)]
        kept[place] = [here[k] for k in sorted([*best, *opposite[:1]])]
        most[place] = _largest(merit) if any(own) else np.inf
    first = sorted(kept, key=lambda place: -most[place])[:_MOST_HIDDEN]
    return [k for place, ks in kept.items() if place in first or most[place] >= _NEEDED for k in ks]


def _followers(slopes: FloatArray) -> list[Single]:
    """Of each channel (rows, k) directions in which the values in place can move it."""
    return [
        np.linalg.qr(column[:, np.square(column).sum(axis=0) > 0])[0].astype(np.float32)
        for column in np.moveaxis(slopes, 0, 2).transpose(1, 0, 2)
    ]


def _without(follow: Sequence[Single], changes: Single) -> Single:
    """(n, rows, n_scored) changes without what the values in place follow, channel by channel."""
    left = changes.copy()
    for c, basis in enumerate(follow):
        left[:, :, c] -= (changes[:, :, c] @ basis) @ basis.T
    return left


def _promises(objective: Objective, residual: Single, changes: Single) -> FloatArray:
    """What as much of each change as suits a channel takes off its ½ log, (n, n_scored).

    NaN for what diverged.
    """
    along = np.einsum("trc,rc->tc", changes, residual, dtype=np.float64)
    size = np.einsum("trc,trc->tc", changes, changes, dtype=np.float64)
    taken = np.where(along < 0, along**2, 0.0) / np.maximum(size, 1e-300)
    taken[np.isnan(size)] = np.nan
    before = np.square(residual).sum(axis=0, dtype=np.float64)
    floor = objective.count * objective.floor**2
    left = np.maximum(before - taken, 0.0) + floor
    promised: FloatArray = 0.5 * np.log((before + floor) / left)
    return promised


def _largest(promised: FloatArray) -> float:
    """Of what is known; that nothing is known promises everything."""
    return float(np.nanmax(promised)) if np.isfinite(promised).any() else np.inf


@dataclass(frozen=True, kw_only=True)
class Tries:
    """A term's values at its places, (n_tries,) each, and the only branches that they can change.

    Those of a place come one after the other.
    """

    term: Term
    places: tuple[str, ...]
    values: tuple[FloatArray, ...]
    branches: tuple[int | None, ...]

    def some(self, kept: Sequence[int]) -> Tries:
        """Some of the tries."""
        return replace(
            self,
            places=tuple(self.places[k] for k in kept),
            values=tuple(self.values[k] for k in kept),
            branches=tuple(self.branches[k] for k in kept),
        )

    def case(self, current: Fit, row: NDArray[np.intp]) -> Case:
        """The tries in the given rows, (n_tries,), on top of a fit."""
        structure = current.structure.with_term(self.term)
        start = carried(current.values, current.structure, structure)
        values = np.tile(start, (1 + int(row.max(initial=-1)), 1))
        for k, place, own in zip(row, self.places, self.values, strict=True):
            values[k, structure.columns(self.term, place)] = own
        return Case(structure=structure, values=values)

    def at_once(self, current: Fit) -> Case:
        """The first tries of all places in one row, the second in another, and so on."""
        seen = Counter[str]()
        row = np.empty(len(self.places), dtype=np.intp)
        for k, place in enumerate(self.places):
            row[k] = seen[place]
            seen[place] += 1
        return self.case(current, row)


def _simulate(
    objective: Objective, current: Fit, simulated: FloatArray, tries: Sequence[Tries]
) -> list[_Simulated]:
    moves = [objective.moves(one.branches) for one in tries]
    cases = [one.case(current, own.row) for one, own in zip(tries, moves, strict=True)]
    found = []
    for group in objective.grouped(cases):
        blocks = objective.freed(cases[group])
        for one, own, block in zip(tries[group], moves[group], blocks, strict=True):
            changes: Single = own.apart((block - simulated).astype(np.float32))
            failed = ~np.isfinite(changes).all(axis=(1, 2))
            if failed.any() and len(block) < len(changes):  # one may have taken others with it
                alone = one.case(current, np.arange(len(changes)))
                alone = replace(alone, values=alone.values[failed])
                changes[failed] = objective.freed([alone])[0] - simulated
                failed = ~np.isfinite(changes).all(axis=(1, 2))
            fine = np.flatnonzero(~failed & (changes != 0).any(axis=(1, 2)))
            found.append(
                _Simulated(
                    term=one.term,
                    places=tuple(one.places[k] for k in fine),
                    values=tuple(one.values[k] for k in fine),
                    changes=changes[fine],
                )
            )
    return found


def tries_of(current: Fit, term: Term) -> Tries:
    """Each magnitude at each place."""
    structure = current.structure.with_term(term)
    lower, upper = structure.bounds
    places, values, only = [], [], []
    for place in term.places:
        columns = structure.columns(term, place)
        magnitudes = [structure.slots[column].parameter.starts for column in columns]
        for magnitude in zip(*magnitudes, strict=True):
            places.append(place)
            values.append(np.clip(magnitude, lower[columns], upper[columns]))
            only.append(structure.branches[columns[0]])
    return Tries(term=term, places=tuple(places), values=tuple(values), branches=tuple(only))
