"""Errors of the gap workflow."""

from __future__ import annotations


class InputError(ValueError):
    """The user's input cannot be used.

    The message is one line that names the file, the column, row or joint, the value that is wrong
    and what to do about it. The command line prints it and ends with exit status 2.
    """
