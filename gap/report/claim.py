"""Whose an output folder is: it belongs to one run until `--overwrite` gives it to another.

    with claimed(folder, key, ["model.xml"], overwrite=False) as save:
        save(diagnose(...))      # goes on from where a run of the same key was killed

While a run is at work its finished steps are in `CHECKPOINT`; when it is done that is gone and
`RUN` says whose the files are. A run that fails leaves the result before it as it was.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.report.output import DIAGNOSES, RUN, WRITING, known_run, save, unwritable
from walkerkit.gap.report.result import Result
from walkerkit.gap.search.journal import Journal, digest
from walkerkit.gap.simulation.robot import Robot

CHECKPOINT = ".walkerkit-checkpoint"


@contextlib.contextmanager
def claimed(
    folder: Path, key: str, files: Sequence[str], *, overwrite: bool, kind: str = DIAGNOSES
) -> Iterator[Callable[[Result], Path]]:
    """Takes a folder for a run, and lets the search within remember its steps there.

    Args:
        folder: made if it is missing.
        key: of the run, from `run_key`.
        files: names that the run is going to write there.
        overwrite: whether files of other runs may be replaced.
        kind: of the run; one demo may replace another.

    Yields:
        What saves the result of the run.

    Raises:
        InputError: it holds files of another run, another run is at work in it, or it cannot be
            written.
    """
    try:
        known = known_run(folder)
        same = known.get("run") == key or kind == known.get("kind") == "demo"
        taken = [name for name in (*files, RUN) if (folder / name).exists()]
        if taken and not (same or overwrite):
            raise InputError(
                f"{folder}: has {taken[0]} of another run or of your own. Give another folder "
                "with --out, or replace it with --overwrite."
            )
        folder.mkdir(parents=True, exist_ok=True)
        checkpoint = folder / CHECKPOINT
        with Journal.open(checkpoint, key) as journal:
            for left in folder.glob(f"{WRITING}*"):
                shutil.rmtree(left)
            with journal.kept():
                yield lambda result: save(
                    result, folder, run={"run": key, "kind": kind}, overwrite=overwrite or same
                )
            checkpoint.unlink(missing_ok=True)
    except BlockingIOError:
        raise InputError(
            f"{folder}: another run is at work in it. Wait for its end, or give another folder "
            "with --out."
        ) from None
    except OSError as error:
        raise unwritable(folder, error.strerror) from None


def run_key(
    robots: Sequence[Robot],
    recordings: Sequence[Sequence[Recording]],
    options: Sequence[object],
) -> str:
    """A digest of everything that a result depends on.

    Args:
        robots: as loaded.
        recordings: what is fitted and what is held out, robot by robot.
        options: of the run, each with a repr that tells it from others.
    """
    parts: list[Any] = [repr(options), *(version(name) for name in ("numpy", "scipy", "mujoco"))]
    sources = Path(__file__).parents[2]
    for folder in ("actuators", "walkers", "tasks", "gap"):
        parts.extend(path.read_bytes() for path in sorted((sources / folder).rglob("*.py")))
    for robot in robots:
        compiled = np.zeros(mujoco.mj_sizeModel(robot.model), np.uint8)
        mujoco.mj_saveModel(robot.model, None, compiled)
        about = (robot.source, robot.measurement, robot.hold, robot.laws, robot.base, robot.notes)
        parts.extend(repr((one.cfg, *one.numbers.items())) for one in robot.programs)
        parts.append(repr([(joint.drives, joint.inputs) for joint in robot.joints.values()]))
        parts.extend([compiled.tobytes(), repr(about)])
    for group in recordings:
        parts.append(str(len(group)))
        for one in group:
            parts.append(repr((one.name, one.source, one.unused, one.notes, list(one.columns))))
            parts.extend(
                [one.time.tobytes(), *(column.tobytes() for column in one.columns.values())]
            )
    return digest(*parts)
