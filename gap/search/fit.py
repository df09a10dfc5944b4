"""Fitting many structures at once.

Levenberg–Marquardt on the score of `objective`, every structure from its own start, with all
perturbations of all structures simulated in one batch and all damping factors tried in another.
Bounded; a trial that diverges scores infinity.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.certainty import INSENSITIVE, sensitivity
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.search.journal import digest, finished, packed, unpacked
from walkerkit.gap.search.objective import Objective, consecutive, simulated_each
from walkerkit.gap.search.slopes import (
    Slopes,
    linearised_each,
    near_slopes,
    posterior_equations,
)
from walkerkit.gap.search.structure import Case, Fit, Structure
from walkerkit.gap.simulation.side_by_side import advanced

FloatArray = NDArray[np.float64]
_Polishing = Generator[Fit | Case, Any, tuple[Fit, Slopes]]

_DAMPING = np.array([1e-4, 1e-2, 0.3, 10.0])
CONVERGED = 3e-4  # of the score
_KEEPS = 0.5  # of its promise that a whole step has to keep
_KEPT = 2**28  # bytes of slopes that are carried along
_STEPS = 8  # of a fit, the most unless it is said
_PACES = 4  # a step gains less than the one before, so a lag of more than these is not made up


def evaluate(objective: Objective, fits: Sequence[tuple[Structure, FloatArray]]) -> list[Fit]:
    """Simulates structures at given values, without fitting."""
    return fits_finished(fits, lambda: _evaluate(objective, fits))


def _evaluate(objective: Objective, fits: Sequence[tuple[Structure, FloatArray]]) -> list[Fit]:
    return best_of(objective, [Case(structure=s, values=v[None]) for s, v in fits])


def best_of(objective: Objective, cases: Sequence[Case]) -> list[Fit]:
    """The row of each case that scores best."""
    return [
        objective.best(case, mean_square)[0]
        for case, mean_square in zip(cases, objective.mean_squares(cases), strict=True)
    ]


def fit(
    objective: Objective,
    starts: Sequence[Fit],
    *,
    iterations: int = _STEPS,
    leader: float = np.inf,
    near: Slopes | None = None,
    progress: Progress | None = None,
    stage: str = "fitting",
) -> list[Fit]:
    """Improves every start until it converges.

    Args:
        objective: what to fit.
        starts: structures with values and their score.
        iterations: the most steps any of them may take.
        leader: a score; a fit that is behind it may take more steps, as long as it can catch up at
            its pace.
        near: slopes of a fit that has numbers in common with all starts, to begin with.
        progress: called before each step.
        stage: what it is told.

    Returns:
        The fits, in the order of `starts`; none scores worse than it started.
    """

    def make() -> list[Fit]:
        return [
            found
            for group in _kept_together([objective] * len(starts), starts)
            for found in _fit(objective, starts[group], iterations, leader, near, progress, stage)
        ]

    return fits_finished([(start.structure, start.values) for start in starts], make)


def _fit(
    objective: Objective,
    starts: Sequence[Fit],
    iterations: int,
    leader: float,
    near: Slopes | None,
    progress: Progress | None,
    stage: str,
) -> list[Fit]:
    best = list(starts)
    active = [i for i, start in enumerate(best) if len(start.values) and np.isfinite(start.score)]
    taken = dict.fromkeys(active, 0)
    slopes: dict[int, Slopes] = {}
    if near is not None:
        slopes = dict(
            zip(active, near_slopes(objective, near, [best[i] for i in active]), strict=True)
        )
    while active:
        if progress:
            progress(stage, min(1.0, min(taken[i] for i in active) / iterations))
        cases = _next_steps(objective, best, active, slopes)
        # They may be right along the last step and nowhere else.
        trusted = {i for i in active if i not in slopes or slopes[i].fresh}
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
            if gains[i] > CONVERGED:
                taken[i] += 1
                behind = best[i].score - leader
                if taken[i] < iterations or (0 < behind <= _PACES * gains[i] and taken[i] < _STEPS):
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
    near_enough: bool = False,
    leader: float = np.inf,
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
        near_enough: for a start; also believe slopes that kept half of what they promised twice.
        leader: a score; a fit too far behind it to catch up at its pace goes no further.
        progress: called before each step.
        stage: what it is told.

    Returns:
        The fit, and the slopes there.
    """
    (found,) = polish_each(
        [objective],
        [start],
        [slopes],
        iterations=iterations,
        certain=certain,
        near_enough=near_enough,
        leader=leader,
        progress=progress,
        stage=stage,
    )
    return found


def polish_each(
    objectives: Sequence[Objective],
    starts: Sequence[Fit],
    slopes: Sequence[Slopes | None],
    *,
    iterations: int,
    **how: Any,
) -> list[tuple[Fit, Slopes]]:
    """What `polish` finds from several starts, each for its own objective, in lock step.

    Args:
        objectives: what to fit, one for each start.
        starts: structures and values.
        slopes: those at each start, where they are known.
        iterations: the most steps.
        **how: as in `polish`, `certain` among them.
    """
    each = zip(objectives, starts, slopes, strict=True)
    runs = [_polishing(*one, iterations=iterations, **how) for one in each]
    return _in_lock_step(objectives, runs)


def _polishing(
    objective: Objective,
    start: Fit,
    slopes: Slopes | None,
    *,
    iterations: int,
    certain: bool,
    near_enough: bool = False,
    leader: float = np.inf,
    progress: Progress | None = None,
    stage: str = "",
) -> _Polishing:
    """As `polish`, asking for the slopes at fits and for the residuals of cases.

    One that is too far behind a leader's score to catch up at its pace goes no further.
    """
    if slopes is None:
        slopes = yield start
    best, kept, gain = objective.at(start, slopes.residual), 0, 0.0
    for k in range(iterations if len(best.values) and np.isfinite(best.score) else 0):
        if progress:
            progress(stage, k / iterations)
        normal, gradient = posterior_equations(objective, best, slopes)
        trials, promised = _most_promising_first(best, normal, gradient)
        step = (trials[0] - best.values) / best.structure.scale
        believed = slopes.sure or (slopes.right and not certain) or (near_enough and kept > 1)
        if believed and (
            promised < CONVERGED
            or best.score - leader > _PACES * max(gain, best.score - slopes.score(objective, step))
        ):
            break
        fresh, gain = slopes.fresh, 0.0
        if promised >= CONVERGED:
            whole = Case(structure=best.structure, values=trials[:1])
            better, residual = _best(objective, whole, (yield whole))
            kept = kept + 1 if best.score - better.score >= _KEEPS * promised else 0
            if not kept:
                less = Case(structure=best.structure, values=trials[1:])
                damped = _best(objective, less, (yield less))
                better, residual = min((better, residual), damped, key=lambda one: one[0].score)
            gain = best.score - better.score
            if gain > 0:
                step = (better.values - best.values) / best.structure.scale
                slopes.follow(step, residual, objective.weights(better.mean_square))
                best = better
        if gain < CONVERGED and fresh:
            break
        if gain < CONVERGED or not (near_enough or kept or slopes.right):
            slopes = yield best
    return best, slopes


@dataclass(frozen=True, kw_only=True, eq=False)
class Promise:
    """What one step of a fit can hope for, by its slopes.

    Attributes:
        score: the score after it.
        values: (n_parameters,) after it.
        normal: (n_parameters, n_parameters) curvature of the score, with the priors', in scales.
    """

    score: float
    values: FloatArray
    normal: FloatArray


def promises(
    objective: Objective, starts: Sequence[Fit], near: Slopes | None
) -> list[Promise | None]:
    """What one step from each start can hope for, by its slopes; None where that diverged.

    Args:
        objective: what would be fitted.
        starts: structures and values; their scores may be those on other recordings.
        near: slopes of a fit that has numbers in common with all of them, to begin with.
    """
    found: list[Promise | None] = []
    for start in starts:  # one after the other, of which none has to be kept
        (slopes,) = (
            linearised_each([objective], [start])
            if near is None
            else near_slopes(objective, near, [start])
        )
        there = objective.at(start, slopes.residual)
        found.append(promise(objective, there, slopes) if np.isfinite(there.score) else None)
    return found


def promise(objective: Objective, one: Fit, slopes: Slopes) -> Promise:
    """What one step from a fit can hope for.

    Args:
        objective: what it is fitted to.
        one: the fit.
        slopes: there.
    """
    normal, gradient = posterior_equations(objective, one, slopes)
    trials, gain = _most_promising_first(one, normal, gradient)
    return Promise(score=one.score - gain, values=trials[0], normal=normal)


def _most_promising_first(
    one: Fit, normal: FloatArray, gradient: FloatArray
) -> tuple[FloatArray, float]:
    """A trial per damping factor, and what the slopes promise of the first.

    Where bounds cut a long step short, a shorter one may promise more.
    """
    trials = _steps(one, normal, gradient)
    steps = (trials - one.values) / one.structure.scale
    promised = -steps @ gradient - 0.5 * np.einsum("ti,ij,tj->t", steps, normal, steps)
    order = np.argsort(-promised, kind="stable")
    return trials[order], float(promised[order[0]])


def _in_lock_step(
    objectives: Sequence[Objective], runs: Sequence[_Polishing]
) -> list[tuple[Fit, Slopes]]:
    """What each run finds for its own objective, with what they ask for simulated together."""
    found: dict[int, tuple[Fit, Slopes]] = {}
    answers: dict[int, Any] = dict.fromkeys(range(len(runs)))
    while answers:
        asked = advanced(runs, answers, found)
        fits = {k: one for k, one in asked.items() if isinstance(one, Fit)}
        cases = {k: one for k, one in asked.items() if isinstance(one, Case)}
        slopes = linearised_each([objectives[k] for k in fits], list(fits.values()))
        answers = dict(zip(fits, slopes, strict=True))
        simulated = simulated_each([objectives[k] for k in cases], list(cases.values()))
        for k, residual in zip(cases, simulated, strict=True):
            objectives[k].take_out_numerical_error(residual, [cases[k]])
            answers[k] = residual
    return [found[k] for k in range(len(runs))]


def polished(
    objective: Objective,
    starts: Sequence[Fit],
    near: Slopes | None = None,
    *,
    iterations: int,
    certain: bool = True,
    near_enough: bool = False,
    own: Sequence[Objective] | None = None,
    progress: Progress | None = None,
    stage: str = "fitting",
) -> list[Fit]:
    """What `polish` finds from several starts, from the journal where it has it.

    Args:
        objective: what to fit.
        starts: structures and values.
        near: slopes of a fit that has numbers in common with all of them, to begin with.
        iterations: the most steps.
        certain: as there.
        near_enough: as there.
        own: for each start the objective that it is to be fitted to instead.
        progress: called before each step.
        stage: what it is told.
    """
    objectives = own or [objective] * len(starts)

    def some(starts: Sequence[Fit], objectives: Sequence[Objective]) -> list[Fit]:
        slopes: Sequence[Slopes | None] = [None] * len(starts)
        if near is not None:
            slopes = list(near_slopes(objective, near, starts))
        found = polish_each(
            objectives,
            starts,
            slopes,
            iterations=iterations,
            certain=certain,
            near_enough=near_enough,
            progress=progress,
            stage=stage,
        )
        return [one for one, _ in found]

    def make() -> list[Fit]:
        return [
            found
            for group in _kept_together(objectives, starts)
            for found in some(starts[group], objectives[group])
        ]

    return fits_finished([(start.structure, start.values) for start in starts], make)


def _kept_together(objectives: Sequence[Objective], starts: Sequence[Fit]) -> list[slice]:
    """Consecutive starts whose slopes fit into memory together."""
    each = zip(objectives, starts, strict=True)
    return consecutive([its.measured.nbytes * len(one.values) for its, one in each], _KEPT)


def _next_steps(
    objective: Objective, best: Sequence[Fit], active: Sequence[int], slopes: dict[int, Slopes]
) -> list[Case]:
    """A trial per damping factor for each fit; finds the slopes that are missing."""
    steps = {
        i: _steps(best[i], *posterior_equations(objective, best[i], slopes[i]))
        for i in active
        if i in slopes
    }
    room = _KEPT - sum(one.jacobian.nbytes for one in slopes.values())
    missing = [i for i in active if i not in slopes]
    for i, found in zip(
        missing,
        linearised_each([objective] * len(missing), [best[i] for i in missing]),
        strict=True,
    ):
        steps[i] = _steps(best[i], *posterior_equations(objective, best[i], found))
        if found.simulated > len(_DAMPING) and found.jacobian.nbytes <= room:
            room -= found.jacobian.nbytes
            slopes[i] = found
    return [Case(structure=best[i].structure, values=steps[i]) for i in active]


def _best(objective: Objective, case: Case, residual: FloatArray) -> tuple[Fit, FloatArray]:
    """The best of some values, whose residuals these are, with its own."""
    found, k = objective.best(case, objective.mean_square(residual))
    return found, residual[k]


def _residuals(objective: Objective, cases: Sequence[Case]) -> Iterator[FloatArray]:
    for group in objective.grouped(cases):
        yield from objective.residuals(cases[group])


def fits_finished(
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


def _steps(one: Fit, normal: FloatArray, gradient: FloatArray) -> FloatArray:
    """One step per damping factor, within the bounds."""
    lower, upper = one.structure.bounds
    pushed_out = ((one.values <= lower) & (gradient > 0)) | ((one.values >= upper) & (gradient < 0))
    # A parameter that the recordings do not feel would be sent far away by the slightest slope.
    free = ~pushed_out & (sensitivity(one, normal) > INSENSITIVE)
    steps = np.zeros((len(_DAMPING), len(gradient)))
    if free.any():
        a = normal[np.ix_(free, free)]
        diagonal = np.diag(a)
        for k, damping in enumerate(_DAMPING):
            steps[k, free] = -np.linalg.solve(a + np.diag(damping * diagonal), gradient[free])
    return np.clip(one.values + steps * one.structure.scale, lower, upper)
