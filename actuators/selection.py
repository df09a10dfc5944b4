"""Which joints a config drives, and which number belongs to which joint.

Expressions are regular expressions that have to match a whole name, as in `(".*_hip_.*", "knee")`.
The result is always in kinematic order, that of the compiled model, whatever the order of the
expressions.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.messages import closest, listed

FloatArray = NDArray[np.float64]
Numbers = float | Mapping[str, float]
"""One number for all joints, or one per expression."""
_FLAGS = re.compile(r"((?:\(\?[aiLmsux]+\))?)(.*)", re.DOTALL)
"""Flags of a whole expression, which stand in front of it."""


def select(
    expressions: Sequence[str], names: Sequence[str], *, field: str = "joint_names_expr"
) -> tuple[int, ...]:
    """Indices of the names that the expressions match, rising.

    Args:
        expressions: full-match regular expressions.
        names: the names that there are, in kinematic order.
        field: what to call the expressions in an error.

    Raises:
        ValueError: an expression matches nothing, or a name is matched twice.
    """
    claimed: dict[int, str] = {}
    for expression in expressions:
        pattern = re.compile(expression)
        matched = [i for i, name in enumerate(names) if pattern.fullmatch(name)]
        if not matched:
            raise ValueError(
                f"{field}: {expression!r} matches none of {listed(names)}"
                f"{closest(expression, names)}; an expression has to match the whole name"
            )
        for i in matched:
            if i in claimed:
                raise ValueError(
                    f"{field}: {names[i]!r} is matched by {claimed[i]!r} and by {expression!r}; "
                    "leave one of them out, or make it narrower"
                )
            claimed[i] = expression
    return tuple(sorted(claimed))


def narrowed(
    expressions: Sequence[str], names: Sequence[str], excluded: Collection[str]
) -> tuple[str, ...]:
    """Expressions that match what the given ones match, but for some names.

    Args:
        expressions: full-match regular expressions.
        names: what they can match.
        excluded: names that they are to leave out.

    Returns:
        As few of them changed as possible; none at all where nothing is left to match.
    """
    left = []
    for expression in expressions:
        pattern = re.compile(expression)
        matched = [name for name in names if pattern.fullmatch(name)]
        lost = [name for name in matched if name in excluded]
        if not lost:
            left.append(expression)
        elif len(lost) < len(matched):
            flags, body = _FLAGS.fullmatch(expression).groups()  # type: ignore[union-attr]
            body = f"(?:{body})" if "|" in body else body
            left.append(f"{flags}(?!(?:{'|'.join(map(re.escape, lost))})$){body}")
    return tuple(left)


def per_joint(value: Numbers, names: Sequence[str], *, field: str) -> FloatArray:
    """One number per joint.

    Args:
        value: a number for all, or full-match expressions with a number each.
        names: the joints, (n_joints,).
        field: what to call the value in an error.

    Returns:
        (n_joints,) array.

    Raises:
        ValueError: an expression matches nothing, a joint is matched twice or not at all.
    """
    if not isinstance(value, Mapping):
        return np.full(len(names), float(value))
    numbers = np.full(len(names), np.nan)
    for expression, number in value.items():
        for i in select((expression,), names, field=field):
            if not np.isnan(numbers[i]):
                raise ValueError(
                    f"{field}: {names[i]!r} is matched by {expression!r} and by another of "
                    f"{list(value)}; make one of them narrower"
                )
            numbers[i] = number
    missing = [name for name, number in zip(names, numbers, strict=True) if np.isnan(number)]
    if missing:
        raise ValueError(
            f"{field} has no number for {listed(missing)}: add an expression that matches them "
            f"to {list(value)}"
        )
    return numbers
