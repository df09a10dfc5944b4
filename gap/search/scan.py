"""A look around a fit whose gap is jagged.

A limit is met or missed, a play is crossed or not: slopes at one place know nothing of the next
dent. The numbers of the newest effect are tried at other sizes, in leaps that a step by the slopes
would not dare.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.fit import evaluate, fit
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.structure import Case, Fit, Structure

FloatArray = NDArray[np.float64]

_SIZES = np.array([0.6, 0.8, 0.9, 0.95, 0.97, 0.985, 1.015, 1.03, 1.05, 1.12, 1.25, 1.6])
_PASSES = 3
_STEPS = 4
_BETTER = 0.01  # of a score, for another start to be worth a fit


def scanned(objective: Objective, current: Fit, on: Objective | None = None) -> Fit:
    """The fit, or a better one that begins where a number of its last effect is another.

    Args:
        objective: the recordings that it was fitted to.
        current: the fit.
        on: fewer recordings, on which to look around; all by default.
    """
    on, structure = on or objective, current.structure
    if not structure.terms or not structure.terms[-1].effect.fitted:
        return current
    for _ in range(_PASSES):
        tried = np.vstack([current.values, _around(structure, current.values)])
        case = Case(structure=structure, values=tried)
        scores = on.score(on.mean_squares([case])[0])
        best = int(np.argmin(scores))
        if not scores[best] < scores[0] - _BETTER:
            break
        start = evaluate(objective, [(structure, tried[best])])
        (found,) = fit(objective, start, iterations=_STEPS)
        if not found.score < current.score - _BETTER:
            break
        current = found
    return current


def _around(structure: Structure, values: FloatArray) -> FloatArray:
    """(n, n_parameters) values of which one is another, by a factor of what it adds."""
    lower, upper = structure.bounds
    away = values - structure.zero
    rows = []
    for k in structure.columns(structure.terms[-1]):
        if structure.slots[k].parameter.choice or not away[k]:
            continue
        for size in _SIZES:
            row = values.copy()
            row[k] = np.clip(structure.zero[k] + size * away[k], lower[k], upper[k])
            rows.append(row)
    return np.array(rows).reshape(-1, len(values))
