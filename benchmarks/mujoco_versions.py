"""Whether older MuJoCos read mended models, as `actuators.json` says of them.

Every effect of the catalogue is put on a leg of two joints; its model.xml is then read by each
release in an environment of its own.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from benchmarks import Row
from benchmarks.trainers.environments import python_with, run_in
from benchmarks.trainers.legs import leg_with, mended_with
from walkerkit.gap.deliver.written import write_mended
from walkerkit.gap.effects import CATALOGUE

VERSIONS = ("3.3.7", "3.5.0", "3.7.0", "3.8.1", "3.12.0", "3.17.0")


def run(*, quick: bool) -> list[Row]:
    """A row for each version: how many models it reads, and how many were said to be too new."""
    with tempfile.TemporaryDirectory() as made:
        needs: dict[str, str] = {}
        for name in CATALOGUE:
            robot = leg_with(name, Path(made) / name / "leg.xml")
            path = Path(made) / name / "model.xml"
            written = write_mended(robot, mended_with(robot, name), path)
            needs[str(path)] = max(written.needs.values(), key=_number, default="0")
        rows = []
        for version in VERSIONS[::3] if quick else VERSIONS:
            said = run_in(python_with(f"mujoco=={version}"), "loads.py", *needs)
            read = {path: not error for path, error in map(json.loads, said.splitlines())}
            told = {path: _number(need) <= _number(version) for path, need in needs.items()}
            wrong = [Path(path).parent.name for path in needs if read[path] != told[path]]
            print(version, sum(read.values()), "read;", "told otherwise:", wrong or "none")
            rows.append(
                Row(
                    what=f"mended models read by MuJoCo {version}",
                    result=f"{sum(read.values())} of {len(needs)}",
                    reference=f"{sum(told.values())} said to be",
                    required="as said",
                )
            )
    return rows


def _number(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")[:2]))
