"""What is told of a failure of ours: one line, and a file to send.

    path = report(error)        # the traceback, and what was run on what

The file has names of files and what the error says of them, and nothing that is in them.
"""

from __future__ import annotations

import os
import platform
import shlex
import sys
import tempfile
import traceback
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = ("walkerkit", "mujoco", "dm-control", "numpy", "scipy")


def report(error: BaseException, command: Sequence[str]) -> Path | None:
    """Writes what someone needs to mend a failure into a new file of the temporary folder.

    Args:
        error: what was raised.
        command: the arguments of the program.

    Returns:
        The file; None where none can be written.
    """
    lines = [
        f"command: {shlex.join(['walkerkit', *command])}",
        f"folder: {Path.cwd()}",
        f"python {platform.python_version()} on {platform.platform()}",
        *(f"{name} {_version(name)}" for name in _PACKAGES),
        "",
        "".join(traceback.format_exception(error)),
    ]
    try:
        handle, name = tempfile.mkstemp(prefix="walkerkit-failure-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="replace") as file:
            file.write("\n".join(lines))
    except OSError:
        traceback.print_exception(error, file=sys.stderr)  # better there than nowhere
        return None
    return Path(name)


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "is not installed"
