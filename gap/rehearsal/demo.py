"""The embedded demonstration: something is hidden in a simulated leg, and found again."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from walkerkit.gap.rehearsal.rehearse import EXPERIMENTS, Rehearsal, rehearse
from walkerkit.gap.report.output import check_free, known_run, write_folder
from walkerkit.gap.report.result import Result
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.workflow import diagnose
from walkerkit.walkers.leg import LEG_XML

KIND, LEG = "demo", "leg.xml"
FILES = {name: f"recordings/{name}.csv" for name in EXPERIMENTS}


def run(
    *,
    seed: int = 0,
    hide: Sequence[str] | None = None,
    out: Path | None = None,
    n_threads: int = 0,
    progress: Progress | None = None,
    overwrite: bool = False,
) -> tuple[Result, Rehearsal]:
    """Records a leg with something hidden in it and diagnoses the recordings.

    Args:
        seed: what is hidden, where and how large.
        hide: effects to hide instead of a drawn one; `["none"]` for nothing.
        out: folder for the result, the leg and its recordings; nothing is written by default.
        n_threads: threads of the simulation, 0 for all cores.
        progress: called with what is being done and how far it is.
        overwrite: whether `out` may replace other files than those of a demo.

    Returns:
        What was found from the recordings alone, and what was hidden.

    Raises:
        InputError: `out` holds files of another run or of the user's own.
    """
    if out is not None:
        check_free(out, (LEG, *FILES.values()), kind=KIND, overwrite=overwrite)
    if progress:
        progress("recording the leg", 0.0)
    rehearsal = rehearse(LEG_XML, hide, seed=seed)
    result = diagnose(
        str(LEG_XML),
        rehearsal.recordings,
        n_threads=n_threads,
        progress=progress,
        out=out,
        overwrite=overwrite,
        kind=KIND,
    )

    def write(made: Path) -> None:
        shutil.copyfile(LEG_XML, made / LEG)
        for recording in rehearsal.recordings:
            file = made / FILES[recording.name]
            file.parent.mkdir(exist_ok=True)
            recording.save(file)

    if out is not None:
        of = {"run": known_run(out)["run"], "kind": KIND}
        write_folder(out, write, run=of, overwrite=overwrite, beside=True)
    return result, rehearsal
