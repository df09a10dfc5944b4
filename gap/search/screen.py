"""Screening: every candidate effect at several magnitudes, as the start of its fit.

One small step says nothing about limits and dead zones, so each effect is tried at its own list
of magnitudes, place by place; the best of every place together is where its fit begins.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.structure import Case, Fit, Structure, Term, carried

FloatArray = NDArray[np.float64]


def screen(objective: Objective, base: Fit, terms: Sequence[Term]) -> list[Fit]:
    """Tries every term on top of a fit.

    Args:
        objective: the recordings to explain.
        base: what is already explained.
        terms: the candidates.

    Returns:
        A start for every term, in order, with its score.
    """
    cases = []
    for term in terms:
        structure = base.structure.with_term(term)
        start = carried(base.values, base.structure, structure)
        cases.append(Case(structure=structure, values=tries(structure, term, start)))
    starts: list[tuple[Structure, FloatArray]] = []
    singles: list[Fit] = []
    for term, case, mean_square in zip(terms, cases, objective.mean_squares(cases), strict=True):
        scores = objective.score(mean_square)
        together = case.values[0].copy()
        for place in term.places:
            columns = case.structure.columns(term, place)
            moved = np.flatnonzero((case.values[:, columns] != together[columns]).any(axis=1))
            if not len(moved):  # bounds that leave no room
                continue
            k = moved[np.argmin(scores[moved])]
            # A place that none of the magnitudes improves starts at its smallest, where the fit
            # still has a gradient.
            k = k if scores[k] < base.score else moved[0]
            together[columns] = case.values[k, columns]
        k = int(np.argmin(scores))
        singles.append(
            Fit(
                structure=case.structure,
                values=case.values[k],
                score=float(scores[k]),
                mean_square=mean_square[k],
            )
        )
        starts.append((case.structure, together))
    return [
        min(alone, combined, key=lambda one: one.score)
        for alone, combined in zip(singles, evaluate(objective, starts), strict=True)
    ]


def tries(structure: Structure, term: Term, start: FloatArray) -> FloatArray:
    """(n, n_parameters) the start itself, then each magnitude of a term at each place."""
    rows = [start]
    for place in term.places:
        columns = structure.columns(term, place)
        magnitudes = [structure.slots[column].parameter.starts for column in columns]
        for values in zip(*magnitudes, strict=True):
            row = start.copy()
            row[columns] = np.clip(values, *(bound[columns] for bound in structure.bounds))
            rows.append(row)
    return np.stack(rows)
