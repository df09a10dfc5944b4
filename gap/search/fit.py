"""Fitting many structures at once.

Levenberg–Marquardt on the score of `objective`, every structure from its own start, with all
perturbations of all structures simulated in one batch and all damping factors tried in another.
Bounded; a trial that diverges scores infinity.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.journal import digest, finished, packed, unpacked
from walkerkit.gap.search.objective import Case, Moves, Objective
from walkerkit.gap.search.structure import Structure

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]  # what is being done, and how far it is (0 to 1)

_PERTURBATION = 0.02  # of a parameter's scale
_DAMPING = np.array([1e-4, 1e-2, 0.3, 10.0])
_CONVERGED, _CONVERGED_IN_RACE = 3e-4, 2e-3  # of the score
INSENSITIVE = 1e-3  # a sensitivity: no gap changes by more than three per cent
_ALIGNED = 0.2  # how much of the model's error looks like a change of one of its numbers
_UNCORRECTED = 0.25  # of what half the timestep changes
_PACES = 4  # a step gains less than the one before, so a lag of more than these is not made up


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A structure with its fitted values.

    Attributes:
        structure: the structure.
        values: (n_parameters,).
        score: its score on the recordings that were fitted.
        mean_square: (n_scored,) mean square gaps on them.
    """

    structure: Structure
    values: FloatArray
    score: float
    mean_square: FloatArray


def evaluate(objective: Objective, fits: Sequence[tuple[Structure, FloatArray]]) -> list[Fit]:
    """Simulates structures at given values, without fitting."""
    return _finished(fits, lambda: _evaluate(objective, fits))


def _evaluate(objective: Objective, fits: Sequence[tuple[Structure, FloatArray]]) -> list[Fit]:
    cases = [Case(structure=s, values=v[None]) for s, v in fits]
    found = []
    for case, (mean_square,) in zip(cases, objective.mean_squares(cases), strict=True):
        found.append(
            Fit(
                structure=case.structure,
                values=case.values[0],
                score=float(objective.score(mean_square)),
                mean_square=mean_square,
            )
        )
    return found


def fit(
    objective: Objective,
    starts: Sequence[Fit],
    *,
    iterations: int = 8,
    race: Sequence[int] | None = None,
    progress: Progress | None = None,
    stage: str = "fitting",
) -> list[Fit]:
    """Improves every start until it converges.

    Args:
        objective: what to fit.
        starts: structures with values and their score.
        iterations: the most steps any of them may take.
        race: the race that each start is in, to give up on a structure that is too far behind the
            best of its race to catch up at its pace; None to take all to their end.
        progress: called before each step.
        stage: what it is told.

    Returns:
        The fits, in the order of `starts`; none scores worse than it started.
    """
    return _finished(
        [(start.structure, start.values) for start in starts],
        lambda: _fit(objective, starts, iterations, race, progress, stage),
    )


def _fit(
    objective: Objective,
    starts: Sequence[Fit],
    iterations: int,
    race: Sequence[int] | None,
    progress: Progress | None,
    stage: str,
) -> list[Fit]:
    best = list(starts)
    active = [i for i, start in enumerate(best) if len(start.values) and np.isfinite(start.score)]
    for iteration in range(iterations):
        if not active:
            break
        if progress:
            progress(stage, iteration / iterations)
        normals = _normal_equations(objective, [best[i] for i in active])
        cases = [
            Case(structure=best[i].structure, values=_steps(best[i], *normal))
            for i, normal in zip(active, normals, strict=True)
        ]
        gains: dict[int, float] = {}
        for i, case, mean_square in zip(active, cases, objective.mean_squares(cases), strict=True):
            scores = objective.score(mean_square)
            k = int(np.argmin(scores))
            gain = best[i].score - float(scores[k])
            if gain > 0:
                best[i] = replace(
                    best[i],
                    values=case.values[k],
                    score=float(scores[k]),
                    mean_square=mean_square[k],
                )
            gains[i] = gain
        if race is None:
            active = [i for i, gain in gains.items() if gain > _CONVERGED]
        else:
            active = [
                i
                for i, gain in gains.items()
                if gain > _CONVERGED_IN_RACE
                and best[i].score - _leader(best, race, race[i]) < _PACES * gain
            ]
    return best


def _finished(
    starts: Sequence[tuple[Structure, FloatArray]], make: Callable[[], list[Fit]]
) -> list[Fit]:
    """The fits of some structures, from the journal where it has them."""

    def unpack(content: Any) -> list[Fit]:
        arrays = [unpacked(one) for one in content]
        return [
            Fit(structure=structure, values=values, score=float(score), mean_square=mean_square)
            for (structure, _), (values, score, mean_square) in zip(starts, arrays, strict=True)
        ]

    return finished(
        digest(*(part for s, values in starts for part in (repr(s.key), values))),
        make,
        lambda fits: [packed([f.values, np.array(f.score), f.mean_square]) for f in fits],
        unpack,
    )


def _leader(fits: Sequence[Fit], race: Sequence[int], which: int) -> float:
    return min(one.score for one, own in zip(fits, race, strict=True) if own == which)


@dataclass(frozen=True, kw_only=True)
class _Perturbed:
    """A fit, and every parameter moved a little, away from its bound.

    Attributes:
        case: the values as they are, then with as many moved at once as cannot meet.
        move: (n_parameters,) the signed moves.
        moves: where each of them is.
    """

    case: Case
    move: FloatArray
    moves: Moves


def _perturbed(objective: Objective, current: Fit) -> _Perturbed:
    structure = current.structure
    _, upper = structure.bounds
    move = _PERTURBATION * structure.scale
    move = np.where(current.values + move > upper, -move, move)
    moves = objective.moves(structure.branches)
    values = np.tile(current.values, (2 + int(moves.row.max(initial=-1)), 1))
    values[1 + moves.row, np.arange(len(move))] += move
    return _Perturbed(case=Case(structure=structure, values=values), move=move, moves=moves)


def _normal_equations(
    objective: Objective, fits: Sequence[Fit]
) -> list[tuple[FloatArray, FloatArray]]:
    """JᵀWJ and JᵀWr of every fit, in units of the parameters' scales."""
    moved = [_perturbed(objective, one) for one in fits]
    cases = [one.case for one in moved]
    equations = []
    for group in objective.grouped(cases):
        linearised = objective.linearised(cases[group], [one.moves for one in moved[group]])
        for one, perturbed, (residual, changes) in zip(
            fits[group], moved[group], linearised, strict=True
        ):
            jacobian = _jacobian(one, changes, perturbed.move)
            weighted = jacobian * objective.weights(one.mean_square)
            flat = weighted.reshape(len(jacobian), -1)
            equations.append(
                (flat @ jacobian.reshape(len(jacobian), -1).T, flat @ residual.ravel())
            )
    return equations


def _jacobian(one: Fit, changes: FloatArray, move: FloatArray) -> FloatArray:
    """(n_parameters, rows, n_scored) per scale; zero for a perturbation that diverged."""
    slope = changes * (one.structure.scale / move)[:, None, None]
    return np.where(np.isfinite(slope), slope, 0.0)


def jacobian(objective: Objective, one: Fit) -> FloatArray:
    """(n_parameters, rows, n_scored) what each parameter changes, per scale."""
    if not len(one.values):
        return np.zeros((0, *objective.measured.shape))
    perturbed = _perturbed(objective, one)
    ((_, changes),) = objective.linearised([perturbed.case], [perturbed.moves])
    return _jacobian(one, changes, perturbed.move)


def losses(objective: Objective, one: Fit) -> FloatArray:
    """(n_parameters,) by how much the score rises, by the slopes, where each is at its zero.

    The other parameters follow.
    """
    ((normal, _),) = _normal_equations(objective, [one])
    variance = np.diag(np.linalg.pinv(normal, rcond=1e-12, hermitian=True))
    away = (one.values - one.structure.zero) / one.structure.scale
    lost: FloatArray = 0.5 * away**2 / np.maximum(variance, 1e-300)
    return np.where(np.diag(normal) > 0, lost, 0.0)


def _steps(one: Fit, normal: FloatArray, gradient: FloatArray) -> FloatArray:
    """One step per damping factor, within the bounds."""
    lower, upper = one.structure.bounds
    pushed_out = ((one.values <= lower) & (gradient > 0)) | ((one.values >= upper) & (gradient < 0))
    # A parameter that the recordings do not feel would be sent far away by the slightest slope.
    free = ~pushed_out & (_sensitivity(one, normal) > INSENSITIVE)
    steps = np.zeros((len(_DAMPING), len(gradient)))
    if free.any():
        a = normal[np.ix_(free, free)]
        diagonal = np.diag(a)
        for k, damping in enumerate(_DAMPING):
            steps[k, free] = -np.linalg.solve(a + np.diag(damping * diagonal), gradient[free])
    return np.clip(one.values + steps * one.structure.scale, lower, upper)


def _sensitivity(one: Fit, normal: FloatArray) -> FloatArray:
    """(n_parameters,) what their whole ranges would change, as in `covariance`."""
    lower, upper = one.structure.bounds
    scales: FloatArray = (upper - lower) / one.structure.scale
    return np.diag(normal) * scales**2 * len(one.mean_square)


def covariance(
    objective: Objective, one: Fit, noise: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Covariance of the values, and how much each matters.

    The errors of one joint stay alike for a while, so rows are not independent: the blocks of the
    objective are (a cluster-robust sandwich, Liang and Zeger, Biometrika 73, 1986). What is left of
    a gap beyond the noise is no chance but the model's error, which pulls the values the same way
    wherever it shows: it may lie along what a number changes, by a cosine of `_ALIGNED`. So may
    what the timestep changes, which is taken out only as far as it is known.

    Args:
        objective: the recordings that were fitted.
        one: the fit.
        noise: (n_scored,) noise of the channels, to allow for the model's error; None for none.

    Returns:
        (n_parameters, n_parameters) covariance, and (n_parameters,) sensitivities: the squared
        change that a parameter's whole range would make at its slope, in gaps, added up over the
        scored channels. Below `INSENSITIVE` the recordings say nothing of it, and `fit` leaves it
        where it started.
    """
    perturbed = _perturbed(objective, one)
    ((residual, changes),) = objective.linearised([perturbed.case], [perturbed.moves])
    jacobian = _jacobian(one, changes, perturbed.move)
    weighted = jacobian * objective.weights(one.mean_square)
    normal = np.einsum("irc,jrc->ij", weighted, jacobian)
    pull = np.einsum("irc,rc->ir", weighted, residual)
    scores = np.stack([np.bincount(objective.block, weights=row) for row in pull])
    blocks = scores.shape[1]
    inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    meat = scores @ scores.T * (blocks / max(1, blocks - len(one.values)))
    found = inverse @ meat @ inverse
    if noise is not None:
        size = one.mean_square + objective.floor**2
        beyond = float(np.mean(np.maximum(one.mean_square - noise**2, 0.0) / size))
        found += _ALIGNED**2 * beyond * inverse
        for change in objective.numerical:
            pulled = inverse @ np.einsum("irc,rc->i", weighted, change)
            found += _UNCORRECTED**2 * np.outer(pulled, pulled)
    scale = np.diag(one.structure.scale)
    return scale @ found @ scale, _sensitivity(one, normal)
