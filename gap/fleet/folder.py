"""What a fleet leaves in its folder: one folder for each robot, and what it takes to keep them.

`member.json` is written last of a robot's files. Its key is a hash of the robot's input, so that a
robot whose input has not changed need not be diagnosed again; its list says which files are ours.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from walkerkit.gap.errors import InputError
from walkerkit.gap.fleet.engine import Failure
from walkerkit.gap.fleet.member import Job, Made, input_key
from walkerkit.gap.report.output import DIAGNOSIS, write_folder

MARK, FAILURE = "member.json", "failure.txt"
SCHEMA = 1


def kept(folder: Path, job: Job) -> dict[str, Any] | None:
    """The diagnosis that a robot's folder has of the same input; None where it has none."""
    mark = _mark(folder)
    if mark is None or not all((folder / name).is_file() for name in mark["files"]):
        return None
    try:
        if mark["key"] != input_key(job):
            return None
    except InputError:
        return None  # whoever diagnoses it will say why
    return read_diagnosis((folder / DIAGNOSIS).read_bytes())


def write_made(folder: Path, made: Made) -> None:
    """Replaces what an earlier run has left.

    Raises:
        InputError: the folder cannot be written.
    """
    clear(folder)
    _write(folder, made.files)
    mark = {"schema": SCHEMA, "key": made.key, "files": list(made.files)}
    _write(folder, {MARK: (json.dumps(mark, indent=2, ensure_ascii=False) + "\n").encode()})


def write_failure(folder: Path, failure: Failure) -> None:
    """Replaces what an earlier run has left by what went wrong.

    Raises:
        InputError: the folder cannot be written.
    """
    clear(folder)
    _write(folder, {FAILURE: f"{failure.message}\n\n{failure.details}".strip().encode() + b"\n"})


def clear(folder: Path) -> None:
    """Removes the files that an earlier run has written, and no others."""
    mark = _mark(folder)
    for name in (MARK, FAILURE, *(mark["files"] if mark else ())):
        (folder / name).unlink(missing_ok=True)


def read_diagnosis(content: bytes) -> dict[str, Any]:
    """The content of a diagnosis.json."""
    found: dict[str, Any] = json.loads(content)
    return found


def _mark(folder: Path) -> dict[str, Any] | None:
    try:
        mark = json.loads((folder / MARK).read_bytes())
    except (OSError, ValueError):
        return None
    proper = isinstance(mark, dict) and mark.get("schema") == SCHEMA and "key" in mark
    names = mark.get("files") if proper else None
    if not isinstance(names, list) or DIAGNOSIS not in names:
        return None
    inside = folder.resolve()
    proper = all(
        isinstance(n, str) and (inside / n).resolve().is_relative_to(inside) for n in names
    )
    return mark if proper else None


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    def write(made: Path) -> None:
        for name, content in files.items():
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_bytes(content)

    write_folder(folder, write)
