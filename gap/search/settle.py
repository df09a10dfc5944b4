"""A fit in the light of its own numerical error, and one that wild blocks do not outvote.

    found = settled(half, start, passes=2)
    found = robustly(half, found, linearised(half.objective, found), noise)

The numerical error is another wherever a fit ends, so that it is found again after each pass. Each
of the two is one step of the journal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import EVERYWHERE
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.search.fit import CONVERGED, fits_finished, polish
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.score import Wildness
from walkerkit.gap.search.slopes import Slopes, linearised, near_slopes
from walkerkit.gap.search.structure import Fit

FloatArray = NDArray[np.float64]

REFITS, PASSES = 8, 3  # steps of a fit that begins near its end, and how often it goes on
_WEIGHINGS, _REWEIGHED = 4, 3  # of blocks by how wild they are, and steps of a fit with each
_HELD_BY_FEW = 0.5  # of the squares of a channel, that blocks hold which are trusted little


def settled(
    half: Half,
    start: Fit,
    near: Slopes | None = None,
    *,
    passes: int,
    iterations: int = 20,
    leader: float = np.inf,
    on_steps: bool = True,
    progress: Progress | None = None,
    stage: str = "fitting",
) -> Fit:
    """A fit in the light of its own numerical error, which is found again after each pass.

    A pass that only seemed better, by the error of where it began, is taken back.

    Args:
        half: the recordings.
        start: structure and values; its score may be that on other recordings.
        near: slopes of a fit to them that has numbers in common with it, to begin with.
        passes: of fitting, the most.
        iterations: of each pass, the most.
        leader: a score; a fit too far behind it to catch up at its pace goes no further.
        on_steps: also with delays of whole steps.
        progress: called before each step.
        stage: what it is told.

    Returns:
        The best, at which the half is refined.
    """
    objective = half.objective
    shown: dict[str, Any] = {"progress": progress, "stage": stage}
    most: dict[str, Any] = {"iterations": iterations, "leader": leader, "near_enough": True}

    def improved(one: Fit, slopes: Slopes | None, *, certain: bool) -> tuple[Fit, Slopes]:
        found, after = polish(objective, one, slopes, certain=certain, **most, **shown)
        return half.by_own_error(found), after

    def made() -> Fit:
        best, slopes = half.by_own_error(start), None
        if near is not None:
            (slopes,) = near_slopes(objective, near, [best])
        for k in range(passes):
            found, after = improved(best, slopes, certain=k == 0)
            if best.score <= found.score + CONVERGED:
                break
            best, slopes = found, after.at_another_error(objective, found)
        for values in _on_steps(objective, best) if on_steps and best.score < leader else ():
            there = half.by_own_error(replace(best, values=values))
            if there.score < best.score - CONVERGED:
                from_there, _ = improved(there, None, certain=False)
                best = min(there, from_there, key=lambda one: one.score)
        return best

    return _in_one(half, start, made)


def robustly(
    half: Half,
    one: Fit,
    slopes: Slopes,
    noise: FloatArray,
) -> Fit:
    """A fit moved to where wild blocks do not outvote the rest, as they do not in the comparison.

    Args:
        half: the recordings.
        one: the fit, to them.
        slopes: there, with what they are with the numerical error in them.
        noise: (n_scored,) of the measurement.

    Returns:
        The fit, at which the half is refined, with the score that it has where all blocks count.
    """
    if not len(one.values) or not np.isfinite(one.score):
        return one

    def made() -> Fit:
        best, residual = one, half.residual(one)
        wildness = Wildness(half.objective, residual, noise)
        for _ in range(_WEIGHINGS):
            trusting = half.trusting(wildness.trust(residual))
            trusting.refine(best)
            its = slopes.trusting(trusting.objective, best)
            better, _ = polish(trusting.objective, best, its, iterations=_REWEIGHED, certain=False)
            there = half.residual(better)
            if wildness.density(there) <= wildness.density(residual):
                break
            best, residual = better, there
        return best

    return _in_one(half, one, made)


def robustly_settled(half: Half, start: Fit, noise: FloatArray, *, passes: int, **how: Any) -> Fit:
    """A settled fit, moved on where few wild blocks hold most of its gaps.

    Wild blocks may also draw it to where nothing else fits. It is moved on from its start then,
    where blocks are likelier as they count in the comparison.

    Args:
        half: the recordings.
        start: structure and values, found on parts of them.
        noise: (n_scored,) of the measurement.
        passes: as in `settled`.
        **how: the same.

    Returns:
        The fit, at which the half is refined.
    """
    found = settled(half, start, passes=passes, **how)
    residual = half.residual(found)
    wildness = Wildness(half.objective, residual, noise)
    there = half.residual(start)
    if wildness.density(there) > wildness.density(residual):
        found = start
    found = half.by_own_error(found)
    if trust_in_the_light_of(half, found, noise) is None:
        return found
    return robustly(half, found, linearised(half.objective, found), noise)


def without_the_wild(problem: Problem, current: Fit) -> Problem | None:
    """A problem in which blocks count as they do in the comparison, in the light of a fit.

    Args:
        problem: what is to be explained; its parts are chosen for the fit.
        current: the fit.

    Returns:
        The problem, whose parts stay as they are; None where no few blocks hold most of the gaps,
        so that the comparison sees what a root mean square does.
    """
    trust = trust_in_the_light_of(problem.fit, current, problem.noise)
    if trust is None:
        return None
    fit = problem.fit.trusting(trust)
    if problem.screen is problem.fit:
        return replace(problem, fit=fit, searched=problem.searched.with_screen(fit))
    seen = _trust(problem.screen, current, problem.noise)[0]
    screen = problem.screen.trusting(seen)
    return replace(problem, fit=fit, searched=problem.searched.with_screen(screen))


def trust_in_the_light_of(half: Half, current: Fit, noise: FloatArray) -> FloatArray | None:
    """(n_blocks, n_scored) how much blocks count; None where no few of them hold most of the gaps.

    Args:
        half: the recordings.
        current: a fit.
        noise: (n_scored,) of the measurement.
    """
    trust, squares = _trust(half, current, noise)
    counted = np.sum(trust * squares, axis=0)
    return None if (counted >= _HELD_BY_FEW * squares.sum(axis=0)).all() else trust


def _trust(half: Half, current: Fit, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n_blocks, n_scored) how much blocks count beside a fit, and their sums of squares."""
    residual = half.residual(current)
    trust = Wildness(half.objective, residual, noise).trust(residual)
    return trust, half.objective.block_squares(residual)


def _in_one(half: Half, start: Fit, make: Callable[[], Fit]) -> Fit:
    """A fit that is one step of the journal, at which the half is refined.

    What the half knows of numerical errors afterwards is what it knows where the journal has it.
    """
    with half.objective.forgetting():
        (found,) = fits_finished([(start.structure, start.values)], lambda: [make()])
    return half.by_own_error(found)


def _on_steps(objective: Objective, one: Fit) -> Iterator[FloatArray]:
    """A fit's values with each delay as long as whole steps, and with one delay in another.

    Between two steps a simulation is late by a mixture of both, which has an error of its own. And
    of two delays in a row the recordings tell the sum much better than the parts.
    """
    lower, upper = one.structure.bounds
    step = max(replay.robot.model.opt.timestep for replay in objective.replays)
    slots = one.structure.slots
    late = [
        k
        for k, slot in enumerate(slots)
        if slot.parameter.is_delay and lower[k] < one.values[k] < upper[k]
    ]
    for k in late:
        for to_step in (np.floor, np.ceil):
            values = one.values.copy()
            values[k] = np.clip(step * to_step(values[k] / step), lower[k], upper[k])
            yield values
    for k in late:
        for term in one.structure.terms:
            into = [
                i
                for i in late
                if slots[i].term is term and slots[k].place in (slots[i].place, EVERYWHERE)
            ]
            if into and term is not slots[k].term:
                values = one.values.copy()
                values[into] = np.clip(values[into] + values[k], lower[into], upper[into])
                values[k] = slots[k].parameter.zero
                yield values
