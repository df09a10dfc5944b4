"""The embedded demonstration: something is hidden in a simulated leg, and found again."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from walkerkit.gap.rehearsal.rehearse import Rehearsal, rehearse
from walkerkit.gap.report.result import Result
from walkerkit.gap.search.fit import Progress
from walkerkit.gap.workflow import diagnose
from walkerkit.walkers.leg import LEG_XML


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
    """
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
        kind="demo",
    )
    if out is not None:
        shutil.copyfile(LEG_XML, out / "leg.xml")
        (out / "recordings").mkdir(exist_ok=True)
        for recording in rehearsal.recordings:
            recording.save(out / "recordings" / f"{recording.name}.csv")
    return result, rehearsal
