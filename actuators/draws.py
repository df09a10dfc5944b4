"""Random numbers from a range, by one of a few distributions or by a composer variation.

    low, high = support((1.0, 0.1), "gaussian")                    # (0.7, 1.3)
    draw((0.5, 2.0), "log_uniform", rng.uniform(size=(64, 12)))    # (64, 12)

Every distribution has ends, so that what may come of it can be judged before anything is drawn. A
Gaussian ends at three standard deviations, which takes 1.4 % off its standard deviation.
"""

from __future__ import annotations

from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Random
from walkerkit.actuators.arguments import check_number, plain

FloatArray = NDArray[np.float64]
Distribution = Literal["uniform", "log_uniform", "gaussian"]

CUT = 3.0
"""Standard deviations at which a Gaussian ends."""


class Variation(Protocol):
    """What a variation of `dm_control.composer` is: something to call for a value."""

    def __call__(
        self, initial_value: FloatArray, current_value: FloatArray, random_state: Any, /
    ) -> Any:
        """The value for all joints, or one for each.

        Args:
            initial_value: nominal values, (n,).
            current_value: present values, (n,).
            random_state: a `RandomState`.
        """


Range = tuple[float, float] | Variation
"""Where draws come from: (low, high), for a Gaussian (mean, standard deviation), or a variation."""


def check_pair(what: str, value: Any, distribution: Distribution) -> tuple[float, float]:
    """The two numbers of a distribution.

    Args:
        what: what an error calls them.
        value: (low, high), of a Gaussian (mean, standard deviation).
        distribution: which one they are for.

    Raises:
        TypeError: not two numbers.
        ValueError: they do not rise, are not positive for `log_uniform`, or the standard deviation
            is negative.
    """
    pair = plain(value)
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        raise TypeError(
            f"{what} should be two numbers (low, high), for a gaussian (mean, standard deviation), "
            f"or a composer variation, got {value!r}"
        )
    first, second = (float(check_number(f"{what}, [{i}]", n)) for i, n in enumerate(pair))
    if distribution == "gaussian":
        if second < 0:
            raise ValueError(
                f"{what} should be (mean, standard deviation) with gaussian, got "
                f"({first:g}, {second:g}), whose standard deviation is negative"
            )
    elif first > second:
        raise ValueError(
            f"{what} should rise from low to high, got ({first:g}, {second:g}): use "
            f"({second:g}, {first:g})"
        )
    if distribution == "log_uniform" and first <= 0:
        raise ValueError(
            f"{what} should be above 0 with log_uniform, got ({first:g}, {second:g}): raise the "
            "lower end, or use uniform"
        )
    return first, second


def support(pair: tuple[float, float], distribution: Distribution) -> tuple[float, float]:
    """The least and the greatest draw.

    Args:
        pair: as `check_pair` returns it.
        distribution: which one it is for.
    """
    first, second = pair
    if distribution == "gaussian":
        return first - CUT * second, first + CUT * second
    return first, second


def draw(pair: tuple[float, float], distribution: Distribution, share: FloatArray) -> FloatArray:
    """Draws within the `support`.

    Args:
        pair: as `check_pair` returns it.
        distribution: how they are distributed.
        share: uniform from 0 to 1, of any shape: one number makes one draw.
    """
    first, second = pair
    if distribution == "uniform":
        draws = first + share * (second - first)
    elif distribution == "log_uniform":
        draws = np.exp(np.log(first) + share * (np.log(second) - np.log(first)))
    else:
        # SciPy takes longer to import than all of this package, and few draws need it.
        from scipy.special import ndtr, ndtri

        tail = ndtr(-CUT)
        draws = first + second * ndtri(tail + share * (1 - 2 * tail))
    # What rounding leaves outside would be impossible where the end itself is just possible.
    return np.clip(draws, *support(pair, distribution))


def draw_whole(pair: tuple[float, float], share: FloatArray) -> FloatArray:
    """Draws of whole numbers from low to high, both of them included, each equally likely."""
    low, high = pair
    return np.minimum(np.floor(low + share * (high - low + 1)), high)


def vary(
    variation: Variation, initial: FloatArray, current: FloatArray, random_state: Random
) -> FloatArray:
    """Draws of a variation, which sees one simulation at a time, as in composer.

    Args:
        variation: what to call.
        initial: nominal values, (n,).
        current: present values, (n,) or (n_sims, n).
        random_state: where it draws from.

    Returns:
        Draws of the shape of `current`.

    Raises:
        ValueError: what it returns is neither a number nor n of them.
    """
    if isinstance(random_state, np.random.Generator):
        # Variations call what only a RandomState has; this one moves the Generator's state on.
        random_state = np.random.RandomState(random_state.bit_generator)
    draws = np.empty(current.shape)
    for i in np.ndindex(current.shape[:-1]):
        drawn = variation(initial.copy(), current[i].copy(), random_state)
        try:
            draws[i] = drawn
        except (TypeError, ValueError):
            raise ValueError(
                f"the variation {variation!r} returned {drawn!r} and should return a number for "
                f"all joints or {len(initial)} numbers, one for each: see its `single_sample`"
            ) from None
    return draws
