"""What a fleet leaves in its folder: one folder for each robot, and what it takes to keep them.

As of any run, a file says whose they are (`walkerkit.gap.report.output`): a robot's with a hash of
its input, so that one whose input has not changed need not be diagnosed again. What no fleet has
left is replaced only where that is wanted.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from walkerkit.gap.errors import InputError
from walkerkit.gap.fleet.engine import Failure
from walkerkit.gap.fleet.member import Job, Made, input_key
from walkerkit.gap.report.output import DIAGNOSIS, REPORT, check_free, known_run, write_folder
from walkerkit.gap.simulation.sidecar import FILE

FAILURE, KIND = "failure.txt", "robot of a fleet"
MODEL = "model.xml"  # of a robot that has one only


def kept(folder: Path, job: Job) -> dict[str, Any] | None:
    """The diagnosis that a robot's folder has of the same input; None where it has none."""
    known = known_run(folder)
    files = known.get("files", ())
    if known.get("kind") != KIND or DIAGNOSIS not in files:
        return None
    if not all((folder / name).is_file() for name in files):
        return None
    try:
        if known.get("run") != input_key(job):
            return None
    except InputError:
        return None  # whoever diagnoses it will say why
    return read_diagnosis((folder / DIAGNOSIS).read_bytes())


def check_robot(folder: Path, job: Job) -> None:
    """Tells whether something else is in the way before the work is done that would be lost.

    Raises:
        InputError: a file is that the robot's folder is going to have.
    """
    one_model = Path(job.member.model).suffix.lower() != ".toml"
    files = (DIAGNOSIS, REPORT, FILE, FAILURE, *([MODEL] if one_model else []))
    check_free(folder, files, kind=KIND, overwrite=False)


def write_made(folder: Path, made: Made, *, overwrite: bool) -> None:
    """Replaces what an earlier run has left.

    Raises:
        InputError: the folder cannot be written, or a file is in the way and `overwrite` is false.
    """
    _write(folder, made.files, key=made.key, overwrite=overwrite)


def write_failure(folder: Path, failure: Failure, *, overwrite: bool) -> None:
    """Replaces what an earlier run has left by what went wrong.

    Raises:
        InputError: as for `write_made`.
    """
    text = f"{failure.message}\n\n{failure.details}".strip() + "\n"
    _write(folder, {FAILURE: text.encode()}, key="", overwrite=overwrite)


def read_diagnosis(content: bytes) -> dict[str, Any]:
    """The content of a diagnosis.json."""
    found: dict[str, Any] = json.loads(content)
    return found


def _write(folder: Path, files: Mapping[str, bytes], *, key: str, overwrite: bool) -> None:
    def write(made: Path) -> None:
        for name, content in files.items():
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_bytes(content)

    write_folder(folder, write, run={"run": key, "kind": KIND}, overwrite=overwrite)
