"""One case, and whether it ended as it may."""

from __future__ import annotations

import contextlib
import io
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

from walkerkit.gap import cli
from walkerkit.gap.errors import InputError

_TWO_SENTENCES = re.compile(r".{8,}[.:;)] .*\w.*", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class Case:
    """Files, and what is done with them.

    Attributes:
        files: name to content.
        act: does it in the files' folder.
        refusals: errors that it may end with, beside exit status 2.
        place: what a refusal has to name; empty where it may be any of several.
    """

    files: Mapping[str, bytes]
    act: Callable[[Path], object] = field(repr=False)
    refusals: tuple[type[Exception], ...] = (InputError,)
    place: str = ""


def outcome(case: Case, folder: Path) -> str | None:
    """What is wrong with how a case ends, or None.

    Args:
        case: the case.
        folder: is emptied, filled with its files and worked in.
    """
    for file in folder.iterdir():
        if file.is_file():
            file.unlink()
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    try:
        with contextlib.chdir(folder), warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", UserWarning)  # MuJoCo's of a model that it doubts
            case.act(folder)
    except case.refusals as error:
        return _fault(str(error), case.place)
    except Exception:
        return "".join(traceback.format_exc()[-1500:])
    return None


def run(*arguments: str) -> None:
    """Runs the program in this process.

    Raises:
        InputError: it ended with exit status 2, and said this.
        RuntimeError: it ended in any other way but 0, or its refusal is not one line.
    """
    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["walkerkit", *arguments]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        _no_path_left(),
    ):
        try:
            cli.main()
        except SystemExit as ended:
            status = ended.code
    if not status:
        return
    said = err.getvalue()
    if status != 2 or len(said.splitlines()) != 1 or not said.startswith("walkerkit: "):
        raise RuntimeError(f"exit status {status}: {said!r} {out.getvalue()!r}")
    raise InputError(said.removeprefix("walkerkit: ").rstrip("\n"))


@contextlib.contextmanager
def _no_path_left() -> Iterator[None]:
    """Callables are looked for in the working directory, which another case has no use for."""
    before = [*sys.path]
    try:
        yield
    finally:
        sys.path[:] = before


def _fault(message: str, place: str) -> str | None:
    if len(message.splitlines()) != 1:
        return f"more than one line, or none: {message!r}"
    if place not in message:
        return f"does not name {place}: {message!r}"
    if not _TWO_SENTENCES.fullmatch(message):
        return f"does not say what to do: {message!r}"
    return None
