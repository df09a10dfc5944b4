"""Fitting many structures at once.

Levenberg–Marquardt on the score of `objective`, every structure from its own start, with all
perturbations of all structures simulated in one batch and all damping factors tried in another.
Bounded; a trial that diverges scores infinity.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.journal import digest, finished, packed, unpacked
from walkerkit.gap.search.objective import Case, Moves, Objective
from walkerkit.gap.search.structure import Structure, found_in

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]  # what is being done, and how far it is (0 to 1)

_PERTURBATION = 0.02  # of a parameter's scale
_SECANT = 0.3  # of it, too, where a slope has to hold for more than the next dent of a gap
_DAMPING = np.array([1e-4, 1e-2, 0.3, 10.0])
_CONVERGED, _CONVERGED_IN_RACE = 3e-4, 2e-3  # of the score
INSENSITIVE = 1e-3  # a sensitivity: no gap changes by more than three per cent
_ALIGNED = 0.2  # how much of the model's error looks like a change of one of its numbers
_UNCORRECTED = 0.25  # of what half the timestep changes
_AT_BOUND = 1e-6  # of the width between the bounds
_RIGHT = 0.1  # of what a step changes may be otherwise than the slopes said
_KEEPS = 0.5  # of its promise that a whole step has to keep
_KEPT = 2**28  # bytes of slopes that are carried along
_RACED, _FEWEST_RACED = 64, 3  # steps in a race, times numbers; and whatever their number
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

    @property
    def case(self) -> Case:
        """Its values, to be simulated."""
        return Case(structure=self.structure, values=self.values[None])


def evaluate(objective: Objective, fits: Sequence[tuple[Structure, FloatArray]]) -> list[Fit]:
    """Simulates structures at given values, without fitting."""
    return _finished(fits, lambda: _evaluate(objective, fits))


def _evaluate(objective: Objective, fits: Sequence[tuple[Structure, FloatArray]]) -> list[Fit]:
    return best_of(objective, [Case(structure=s, values=v[None]) for s, v in fits])


def best_of(objective: Objective, cases: Sequence[Case]) -> list[Fit]:
    """The row of each case that scores best."""
    return [
        _best_row(objective, case, mean_square)[0]
        for case, mean_square in zip(cases, objective.mean_squares(cases), strict=True)
    ]


def fit(
    objective: Objective,
    starts: Sequence[Fit],
    *,
    iterations: int = 8,
    race: Sequence[int] | None = None,
    near: Slopes | None = None,
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
        near: slopes of a fit that has numbers in common with all starts, to begin with.
        progress: called before each step.
        stage: what it is told.

    Returns:
        The fits, in the order of `starts`; none scores worse than it started.
    """
    return _finished(
        [(start.structure, start.values) for start in starts],
        lambda: _fit(objective, starts, iterations, race, near, progress, stage),
    )


def _fit(
    objective: Objective,
    starts: Sequence[Fit],
    iterations: int,
    race: Sequence[int] | None,
    near: Slopes | None,
    progress: Progress | None,
    stage: str,
) -> list[Fit]:
    best = list(starts)
    active = [i for i, start in enumerate(best) if len(start.values) and np.isfinite(start.score)]
    taken = dict.fromkeys(active, 0)
    slopes: dict[int, Slopes] = {}
    size = sum(len(best[i].values) for i in active) * objective.measured.nbytes
    if near is not None and size <= _KEPT:
        slopes = dict(zip(active, _near(objective, near, [best[i] for i in active]), strict=True))
    while active:
        if progress:
            progress(stage, min(taken[i] for i in active) / iterations)
        cases = _next_steps(objective, best, active, slopes)
        # They may be right along the last step and nowhere else, so that only a race trusts that.
        trusted = {
            i
            for i in active
            if i not in slopes or slopes[i].fresh or (race is not None and slopes[i].right)
        }
        gains: dict[int, float] = {}
        for i, case, residual in zip(active, cases, _residuals(objective, cases), strict=True):
            better, there = _best(objective, case, residual)
            gains[i] = best[i].score - better.score
            if gains[i] > 0:
                if i in slopes:
                    step = (better.values - best[i].values) / case.structure.scale
                    slopes[i].follow(step, there, objective.weights(better.mean_square))
                best[i] = better
        active, before = [], active
        for i in before:
            leader = _leader(best, race, race[i]) if race is not None else -np.inf
            least = _CONVERGED if race is None else _CONVERGED_IN_RACE
            if gains[i] > least and (race is None or best[i].score - leader < _PACES * gains[i]):
                taken[i] += 1
                most = iterations if race is None else _RACED // len(best[i].values)
                if taken[i] < min(iterations, max(_FEWEST_RACED, most)):
                    active.append(i)
            elif i not in trusted:
                del slopes[i]  # which cannot say that there is no more
                active.append(i)
            else:
                slopes.pop(i, None)
    return best


def polish(
    objective: Objective,
    start: Fit,
    slopes: Slopes | None = None,
    *,
    iterations: int = 20,
    certain: bool = True,
    progress: Progress | None = None,
    stage: str = "fitting",
) -> tuple[Fit, Slopes]:
    """Improves a fit that is near its best, in as few simulations as that takes.

    A step is taken whole where that keeps half of what the slopes promise, and what they promise
    no more of is not simulated; they are believed where they foretold the step that led there.

    Args:
        objective: what to fit.
        start: structure and values; its score may be that on other recordings.
        slopes: those there, where they are known.
        iterations: the most steps.
        certain: slopes that were right along the last step may be wrong elsewhere; do not end on
            them.
        progress: called before each step.
        stage: what it is told.

    Returns:
        The fit, and the slopes there.
    """
    if slopes is None:
        slopes = linearised(objective, start)
    best, _ = _best(objective, start.case, slopes.residual[None])
    for k in range(iterations if len(best.values) and np.isfinite(best.score) else 0):
        if progress:
            progress(stage, k / iterations)
        normal, gradient = _normal_equations(objective, best, slopes)
        trials = _steps(best, normal, gradient)
        step = (trials[0] - best.values) / best.structure.scale
        promised = -float(step @ (gradient + 0.5 * normal @ step))
        if promised < _CONVERGED and (slopes.sure or (slopes.right and not certain)):
            break
        fresh, gain = slopes.fresh, 0.0
        if promised >= _CONVERGED:
            better, residual = _tried(objective, best.structure, trials[:1])
            if best.score - better.score < _KEEPS * promised:
                damped = _tried(objective, best.structure, trials[1:])
                better, residual = min((better, residual), damped, key=lambda one: one[0].score)
            gain = best.score - better.score
            if gain > 0:
                step = (better.values - best.values) / best.structure.scale
                slopes.follow(step, residual, objective.weights(better.mean_square))
                best = better
        if gain < _CONVERGED:
            if fresh:
                break
            slopes = linearised(objective, best)
    return best, slopes


def polished(
    objective: Objective,
    start: Fit,
    near: Slopes | None = None,
    *,
    iterations: int,
    certain: bool = True,
) -> Fit:
    """What `polish` finds, from the journal where it has it.

    Args:
        objective: what to fit.
        start: structure and values.
        near: slopes of a fit that has numbers in common with it, to begin with.
        iterations: the most steps.
        certain: as there.
    """

    def make() -> list[Fit]:
        slopes = None
        if near is not None:
            slopes = next(_near(objective, near, [start]))
        found, _ = polish(objective, start, slopes, iterations=iterations, certain=certain)
        return [found]

    (found,) = _finished([(start.structure, start.values)], make)
    return found


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
    """

    structure: Structure
    residual: FloatArray
    jacobian: FloatArray
    simulated: int
    fresh: bool = True
    right: bool = False
    sure: bool = True

    def correct(self, objective: Objective) -> None:
        """Takes out the numerical error."""
        self.residual, self.jacobian = objective.corrected(self.residual, self.jacobian)

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


def _near(objective: Objective, near: Slopes, starts: Sequence[Fit]) -> Iterator[Slopes]:
    """Slopes to begin with: those of another fit for the numbers that it has, others simulated."""
    places = [found_in(start.structure, near.structure) for start in starts]
    own = [np.flatnonzero(place < 0) for place in places]
    for start, place, slopes in zip(
        starts, places, _linearised(objective, starts, own), strict=True
    ):
        scale = start.structure.scale / near.structure.scale[place]
        slopes.jacobian = np.where(
            (place < 0)[:, None, None],
            slopes.jacobian,
            near.jacobian[place] * scale[:, None, None],
        )
        slopes.fresh = slopes.sure = False
        slopes.simulated = len(place)
        yield slopes


def _next_steps(
    objective: Objective, best: Sequence[Fit], active: Sequence[int], slopes: dict[int, Slopes]
) -> list[Case]:
    """A trial per damping factor for each fit; finds the slopes that are missing."""
    steps = {
        i: _steps(best[i], *_normal_equations(objective, best[i], slopes[i]))
        for i in active
        if i in slopes
    }
    room = _KEPT - sum(one.jacobian.nbytes for one in slopes.values())
    missing = [i for i in active if i not in slopes]
    for i, found in zip(missing, _linearised(objective, [best[i] for i in missing]), strict=True):
        steps[i] = _steps(best[i], *_normal_equations(objective, best[i], found))
        if found.simulated > len(_DAMPING) and found.jacobian.nbytes <= room:
            room -= found.jacobian.nbytes
            slopes[i] = found
    return [Case(structure=best[i].structure, values=steps[i]) for i in active]


def _tried(
    objective: Objective, structure: Structure, values: FloatArray
) -> tuple[Fit, FloatArray]:
    """The best of some values, (n, n_parameters), with its residual."""
    case = Case(structure=structure, values=values)
    (residual,) = objective.residuals([case])
    return _best(objective, case, residual)


def _best(objective: Objective, case: Case, residual: FloatArray) -> tuple[Fit, FloatArray]:
    """The same of values that are simulated, (n, rows, n_scored)."""
    found, k = _best_row(objective, case, objective.mean_square(residual))
    return found, residual[k]


def _best_row(objective: Objective, case: Case, mean_square: FloatArray) -> tuple[Fit, int]:
    """The best of some values whose gaps are known, (n, n_scored), and which it is."""
    scores = objective.score(mean_square)
    k = int(np.argmin(scores))
    found = Fit(
        structure=case.structure,
        values=case.values[k],
        score=float(scores[k]),
        mean_square=mean_square[k],
    )
    return found, k


def _residuals(objective: Objective, cases: Sequence[Case]) -> Iterator[FloatArray]:
    for group in objective.grouped(cases):
        yield from objective.residuals(cases[group])


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


def _perturbed(
    objective: Objective, current: Fit, own: NDArray[np.intp], part: float
) -> _Perturbed:
    structure = current.structure
    _, upper = structure.bounds
    move = part * structure.scale
    move = np.where(current.values + move > upper, -move, move)[own]
    moves = objective.moves([structure.branches[k] for k in own])
    values = np.tile(current.values, (2 + int(moves.row.max(initial=-1)), 1))
    values[1 + moves.row, own] += move
    return _Perturbed(case=Case(structure=structure, values=values), move=move, moves=moves)


def _linearised(
    objective: Objective,
    fits: Sequence[Fit],
    own: Sequence[NDArray[np.intp]] | None = None,
    *,
    part: float = _PERTURBATION,
    correct: bool = True,
) -> Iterator[Slopes]:
    """The slopes at every fit, simulated, or those of some of its numbers, zero for the others.

    Each over a part of the number's scale; with the numerical error in them if not corrected.
    """
    if own is None:
        own = [np.arange(len(one.values)) for one in fits]
    moved = [_perturbed(objective, one, some, part) for one, some in zip(fits, own, strict=True)]
    cases = [one.case for one in moved]
    for group in objective.grouped(cases):
        linearised = objective.linearised(cases[group], [one.moves for one in moved[group]])
        for one, some, perturbed, (residual, changes) in zip(
            fits[group], own[group], moved[group], linearised, strict=True
        ):
            changes *= (one.structure.scale[some] / perturbed.move)[:, None, None]
            changes[~np.isfinite(changes.sum(axis=(1, 2)))] = 0.0  # what diverged
            jacobian = changes
            if len(some) < len(one.values):
                jacobian = np.zeros((len(one.values), *residual.shape))
                jacobian[some] = changes
            slopes = Slopes(
                structure=one.structure,
                residual=residual,
                jacobian=jacobian,
                simulated=len(perturbed.case.values) - 1,
            )
            if correct:
                slopes.correct(objective)
            yield slopes


def _normal_equations(
    objective: Objective, one: Fit, slopes: Slopes
) -> tuple[FloatArray, FloatArray]:
    """JᵀWJ and JᵀWr, in units of the parameters' scales."""
    weighted = slopes.jacobian * objective.weights(one.mean_square)
    flat = weighted.reshape(len(weighted), -1)
    jacobian = slopes.jacobian.reshape(len(weighted), -1)
    return flat @ jacobian.T, flat @ slopes.residual.ravel()


def linearised(objective: Objective, one: Fit) -> Slopes:
    """The slopes at a fit."""
    (found,) = _linearised(objective, [one])
    return found


def slopes_to_carry(objective: Objective, one: Fit) -> Slopes | None:
    """The slopes at a fit, for others to begin with; None where it has no numbers."""
    return linearised(objective, one) if len(one.values) else None


def losses(objective: Objective, one: Fit, slopes: Slopes) -> FloatArray:
    """(n_parameters,) by how much the score rises, by the slopes, where each is at its zero.

    The other parameters follow.
    """
    normal, _ = _normal_equations(objective, one, slopes)
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
    objective: Objective,
    one: Fit,
    noise: FloatArray | None = None,
    slopes: Slopes | None = None,
    part: Objective | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Covariance of the values, and how much each matters.

    The errors of one joint stay alike for a while, so rows are not independent: the blocks of the
    objective are (a cluster-robust sandwich, Liang and Zeger, Biometrika 73, 1986). What is left of
    a gap beyond the noise is no chance but the model's error, which pulls the values the same way
    wherever it shows: it may lie along what a number changes, by a cosine of `_ALIGNED`. So may
    what the timestep changes, which is taken out only as far as it is known: where a number and
    the timestep change the same, too little or too much of it goes into the number. A jagged gap
    is steeper from dent to dent than as a whole: of two slopes, over little and over more of a
    number's scale, the one that tells less counts.

    Args:
        objective: the recordings that were fitted.
        one: the fit.
        noise: (n_scored,) noise of the channels, to allow for the model's error; None for none.
        slopes: of the fit, where they are known.
        part: of the recordings, on which it is seen how jagged the gap is and what the timestep
            pulls; all by default.

    Returns:
        (n_parameters, n_parameters) covariance, and (n_parameters,) sensitivities: the squared
        change that a parameter's whole range would make at its slope, in gaps, added up over the
        scored channels. Below `INSENSITIVE` the recordings say nothing of it, and `fit` leaves it
        where it started.
    """
    if slopes is None:
        slopes = linearised(objective, one)
    normal, _ = _normal_equations(objective, one, slopes)
    found = _covariance(objective, one, slopes, noise)
    seen = objective if part is None else part
    (own,) = _linearised(seen, [one], correct=False)
    pulled = _pulled(seen, one, own)
    own.correct(seen)
    there, _ = _best(seen, one.case, own.residual[None])
    (secants,) = _linearised(seen, [there], part=_SECANT)
    near, wide = (_covariance(seen, there, each, noise) for each in (own, secants))
    wider = _wider(np.diag(near), np.diag(wide))
    found = found * np.outer(wider, wider) + _UNCORRECTED**2 * pulled.T @ pulled
    return found * np.outer(one.structure.scale, one.structure.scale), _sensitivity(one, normal)


def _pulled(objective: Objective, one: Fit, slopes: Slopes) -> FloatArray:
    """(k, n_parameters) by how much the numerical changes move the values, in their scales.

    Args:
        objective: the recordings.
        one: the fit.
        slopes: its slopes, with the numerical error in them.
    """
    there, _ = _best(objective, one.case, slopes.residual[None])
    weighted = slopes.jacobian * objective.weights(there.mean_square)
    normal, _ = _normal_equations(objective, there, slopes)
    inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    pulled: FloatArray = np.einsum("krc,irc->ki", objective.numerical, weighted) @ inverse
    return pulled


def _wider(near: FloatArray, wide: FloatArray) -> FloatArray:
    """(n_parameters,) by how many times the errors of one variance are larger; 1 at least."""
    felt = near > 0
    ratio: FloatArray = np.sqrt(np.maximum(wide / np.where(felt, near, 1.0), 1.0))
    return np.where(felt, ratio, 1.0)


def _covariance(
    objective: Objective, one: Fit, slopes: Slopes, noise: FloatArray | None
) -> FloatArray:
    """(n_parameters, n_parameters) by some slopes, in the parameters' scales."""
    weighted = slopes.jacobian * objective.weights(one.mean_square)
    normal, _ = _normal_equations(objective, one, slopes)
    pull = np.einsum("irc,rc->ir", weighted, slopes.residual)
    scores = np.stack([np.bincount(objective.block, weights=row) for row in pull])
    blocks = scores.shape[1]
    inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    meat = scores @ scores.T * (blocks / max(1, blocks - len(one.values)))
    found: FloatArray = inverse @ meat @ inverse
    if noise is not None:
        size = one.mean_square + objective.floor**2
        beyond = float(np.mean(np.maximum(one.mean_square - noise**2, 0.0) / size))
        found += _ALIGNED**2 * beyond * inverse
    return found


def at_bound(one: Fit) -> NDArray[np.bool_]:
    """(n_parameters,) whether each value ran into a bound."""
    lower, upper = one.structure.bounds
    nearest = np.minimum(one.values - lower, upper - one.values)
    at: NDArray[np.bool_] = nearest <= _AT_BOUND * (upper - lower)
    return at


def certainty(
    objective: Objective, one: Fit, noise: FloatArray, part: Objective | None = None
) -> FloatArray:
    """(n_parameters,) standard errors between each value and that which leaves the robot as it is.

    Infinite at a bound, where there is no standard error, and for what is not felt.
    """
    found, sensitivity = covariance(objective, one, noise, part=part)
    std = np.sqrt(np.maximum(np.diag(found), 0.0))
    away = np.abs(one.values - one.structure.zero)
    known = ~at_bound(one) & (sensitivity > INSENSITIVE) & (std > 0)
    errors: FloatArray = np.where(known, away / np.where(known, std, 1.0), np.inf)
    return np.where(away == 0, 0.0, errors)
