"""How far the values of a fit can be trusted: their standard errors, bounds, sensitivities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.slopes import Slopes, linearised, normal_equations
from walkerkit.gap.search.structure import Fit

FloatArray = NDArray[np.float64]

INSENSITIVE = 1e-3  # a sensitivity: no gap changes by more than three per cent
_SECANT = 0.3  # of a number's scale, over which a slope has to hold for more than the next dent
_ALIGNED = 0.25  # how much of the model's error looks like a change of one of its numbers
_OF_A_STEP = 0.25  # of the timestep, within which one integrator answers later than another
_AT_BOUND = 1e-6  # of the width between the bounds


def covariance(
    objective: Objective,
    one: Fit,
    noise: FloatArray | None = None,
    slopes: Slopes | None = None,
    part: Objective | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Covariance of the values, and how much each matters.

    The errors of one joint stay alike for a while, so rows are not independent: the blocks of the
    objective are (a cluster-robust sandwich, Liang and Zeger, Biometrika 73, 1986). How much of the
    numerical error there is counts as unknown, as widely as its bounds are apart. What is left of
    a gap beyond the noise is no chance but the model's error, which pulls the values the same way
    wherever it shows: it may lie along what a number changes, by a cosine of `_ALIGNED`. A jagged
    gap is steeper from dent to dent than as a whole: of two slopes, over little and over more of a
    number's scale, the one that tells less counts. A delay or a lag is known no better than a part
    of the timestep.

    Args:
        objective: the recordings that were fitted.
        one: the fit.
        noise: (n_scored,) noise of the channels, to allow for the model's error; None for none.
        slopes: of the fit, where they are known.
        part: of the recordings, on which it is seen how jagged the gap is; all by default.

    Returns:
        (n_parameters, n_parameters) covariance, and (n_parameters,) sensitivities: the squared
        change that a parameter's whole range would make at its slope, in gaps, added up over the
        scored channels. Below `INSENSITIVE` the recordings say nothing of it, and `fit` leaves it
        where it started.
    """
    if slopes is None or slopes.uncorrected is None:
        slopes = linearised(objective, one)
    normal, _ = normal_equations(objective, one, slopes)
    found = _covariance(objective, one, slopes, noise)
    seen = objective if part is None else part
    own = linearised(seen, one)
    there = seen.at(one, own.residual)
    if not np.isfinite(there.score):  # longer steps may run away
        seen, own, there = objective, slopes, one
    secants = linearised(seen, there, part=_SECANT)
    near, wide = (_covariance(seen, there, each, noise) for each in (own, secants))
    wider = _wider(np.diag(near), np.diag(wide))
    found *= np.outer(wider, wider)
    # What a small move does not change, a larger one may.
    found += np.diag(np.where(np.diag(near) > 0, 0.0, np.diag(wide)))
    found *= np.outer(one.structure.scale, one.structure.scale)
    found += np.diag(_late(objective, one) ** 2)
    return found, sensitivity(one, normal)


def _late(objective: Objective, one: Fit) -> FloatArray:
    """(n_parameters,) how well a delay or a lag can be known: the simulation itself is late."""
    step = max(replay.robot.model.opt.timestep for replay in objective.replays)
    slots = one.structure.slots
    timing = [s.parameter.unit == "s" and s.term.effect.part == "timing" for s in slots]
    return np.where(timing, _OF_A_STEP * step, 0.0)


def _wider(near: FloatArray, wide: FloatArray) -> FloatArray:
    """(n_parameters,) by how many times the errors of one variance are larger; 1 at least."""
    felt = near > 0
    ratio: FloatArray = np.sqrt(np.maximum(wide / np.where(felt, near, 1.0), 1.0))
    return np.where(felt, ratio, 1.0)


def _covariance(
    objective: Objective, one: Fit, slopes: Slopes, noise: FloatArray | None
) -> FloatArray:
    """(n_parameters, n_parameters) by some slopes, in the parameters' scales."""
    count, error = len(one.values), objective.numerical
    moved = np.concatenate([slopes.as_simulated, error.changes])
    weights = objective.weights(one.mean_square)
    normal = _gram(moved, weights)
    # What is known without the recordings: how large numbers are, and that the factors of the
    # numerical error lie between their bounds.
    known = (
        np.concatenate(
            [
                one.structure.prior_curvature(one.values),
                12 / np.ptp(error.bounds, axis=1) ** 2,
            ]
        )
        / objective.samples
    )
    pull = np.einsum("irc,rc->ir", moved, slopes.residual * weights)
    scores = np.stack([np.bincount(objective.block, weights=row) for row in pull])
    blocks = scores.shape[1]
    meat = scores @ scores.T * (blocks / max(1, blocks - count))
    inverse = np.linalg.pinv(normal + np.diag(known), rcond=1e-12, hermitian=True)
    found: FloatArray = inverse @ (meat + np.diag(known / objective.samples)) @ inverse
    if noise is not None:
        # Channel by channel, since what one lacks says nothing of a number that moves another.
        beyond = objective.count * np.maximum(one.mean_square - noise**2, 0.0)
        found += _ALIGNED**2 * inverse @ _gram(moved, weights**2 * beyond) @ inverse
    return found[:count, :count]


def _gram(changes: FloatArray, weights: FloatArray) -> FloatArray:
    """(n, n) products of (n, rows, n_scored) changes, with (n_scored,) weights."""
    flat = (changes * np.sqrt(weights)).reshape(len(changes), np.prod(changes.shape[1:]))
    found: FloatArray = flat @ flat.T
    return found


def sensitivity(one: Fit, normal: FloatArray) -> FloatArray:
    """(n_parameters,) what their whole ranges would change, as in `covariance`."""
    lower, upper = one.structure.bounds
    scales: FloatArray = (upper - lower) / one.structure.scale
    return np.diag(normal) * scales**2 * len(one.mean_square)


def at_bound(one: Fit) -> NDArray[np.bool_]:
    """(n_parameters,) whether each value ran into a bound that is no end of its own."""
    lower, upper = one.structure.bounds
    ends = np.array([slot.parameter.end for slot in one.structure.slots], dtype=float)
    below, above = one.values - lower, upper - one.values
    below[ends == lower], above[ends == upper] = np.inf, np.inf
    at: NDArray[np.bool_] = np.minimum(below, above) <= _AT_BOUND * (upper - lower)
    return at


def ran_away(one: Fit) -> NDArray[np.bool_]:
    """(n_parameters,) whether a value ran into a bound; choices and what is not there do not."""
    choice = np.array([slot.parameter.choice for slot in one.structure.slots], dtype=bool)
    away: NDArray[np.bool_] = at_bound(one) & (one.values != one.structure.zero) & ~choice
    return away
