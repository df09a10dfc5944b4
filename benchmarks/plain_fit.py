"""Whether a diagnosis leaves less of real logs than a structure that one would try anyway.

    python -m benchmarks plain_fit --out plain            # all logs, resumed
    python -m benchmarks plain_fit --quick                # the plain fit, mujoco.sysid and PACE
    python -m benchmarks.plain_fit --out plain --log go2_leg --method plain --method gap.diagnose

The rivals, on the same split and in the same run: the plain fit of `gap.fit` (armature, damping,
dry friction, the gains of each joint, one delay), `mujoco.sysid` with three of these and with all
but the delay, PACE's set and BAM's M1 to M6; see `rivals.methods`. A diagnosis should never leave
more than 1.02 times what the best of them leaves.

With `--out` what each method reached is added to `plain_fit.jsonl`, with its commit, and is not run
again; a structure that another one is more of may be, since that starts from it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Collection, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import Row
from benchmarks.plants.best import commit
from benchmarks.rivals.logs import LOGS, RealLog
from benchmarks.rivals.methods import DIAGNOSIS, GIVEN, METHODS, PLAIN, RIVALS, Reached, methods
from benchmarks.rivals.structures import NESTED

FILE = "plain_fit.jsonl"
MOST = 1.02
"""Of what the best rival leaves, what a diagnosis may leave."""
_QUICK = (GIVEN, PLAIN, "mujoco.sysid", "PACE")
_COMPARED = (GIVEN, *RIVALS, DIAGNOSIS)


def run(*, quick: bool, out: Path | None = None) -> list[Row]:
    """All methods on all logs, or the fast ones."""
    chosen = _QUICK if quick else _COMPARED
    return [row for log in LOGS for row in rows(log, list(reached(log, chosen, out)))]


def reached(log: RealLog, chosen: Collection[str], out: Path | None) -> Iterator[Reached]:
    """What methods reach on a log, and a line for each; nothing where the log is not there.

    Args:
        log: the log.
        chosen: names of the methods.
        out: folder of what is known already; None for none.
    """
    commit()  # before anything is run, while files change
    file = None if out is None else out / FILE
    known = _known(file, log.name)
    yield from (one for name, one in known.items() if name in chosen)
    left = [name for name in chosen if name not in known]
    if not left:
        return
    try:
        problem = log.load()
    except FileNotFoundError as missing:
        print(missing, flush=True)
        return
    for one in methods(log, problem, _with_nested(left)):
        print(
            f"{log.name}: {one.method:20} {log.said(one.figure)}, {one.seconds:.0f} s", flush=True
        )
        if one.method not in left:
            continue
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            with file.open("a", encoding="utf-8") as kept:
                told = {"log": log.name, "commit": commit(), **asdict(one)}
                kept.write(json.dumps(told, ensure_ascii=False) + "\n")
        yield one


def rows(log: RealLog, every: Collection[Reached]) -> list[Row]:
    """The rows of a log: every method, and the diagnosis against the best of the rivals."""
    found = [
        Row(
            what=f"{log.name}: {one.method}",
            result=log.said(one.figure),
            reference=f"{one.parameters} parameters, {one.seconds:.0f} s"
            + (f"; {one.note}" if one.note else ""),
        )
        for one in every
    ]
    rivals = [one for one in every if one.method in RIVALS]
    diagnosed = [one for one in every if one.method == DIAGNOSIS]
    if rivals and diagnosed:
        best = min(rivals, key=_size)
        found.append(
            Row(
                what=f"{log.name}: the diagnosis over the best",
                result=f"{_size(diagnosed[0]) / _size(best):.3f}",
                reference=best.method,
                required=f"<= {MOST}",
            )
        )
    return found


def _size(one: Reached) -> float:
    """Root-mean-square over the figure's numbers, but for a factor."""
    return float(np.linalg.norm(one.figure))


def _known(file: Path | None, log: str) -> dict[str, Reached]:
    if file is None or not file.exists():
        return {}
    found = {}
    for text in file.read_text(encoding="utf-8").splitlines():
        told = json.loads(text)
        if told.pop("log") == log:
            told.pop("commit")
            found[told["method"]] = Reached(**{**told, "figure": tuple(told["figure"])})
    return found


def _with_nested(names: Collection[str]) -> list[str]:
    """The methods, and those that they start from."""
    wanted = set(names)
    while more := {other for name in wanted for other in NESTED.get(name, ())} - wanted:
        wanted |= more
    return [name for name in METHODS if name in wanted]


def main() -> None:
    """Runs what the command line asks for and prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.plain_fit")
    names = [log.name for log in LOGS]
    parser.add_argument("--log", choices=names, action="append", help="one or more; else all")
    parser.add_argument("--method", choices=_COMPARED, action="append", help="else all")
    parser.add_argument("--out", type=Path, metavar="DIR", help="kept there, and resumed from")
    asked = parser.parse_args()
    table = Table("what", "measured", "reference", "required")
    for log in LOGS:
        if log.name in (asked.log or names):
            for row in rows(log, list(reached(log, asked.method or _COMPARED, asked.out))):
                table.add_row(row.what, row.result, row.reference, row.required)
    Console().print(table)


if __name__ == "__main__":
    main()
