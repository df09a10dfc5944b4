"""Fitted values as estimates: with standard errors, units, and which of them are none."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import EVERYWHERE
from walkerkit.gap.effects.fields import FILE
from walkerkit.gap.report.diagnosis import Change, Estimate
from walkerkit.gap.search.certainty import INSENSITIVE, at_bound
from walkerkit.gap.search.structure import Fit, Slot, Term
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]

_NOTHING = 1e-9  # so stiff that more makes no difference


def estimates(
    fit: Fit,
    term: Term,
    variance: FloatArray,
    sensitivity: FloatArray,
    mended: Sequence[Robot] = (),
    told: Sequence[Term] | None = None,
) -> tuple[Estimate, ...]:
    """The numbers of one term of a fit.

    Args:
        fit: the fit.
        term: one of its structure's.
        variance: as `covariance` has it of the fit.
        sensitivity: the same.
        mended: the fit's robots with all that was named; none for what is not written anywhere.
        told: the structure's terms in the order in which they are told; by default its own.
    """
    order = [k for one in told or fit.structure.terms for k in fit.structure.columns(one)]
    lower, upper = fit.structure.bounds
    correlation = _correlation(fit, variance)
    stopped = at_bound(fit)
    found = []
    for i in fit.structure.columns(term):
        slot = fit.structure.slots[i]
        known = sensitivity[i] > INSENSITIVE and not stopped[i]
        field = slot.term.effect.fields.get(slot.parameter.name)
        choice = slot.parameter.choice  # is what it is, without an error
        estimate = Estimate(
            name=slot.parameter.name,
            place=slot.place,
            value=float(fit.values[i]),
            std=0.0 if choice else float(np.sqrt(variance[i, i])) if known else None,
            unit=slot.parameter.unit,
            at_bound=bool(stopped[i]) and not choice,
            lower=float(lower[i]),
            upper=float(upper[i]),
            field=field.path if field is not None else "",
            changes=tuple(_changes(slot, fit.structure.robots, mended)),
            correlation=tuple(map(float, correlation[i, order])),
        )
        found.append(_inverted(estimate, *slot.parameter.inverse))
    return tuple(found)


def _correlation(fit: Fit, variance: FloatArray) -> FloatArray:
    """(n_parameters, n_parameters) correlations of what is told of a fit's values."""
    std = np.sqrt(np.maximum(np.diag(variance), 0.0))
    felt = std > 0
    size = np.where(felt, std, 1.0)
    # One over a number moves the other way.
    inverse = [bool(slot.parameter.inverse) for slot in fit.structure.slots]
    sign = np.where(np.array(inverse) & (fit.values > 0), -1.0, 1.0)
    found: FloatArray = variance / np.outer(size, size) * np.outer(sign, sign)
    found[~felt], found[:, ~felt] = 0.0, 0.0
    np.fill_diagonal(found, 1.0)
    return np.clip(found, -1.0, 1.0)


def _changes(slot: Slot, given: Sequence[Robot], mended: Sequence[Robot]) -> Iterator[Change]:
    """What each robot had and has at each site that a number is of."""
    field = slot.term.effect.fields.get(slot.parameter.name)
    if field is None:  # an effect of the user's that does not say where its numbers are
        return
    sites = slot.term.sites if slot.place == EVERYWHERE else (slot.place,)
    for before, after in zip(given, mended, strict=len(mended) > 0):
        for site in sites:
            was, now = (field.read(robot, site, before) for robot in (before, after))
            yield Change(model=before.stem, place=site, was=_number(was), now=_number(now))


def _number(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _inverted(estimate: Estimate, name: str = "", unit: str = "") -> Estimate:
    """One over an estimate, by its own name; as it is without a name, or at zero."""
    if not name or estimate.value <= 0:
        return estimate
    # MJCF has the number that people speak of, and actuators.json the parameter itself.
    field = f"1 / {estimate.field}" if estimate.field.startswith(FILE) else estimate.field
    return replace(
        estimate,
        name=name,
        field=field,
        unit=unit,
        value=1 / estimate.value,
        std=None if estimate.std is None else estimate.std / estimate.value**2,
        lower=1 / estimate.upper,
        upper=1 / max(estimate.lower, _NOTHING),
        changes=tuple(
            replace(one, was=1 / one.was if one.was else None, now=1 / one.now if one.now else None)
            for one in estimate.changes
        ),
    )
