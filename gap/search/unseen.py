"""Effects of many looks, judged by recordings that had no part in the choice of one.

    looks_of(structure)                 # the rare effects of which one look was chosen, and where
    squares = by_unseen(problem, fit)   # of each block, by a fit that never saw its recording

A wave has a length and a phase, of which the one that suits all recordings best is chosen from
many. What slopes say of a fit without a recording keeps that choice, in which the recording had its
part, and is too good (Cawley and Talbot, Journal of Machine Learning Research 11, 2010). So the
choice is made again without it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.fit import evaluate, fits_finished, polish_each, promises
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.settle import trust_in_the_light_of
from walkerkit.gap.search.slopes import Slopes, linearised, near_slopes
from walkerkit.gap.search.structure import Fit, Structure, Unit, found_in

FloatArray = NDArray[np.float64]
Looks = frozenset[Unit]

_PARTS = 4  # of which each is left out once, at most
_OF_ONE = 3  # parts of what is only one recording
_MOST_STARTS = 8  # beyond which places begin alike
_FITTED, _STEPS = 2, 4  # of them, that promise most without a part, and steps of a fit to the rest


def looks_of(structure: Structure) -> Looks:
    """The rare effects of which one look was chosen from several, at each of their places."""
    rare = structure.rare_names
    return frozenset(
        slot.unit
        for slot in structure.slots
        if slot.parameter.shape and len({*slot.parameter.starts}) > 1 and slot.unit[0] in rare
    )


def by_unseen(problem: Problem, one: Fit) -> FloatArray | None:
    """How a structure predicts blocks when its looks are chosen without their recording.

    Args:
        problem: what is to be explained.
        one: the structure's fit to all recordings; what has no looks begins there.

    Returns:
        (n_blocks, n_scored) sums of squares; None where there is nothing to leave out.
    """
    half, objective = problem.fit, problem.fit.objective
    part = _parts(objective)
    count = 1 + int(part.max())
    if count < 2:
        return None
    half.refine(one)
    trust = trust_in_the_light_of(half, one, problem.noise)
    if trust is None:
        trust = np.ones((len(part), len(objective.channels)))
    others = [half.trusting(trust * (part != k)[:, None]) for k in range(count)]
    for other in others:
        other.refine(one)
    begun = evaluate(objective, [(one.structure, values) for values in _begun(one)])
    slopes = linearised(objective, one)
    starts, near, own = list[Fit](), list[Slopes](), list[Objective]()
    for other in others:
        its = _of_the_rest(slopes.trusting(other.objective, one), one)
        hopes = promises(other.objective, begun, its)
        promised = [np.inf if hope is None else hope.score for hope in hopes]
        some = [begun[k] for k in np.argsort(promised, kind="stable")[:_FITTED]]
        starts += some
        near += near_slopes(other.objective, its, some)
        own += [other.objective] * len(some)

    def fitted() -> list[Fit]:
        ends = polish_each(own, starts, near, iterations=_STEPS, certain=False, near_enough=True)
        return [fit for fit, _ in ends]

    found = fits_finished([(start.structure, start.values) for start in starts], fitted)
    each = len(found) // count
    best = [
        min(found[first : first + each], key=lambda fit: fit.score)
        for first in range(0, len(found), each)
    ]
    best = [fit if np.isfinite(fit.score) else one for fit in best]  # where all diverged
    residuals = objective.residuals([fit.case for fit in best])
    squares = np.stack([objective.block_squares(residual) for (residual,) in residuals])
    left_out: FloatArray = squares[part, np.arange(len(part))]
    return left_out


def _of_the_rest(slopes: Slopes, one: Fit) -> Slopes:
    """Those of a fit without its looks."""
    structure = one.structure
    rest = structure.at(structure.units.keys() - looks_of(structure))
    kept = found_in(rest, structure)
    return replace(slopes, structure=rest, jacobian=slopes.jacobian[kept])


def _parts(objective: Objective) -> NDArray[np.int64]:
    """(n_blocks,) index of the part that each is left out with: of recordings, or of the one."""
    recording = objective.recording_of_block
    if recording.max() > 0:
        return recording % _PARTS
    folds = objective.folds
    found: NDArray[np.int64] = folds * min(_OF_ONE, 1 + int(folds.max())) // (1 + folds.max())
    return found


def _begun(one: Fit) -> Iterator[FloatArray]:
    """(n_parameters,) values from which the looks of a fit are chosen, all else as it is."""
    structure, looks = one.structure, looks_of(one.structure)
    choices = []
    for own in (own for unit, own in structure.units.items() if unit in looks):
        starts = [structure.slots[k].parameter.starts for k in own]
        choices.append([(own, values) for values in zip(*starts, strict=True)])
    few = math.prod(map(len, choices)) <= _MOST_STARTS
    for choice in itertools.product(*choices) if few else zip(*choices, strict=False):
        values = one.values.copy()
        for own, start in choice:
            values[own] = start
        yield np.clip(values, *structure.bounds)
