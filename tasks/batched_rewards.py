"""Reward terms of many robots at once: what `rewards` says of one, over arrays `(..., n)`.

    batched_rewards.closeness(error, 0.5)        # (64, 12) rad → (64,)

All in [0, 1], 1 being best, and 1 where there is nothing to be off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

_FAR = 40.0  # scales; the square of what is farther overflows where exp is long zero


def closeness(error: ArrayLike, scale: ArrayLike) -> FloatArray:
    """Few errors, r = meanᵢ exp(−(eᵢ/σ)²), (...,).

    Args:
        error: what is off, (..., n), in the unit of the scale.
        scale: σ, above 0, a number or what goes with the errors.
    """
    far = np.minimum(np.abs(np.asarray(error, dtype=np.float64) / np.asarray(scale)), _FAR)
    return _mean(np.exp(-(far**2)))


def upright(cos_tilt: ArrayLike) -> FloatArray:
    """No tilt, r = (1 + cos θ)/2, of any shape.

    Args:
        cos_tilt: cosine of the angle θ from the upright pose.
    """
    return np.clip((1.0 + np.asarray(cos_tilt)) / 2.0, 0.0, 1.0)


def low_effort(effort: ArrayLike, limit: ArrayLike) -> FloatArray:
    """Little effort, r = 1 − meanᵢ min((τᵢ/τᵢ_max)², 1), (...,).

    Args:
        effort: (..., n) [N·m; N].
        limit: (n,) effort limits, above 0 [N·m; N]; an infinite one makes effort cost nothing.
    """
    shares = np.minimum(np.abs(np.asarray(effort)) / np.asarray(limit), 1.0)
    return _one_minus_mean(shares**2)


def smoothness(action: ArrayLike, previous: ArrayLike) -> FloatArray:
    """Steady actions, r = 1 − meanᵢ ((aᵢ − aᵢ')/2)², (...,).

    Args:
        action: (..., n), in [-1, 1]; what is outside counts as if it were clipped.
        previous: the one before.
    """
    now, before = (np.clip(np.asarray(a, dtype=np.float64), -1.0, 1.0) for a in (action, previous))
    return _one_minus_mean(((now - before) / 2.0) ** 2)


def weighted_mean(terms: Mapping[str, ArrayLike], weights: Mapping[str, float]) -> FloatArray:
    """All terms together, r = Σ wₖ rₖ / Σ wₖ.

    Args:
        terms: by name, in [0, 1], of one shape.
        weights: by the same names, as `rewards.checked_weights` lets them pass.
    """
    total = math.fsum(weights[name] for name in terms)
    mean = sum(np.asarray(value) * (weights[name] / total) for name, value in terms.items())
    return np.clip(mean, 0.0, 1.0)


def _mean(values: FloatArray) -> FloatArray:
    """Over the last axis; 1 where it is empty."""
    return np.asarray(values.mean(axis=-1)) if values.shape[-1] else np.ones(values.shape[:-1])


def _one_minus_mean(losses: FloatArray) -> FloatArray:
    """What is left over the last axis; 1 where it is empty."""
    return 1.0 - _mean(losses) if losses.shape[-1] else _mean(losses)
