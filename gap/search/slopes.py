"""Slopes of a fit: what each of its numbers changes of the residual.

slopes = linearised(objective, fit)
slopes.follow(step, residual, weights)    # where the fit moves on
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.objective import Moves, Objective, simulated_each
from walkerkit.gap.search.structure import Case, Fit, Structure, found_in

FloatArray = NDArray[np.float64]

_PERTURBATION = 0.02  # of a parameter's scale
_BEYOND_JUMPS = 0.3  # of it, to both sides: over so much what goes steadily outweighs what jumps
_ROWS = 256  # of slopes, multiplied at a time
_RIGHT = 0.1  # of what a step changes may be otherwise than the slopes said


@dataclass(kw_only=True)
class Slopes:
    """What each parameter changes of a fit's residual, carried along with the fit.

    Where a step changed the residual by something else than the slopes said, they are turned as
    little as makes them right along that step (Broyden, Mathematics of Computation 19, 1965).

    Attributes:
        structure: that of the fit.
        residual: (rows, n_scored).
        jacobian: (n_parameters, rows, n_scored) per scale.
        simulated: how many simulations that took; few are not worth carrying along.
        fresh: they are of this very fit.
        right: they said what the last step would change.
        sure: they are of this very fit, or said what the only step since then would change.
        uncorrected: residual and jacobian with the numerical error in them, where they were kept.
    """

    structure: Structure
    residual: FloatArray
    jacobian: FloatArray
    simulated: int
    fresh: bool = True
    right: bool = False
    sure: bool = True
    uncorrected: tuple[FloatArray, FloatArray] | None = None

    def keep(self, objective: Objective) -> None:
        """Keeps what they are with the numerical error in them, to be predicted far away."""
        residual, jacobian = self.residual[None].copy(), self.jacobian.copy()
        objective.numerical.free(residual)
        objective.numerical.free(jacobian)
        self.uncorrected = residual[0], jacobian

    @property
    def as_simulated(self) -> FloatArray:
        """(n_parameters, rows, n_scored) per scale, with the numerical error in them."""
        return self.jacobian if self.uncorrected is None else self.uncorrected[1]

    def correct(self, objective: Objective) -> None:
        """Takes out the numerical error."""
        self.residual, self.jacobian = objective.corrected(self.residual, self.jacobian)

    def at_another_error(self, objective: Objective, one: Fit) -> Slopes:
        """The same, of a fit that they have followed, where other numerical errors are taken out.

        These change what the numbers change by little.
        """
        (residual,) = objective.residuals([one.case])[0]
        return self._believed(residual, self.jacobian)

    def trusting(self, objective: Objective, one: Fit) -> Slopes:
        """The same, of a fit near by, of recordings of which some blocks count less."""
        (residual,) = objective.simulated([one.case])[0]
        jacobian = self.as_simulated.copy()
        if objective.root is not None:
            jacobian *= objective.root
        found = self._believed(residual, jacobian)
        found.correct(objective)
        return found

    def _believed(self, residual: FloatArray, jacobian: FloatArray) -> Slopes:
        """Slopes that are right, though they are not of this very fit."""
        return replace(
            self,
            residual=residual,
            jacobian=jacobian,
            fresh=False,
            right=True,
            sure=True,
            uncorrected=None,
        )

    def score(self, objective: Objective, step: FloatArray) -> float:
        """The score that they foretell after a step, (n_parameters,) in scales."""
        residual = self.residual + np.tensordot(step, self.jacobian, 1)
        return float(objective.score(objective.mean_square(residual[None]))[0])

    def follow(self, step: FloatArray, residual: FloatArray, weights: FloatArray) -> None:
        """Moves on by a step, (n_parameters,) in scales, to where the residual is another."""
        changed = residual - self.residual
        missed = changed - np.tensordot(step, self.jacobian, 1)
        length = float(step @ step)
        for k in np.flatnonzero(step):
            self.jacobian[k] += step[k] / length * missed
        self.residual = residual.copy()
        size, wrong = (float(np.sum(weights * one**2)) for one in (changed, missed))
        self.right = wrong < _RIGHT**2 * size
        self.fresh, self.sure = False, self.fresh and self.right


@dataclass(frozen=True, kw_only=True)
class _Perturbed:
    """A fit, and every parameter moved a little, away from its bound, once or to both sides.

    Attributes:
        case: the values as they are, then with as many moved at once as cannot meet, side by side.
        move: (n_sides, n_parameters) the signed moves.
        moves: where each of them is.
    """

    case: Case
    move: FloatArray
    moves: Moves


def linearised(objective: Objective, one: Fit, *, part: float = _PERTURBATION) -> Slopes:
    """The slopes at a fit, and what they are with the numerical error in them.

    Over a part of each number's scale; where residuals jump, over more of it to both sides.
    """
    (found,) = linearised_each([objective], [one], part=part, correct=False)
    found.keep(objective)
    found.correct(objective.in_the_light_of(one.case))
    return found


def slopes_to_carry(objective: Objective, one: Fit) -> Slopes | None:
    """The slopes at a fit, for others to begin with; None where it has no numbers."""
    return linearised(objective, one) if len(one.values) else None


def linearised_each(
    objectives: Sequence[Objective],
    fits: Sequence[Fit],
    own: Sequence[NDArray[np.intp]] | None = None,
    *,
    part: float = _PERTURBATION,
    correct: bool = True,
) -> Iterator[Slopes]:
    """The slopes at every fit, simulated, or those of some of its numbers, zero for the others.

    Each for its own objective and over a part of the number's scale; with the numerical error in
    them if not corrected. Where residuals jump, from moves over more of it to both sides.
    """
    if own is None:
        own = [np.arange(len(one.values)) for one in fits]
    moved = [
        _perturbed(objective, one, some, part)
        for objective, one, some in zip(objectives, fits, own, strict=True)
    ]
    simulated = simulated_each(objectives, [one.case for one in moved])
    for objective, one, some, perturbed, residuals in zip(
        objectives, fits, own, moved, simulated, strict=True
    ):
        residual = residuals[0]
        secants = []
        sides = np.split(residuals[1:] - residual, len(perturbed.move))
        for changes, move in zip(sides, perturbed.move, strict=True):
            secant = perturbed.moves.apart(changes)
            secant *= (one.structure.scale[some] / move)[:, None, None]
            secant[~np.isfinite(secant.sum(axis=(1, 2)))] = 0.0  # what diverged
            secants.append(secant)
        slopes = Slopes(
            structure=one.structure,
            residual=residual,
            jacobian=np.mean(secants, axis=0) if objective.jumps else secants[0],
            simulated=len(perturbed.case.values) - 1,
        )
        if correct:
            slopes.correct(objective.in_the_light_of(one.case))
        if len(some) < len(one.values):
            found, slopes.jacobian = slopes.jacobian, np.zeros((len(one.values), *residual.shape))
            slopes.jacobian[some] = found
        yield slopes


def near_slopes(objective: Objective, near: Slopes, starts: Sequence[Fit]) -> Iterator[Slopes]:
    """Slopes to begin with: those of another fit for the numbers that it has, others simulated.

    Those of what a new effect extends at a place are simulated as well: how rigid friction slopes
    says nothing of friction that bristles carry.
    """
    if not len(near.jacobian):
        yield from linearised_each([objective] * len(starts), starts)
        return
    places = [_carried_over(start.structure, near.structure) for start in starts]
    own = [np.flatnonzero(place < 0) for place in places]
    for start, place, slopes in zip(
        starts, places, linearised_each([objective] * len(starts), starts, own), strict=True
    ):
        scale = start.structure.scale / near.structure.scale[place]
        for k in np.flatnonzero(place >= 0):
            np.multiply(near.jacobian[place[k]], scale[k], out=slopes.jacobian[k])
        slopes.fresh = slopes.sure = False
        slopes.simulated = len(place)
        yield slopes


def _carried_over(structure: Structure, near: Structure) -> NDArray[np.intp]:
    """(n_parameters,) index of each number among those near by; -1 where its slope is another."""
    found = found_in(structure, near)
    new = [slot for slot, place in zip(structure.slots, found, strict=True) if place < 0]
    other = {(name, slot.place) for slot in new for name in slot.term.effect.extends}
    is_other = [slot.unit in other for slot in structure.slots]
    carried: NDArray[np.intp] = np.where(is_other, -1, found)
    return carried


def _perturbed(
    objective: Objective, current: Fit, own: NDArray[np.intp], part: float
) -> _Perturbed:
    structure = current.structure
    lower, upper = structure.bounds
    # A foot that touches down a step earlier makes what follows jump, after the smallest move.
    move = (_BEYOND_JUMPS if objective.jumps else part) * structure.scale
    move = np.where(current.values + move > upper, -move, move)
    sides = [move]
    if objective.jumps:
        back = current.values - move
        sides.append(np.where((back < lower) | (back > upper), 0.5 * move, -move))
    moves = objective.moves([structure.branches[k] for k in own])
    count = 1 + int(moves.row.max(initial=-1))
    values = np.tile(current.values, (1 + len(sides) * count, 1))
    for k, side in enumerate(sides):
        values[1 + k * count + moves.row, own] += side[own]
    return _Perturbed(
        case=Case(structure=structure, values=values), move=np.stack(sides)[:, own], moves=moves
    )


def normal_equations(
    objective: Objective, one: Fit, slopes: Slopes
) -> tuple[FloatArray, FloatArray]:
    """JᵀWJ and JᵀWr, in units of the parameters' scales."""
    weights = objective.weights(one.mean_square)
    n, rows, _ = slopes.jacobian.shape
    normal, gradient = np.zeros((n, n)), np.zeros(n)
    # A few rows at a time stay in a core's cache.
    for first in range(0, rows, _ROWS):
        part = slopes.jacobian[:, first : first + _ROWS]
        weighted = (part * weights).reshape(n, part.shape[1] * part.shape[2])
        normal += weighted @ part.reshape(weighted.shape).T
        gradient += weighted @ slopes.residual[first : first + _ROWS].ravel()
    return normal, gradient


def posterior_equations(
    objective: Objective, one: Fit, slopes: Slopes
) -> tuple[FloatArray, FloatArray]:
    """As `normal_equations`, with the priors of the parameters."""
    normal, gradient = normal_equations(objective, one, slopes)
    structure = one.structure
    curved = structure.prior_curvature(one.values) / objective.prior_samples
    return normal + np.diag(curved), gradient + curved * (
        one.values - structure.zero
    ) / structure.scale
