"""Functions of the user's, named as `package.module:callable`.

make = function_named("my_robot:make", "the walker")
with blamed_on("my_robot:make", "Mend it until it returns the walker without arguments."):
    walker = make()
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from walkerkit.gap.errors import InputError, closest, one_line


def function_named(source: str, returns: str) -> Callable[..., Any]:
    """Imports a function; the working directory is looked in first.

    Args:
        source: `package.module:callable`.
        returns: what it should return, in words.

    Raises:
        InputError: the module cannot be imported, or has no such function.
    """
    module_name, _, function_name = source.rpartition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # a module can fail to import in any way
        raise InputError(
            f"{source}: cannot import {module_name!r}: {one_line(error)}. "
            "Install it or run from its folder."
        ) from error
    found = getattr(module, function_name, None)
    if not callable(found):
        raise InputError(
            f"{source}: {module_name!r} has no function {function_name!r}"
            f"{closest(function_name, vars(module))}. Name one that returns {returns}."
        )
    return found  # type: ignore[no-any-return]


@contextmanager
def blamed_on(source: str, remedy: str) -> Iterator[None]:
    """Says of whatever is raised that the user's function raised it.

    Args:
        source: the function, as the user knows it.
        remedy: what to do about it, a sentence.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # it is the user's function
        raise InputError(
            f"{source}: it raised {type(error).__name__}: {one_line(error)}. {remedy}"
        ) from error
