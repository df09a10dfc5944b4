"""Numbers that a caller passes: Python's, numpy's or anyone's, checked and made plain.

    kp = check_number("kp", np.float32(50), at_least=0)  # 50.0
    low, high = check_range("ctrlrange", (-1, 1))  # (-1.0, 1.0)

Every error names the argument, shows the value as it was given, and says what to pass instead.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from numbers import Real
from typing import Any


def check_number(
    name: str,
    value: Any,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> float:
    """A finite number, as Python's own.

    Args:
        name: what the error calls it.
        value: anything that may be a number.
        above: excluded lower bound.
        at_least: lower bound.
        at_most: upper bound.

    Raises:
        TypeError: `value` is not a number; True and False are none.
        ValueError: it is not finite, or not within the bounds.
    """
    number = plain(value)
    is_number = isinstance(number, Real) and not isinstance(number, bool)
    if not is_number:
        raise TypeError(
            f"`{name}` should be a number, got {value!r} of type {type(value).__name__}: pass an "
            "int or a float"
        )
    if not -sys.float_info.max <= number <= sys.float_info.max:
        raise ValueError(f"`{name}` should be finite, got {value!r}: pass a finite number")
    if above is not None and not number > above:
        raise ValueError(f"`{name}` should be above {above:g}, got {value!r}")
    if at_least is not None and not number >= at_least:
        raise ValueError(f"`{name}` should be at least {at_least:g}, got {value!r}")
    if at_most is not None and not number <= at_most:
        raise ValueError(f"`{name}` should be at most {at_most:g}, got {value!r}")
    # An int stays one because its negative has no -0.0, which dm_control would not write either.
    return number if isinstance(number, int) else float(number)


def check_range(name: str, value: Any) -> tuple[float, float]:
    """Two rising, finite numbers.

    Args:
        name: what the error calls them.
        value: anything that may be two numbers.

    Raises:
        TypeError: `value` is not a sequence of numbers.
        ValueError: not two of them, not finite, or not rising.
    """
    numbers = plain(value)
    if isinstance(numbers, str | bytes) or not isinstance(numbers, Sequence):
        hint = ""
        if value is None:
            hint = (
                ". PyMJCF's `joint.range` is None where a default class sets it: "
                '`qposrange="joint"` of a position actuator resolves it'
            )
        elif isinstance(numbers, str):
            hint = '. The one word that stands for a range is `qposrange="joint"`'
        raise TypeError(f"`{name}` should be two numbers (low, high), got {value!r}{hint}")
    if len(numbers) != 2:
        raise ValueError(
            f"`{name}` should be two numbers (low, high), got {len(numbers)}: {value!r}"
        )
    low, high = (float(check_number(f"{name}[{i}]", n)) for i, n in enumerate(numbers))
    if not low < high:
        raise ValueError(
            f"`{name}` should rise from low to high, got ({low}, {high}): "
            + (f"use ({high}, {low})" if high < low else "give it a width")
        )
    return low, high


def plain(value: Any) -> Any:
    """Python's own numbers and lists for those of numpy, JAX, torch or pandas."""
    tolist = getattr(value, "tolist", None)
    return tolist() if callable(tolist) else value
