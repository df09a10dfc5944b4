"""Runs that ask for work which others may ask for too, so that it is done for all at once."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from typing import Any, TypeVar

_Asked = TypeVar("_Asked")
_Result = TypeVar("_Result")


def advanced(
    runs: Sequence[Generator[_Asked, Any, _Result]],
    answers: Mapping[int, Any],
    found: dict[int, _Result],
) -> dict[int, _Asked]:
    """Takes some runs as far as the next thing that each asks for.

    Args:
        runs: all of them.
        answers: number of a run to what it last asked for; None to begin.
        found: written to: what those return that come to their end.

    Returns:
        Number of each other run to what it asks for.
    """
    asked: dict[int, _Asked] = {}
    for k, answer in answers.items():
        try:
            asked[k] = runs[k].send(answer)
        except StopIteration as stop:
            found[k] = stop.value
    return asked
