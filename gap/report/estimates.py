"""Fitted values as estimates: with standard errors, units, and which of them are none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.report.diagnosis import Estimate
from walkerkit.gap.search.fit import INSENSITIVE, Fit
from walkerkit.gap.search.structure import Term

FloatArray = NDArray[np.float64]

_AT_BOUND = 1e-6  # of the width between the bounds


def estimates(
    fit: Fit, term: Term, variance: FloatArray, sensitivity: FloatArray
) -> tuple[Estimate, ...]:
    """The numbers of one term of a fit.

    Args:
        fit: the fit.
        term: one of its structure's.
        variance: as `covariance` has it of the fit.
        sensitivity: the same.
    """
    lower, upper = fit.structure.bounds
    found = []
    for i in fit.structure.columns(term):
        slot = fit.structure.slots[i]
        margin = _AT_BOUND * (upper[i] - lower[i])
        at_bound = bool(min(fit.values[i] - lower[i], upper[i] - fit.values[i]) <= margin)
        known = sensitivity[i] > INSENSITIVE and not at_bound
        found.append(
            Estimate(
                name=slot.parameter.name,
                place=slot.place,
                value=float(fit.values[i]),
                std=float(np.sqrt(variance[i, i])) if known else None,
                unit=slot.parameter.unit,
                at_bound=at_bound,
                lower=float(lower[i]),
                upper=float(upper[i]),
            )
        )
    return tuple(found)
