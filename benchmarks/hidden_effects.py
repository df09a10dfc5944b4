"""Effects hidden in simulated hardware that shares no law with the workflow, and found again.

    python -m benchmarks hidden_effects [--quick]
    python -m benchmarks.hidden_effects --tier one_effect --cases 40 --out one_effect.jsonl

Tiers, cases and seeds are frozen; see `benchmarks.hidden.cases`. The workflow was written with
them in view: `--draw 1`, 2, … has as many others, of robots with other numbers, logged at other
rates. With `--out` each outcome is added to a file as it comes, and cases that are in the file
already are not run again: a long run can be stopped, resumed, and split by tier. Cases run on one
thread each, in processes of this machine or, with `--engine` and `--address`, on a Ray or Dask
cluster whose machines have this checkout.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import Row
from benchmarks.hidden.cases import TIERS, Case, cases
from benchmarks.hidden.outcome import Outcome
from benchmarks.hidden.running import run_case, without_answer
from benchmarks.hidden.table import line, rows
from walkerkit.gap.fleet import engine as engines

__all__ = ["run", "run_case"]

QUICK = {"one_effect": 4, "one_effect_q_qd": 2, "two_effects": 1, "nothing": 3, "outside": 2}
"""Cases of each tier that fit in five minutes on two cores."""


def run(*, quick: bool) -> list[Row]:
    """Runs every tier, or a few cases of some."""
    chosen = QUICK if quick else dict.fromkeys(TIERS)
    every = [case for tier, count in chosen.items() for case in cases(tier, count)]
    return rows(list(outcomes(every)))


def outcomes(
    chosen: Sequence[Case],
    *,
    out: Path | None = None,
    jobs: int | None = None,
    engine: str = engines.PROCESSES,
    address: str | None = None,
) -> Iterator[Outcome]:
    """Runs cases side by side and prints a line for each.

    Args:
        chosen: the cases.
        out: file of JSON lines to add to; what it has already is not run again.
        jobs: cases at a time, by default as many as there are cores.
        engine: what runs them; see `walkerkit.gap.fleet.engine`.
        address: of a cluster that runs already.

    Yields:
        What is in the file, then the others as they come.
    """
    known: dict[str, Outcome] = {}
    if out is not None and out.exists():
        for text in out.read_text().splitlines():
            outcome = Outcome.from_json(text)
            known[outcome.case] = outcome
    left = [case for case in chosen if case.name not in known]
    yield from (known[case.name] for case in chosen if case.name in known)
    for done in engines.run(run_case, left, engine=engine, address=address, workers=jobs):
        if done.failure is not None:
            outcome = without_answer(left[done.index], "failed", done.failure.message)
        else:
            outcome = done.value
        print(line(outcome), flush=True)
        if out is not None:
            with out.open("a") as file:
                file.write(outcome.to_json() + "\n")
        yield outcome


def main() -> None:
    """Runs what the command line asks for and prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden_effects")
    parser.add_argument("--tier", choices=TIERS, action="append", help="one or more; else all")
    parser.add_argument("--cases", type=int, metavar="N", help="of each tier, spread over all")
    parser.add_argument("--draw", type=int, default=0, metavar="N", help="other cases and robots")
    parser.add_argument("--only", metavar="NAME", action="append", help="cases by name")
    parser.add_argument("--out", type=Path, metavar="FILE", help="JSON lines; resumed from")
    parser.add_argument("--jobs", type=int, metavar="N", help="cases at a time")
    parser.add_argument("--engine", choices=engines.ENGINES, default=engines.PROCESSES)
    parser.add_argument("--address", help="of a Ray or Dask cluster that runs")
    asked = parser.parse_args()
    if asked.draw < 0:
        parser.error(f"--draw is {asked.draw}; draws count from 0")
    count = None if asked.only else asked.cases
    chosen = [c for tier in asked.tier or TIERS for c in cases(tier, count, draw=asked.draw)]
    names = [case.name for case in chosen]
    for name in asked.only or ():
        if name not in names:
            parser.error(f"no case is called {name}; the first is called {names[0]}")
    if asked.only:
        chosen = [case for case in chosen if case.name in asked.only]
    table = Table("what", "result", "required")
    options = {"jobs": asked.jobs, "engine": asked.engine, "address": asked.address}
    for row in rows(list(outcomes(chosen, out=asked.out, **options))):
        table.add_row(row.what, row.result, row.reference)
    Console().print(table)


if __name__ == "__main__":
    main()
