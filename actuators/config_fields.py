"""Fields of configs, each with the check that its value has to pass.

stiffness: Numbers = number(at_least=0)
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import field
from typing import Any

from walkerkit.actuators.messages import closest


def _names(name: str, value: Any) -> tuple[str, ...]:
    if isinstance(value, str):
        raise TypeError(f"{name} should be a tuple of expressions, got {value!r}: use ({value!r},)")
    if not isinstance(value, Iterable):
        raise TypeError(f"{name} should be a tuple of expressions, got {value!r}")
    expressions = tuple(value)
    if not expressions:
        raise ValueError(f'{name} is empty: name the joints, or use (".*",) for all of them')
    for expression in expressions:
        if not isinstance(expression, str):
            raise TypeError(f"{name} should hold strings, got {expression!r} among {expressions}")
        try:
            re.compile(expression)
        except re.error as error:
            raise ValueError(
                f"{name}: {expression!r} is no regular expression ({error}); write a star that "
                "stands for anything as '.*'"
            ) from None
    return expressions


def number(
    *,
    default: Any = ...,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    whole: bool = False,
    per_joint: bool = True,
) -> Any:
    """A dataclass field that holds a finite number, or one per expression.

    Args:
        default: as in `dataclasses.field`; with None the field may be None, too.
        above: excluded lower bound.
        at_least: lower bound.
        at_most: upper bound.
        whole: integers only.
        per_joint: whether `{expression: number}` will do.
    """

    def check_one(name: str, value: Any) -> float:
        what = "a whole number" if whole else "a number"
        plain = getattr(value, "item", lambda: value)() if getattr(value, "ndim", 0) == 0 else value
        if isinstance(plain, bool) or not isinstance(plain, int if whole else (int, float)):
            each = ", or {expression: number}" if per_joint else ""
            raise TypeError(f"{name} should be {what}{each}, got {value!r}")
        if not math.isfinite(plain):
            none = " (None means unlimited)" if default is None else ""
            raise ValueError(f"{name} should be finite, got {value!r}{none}")
        if (
            (above is not None and plain <= above)
            or (at_least is not None and plain < at_least)
            or (at_most is not None and plain > at_most)
        ):
            bounds = [
                text.format(bound)
                for text, bound in (
                    ("above {:g}", above),
                    ("at least {:g}", at_least),
                    ("at most {:g}", at_most),
                )
                if bound is not None
            ]
            raise ValueError(f"{name} should be {' and '.join(bounds)}, got {value!r}")
        return int(plain) if whole else float(plain)

    def check(name: str, value: Any) -> Any:
        if value is None and default is None:
            return None
        if per_joint and isinstance(value, Mapping):
            _names(name, tuple(value))
            return {key: check_one(f"{name}[{key!r}]", one) for key, one in value.items()}
        return check_one(name, value)

    metadata = {"check": check, "per_joint": per_joint}
    return field(metadata=metadata) if default is ... else field(default=default, metadata=metadata)


def choice(*valid: str, default: Any = ...) -> Any:
    """A dataclass field that holds one of a few words."""

    def check(name: str, value: Any) -> str | None:
        if value is None and default is None:
            return None
        if value not in valid:
            raise ValueError(
                f"{name} should be one of {list(valid)}, got {value!r}{closest(str(value), valid)}"
            )
        return str(value)

    metadata = {"check": check}
    return field(metadata=metadata) if default is ... else field(default=default, metadata=metadata)


def names() -> Any:
    """A dataclass field that holds full-match regular expressions."""
    return field(metadata={"check": _names})


def direction() -> Any:
    """A dataclass field that holds six numbers, or None."""

    def check(name: str, value: Any) -> tuple[float, ...] | None:
        if value is None:
            return None
        try:
            numbers = tuple(float(v) for v in value)
        except (TypeError, ValueError):
            numbers = ()
        if len(numbers) != 6 or not all(map(math.isfinite, numbers)) or not any(numbers):
            raise ValueError(
                f"{name} should be six finite numbers, not all zero (force, then torque, in the "
                f"site's frame), got {value!r}"
            )
        return numbers

    return field(default=None, metadata={"check": check})
