"""Reward terms, each in [0, 1], 1 being best; and their weighted mean, in [0, 1] as well.

    terms = {"upright": upright(cos_tilt), "effort": low_effort(effort, limits)}
    reward = weighted_mean(terms, {"upright": 1.0, "effort": 0.1})

A bounded reward says on its own how well things go, and none of its terms can drown the others.
`batched_rewards` has the same terms for many robots at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from walkerkit.actuators.arguments import check_number
from walkerkit.actuators.messages import closest, listed
from walkerkit.tasks import batched_rewards


def closeness(error: ArrayLike, scale: float) -> float:
    """Few errors, r = meanᵢ exp(−(eᵢ/σ)²): 1 without error, 0.37 where every error is one scale.

    Args:
        error: what is off, scalar or (n,), in the unit of the scale; 1 where there is nothing.
        scale: σ, above 0.
    """
    return float(
        batched_rewards.closeness(np.atleast_1d(np.asarray(error, dtype=np.float64)), scale)
    )


def upright(cos_tilt: float) -> float:
    """No tilt, r = (1 + cos θ)/2: 1 upright, 0.5 on its side, 0 upside down.

    Args:
        cos_tilt: cosine of the angle θ from the upright pose.
    """
    return float(batched_rewards.upright(cos_tilt))


def low_effort(effort: ArrayLike, limit: ArrayLike) -> float:
    """Little effort, r = 1 − meanᵢ min((τᵢ/τᵢ_max)², 1): 1 without, 0 with all at their limits.

    Args:
        effort: (n,) [N·m; N]; 1 where there is nothing.
        limit: (n,) effort limits, above 0 [N·m; N]; an infinite one makes effort cost nothing.
    """
    return float(batched_rewards.low_effort(effort, limit))


def smoothness(action: ArrayLike, previous: ArrayLike) -> float:
    """Steady actions, r = 1 − meanᵢ ((aᵢ − aᵢ')/2)²: 0 from one end of the range to the other.

    Args:
        action: (n,), in [-1, 1]; what is outside counts as if it were clipped.
        previous: the one before.
    """
    return float(batched_rewards.smoothness(action, previous))


def weighted_mean(terms: Mapping[str, float], weights: Mapping[str, float]) -> float:
    """All terms together, r = Σ wₖ rₖ / Σ wₖ: no less than the least, no more than the greatest.

    Args:
        terms: by name, in [0, 1].
        weights: by the same names, as `checked_weights` lets them pass.
    """
    total = math.fsum(weights[name] for name in terms)
    mean = math.fsum(weights[name] / total * value for name, value in terms.items())
    return min(max(mean, 0.0), 1.0)


def checked_weights(
    weights: Mapping[str, float] | None, default: Mapping[str, float]
) -> dict[str, float]:
    """The weights of a task: what the user gives, and the default for the rest.

    Args:
        weights: name of a term to its weight.
        default: all terms of the task with their default weights.

    Raises:
        TypeError: a weight is not a number.
        ValueError: a term is unknown, or a weight is negative, not finite, or all are 0.
    """
    for name, weight in (weights or {}).items():
        if name not in default:
            raise ValueError(
                f"weights: there is no reward term {name!r}{closest(name, default)}; there are "
                f"{listed(default)}"
            )
        check_number(f"weights[{name!r}]", weight, at_least=0)
    chosen = {**default, **(weights or {})}
    if not any(chosen.values()):
        raise ValueError(f"weights are {chosen}; at least one should be above 0")
    return {name: float(weight) for name, weight in chosen.items()}
