"""Errors of the gap workflow, and what their messages are made of."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


class InputError(ValueError):
    """The user's input cannot be used.

    The message is one line that names the file, the column, row or joint, the value that is wrong
    and what to do about it. The command line prints it and ends with exit status 2.
    """


def refusal(text: str) -> InputError:
    """The error to raise, on one line even where a file name or a parser has line breaks."""
    return InputError(" ".join(text.splitlines()))


def one_line(error: BaseException) -> str:
    """What an error of another library says, as a part of a sentence."""
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__


def closest(name: str, valid: Iterable[str]) -> str:
    """The names most like `name`, as a clause of an error message; empty where none is."""
    lower = {option.lower(): option for option in valid}
    close = difflib.get_close_matches(name.lower(), lower, n=3, cutoff=0.4)
    return f" (did you mean {', '.join(repr(lower[match]) for match in close)}?)" if close else ""


def some(names: Sequence[str], most: int = 3) -> str:
    """The first of some names, and how many more there are."""
    more = len(names) - most
    shown = ", ".join(map(repr, names[:most]))
    return f"{shown} and {more} more" if more > 0 else shown
