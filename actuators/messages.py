"""What the error messages of the actuators are made of."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def closest(name: str, valid: Iterable[str]) -> str:
    """The names most like `name`, as a clause of an error message; empty where none is."""
    lower = {option.lower(): option for option in valid}
    close = difflib.get_close_matches(name.lower(), lower, n=3, cutoff=0.4)
    return f" (did you mean {', '.join(repr(lower[match]) for match in close)}?)" if close else ""


def listed(names: Iterable[str], most: int = 12) -> str:
    """The names in a row, no more of them than a reader takes in."""
    every = [repr(name) for name in names]
    rest = len(every) - most
    return ", ".join(every[:most]) + (f" and {rest} more" if rest > 0 else "") or "none at all"
