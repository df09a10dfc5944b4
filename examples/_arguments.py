"""What the examples are told on the command line."""

from __future__ import annotations

import argparse
from typing import TypeVar

T = TypeVar("T")


def argument(description: str | None, name: str, default: T) -> T:
    """The one argument of a program, which may be left out.

    Args:
        description: of the program, its docstring.
        name: of the argument, as its help has it.
        default: what it is otherwise; the argument is of its type.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("value", metavar=name, type=type(default), nargs="?", default=default)
    found: T = parser.parse_args().value
    return found
