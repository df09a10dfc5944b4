"""Robot files as other people have them: walkers, own logs, rehearsals.

    python -m benchmarks robot_files [--quick] [--out FOLDER]
    python -m benchmarks.robot_files --only ant.xml --out FOLDER

Files of the packages `gymnasium` and `dm_control`, and files written for it (`robots/written.py`).
Of each: it is a walker with its own actuators and with each config of ours that fits, 500 physics
steps come out the same twice, its own log leaves no gap, and an effect hidden in its rehearsal is
named among five; or one sentence says why not. Nothing ends in a traceback. Outcomes are added to
`robot_files.jsonl` in the folder as they come, and files that are there are not run again.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import dm_control
import gymnasium
from rich.console import Console
from rich.table import Table

from benchmarks import Row
from benchmarks.robots.checks import Outcome, check, written_file
from benchmarks.robots.written import WRITTEN

_GYMNASIUM = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
_SUITE = Path(dm_control.__file__).parent / "suite"
_LOCOMOTION = Path(dm_control.__file__).parent / "locomotion" / "walkers" / "assets"
FILES: Mapping[str, Path] = {
    **{
        f"{name}.xml": _GYMNASIUM / f"{name}.xml"
        for name in (
            *("ant", "half_cheetah", "hopper", "inverted_double_pendulum", "inverted_pendulum"),
            *("point", "pusher", "reacher", "swimmer", "walker2d", "humanoid"),
        )
    },
    **{
        f"suite/{name}.xml": _SUITE / f"{name}.xml"
        for name in (
            *("acrobot", "ball_in_cup", "cartpole", "cheetah", "finger", "fish", "hopper"),
            *("manipulator", "pendulum", "point_mass", "quadruped", "reacher", "walker"),
        )
    },
    **{
        f"locomotion/{name.rpartition('/')[2]}": _LOCOMOTION / name
        for name in (
            "humanoid_CMU_V2020.xml",
            "jumping_ball/jumping_ball_with_head.xml",
            "rodent.xml",
        )
    },
}
QUICK = ("reacher.xml", "suite/manipulator.xml", "pair", "gripper_on_a_tendon", "four_bar")


def run(*, quick: bool, out: Path | None = None) -> list[Row]:
    """Checks every file, or a few."""
    names = [name for name in (*WRITTEN, *FILES) if not quick or name in QUICK]
    return rows(list(outcomes(names, out)))


def outcomes(names: Sequence[str], out: Path | None) -> Iterator[Outcome]:
    """Checks files one by one, and prints a line for each.

    Args:
        names: of `FILES` and `WRITTEN`.
        out: folder of the file of outcomes, or None to keep none.
    """
    folder = Path(tempfile.mkdtemp(prefix="robot_files_")) if out is None else out
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "robot_files.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    known = {outcome.file: outcome for outcome in map(Outcome.from_json, lines)}
    for name in names:
        if name not in known:
            path = FILES.get(name) or written_file(name, WRITTEN[name])
            known[name] = check(name, path)
            with file.open("a", encoding="utf-8") as lines_of:
                lines_of.write(known[name].to_json() + "\n")
        outcome = known[name]
        print(
            f"{name}: walkers {len(outcome.walkers)}/{outcome.tried}, the same twice "
            f"{len(outcome.repeats)}, own log {outcome.own}, found {outcome.found}",
            flush=True,
        )
        for one in (*outcome.refused, *outcome.tracebacks):
            print(f"    {one}", flush=True)
        yield outcome


def rows(found: Sequence[Outcome]) -> list[Row]:
    """What the table says."""
    walkers = sum(len(one.walkers) for one in found)
    tried = sum(one.tried for one in found)
    refused = sum(len(one.refused) for one in found)
    own = [one.own.startswith(("no_gap", "refused")) for one in found]
    named = [
        one.hidden in one.found.split(", ") or one.found.startswith("refused") for one in found
    ]
    same = sum(len(one.repeats) for one in found)
    broken = sum(len(one.tracebacks) for one in found)

    def row(what: str, result: object, reference: object, required: str = "all") -> Row:
        return Row(what=what, result=str(result), reference=str(reference), required=required)

    return [
        row("files", len(found), "", "20"),
        row("are walkers, or one sentence", f"{walkers} + {refused}", tried),
        row("500 steps twice, to the same bits", same, walkers),
        row("own log leaves no gap, or one sentence", sum(own), len(own)),
        row("what is hidden is named, or one sentence", sum(named), len(named)),
        row("tracebacks", broken, "", "0"),
    ]


def main() -> None:
    """Checks what the command line asks for and prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.robot_files")
    parser.add_argument("--only", metavar="NAME", action="append", help="files by name")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="of robot_files.jsonl")
    asked = parser.parse_args()
    table = Table("what", "measured", "of", "required")
    for row in rows(list(outcomes(asked.only or [*WRITTEN, *FILES], asked.out))):
        table.add_row(row.what, row.result, row.reference, row.required)
    Console().print(table)


if __name__ == "__main__":
    main()
