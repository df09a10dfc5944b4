"""Numbers as MJCF writes them."""

from __future__ import annotations

from collections.abc import Iterable

_DIGITS = 8  # far more than any estimate has


def numerals(values: Iterable[float]) -> str:
    """Numbers with a fitted one's digits, e.g. `0.202` or `-0.3 0.3`."""
    return " ".join(f"{float(value):.{_DIGITS}g}" for value in values)


def whole(values: Iterable[float]) -> str:
    """Numbers with all of their digits."""
    return " ".join(f"{float(value):.17g}" for value in values)
