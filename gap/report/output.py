"""The folder that `diagnose --out` leaves behind."""

from __future__ import annotations

import json
import os
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from errno import EISDIR
from pathlib import Path
from typing import TYPE_CHECKING, Any

from walkerkit.gap.deliver.written import write_mended
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.report.experiments import mended_experiments
from walkerkit.gap.report.hints import stopgap_file
from walkerkit.gap.report.motion import MOTIONS, save_motions
from walkerkit.gap.report.page import write_report
from walkerkit.gap.report.planner import FILE as TARGETS
from walkerkit.gap.report.planner import MODEL as CHANGED
from walkerkit.gap.simulation.mend import write_model
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import FILE, sidecar
from walkerkit.gap.stopgap.learned_drive import LearnedDrive

if TYPE_CHECKING:
    from walkerkit.gap.report.result import Result

RUN, WRITING = ".walkerkit-run.json", ".writing-"
DIAGNOSES = "diagnosis"  # the kind of a run that `diagnose` makes
DIAGNOSIS, REPORT, MANIFEST = "diagnosis.json", "report.html", "experiments.toml"


def check_folder(folder: Path) -> None:
    """Tells whether a folder can be written before the work is done that would be lost.

    Args:
        folder: may be missing.

    Raises:
        InputError: it is no folder, or what it would be made in is none or may not be written.
    """
    whole = folder.absolute()
    try:
        there = next(path for path in (whole, *whole.parents) if path.exists())
    except OSError as error:
        raise unwritable(folder, error.strerror) from None
    if not there.is_dir():
        raise unwritable(folder, f"{there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise unwritable(folder, f"no permission to write in {there}")


def check_free(folder: Path, files: Iterable[str], *, kind: str, overwrite: bool) -> None:
    """Tells whether files of the user's or of another kind of run are in the way.

    Args:
        folder: may be missing.
        files: names in it that are going to be written.
        kind: of the run that writes them; what one of its kind has left may be replaced.
        overwrite: whether everything may be.

    Raises:
        InputError: a file is in the way.
    """
    if overwrite:
        return
    ours = known_run(folder).get("kind") == kind
    own = (*_left(folder, kind), *([RUN] if ours else []))
    for name in (*files, RUN):
        if (folder / name).exists() and name not in own:
            raise InputError(
                f"{folder / name}: is in the way, of another run or of your own. Move it, give "
                "another folder with --out, or replace it with --overwrite."
            )


def save(
    result: Result, folder: Path, *, run: Mapping[str, str] | None = None, overwrite: bool = True
) -> Path:
    """Writes everything that a diagnosis leaves.

    Args:
        result: what was found.
        folder: as for `write_folder`, as are the next two.
        run: what the folder's files are of.
        overwrite: whether files that are there may be replaced.

    Returns:
        The folder.

    Raises:
        InputError: the folder cannot be written, or a file is in the way.
    """
    return write_folder(folder, lambda made: _write(result, made), run=run, overwrite=overwrite)


def write_folder(
    folder: Path,
    write: Callable[[Path], None],
    *,
    run: Mapping[str, str] | None = None,
    overwrite: bool = True,
    beside: bool = False,
) -> Path:
    """Has files written into a folder beside the target first, so that none is ever half there.

    Args:
        folder: made if it is missing.
        write: given an empty folder, writes into it.
        run: what the folder's files are of, to be kept beside them, its `kind` above all; None for
            nothing.
        overwrite: whether files that no run of this kind has left may be replaced.
        beside: whether what a run of this kind has left stays; it goes otherwise.

    Returns:
        The folder.

    Raises:
        InputError: the folder cannot be written, or a file is in the way.
    """
    kind = DIAGNOSES if run is None else run["kind"]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix=WRITING) as name:
            made = Path(name)
            write(made)
            files = [p.relative_to(made) for p in sorted(made.rglob("*")) if not p.is_dir()]
            check_free(folder, map(str, files), kind=kind, overwrite=overwrite)
            for path in files:
                target = folder / path
                if target.is_dir():
                    raise IsADirectoryError(EISDIR, f"{target} is a folder")
                with (made / path).open("rb") as file:
                    os.fsync(file.fileno())
            before, new = _left(folder, kind), [str(path) for path in files]
            if run is not None:
                # First, so that a run that is killed in between finds the folder to be its own.
                content = {**run, "files": [*dict.fromkeys((*before, *new))] if beside else new}
                _write_text(made / RUN, json.dumps(content) + "\n")
                files.insert(0, Path(RUN))
            with _uninterrupted():
                for path in files:
                    (folder / path.parent).mkdir(parents=True, exist_ok=True)
                    (made / path).replace(folder / path)
                for old in () if beside else {*before} - {*new}:
                    (folder / old).unlink(missing_ok=True)
                if run is None:
                    (folder / RUN).unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(folder, error.strerror) from None
    return folder


def known_run(folder: Path) -> dict[str, Any]:
    """What a folder says of the run that its files are of; nothing where it says nothing."""
    try:
        content = json.loads((folder / RUN).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return {}
    if not isinstance(content, dict):
        return {}
    files = content.get("files", [])
    inside = [f for f in files if isinstance(f, str) and ".." not in f and not f.startswith("/")]
    return {**content, "files": inside}


def _left(folder: Path, kind: str) -> list[str]:
    """The files that a run of this kind has left in a folder."""
    known = known_run(folder)
    files: list[str] = known["files"] if known.get("kind") == kind else []
    return files


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Lets Ctrl-C and a polite end wait until files have changed their names."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def unwritable(folder: Path, reason: str | None) -> InputError:
    """The refusal of a folder that cannot be written."""
    return InputError(f"{folder}: cannot be written ({reason}). Give another folder with --out.")


def _write(result: Result, folder: Path) -> None:
    names = model_names(result.robots)
    taken: dict[str, Path | str] = {}
    written = {
        name: write_mended(given, robot, folder / name, taken)
        for name, given, robot in zip(names, result.problem.robots, result.robots, strict=True)
    }
    robots = dict(zip(names, result.robots, strict=True))
    robots |= _next_experiment(result, folder, taken)
    named = result.diagnosis.to_dict()["effects"]
    content = sidecar(robots, named)
    for name, how in written.items():
        content["models"][name]["file"] = how.to_dict()
    if result.stopgaps:
        content["models"][names[0]]["stopgap"] = {
            drive.joint: _saved(drive, folder) for drive in result.stopgaps
        }
    _write_text(folder / FILE, json.dumps(content, indent=2, ensure_ascii=False) + "\n")
    if len(names) > 1:
        _write_text(folder / MANIFEST, mended_experiments(result.problem, names))
    if result.diagnosis.motions:
        save_motions(result.diagnosis.motions, names, folder / MOTIONS)
    write_report(
        result.diagnosis,
        folder / REPORT,
        title=title(result.robots),
        catalogue=CATALOGUE,
        models=names,
        experiments=result.next_experiments,
    )
    _write_text(folder / DIAGNOSIS, result.diagnosis.to_json())


def title(robots: Sequence[Robot]) -> str:
    """The heading of a report: the names of all models."""
    return ", ".join(dict.fromkeys(robot.stem for robot in robots))


def _saved(drive: LearnedDrive, folder: Path) -> dict[str, Any]:
    """Writes a learned drive's network; returns what its actuator config needs."""
    file = stopgap_file(drive.joint)
    drive.trained.save(folder / file)
    return {**drive.fields(file), "lag": drive.lag}


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def main_files(robots: Sequence[Robot]) -> list[str]:
    """The files that every result of some robots has."""
    names = model_names(robots)
    return [*names, FILE, REPORT, DIAGNOSIS, MOTIONS, *([MANIFEST] if len(names) > 1 else [])]


def model_names(robots: Sequence[Robot]) -> list[str]:
    """`model.xml`, or `model_<stem>.xml` each; stems that repeat get a number."""
    if len(robots) == 1:
        return ["model.xml"]
    names: list[str] = []
    for robot in robots:
        name, number = f"model_{robot.stem}.xml", 1
        while name in names:
            number += 1
            name = f"model_{robot.stem}_{number}.xml"
        names.append(name)
    return names


def _next_experiment(
    result: Result, folder: Path, taken: dict[str, Path | str]
) -> dict[str, Robot]:
    """Writes what to send next, and the model with a changed set-up where there is one."""
    following = result.following
    if following is None:
        return {}
    following.targets.save(folder / TARGETS)
    if following.robot is None:
        return {}
    robot = replace(following.robot, hold=result.problem.hold)
    write_model(robot, folder / CHANGED, taken)
    return {CHANGED: robot}
