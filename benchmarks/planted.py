"""Known errors planted beside real logs whose best model was found before.

    python -m benchmarks planted --out planted             # all of draw 0, resumed
    python -m benchmarks.planted --out planted --log go2_leg --jobs 2
    python -m benchmarks.planted --out planted --only go2_leg-payload --draw 3

The best model of a log (`plants.best`) is fitted once and kept in the folder, and an error is put
into it, or into the log: see `plants.kinds`. Where that raises the held-out gap by a fifth or more,
the diagnosis is asked what is wrong. Every plant is of one of two halves: what a decision is fitted
on, and what it is told on. `--draw N` has other places and sizes.

Each outcome is added to `planted.jsonl` as it comes, with its commit and seconds; cases that are in
the file are not run again. Without `--out` nothing is kept. `WALKERKIT_DATA` says where the logs
are; those that are not there are left out.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import Row
from benchmarks.plants.best import best_model
from benchmarks.plants.cases import PLANTS, PlantedCase, cases
from benchmarks.plants.outcome import FILE, PlantedOutcome, kept
from benchmarks.plants.running import Job, run_case
from benchmarks.plants.table import line, rows
from walkerkit.gap.fleet import engine as engines

BEST = "best"
QUICK = ("go2_leg-gain_0.5", "go2_leg-payload", "emps-coulomb_friction")
"""Cases that fit in a few minutes."""


def run(*, quick: bool, out: Path | None = None) -> list[Row]:
    """Runs every case of draw 0, or a few."""
    chosen = [case for case in cases() if not quick or case.name in QUICK]
    return rows(list(outcomes(chosen, out=out)))


def outcomes(
    chosen: Sequence[PlantedCase], *, out: Path | None = None, jobs: int | None = None
) -> Iterator[PlantedOutcome]:
    """Runs cases side by side and prints a line for each.

    Args:
        chosen: the cases.
        out: folder of best models and of outcomes; what it has already is not run again.
        jobs: cases at a time, by default as many as there are cores.

    Yields:
        What is in the folder, then the others as they come.
    """
    if out is None:
        with tempfile.TemporaryDirectory() as folder:
            yield from outcomes(chosen, out=Path(folder), jobs=jobs)
        return
    out.mkdir(parents=True, exist_ok=True)
    file = out / FILE
    known = {one.case: one for one in kept(file)} if file.exists() else {}
    yield from (known[case.name] for case in chosen if case.name in known)
    left = _with_logs([case for case in chosen if case.name not in known], out / BEST)
    asked = [Job(case=case, best=out / BEST) for case in left]
    for done in engines.run(run_case, asked, workers=jobs):
        if done.failure is not None:
            raise RuntimeError(f"{left[done.index].name}: {done.failure.message}")
        print(line(done.value), flush=True)
        with file.open("a", encoding="utf-8") as lines:
            lines.write(done.value.to_json() + "\n")
        yield done.value


def _with_logs(chosen: Sequence[PlantedCase], folder: Path) -> list[PlantedCase]:
    """The cases whose logs are there, with their best models fitted: once, before all else."""
    missing = set()
    for log in dict.fromkeys(case.log for case in chosen):
        try:
            best = best_model(log, folder)
        except FileNotFoundError as absent:
            print(absent, flush=True)
            missing.add(log)
            continue
        told = ", ".join(f"{signal} {size:.4g}" for signal, size in best.gaps.items())
        print(f"{log}: its best model leaves {told} ({best.commit})", flush=True)
    return [case for case in chosen if case.log not in missing]


def main() -> None:
    """Runs what the command line asks for and prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.planted")
    parser.add_argument("--log", choices=PLANTS, action="append", help="one or more; else all")
    parser.add_argument("--draw", type=int, default=0, metavar="N", help="other places and sizes")
    parser.add_argument("--only", metavar="NAME", action="append", help="cases by log and kind")
    parser.add_argument("--cases", type=int, metavar="N", help="the first ones, logs in turns")
    parser.add_argument("--out", type=Path, metavar="DIR", help="kept there, and resumed from")
    parser.add_argument("--jobs", type=int, metavar="N", help="cases at a time")
    asked = parser.parse_args()
    if asked.draw < 0:
        parser.error(f"--draw is {asked.draw}; draws count from 0")
    chosen = cases(*(asked.log or ()), draw=asked.draw)
    names = [f"{case.log}-{case.kind}" for case in chosen]
    for name in asked.only or ():
        if name not in names:
            parser.error(f"no case is called {name!r}; there are {', '.join(names)}")
    if asked.only:
        chosen = [c for c, name in zip(chosen, names, strict=True) if name in asked.only]
    table = Table("what", "measured", "required")
    for row in rows(list(outcomes(chosen[: asked.cases], out=asked.out, jobs=asked.jobs))):
        table.add_row(row.what, row.result, row.required)
    Console().print(table)


if __name__ == "__main__":
    main()
