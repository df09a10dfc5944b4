"""The program as a user meets it: exit statuses, one-line refusals, what is printed and written."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from rich.cells import cell_len

from tests.gap.progress import without_progress
from walkerkit.gap import cli, workflow
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hidden import HIDEABLE

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
            err=without_progress(captured.err),
        )

    return run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a model and three good recordings."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "servo.xml").write_text(SERVO)
    for name in ("a", "b", "c"):
        log(tmp_path / f"{name}.csv", samples=200)
    return tmp_path


def log(path: Path, samples: int = 300, rate: float = RATE, **changes: ArrayLike | None) -> Path:
    """A recording of the knee behind its target.

    `knee__effort=...` adds the column `knee/effort` or changes it; None drops it.
    """
    time = np.arange(samples) / rate
    random = np.random.default_rng(len(path.name))
    columns: dict[str, Any] = {
        "time": time,
        "knee/position_target": 0.3 * np.sin(3 * time),
        "knee/position": 0.3 * np.sin(3 * time - 0.05) + 1e-4 * random.standard_normal(samples),
    }
    columns |= {name.replace("__", "/"): values for name, values in changes.items()}
    kept = {name: np.broadcast_to(v, samples) for name, v in columns.items() if v is not None}
    rows = np.stack(list(kept.values()), axis=1).tolist()
    text = [",".join(kept), *(",".join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return path


def ankle(samples: int = 300) -> dict[str, ArrayLike]:
    time = np.arange(samples) / RATE
    return {
        "ankle__position_target": 0.2 * np.sin(4 * time),
        "ankle__position": 0.2 * np.sin(4 * time - 0.05),
    }


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
        # Beside an effort: a row without any measurement is that of a target alone.
        lambda path: log(path, knee__position=at(300, 7, np.nan), knee__effort=0.1),
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
    "degrees within 50": (
        lambda path: log(
            path,
            knee__position=39.0 * np.sin(np.arange(300) / 50),
            knee__position_target=35.0 * np.sin(np.arange(300) / 50 + 0.1),
        ),
        ("'knee/position' reaches 39", "servo.xml ends at 2 rad", "degrees", "numpy.deg2rad"),
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
    "repeated command": (
        lambda path: log(path, knee__position=0.3 * np.sin(3 * (np.arange(300) / RATE))),
        ("'knee/position' is 'knee/position_target' to the bit", "Log what was measured"),
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
    "nothing moves": (
        lambda path: log(path, knee__position=0.1),
        ("no joint moves", "Record a motion"),
    ),
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
    refused(run("compare", "servo.xml", "bad.csv"), "bad.csv", *parts)


def test_a_bad_recording_among_good_ones_is_named(run: Run, folder: Path) -> None:
    log(folder / "bad.csv", time=BACKWARDS)
    refused(run("diagnose", "servo.xml", "a.csv", "bad.csv", "c.csv", "--out", "o"), "bad.csv")
    assert not (folder / "o").exists()


def test_recordings_given_wrongly_are_refused(run: Run, folder: Path) -> None:
    refused(run("compare", "servo.xml", "servo.xml"), "servo.xml", "'.xml'", ".csv, .parquet, .npz")
    refused(run("compare", "a.csv", "servo.xml"), "a.csv", "the model first")
    refused(run("compare", "servo.xml", folder), "this is a folder")
    refused(run("compare", "servo.xml"), "servo.xml", "no recording")
    refused(run("compare", "servo.xml", "a.csv", "a.csv"), "a.csv", "listed 2 times")
    refused(run("compare", "servo.xml", "--held-out", "a.csv"), "servo.xml", "held out")
    refused(run("compare", "servo.xml", "a.csv", "--held-out", "z"), "z", "none of the recordings")


def test_a_column_in_the_held_out_half_alone_is_refused(run: Run, folder: Path) -> None:
    log(folder / "effort.csv", knee__effort=np.sin(np.arange(300)))
    outcome = run("compare", "servo.xml", "a.csv", "--held-out", "effort.csv")
    refused(outcome, "'knee/effort'", "not in both", "Hold out others")
    outcome = run("compare", "servo.xml", "effort.csv", "--held-out", "a.csv")
    refused(outcome, "'knee/effort'", "not in both")


# The model


BAD_MODELS: dict[str, tuple[str | None, tuple[str, ...]]] = {
    "missing": (None, ("no such file", "Check the path")),
    "empty": ("", ("the file is empty",)),
    "no XML": ("hello", ("does not compile", "Mend the MJCF")),
    "unclosed": ("<mujoco><worldbody>", ("does not compile", "line 1", "Mend the MJCF")),
    "unknown attribute": (
        SERVO.replace("kp=", 'kq="1" kp='),
        ("does not compile", "unrecognized attribute: 'kq'", "line 11", "Mend the MJCF"),
    ),
    "unknown element": (SERVO.replace("<geom", "<geon"), ("does not compile", "'geon'")),
    "missing mesh": (
        SERVO.replace("<worldbody>", '<asset><mesh name="m" file="no.stl"/></asset><worldbody>'),
        ("does not compile", "no.stl"),
    ),
    "no mass": (
        SERVO.replace('mass="0.6"', 'mass="0"').replace('armature="0.005"', ""),
        ("does not compile", "mass"),
    ),
    "no joints": ("<mujoco/>", ("no named hinge or slide joint", "Name its joints")),
    "unnamed joint": (
        SERVO.replace('<joint name="knee"', "<joint").replace(ACTUATOR, ""),
        ("no named hinge or slide joint",),
    ),
    "floating base": (
        SERVO.replace("<joint name=", '<freejoint/><geom size="1"/><body><joint name=').replace(
            "</body>", "</body></body>", 1
        ),
        ("a.csv", "floats", "'base/position_x'", "`walkerkit hang`"),
    ),
    "other joint": (SERVO.replace("knee", "elbow"), ("a.csv", "'knee'", "elbow")),
    "motor": (
        SERVO.replace(ACTUATOR, '<motor joint="knee"/>'),
        ("a.csv", "'knee'", "actuator for effort", "`knee/effort_target`"),
    ),
    "velocity servo": (
        SERVO.replace(ACTUATOR, '<velocity joint="knee" kv="1"/>'),
        ("a.csv", "'knee'", "actuator for velocity", "`knee/velocity_target`"),
    ),
    "no actuator": (
        SERVO.replace(ACTUATOR, ""),
        ("a.csv", "`knee/position_target`", "no actuator", "Add a <position> actuator"),
    ),
}


@pytest.mark.parametrize("case", BAD_MODELS)
def test_bad_models_are_refused(run: Run, folder: Path, case: str) -> None:
    text, parts = BAD_MODELS[case]
    if text is not None:
        (folder / "bad.xml").write_text(text)
    refused(run("compare", "bad.xml", "a.csv"), "bad.xml", *parts)


def test_a_joint_without_its_target_is_refused(run: Run, folder: Path) -> None:
    (folder / "leg.xml").write_text(LEG)
    log(folder / "leg.csv", ankle__position=0.1)
    refused(run("compare", "leg.xml", "leg.csv"), "leg.csv", "'ankle'", "`ankle/position_target`")


CALLABLES = """
import pathlib

import mujoco

class Walker:
    @property
    def mjcf_model(self):
        raise ValueError("no legs")

def spec(): return mujoco.MjSpec.from_file("servo.xml")
def text(): return pathlib.Path("servo.xml").read_text()
def number(): return 3
def nothing(): return None
def words(): return "hello"
def wrong(): return "<mujoco><nope/></mujoco>"
def raises(): raise KeyError("knee")
def misspelt(): return nothing().legs
def needs(name): return name
def walker(): return Walker()
"""


@pytest.mark.parametrize(
    ("model", "parts"),
    [
        ("no_such_robots:leg", ("cannot import 'no_such_robots'",)),
        ("no.such.robots:leg", ("cannot import 'no.such.robots'",)),
        ("robots:lex", ("'lex'",)),
        ("robots:mujoco", ("'mujoco'",)),
        ("robots:number", ("returned a int", "Return a walker")),
        ("robots:nothing", ("returned a NoneType", "Return a walker")),
        ("robots:words", ()),
        ("robots:wrong", ("nope",)),
        ("robots:raises", ("KeyError", "knee")),
        ("robots:misspelt", ("legs",)),
        ("robots:needs", ("name",)),
        ("robots:walker", ("no legs",)),
        ("broken_robots:leg", ("broken_robots",)),
        ("missing_robots:leg", ("no_such_module",)),
        (":leg", ()),
    ],
)
def test_bad_callables_are_refused(
    run: Run, folder: Path, model: str, parts: tuple[str, ...]
) -> None:
    (folder / "robots.py").write_text(CALLABLES)
    (folder / "broken_robots.py").write_text("def leg(:")
    (folder / "missing_robots.py").write_text("import no_such_module")
    outcome = run("compare", model, "a.csv")
    sys.modules.pop("robots", None)
    refused(outcome, model, *parts)


@pytest.mark.parametrize("model", ["robots:spec", "robots:text"])
def test_callables_of_the_working_directory_are_models(run: Run, folder: Path, model: str) -> None:
    (folder / "robots.py").write_text(CALLABLES)
    by_callable = run("compare", model, "a.csv", "--json")
    sys.modules.pop("robots", None)
    assert by_callable.status == 0
    by_file = run("compare", "servo.xml", "a.csv", "--json")
    assert without_seconds(by_callable.out) == without_seconds(by_file.out)


def without_seconds(text: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(text)
    assert content.pop("seconds") > 0
    return content


# Manifests


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ("the file is empty",)),
        ("model = \n", ("not a TOML file", "line 1")),
        ("[experiment]", ("no [[experiment]]",)),
        ("[[experiment]]", ("experiment 1 has no model",)),
        ('[[experiment]]\nmodel = "servo.xml"', ("experiment 1 has no recordings",)),
        ('[[experiment]]\nmodel = "servo.xml"\nrecordings = ["z.csv"]', ("z.csv", "no such file")),
        ('[[experiment]]\nmodel = "z.xml"\nrecordings = ["a.csv"]', ("z.xml", "no such file")),
        (
            '[[experiment]]\nmodel = "servo.xml"\nrecordings = ["a.csv"]\nheldout = ["b.csv"]',
            ("'heldout'", "did you mean 'held_out'?"),
        ),
        (
            '[[experiment]]\nmodel = "servo.xml"\nheld_out = ["a.csv"]',
            ("all recordings are held out",),
        ),
    ],
)
def test_bad_manifests_are_refused(
    run: Run, folder: Path, text: str, parts: tuple[str, ...]
) -> None:
    (folder / "experiments.toml").write_text(text)
    refused(run("compare", "experiments.toml"), *parts)


@pytest.mark.parametrize("order", ["ab", "ba"])
def test_models_of_a_manifest_have_the_same_joints(run: Run, folder: Path, order: str) -> None:
    (folder / "elbow.xml").write_text(SERVO.replace('"knee"', '"elbow"'))
    text = (folder / "b.csv").read_text().replace("knee/", "elbow/")
    (folder / "e.csv").write_text(text)
    tables = {"a": ("servo.xml", "a.csv"), "b": ("elbow.xml", "e.csv")}
    (folder / "two.toml").write_text(
        "".join(
            '[[experiment]]\nmodel = "{}"\nrecordings = ["{}"]\n'.format(*tables[one])
            for one in order
        )
    )
    lacks, of = ("elbow", "servo") if order == "ab" else ("servo", "elbow")
    joint = "knee" if order == "ab" else "elbow"
    for command in ("compare", "diagnose"):
        says = f"{lacks}.xml: the model has no joint '{joint}'"
        refused(run(command, "two.toml"), says, f"recordings of {of}.xml", "diagnose-fleet")


def test_models_of_a_manifest_may_have_their_joints_in_another_order(
    run: Run, folder: Path
) -> None:
    motors = '<position joint="{}" kp="30" kv="1"/><position joint="{}" kp="30" kv="1"/>'
    link = '<joint name="{}" axis="0 1 0"/><geom size="0.05" pos="0 0 -0.2"/>'
    arm = f'<body pos="0 {{}} 0">{link}</body>'
    bodies = {"knee": arm.format(0, "knee"), "ankle": arm.format(1, "ankle")}
    tables = ""
    for first, second in (("knee", "ankle"), ("ankle", "knee")):
        world = f"<worldbody>{bodies[first]}{bodies[second]}</worldbody>"
        actuators = f"<actuator>{motors.format(first, second)}</actuator>"
        (folder / f"{first}.xml").write_text(f"<mujoco>{world}{actuators}</mujoco>")
        log(folder / f"{first}.csv", **ankle())
        tables += f'[[experiment]]\nmodel = "{first}.xml"\nrecordings = ["{first}.csv"]\n'
    (folder / "two.toml").write_text(tables)
    outcome = run("diagnose", "two.toml", "--effect", "viscous_friction", "--json")
    assert (outcome.status, outcome.err) == (0, "")
    # A diagnosis may read targets otherwise.
    outcome = run("compare", "two.toml", "--json")
    alone = run("compare", "knee.xml", "knee.csv", "--json")
    sizes = [json.loads(one.out)["gap"]["joints"] for one in (outcome, alone)]
    for joint in ("knee", "ankle"):
        before = [size[joint]["before"] for size in sizes]
        assert before[0] == pytest.approx(before[1], rel=1e-3)


def test_a_manifest_runs_code_only_where_that_is_allowed(run: Run, folder: Path) -> None:
    (folder / "trap.py").write_text(
        f"from pathlib import Path\nPath('ran').touch()\ndef leg(): return {SERVO!r}\n"
    )
    (folder / "experiments.toml").write_text(
        '[[experiment]]\nmodel = "trap:leg"\nrecordings = ["a.csv"]'
    )
    for command in ("compare", "diagnose"):
        refused(run(command, "experiments.toml"), "experiment 1", "'trap:leg'", "--allow-code")
    assert not (folder / "ran").exists()
    assert run("compare", "experiments.toml", "--allow-code").status == 0
    assert (folder / "ran").exists()
    sys.modules.pop("trap")


def test_a_model_reads_other_folders_only_where_that_is_allowed(run: Run, folder: Path) -> None:
    (folder / "robot").mkdir()
    (folder / "robot/servo.xml").write_text('<mujoco><include file="../servo.xml"/></mujoco>')
    refused(run("compare", "robot/servo.xml", "a.csv"), "../servo.xml", "--allow-outside")
    assert run("compare", "robot/servo.xml", "a.csv", "--allow-outside").status == 0
    rehearsed = ("simulate", "robot/servo.xml", "--hide", "none", "--seconds", 1)
    refused(run(*rehearsed), "../servo.xml", "--allow-outside")
    assert run(*rehearsed, "--allow-outside").status == 0


def test_a_manifest_beside_recordings_is_refused(run: Run, folder: Path) -> None:
    (folder / "e.toml").write_text('[[experiment]]\nmodel = "servo.xml"\nrecordings = ["a.csv"]')
    refused(run("compare", "e.toml", "b.csv"), "e.toml", "b.csv", "Leave one of the two out")
    refused(run("compare", "nothing.toml"), "nothing.toml", "no such file")


# Options


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["nope"], ("'nope'", "walkerkit --help")),
        (["compare"], ("model", "walkerkit compare --help")),
        (["compare", "servo.xml", "a.csv", "--nope"], ("--nope",)),
        (["compare", "servo.xml", "a.csv", "--threads", "-1"], ("--threads",)),
        (["compare", "servo.xml", "a.csv", "--threads", "two"], ("--threads",)),
        (["compare", "servo.xml", "a.csv", "--window", "x"], ("--window", "compare --help")),
        (["compare", "servo.xml", "a.csv", "--window"], ("--window",)),
        (["compare", "servo.xml", "a.csv", "--window", "0"], ("window is 0", "positive")),
        (["compare", "servo.xml", "a.csv", "--window", "-1"], ("window is -1", "positive")),
        (["compare", "servo.xml", "a.csv", "--window", "nan"], ("window is nan", "positive")),
        (["diagnose", "servo.xml", "a.csv", "--effect", "nope"], ("'nope'", "coulomb_friction")),
        (["demo", "--seed", "-1"], ("--seed", "demo --help")),
        (["demo", "--hide", "nope"], ("'nope'", "none, viscous_friction")),
        (["demo", "--out", "a.csv"], ("a.csv", "is a file")),
        (["effects", "extra"], ("extra",)),
        (["simulate"], ("model",)),
        (["simulate", "servo.xml", "--hide", "gremlins"], ("'gremlins'", "coulomb_friction")),
        (["simulate", "servo.xml", "--hide", "payload", "gremlins"], ("'gremlins'", "payload")),
        (["simulate", "servo.xml", "--hide", "timestep"], ("'timestep'", "not the robot's")),
        (["simulate", "servo.xml", "--hide", "ground_friction"], ("ground_friction", "no feet")),
        (["simulate", "servo.xml", "payload"], ("'payload'", "after --hide")),
        (["simulate", "--hide", "payload", "armature", "servo.xml"], ("'armature'", "before")),
        (["simulate", "servo.xml", "--seconds", "0"], ("seconds is 0", "at least 1 s")),
        (["simulate", "servo.xml", "--seconds", "nan"], ("seconds is nan",)),
        (["simulate", "servo.xml", "--seconds", "inf"], ("seconds is inf", "at most 3600 s")),
        (["simulate", "nothing.xml"], ("nothing.xml",)),
        (["simulate", "servo.xml", "--seconds", "1", "--out", "a.csv"], ("a.csv", "--out")),
        (["simulate", "servo.xml", "--seconds", "1", "--out", "a.csv/b"], ("a.csv/b", "--out")),
    ],
)
def test_bad_options_are_refused(
    run: Run, folder: Path, arguments: list[str], parts: tuple[str, ...]
) -> None:
    refused(run(*arguments), *parts)


def test_windows_of_a_few_samples_are_refused(run: Run, folder: Path) -> None:
    (folder / "motor.xml").write_text(SERVO.replace(ACTUATOR, '<motor joint="knee"/>'))
    log(folder / "motor.csv", knee__position_target=None, knee__effort_target=0.0)
    for window in ("0.02", "1e-09"):
        outcome = run("compare", "motor.xml", "motor.csv", "--window", window)
        refused(outcome, f"window is {window}", "motor.csv", "250 Hz", "at least 0.032 s")
    outcome = run("compare", "motor.xml", "motor.csv", "--window", "0.04", "--json")
    assert json.loads(outcome.out)["gap"]["horizon"] == 0.04
    # Windows longer than the recording are whole rollouts.
    assert run("compare", "motor.xml", "motor.csv", "--window", "1e9").status == 0


def test_an_output_that_is_no_folder_is_refused_before_any_work(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(*arguments: object, **options: object) -> None:
        raise AssertionError("worked in vain")

    monkeypatch.setattr(workflow, "diagnose", work)
    monkeypatch.setattr("walkerkit.gap.rehearsal.demo.run", work)
    for out in ("a.csv", "a.csv/sub", "a.csv/sub/sub"):
        refused(
            run("diagnose", "servo.xml", "b.csv", "--out", out), out, "a.csv is a file", "--out"
        )
        refused(run("demo", "--out", out), out, "a.csv is a file", "--out")


def test_an_output_that_cannot_be_written_is_refused(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "out/report.html").mkdir(parents=True)
    few = ("--effect", "viscous_friction")
    refused(run("diagnose", "servo.xml", "a.csv", *few, "--out", "out"), "out", "--out")
    assert (folder / "out/report.html").is_dir()
    assert not list((folder / "out").glob(".writing-*"))
    (folder / "sim/chirp.csv").mkdir(parents=True)
    refused(run("simulate", "servo.xml", "--seconds", "1", "--out", "sim"), "chirp.csv", "folder")
    # Tests may run as root, whom no permission stops.
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: mode == os.R_OK and access(path, mode))
    refused(run("diagnose", "servo.xml", "a.csv", "--out", "new"), "new", "no permission to write")


# What looks odd and works


ODD_LOGS: dict[str, Callable[[Path], object]] = {
    "0.1 s": lambda path: log(path, 25),
    "20 samples": lambda path: log(path, 20),
    "6 Hz": lambda path: log(path, 24, rate=6.0),
    "20 kHz": lambda path: log(path, 1000, rate=2e4),
    "1 MHz": lambda path: log(path, 400, rate=1e6),
    "jitter": lambda path: log(path, time=np.arange(300) / RATE + 3e-3 * np.sin(np.arange(300))),
    "lost samples": lambda path: log(
        path, time=np.arange(300) / RATE + 0.4 * (np.arange(300) > 99)
    ),
    "clock of the day": lambda path: log(path, time=1.7e9 + np.arange(300) / RATE),
    "no noise": lambda path: log(path, knee__position=0.3 * np.sin(3 * np.arange(300) / RATE)),
    "effort never reported": lambda path: log(path, knee__effort=0.0, knee__velocity=0.0),
    "target never changes": lambda path: log(path, knee__position_target=0.3),
    "other columns": lambda path: log(
        path, battery=24.0, knee__temperature=30.0, foot__contact=0.0
    ),
    "feed-forward": lambda path: log(path, knee__effort_target=np.sin(np.arange(300) / 50)),
    "wild": lambda path: log(path, knee__position=40 * np.sin(np.arange(300))),
}


@pytest.mark.parametrize("case", ODD_LOGS)
def test_odd_recordings_work(run: Run, folder: Path, case: str) -> None:
    ODD_LOGS[case](folder / "odd.csv")
    outcome = run(
        *("diagnose", "servo.xml", "odd.csv", "--threads", 1, "--json"),
        *("--effect", "viscous_friction"),
    )
    assert (outcome.status, outcome.err) == (0, "")
    gap = json.loads(outcome.out)["gap"]
    for size in (gap, *gap["joints"].values(), *gap["signals"].values()):
        assert all(isinstance(size[key], float) for key in ("before", "after", "noise_floor"))
    assert gap["before"] > 0


def test_a_log_of_five_samples_a_second_works(run: Run, folder: Path) -> None:
    log(folder / "slow.csv", samples=20, rate=1 / 0.19)
    assert run("compare", "servo.xml", "slow.csv").status == 0


def test_recordings_of_different_joints_work_together(run: Run, folder: Path) -> None:
    (folder / "leg.xml").write_text(LEG)
    only_knee, both = log(folder / "knee.csv"), log(folder / "both.csv", **ankle())
    only_ankle = log(
        folder / "ankle.csv", knee__position=None, knee__position_target=None, **ankle()
    )
    for logs in ((only_knee,), (only_knee, only_ankle), (only_knee, both, only_ankle)):
        outcome = run("compare", "leg.xml", *logs, "--json")
        assert (outcome.status, outcome.err) == (0, "")
        gap = json.loads(outcome.out)["gap"]
        assert set(gap["joints"]) == {"knee", *(["ankle"] if len(logs) > 1 else [])}
        assert all(size["before"] > 0 for size in gap["joints"].values())


def test_a_signal_that_some_recordings_lack_is_compared_where_it_is(run: Run, folder: Path) -> None:
    effort = log(folder / "effort.csv", knee__effort=np.sin(np.arange(300) / 50))
    for logs in ((effort, "a.csv", "b.csv"), ("a.csv", "b.csv", effort)):
        outcome = run("compare", "servo.xml", *logs, "--json")
        assert (outcome.status, outcome.err) == (0, "")
        assert json.loads(outcome.out)["gap"]["signals"]["effort"]["before"] > 0


def test_names_may_be_strange(run: Run, folder: Path) -> None:
    name = "front left/[red]knee[/red] <b>µ</b>"
    escaped = name.replace("<", "&lt;").replace(">", "&gt;")
    place = folder / "two words/[bold]ü"
    place.mkdir(parents=True)
    (place / "my robot.xml").write_text(SERVO.replace('"knee"', f'"{escaped}"'), encoding="utf-8")
    text = (folder / "a.csv").read_text().replace("knee/", f"{name}/")
    (place / "log of [today].csv").write_text(text, encoding="utf-8")
    outcome = run(
        *("diagnose", place / "my robot.xml", place / "log of [today].csv"),
        *("--out", place / "out put", "--effect", "viscous_friction"),
    )
    assert (outcome.status, outcome.err) == (0, "")
    assert "[red]knee[/red]" in outcome.out
    content = json.loads((place / "out put/diagnosis.json").read_text(encoding="utf-8"))
    assert list(content["gap"]["joints"]) == [name]
    again = run("compare", place / "out put/model.xml", place / "log of [today].csv", "--json")
    assert list(json.loads(again.out)["gap"]["joints"]) == [name]


def test_all_formats_give_the_same_answer(run: Run, folder: Path) -> None:
    answers = []
    for suffix in (".csv", ".parquet", ".npz"):
        Recording.load("a.csv").save(folder / f"same{suffix}")
        outcome = run("compare", "servo.xml", f"same{suffix}", "--json")
        answers.append(without_seconds(outcome.out))
    assert answers[0] == answers[1] == answers[2]


# What is printed


def test_help_lists_every_command(run: Run) -> None:
    for arguments in ([], ["--help"]):
        outcome = run(*arguments)
        assert (outcome.status, outcome.err) == (0, "")
        for command in ("demo", "compare", "diagnose", "diagnose-fleet", "effects", "simulate"):
            assert command in outcome.out
            assert run(command, "--help").status == 0


def test_version_is_that_of_the_package(run: Run) -> None:
    outcome = run("--version")
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out == f"walkerkit {metadata.version('walkerkit')}\n"


def test_effects_lists_the_whole_catalogue(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    outcome = run("effects")
    assert (outcome.status, outcome.err) == (0, "")
    said = " ".join(outcome.out.split())
    for effect in CATALOGUE.values():
        for text in (effect.name, effect.equation, effect.symptom, effect.added_as):
            assert " ".join(text.split()) in said
    assert "2ε: width [rad]" in said
    assert max(map(cell_len, outcome.out.splitlines())) <= 80


def test_compare_names_nothing_and_writes_nothing(run: Run, folder: Path) -> None:
    before = sorted(folder.iterdir())
    outcome = run("compare", "servo.xml", "a.csv", "b.csv")
    assert (outcome.status, outcome.err) == (0, "")
    assert "noise floor" in outcome.out
    content = json.loads(run("compare", "servo.xml", "a.csv", "b.csv", "--json").out)
    assert content["effects"] == []
    assert content["gap"]["before"] == content["gap"]["after"]
    assert sorted(folder.iterdir()) == before


def test_diagnose_prints_the_json_that_it_writes(run: Run, folder: Path) -> None:
    hide = ("--hide", "viscous_friction", "--seconds", 3, "--out", "logs")
    *files, _ = run("simulate", "servo.xml", *hide).out.splitlines()
    few = ("--effect", "viscous_friction", "--effect", "command_delay", "--threads", 1)
    printed = run("diagnose", "servo.xml", *files, "--out", "o", *few, "--json")
    assert (printed.status, printed.err) == (0, "")
    assert printed.out == (folder / "o/diagnosis.json").read_text(encoding="utf-8")
    shown = run("diagnose", "servo.xml", *files, "--out", "p", *few)
    assert shown.out.splitlines()[-1] == "p/report.html"
    (named,) = json.loads(printed.out)["effects"]
    assert re.search(rf"^{named['effect']} .* sure .*\n  knee ", shown.out, re.MULTILINE)


def test_simulate_records_what_diagnose_reads(run: Run, folder: Path) -> None:
    outcome = run("simulate", "servo.xml", "--hide", "torque_bias", "--seconds", 3, "--out", "logs")
    assert (outcome.status, outcome.err) == (0, "")
    *files, hidden = outcome.out.splitlines()
    assert hidden.startswith("hidden: torque_bias on knee: bias [")
    assert [Path(file).parent for file in files] == [Path("logs")] * 3
    again = run("diagnose", "servo.xml", *files, "--effect", "torque_bias", "--json")
    (named,) = json.loads(again.out)["effects"]
    assert named["effect"] == "torque_bias"
    value = float(re.findall(r"[-+][\d.]+", hidden)[0])
    assert named["parameters"][0]["value"] == pytest.approx(value, rel=0.05)


def test_simulate_replaces_rehearsals_only(run: Run, folder: Path) -> None:
    few = ("simulate", "servo.xml", "--hide", "none", "--seconds", 1, "--out")
    assert run(*few, "logs").status == 0
    first = (folder / "logs/steps.csv").read_bytes()
    assert run(*few, "logs", "--seed", 1).status == 0
    assert (folder / "logs/steps.csv").read_bytes() != first
    (folder / "mine").mkdir()
    own = folder / "mine/steps.csv"
    own.write_text("mine")
    refused(run(*few, "mine"), "mine/steps.csv: is in the way", "--out", "--overwrite")
    assert [path.name for path in (folder / "mine").iterdir()] == ["steps.csv"]
    assert own.read_text() == "mine"
    assert run(*few, "mine", "--overwrite").status == 0
    assert own.read_bytes() == first
    # A rehearsal is not lost to a diagnosis of it, either.
    diagnose = ("diagnose", "servo.xml", "logs/chirp.csv", "--effect", "armature", "--out", "logs")
    refused(run(*diagnose), "logs: has .walkerkit-run.json of another run", "--overwrite")
    assert run(*diagnose, "--overwrite").status == 0
    assert (folder / "logs/chirp.csv").exists()


@pytest.mark.parametrize(
    "given",
    [
        ("servo.xml", "--hide", "torque_bias", "payload", "armature"),
        ("servo.xml", "--hide", "torque_bias", "--hide", "payload", "armature"),
        ("--hide", "torque_bias", "servo.xml", "--hide", "payload", "--hide", "armature"),
    ],
)
def test_several_effects_follow_hide_or_repeat_it(
    run: Run, folder: Path, given: tuple[str, ...]
) -> None:
    outcome = run("simulate", *given, "--seconds", 1, "--out", "logs")
    assert (outcome.status, outcome.err) == (0, "")
    hidden = outcome.out.splitlines()[-1]
    assert re.findall(r"(\w+) on", hidden) == ["torque_bias", "payload", "armature"]


def test_simulate_takes_a_callable(run: Run, folder: Path) -> None:
    (folder / "robots.py").write_text(CALLABLES)
    few = ("--hide", "torque_bias", "--seconds", 1)
    by_callable = run("simulate", "robots:spec", *few, "--out", "one")
    sys.modules.pop("robots", None)
    by_file = run("simulate", "servo.xml", *few, "--out", "other")
    assert (by_callable.status, by_callable.err) == (0, "")
    assert by_callable.out.splitlines()[-1] == by_file.out.splitlines()[-1]
    for name in ("chirp", "slow_triangle", "steps"):
        one, other = (folder / f"{out}/{name}.csv" for out in ("one", "other"))
        assert one.read_bytes() == other.read_bytes()


def test_simulate_says_which_robots_and_effects_it_takes(run: Run, folder: Path) -> None:
    (folder / "muscle.xml").write_text(
        SERVO.replace(ACTUATOR, '<muscle joint="knee" lengthrange="0 1"/>')
    )
    outcome = run("simulate", "muscle.xml")
    refused(outcome, "muscle.xml", "is neither a plain servo nor a plain motor", "Rehearse with")
    told = " ".join(run("simulate", "--help").out.split())
    words = ("timestep", "ground_friction", "ground_compliance", "foot_offset", "motors")
    for word in words:
        assert word in told


def test_simulate_hides_nothing_when_told_so(run: Run, folder: Path) -> None:
    outcome = run("simulate", "servo.xml", "--hide", "none", "--seconds", 1, "--out", "logs")
    assert outcome.out.splitlines()[-1] == "hidden: nothing"
    every = run("simulate", "servo.xml", "--hide", "list", "--seconds", 1)
    for name in HIDEABLE:
        assert name in every.err


# The program itself


def program(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "walkerkit.gap", *map(str, arguments)],
        capture_output=True,
        encoding="utf-8",
        env={**os.environ, **environment},
        timeout=100,
        check=False,
    )


def test_the_program_ends_with_its_exit_status(run: Run, folder: Path) -> None:
    refusal = program("compare", "servo.xml", "missing.csv")
    refused(
        Outcome(status=refusal.returncode, out=refusal.stdout, err=refusal.stderr), "missing.csv"
    )
    refused(run("compare", "--threads", "many"), "--threads")


def test_a_terminal_that_cannot_write_greek_still_gets_its_tables(folder: Path) -> None:
    done = program("compare", "servo.xml", "a.csv", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, "")
    assert "noise floor" in done.stdout


def test_a_failure_of_ours_is_one_line_and_a_file_to_send(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*arguments: Any, **options: Any) -> None:
        raise ZeroDivisionError("a fault\nof two lines")

    monkeypatch.setattr(workflow, "compare", fails)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    ended = run("compare", "leg.xml", "walk.csv")
    assert ended.status == 1
    (file,) = tmp_path.glob("walkerkit-failure-*.txt")
    assert ended.err == (
        "walkerkit: this is a failure of ours: ZeroDivisionError: a fault of two lines. "
        f"Please send us {file}, which has the details.\n"
    )
    told = file.read_text(encoding="utf-8")
    assert "command: walkerkit compare leg.xml walk.csv\n" in told
    assert f"walkerkit {metadata.version('walkerkit')}\n" in told
    assert "Traceback" in told
    assert "in fails" in told


def test_a_span_is_skipped(run: Run, folder: Path) -> None:
    whole = run("compare", "servo.xml", "a.csv", "b.csv", "--json")
    less = run("compare", "servo.xml", "a.csv", "b.csv", "--skip", "a.csv=:0.2", "--json")
    assert (whole.status, less.status) == (0, 0)
    assert not any("skipped" in note for note in json.loads(whole.out)["notes"])
    assert any("0.2 s was skipped" in note for note in json.loads(less.out)["notes"])
    refused(run("compare", "servo.xml", "a.csv", "b.csv", "--skip", "1:2"), "a.csv=1:2")
    refused(run("compare", "servo.xml", "a.csv", "--skip", "1-2"), "'1-2' is no span to skip")
