"""Fuzzing: ten thousand inputs of every kind, each ending with a result or a refusal in one line.

    python -m benchmarks fuzz                         # all of them
    python -m benchmarks.fuzz mjcf 2000 --seed 1      # some of one kind

Each kind runs in processes of its own, so that a crash of a library is seen, and counts. Cases are
the same in every run.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from benchmarks import Row
from benchmarks.fuzzing.case import Case, outcome
from benchmarks.fuzzing.files import MANIFESTS, RECORDINGS, WEIGHTS
from benchmarks.fuzzing.models import COMMANDS, COMPARISONS, DIAGNOSES, MODELS, SIDECARS

CASES: Mapping[str, tuple[st.SearchStrategy[Case], int]] = {
    "recordings": (RECORDINGS, 3900),
    "manifests": (MANIFESTS, 1200),
    "weights": (WEIGHTS, 1200),
    "mjcf": (MODELS, 2000),
    "actuators_json": (SIDECARS, 900),
    "command_lines": (COMMANDS, 500),
    "compared_logs": (COMPARISONS, 200),
    "diagnosed_logs": (DIAGNOSES, 100),
}
"""Kind to the strategy that draws its cases, and how many of them the benchmark tries."""

_QUICK = 40  # times fewer
_SLICE = 500  # cases of one process
_SHOWN = 5


def run(*, quick: bool) -> list[Row]:
    """Tries all kinds."""
    rows = []
    for kind, (_, wanted) in CASES.items():
        count = wanted // _QUICK if quick else wanted
        broken, start = 0, time.perf_counter()
        for number in range(0, count, _SLICE):
            done = subprocess.run(
                [
                    *(sys.executable, "-m", "benchmarks.fuzz", kind),
                    *(str(min(_SLICE, count - number)), "--seed", str(number // _SLICE)),
                ],
                capture_output=True,
                text=True,
                check=False,
            )
            print(done.stdout, end="", flush=True)
            if done.returncode not in (0, 1):
                broken += 1
                print(f"{kind}: the process ended with {done.returncode}: {done.stderr[-2000:]}")
            broken += sum(line.startswith("BROKEN") for line in done.stdout.splitlines())
        print(f"{kind}: {count} cases, {broken} broken, {time.perf_counter() - start:.0f} s")
        rows.append(Row(what=kind, result=f"{broken} broken", reference=f"of {count}"))
    return rows


def broken_cases(kind: str, count: int, number: int, folder: Path) -> list[tuple[Case, str]]:
    """Tries some cases of a kind.

    Args:
        kind: one of `CASES`.
        count: how many.
        number: of the slice; the same number makes the same cases.
        folder: to work in.

    Returns:
        Those that ended otherwise than they may, with what was wrong.
    """
    found: list[tuple[Case, str]] = []
    strategy, _ = CASES[kind]

    @seed(number)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(case=strategy)
    def every(case: Case) -> None:
        wrong = outcome(case, folder)
        if wrong is not None:
            found.append((case, wrong))

    every()
    return found


def main() -> None:
    """Tries some cases of one kind, and shows what is broken."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("kind", choices=list(CASES))
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        broken = broken_cases(chosen.kind, chosen.count, chosen.seed, Path(folder))
    seen: set[str] = set()
    for case, wrong in broken:
        print("BROKEN", repr(wrong[-300:]))
        if wrong[-80:] not in seen and len(seen) < _SHOWN:
            seen.add(wrong[-80:])
            print(wrong, {name: content[:600] for name, content in case.files.items()})
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    os.environ.setdefault("MUJOCO_GL", "disable")
    main()
