"""The code blocks of a page, run one after the other in one folder as a reader would."""

from __future__ import annotations

import contextlib
import glob
import importlib
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from walkerkit.gap import cli

_BLOCK = re.compile(r"^```(bash|python|toml|xml)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

Block = tuple[str, str]


def runnable(page: Path) -> list[Block]:
    """Language and code of its blocks in bash and Python; others are shown, not run.

    `make` itself is what runs these tests.
    """
    return [
        (language, code)
        for language, code in _BLOCK.findall(page.read_text(encoding="utf-8"))
        if language in ("bash", "python") and not code.startswith(("git clone", "make "))
    ]


def run(blocks: list[Block], folder: Path) -> None:
    """Runs them here, where a warning is an error; what only a shell understands, in a shell."""
    with contextlib.chdir(folder), _importable(folder):
        for language, code in blocks:
            try:
                _run(language, code)
            except Exception as error:
                error.add_note(f"in this block:\n{code}")
                raise


@contextlib.contextmanager
def _importable(folder: Path) -> Iterator[None]:
    """Lets modules that a reader saves in the folder be imported, for as long."""
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in [path.stem for path in folder.glob("*.py")]:
            sys.modules.pop(name, None)


def _run(language: str, code: str) -> None:
    named = re.match(r"# (\w+\.py)\n", code)
    if language == "python" and named:  # a module that the reader saves
        Path(named[1]).write_text(code, encoding="utf-8")
        return
    # What is imported already costs a block seconds in a process of its own.
    if language == "python":
        exec(compile(code, "<block>", "exec"), {"__name__": "__main__"})
    else:
        for line in _commands(code):
            if line.startswith("walkerkit ") and not set(line) & set("|<>&$\\\n"):
                _program(shlex.split(line, comments=True))
            else:
                _shell(line)


def _commands(code: str) -> list[str]:
    """Its lines of `walkerkit`, and between them what is whole to a shell."""
    parts, within = [""], ""  # within a text that ends with this word
    for line in code.splitlines(keepends=True):
        own = line.startswith("walkerkit ") and not within and not parts[-1].endswith("\\\n")
        begun = re.search(r"<<'(\w+)'$", line)
        within = begun[1] if begun else "" if line.strip() == within else within
        if own and not line.endswith("\\\n"):
            parts += [line.rstrip(), ""]
        else:
            parts[-1] += line
    return [part for part in parts if part.strip()]


def _program(words: list[str]) -> None:
    """A command line, its patterns spelt out as a shell does."""
    if not words:
        return
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(io.StringIO()) as told:
        found = [sorted(glob.glob(word)) or [word] for word in words]  # noqa: PTH207
        patch.setattr(sys, "argv", [one for some in found for one in some])
        with pytest.raises(SystemExit) as ended:
            cli.main()
    assert not ended.value.code, f"{words} ended with {ended.value.code}\n{told.getvalue()}"


def _shell(code: str) -> None:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    command = ["bash", "-euo", "pipefail", "-c", code]
    done = subprocess.run(
        command, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False
    )
    assert not done.returncode, f"ended with {done.returncode}\n{done.stdout}\n{done.stderr}"
