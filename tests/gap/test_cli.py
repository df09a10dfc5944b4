"""The program as a user meets it: exit statuses, one-line refusals, what is printed and written."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from walkerkit.gap import cli, workflow
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.hidden import HIDEABLE
from walkerkit.gap.recording import Recording

ACTUATOR = '<position name="knee" joint="knee" kp="30" kv="1" forcerange="-20 20"/>'
SERVO = f"""
<mujoco model="servo">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="knee" axis="0 1 0" armature="0.005" damping="0.1" range="-2 2" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
    </body>
  </worldbody>
  <actuator>{ACTUATOR}</actuator>
</mujoco>
"""
LEG = SERVO.replace(
    "</body>",
    """<body name="shin" pos="0 0 -0.25">
        <joint name="ankle" axis="0 1 0" armature="0.005" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
      </body></body>""",
).replace("</actuator>", '<position joint="ankle" kp="20" kv="0.5"/></actuator>')
ROOM = SERVO.replace(  # a second joint that the first does not feel
    "</worldbody>",
    """<body name="turret" pos="1 0 0">
        <joint name="yaw" axis="0 0 1" armature="0.005" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.6"/>
      </body></worldbody>""",
).replace("</actuator>", '<position joint="yaw" kp="30" kv="1"/></actuator>')
RATE = 250.0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a run ended."""

    status: int
    out: str
    err: str


Run = Callable[..., Outcome]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs the program in this process; an exception that leaves it fails the test."""
    monkeypatch.setenv("COLUMNS", "100")

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["walkerkit", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        captured = capsys.readouterr()
        return Outcome(
            status=int(ended.value.code or 0),
            out=captured.out,
            err=captured.err,
        )

    return run


@pytest.fixture
def folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Path]:  # modules of the folder are forgotten again
    """The working directory, with a model and three good recordings."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    known = set(sys.modules)
    (tmp_path / "servo.xml").write_text(SERVO)
    for name in ("a", "b", "c"):
        log(tmp_path / f"{name}.csv", samples=200)
    yield tmp_path
    for name in set(sys.modules) - known:
        if not name.startswith(("walkerkit", "numpy", "scipy", "pandas", "plotly", "rich")):
            sys.modules.pop(name)


def log(
    path: Path, samples: int = 300, rate: float = RATE, **changes: ArrayLike | None
) -> Path:
    """A recording of the knee behind its target; `knee__effort=...` adds a column, None drops one."""
    time = np.arange(samples) / rate
    random = np.random.default_rng(len(path.name))
    columns: dict[str, Any] = {
        "time": time,
        "knee/position_target": 0.3 * np.sin(3 * time),
        "knee/position": 0.3 * np.sin(3 * time - 0.05) + 1e-4 * random.standard_normal(samples),
    }
    columns |= {name.replace("__", "/"): values for name, values in changes.items()}
    kept = {k: np.broadcast_to(v, samples) for k, v in columns.items() if v is not None}
    lines = [",".join(kept), *(",".join(map(repr, map(float, row))) for row in zip(*kept.values(), strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def ankle(samples: int = 300) -> dict[str, ArrayLike]:
    time = np.arange(samples) / RATE
    return {"ankle__position_target": 0.2 * np.sin(4 * time), "ankle__position": 0.2 * np.sin(4 * time - 0.05)}


def at(samples: int, row: int, value: float) -> ArrayLike:
    """Zeros but for one row."""
    values = np.zeros(samples)
    values[row] = value
    return values


def refused(outcome: Outcome, *parts: str) -> None:
    """Exit status 2, nothing on standard output, and one line that has the parts."""
    assert outcome.status == 2, outcome
    assert outcome.out == ""
    assert len(outcome.err.splitlines()) == 1, outcome.err
    assert outcome.err.startswith("walkerkit: ")
    assert outcome.err.endswith((".\n", "?\n"))
    for part in parts:
        assert part in outcome.err


# The recordings

BACKWARDS = np.arange(300) / RATE
BACKWARDS[100] = BACKWARDS[98]
PAUSE = np.arange(300) / RATE + np.repeat([0.0, 5.0], 150)
BAD_LOGS: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "missing": (lambda path: None, ("no such file", "did you mean", "Check the path")),
    "empty": (lambda path: path.write_text(""), ("the file is empty", "Write it again")),
    "header only": (
        lambda path: path.write_text("time,knee/position,knee/position_target\n"),
        ("no rows of data",),
    ),
    "one row": (
        lambda path: path.write_text("time,knee/position,knee/position_target\n0,0,0\n"),
        ("too few rows of data (1)",),
    ),
    "3 samples": (lambda path: log(path, 3), ("3 samples", "at least 20", "Record for longer")),
    "no time": (
        lambda path: path.write_text("t,knee/position,knee/position_target\n0,0,0\n1,0,0\n"),
        ("no column 'time'", "did you mean 't'"),
    ),
    "backwards": (
        lambda path: log(path, time=BACKWARDS),
        ("'time' goes backwards", "row 101", "Sort the rows"),
    ),
    "pause": (lambda path: log(path, time=PAUSE), ("'time'", "pause of 5.004 s", "Cut the file")),
    "nan": (
        lambda path: log(path, knee__position=at(300, 7, np.nan)),
        ("'knee/position'", "NaN", "row 8 (line 9)", "Delete such rows"),
    ),
    "infinite target": (
        lambda path: log(path, knee__position_target=at(300, 0, np.inf)),
        ("'knee/position_target'", "row 1"),
    ),
    "text": (
        lambda path: path.write_text("time,knee/position,knee/position_target\n0,0,a\n1,0,b\n"),
        ("'knee/position_target'", "'a'", "row 1"),
    ),
    "degrees": (
        lambda path: log(path, knee__position=at(300, 30, 51.0)),
        ("'knee/position' has 51 at row 31", "degrees", "numpy.deg2rad"),
    ),
    "milliseconds": (
        lambda path: log(path, time=np.arange(300) * 4.0),
        ("'time'", "looks like milliseconds", "Divide it by 1e3"),
    ),
    "slower than 5 Hz": (lambda path: log(path, 300, rate=4.0), ("'time'", "0.25 s")),
    "no target": (
        lambda path: log(path, knee__position_target=None),
        ("no joint has a target", "knee/position_target"),
    ),
    "no position": (
        lambda path: log(path, knee__position=None),
        ("'knee'", "no position", "knee/position"),
    ),
    "velocity target": (
        lambda path: log(path, knee__position_target=None, knee__velocity_target=0.0),
        ("'knee'", "servo.xml", "`knee/position_target`", "Log that target"),
    ),
    "effort target": (
        lambda path: log(path, knee__position_target=None, knee__effort_target=0.0),
        ("'knee'", "servo.xml", "`knee/position_target`", "Log that target"),
    ),
    "unknown joint": (
        lambda path: log(path, hip__position=0.0),
        ("joint 'hip'", "servo.xml", "knee", "Rename the columns"),
    ),
    "misspelt joint": (
        lambda path: log(path, kne__position=0.0, kne__position_target=0.0),
        ("joint 'kne'", "did you mean 'knee'?"),
    ),
    "nothing moves": (lambda path: log(path, knee__position=0.1), ("no joint moves", "Record a motion")),
    "all zero": (
        lambda path: log(path, knee__position=0.0, knee__position_target=0.0, knee__effort=0.0),
        ("no joint moves",),
    ),
    "no recording": (lambda path: path.with_suffix(".csv").write_bytes(bytes(range(256))), ()),
}


@pytest.mark.parametrize("case", BAD_LOGS)
def test_bad_recordings_are_refused(run: Run, folder: Path, case: str) -> None:
    write, parts = BAD_LOGS[case]
    write(folder / "bad.csv")
    refused(run("compare", "servo.xml", "a.csv" if case == "missing" else "bad.csv", "bad.csv") if case == "missing" else run("compare", "servo.xml", "bad.csv"), "bad.csv", *parts)


def test_other_files_than_recordings_are_refused(run: Run, folder: Path) -> None:
    refused(run("compare", "servo.xml", "servo.xml"), "servo.xml", "'.xml'", ".csv, .parquet, .npz")
    refused(run("compare", "a.csv", "servo.xml"), "a.csv", "the model first")
    refused(run("compare", "servo.xml", folder), "this is a folder")
    refused(run("compare", "servo.xml"), "servo.xml", "no recording")
    refused(run("compare", "servo.xml", "a.csv", "a.csv"), "a.csv", "listed 2 times")
    refused(run("compare", "servo.xml", "--held-out", "a.csv"), "servo.xml", "held out")
    refused(run("compare", "servo.xml", "a.csv", "--held-out", "z"), "z", "none of the recordings")
