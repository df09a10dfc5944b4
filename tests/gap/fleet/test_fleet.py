"""Fleets of tiny robots, diagnosed for real: one result on every engine, and what goes wrong."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from walkerkit import gap
from walkerkit.gap import cli
from walkerkit.gap.fleet.fleet import Outcome
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect

SERVO = """
<mujoco model="servo">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="knee" axis="0 1 0" armature="0.005" damping="0.1" range="-2 2" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
    </body>
  </worldbody>
  <actuator><position name="knee" joint="knee" kp="30" kv="1" forcerange="-20 20"/></actuator>
</mujoco>
"""
ROBOT = '[[robot]]\nname = "{0}"\nmodel = "servo.xml"\nrecordings = ["{0}/a.csv", "{0}/b.csv"]\n'
FEW: dict[str, Any] = {"effects": ["torque_bias"]}


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two robots that have a torque bias each, and their fleet.toml."""
    folder = tmp_path_factory.mktemp("fleet")
    (folder / "servo.xml").write_text(SERVO)
    time = np.arange(0, 1.0, 1 / 250)[:, None]
    sent = [0.6 * np.sin(4 * time), 0.5 * np.sin(7 * time) + 0.2 * np.sin(3 * time)]
    for seed, (name, bias) in enumerate({"unit-1": 0.3, "unit 2": 0.5}.items()):
        hidden = HiddenEffect(effect="torque_bias", joints=("knee",), values={"bias": bias})
        (folder / name).mkdir()
        for recording, file in zip(
            run_hardware(folder / "servo.xml", sent, rate=250.0, hidden=[hidden], seed=seed),
            ("a", "b"),
            strict=True,
        ):
            kept = {f"knee/{s}" for s in ("position", "position_target")}
            columns = {c: v for c, v in recording.columns.items() if c in kept}
            Recording(name=file, time=recording.time, columns=columns).save(
                folder / name / f"{file}.csv"
            )
    (folder / "fleet.toml").write_text("".join(map(ROBOT.format, ("unit-1", "unit 2"))))
    return folder


@pytest.fixture(scope="module")
def here(robots: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What two processes make of them, side by side."""
    out = tmp_path_factory.mktemp("here")
    gap.diagnose_fleet(robots / "fleet.toml", out, workers=2, **FEW)
    return out


def contents(folder: Path) -> dict[str, bytes]:
    """Every file, without the seconds."""
    found = {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
    timed = re.compile(rb'"seconds": [\d.e-]+|Diagnosed in [\d.]+ s')
    return {name: timed.sub(b"", content) for name, content in found.items()}


@contextmanager
def ray_cluster() -> Iterator[str]:
    """A Ray cluster that is running already."""
    from ray.cluster_utils import Cluster

    options = {"num_cpus": 1, "include_dashboard": False}
    cluster = Cluster(initialize_head=True, head_node_args=options)
    try:
        yield cluster.address
    finally:
        cluster.shutdown()


@contextmanager
def dask_cluster() -> Iterator[str]:
    """A Dask cluster that is running already."""
    from distributed import LocalCluster

    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**options, silence_logs=50) as cluster:
        yield cluster.scheduler_address


def test_what_is_found_and_what_is_written(here: Path) -> None:
    files = set(contents(here))
    for name in ("unit-1", "unit 2"):
        for file in ("diagnosis.json", "report.html", "model.xml", "actuators.json"):
            assert f"{name}/{file}" in files
    content = json.loads((here / "fleet.json").read_text())
    assert [robot["name"] for robot in content["robots"]] == ["unit-1", "unit 2"]
    (common,) = content["effects"]
    assert (common["effect"], common["joint"], common["shared"]) == ("torque_bias", "knee", "all")
    values = {name: one["value"] for name, one in common["parameters"][0]["robots"].items()}
    assert values == pytest.approx({"unit-1": 0.3, "unit 2": 0.5}, rel=0.1)
    assert common["parameters"][0]["median"] == pytest.approx(0.4, rel=0.1)
    assert "All robots have torque_bias at knee." in (here / "fleet.html").read_text()


@pytest.mark.parametrize(("engine", "cluster"), [("ray", ray_cluster), ("dask", dask_cluster)])
def test_results_do_not_depend_on_engine_or_workers(
    robots: Path,
    here: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    engine: str,
    cluster: Callable[[], Any],
) -> None:
    monkeypatch.setenv("RAY_worker_niceness", "0")  # other tests run beside this one
    with cluster() as address:
        gap.diagnose_fleet(
            robots / "fleet.toml", tmp_path, engine=engine, address=address, workers=1, **FEW
        )
    assert contents(tmp_path) == contents(here)


def test_a_robot_that_fails_is_reported_and_the_rest_is_kept(
    robots: Path, here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    with (robots / "unit-1" / "short.csv").open("w") as file:
        file.write("time,knee/position,knee/position_target\n0,0,0\n1,0,0\n")
    bad = ROBOT.format("broken").replace("broken/a", "unit-1/short").replace("broken/b", "unit-1/b")
    (robots / "more.toml").write_text((robots / "fleet.toml").read_text() + bad)
    for path in here.rglob("*"):
        if path.is_file():
            (tmp_path / path.relative_to(here)).parent.mkdir(exist_ok=True)
            (tmp_path / path.relative_to(here)).write_bytes(path.read_bytes())
    arguments = ["diagnose-fleet", robots / "more.toml", "--out", tmp_path]
    arguments += ["--effect", "torque_bias", "--workers", 1]
    monkeypatch.setattr(sys, "argv", ["walkerkit", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    printed = capsys.readouterr()
    assert ended.value.code == 2  # the input's fault, not ours
    assert len(printed.err.splitlines()) == 1
    for part in ("more.toml: robot 'broken' failed: ", "short.csv", "the other robots are kept"):
        assert part in printed.err
    assert re.search(r"^1/3 unit-1: .*kept from an earlier run", printed.out, re.MULTILINE)
    assert re.search(r"^3/3 broken: Failed: .*short.csv", printed.out, re.MULTILINE)
    content = json.loads((tmp_path / "fleet.json").read_text())
    assert [robot["verdict"] for robot in content["robots"]][2] == "failed"
    assert "short.csv" in (tmp_path / "broken/failure.txt").read_text()
    assert (tmp_path / "unit-1/report.html").read_bytes() == (
        here / "unit-1/report.html"
    ).read_bytes()


def test_only_the_same_input_is_kept(robots: Path, here: Path, tmp_path: Path) -> None:
    from walkerkit.gap.fleet.engine import Failure
    from walkerkit.gap.fleet.folder import kept, write_failure
    from walkerkit.gap.fleet.manifest import load_fleet
    from walkerkit.gap.fleet.member import Job

    member = load_fleet(robots / "fleet.toml")[0]

    def job(**changes: Any) -> Job:
        options = {"member": member, "window": None, "effects": ("torque_bias",), "n_threads": 2}
        allowed = {"allow_code": False, "allow_outside": False}
        return Job(**{**options, **allowed, "folder": str(tmp_path), **changes})

    folder = tmp_path / "unit-1"
    folder.mkdir()
    for path in (here / "unit-1").iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    assert kept(folder, job()) == json.loads((folder / "diagnosis.json").read_text())
    assert kept(folder, job(window=0.4)) is None
    assert kept(folder, job(effects=None)) is None
    (folder / "notes.txt").write_text("mine")
    (folder / "model.xml").unlink()
    assert kept(folder, job()) is None
    write_failure(folder, Failure(message="it broke", details="Traceback"), overwrite=False)
    left = [".walkerkit-run.json", "failure.txt", "notes.txt"]
    assert sorted(path.name for path in folder.iterdir()) == left
    assert kept(folder, job()) is None
    mark = json.loads((folder / left[0]).read_text())
    (folder / left[0]).write_text(json.dumps({**mark, "files": ["failure.txt", "../x"]}))
    (tmp_path / "x").write_text("not ours")
    write_failure(folder, Failure(message="it broke again"), overwrite=False)
    assert (tmp_path / "x").exists()


def test_files_of_the_users_own_stay(robots: Path, here: Path, tmp_path: Path) -> None:
    for mine in ("unit-1/model.xml", "unit 2/report.html", "fleet.json"):
        out = tmp_path / mine.replace("/", " of ")
        (out / mine).parent.mkdir(parents=True)
        (out / mine).write_text("mine")
        before = contents(out)
        with pytest.raises(gap.InputError, match=rf"{mine}: is in the way.*--overwrite"):
            gap.diagnose_fleet(robots / "fleet.toml", out, workers=1, **FEW)
        assert contents(out) == before  # and nothing was diagnosed in vain
        (tmp_path / "all" / mine).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "all" / mine).write_text("mine")
    out = tmp_path / "all"
    gap.diagnose_fleet(robots / "fleet.toml", out, workers=1, overwrite=True, **FEW)
    assert contents(out) == contents(here)
    # From now on they are the fleet's.
    gap.diagnose_fleet(robots / "fleet.toml", out, workers=1, window=0.4, **FEW)


def test_a_result_of_diagnose_is_none_of_a_fleet(robots: Path, tmp_path: Path) -> None:
    logs = [robots / "unit-1" / f"{name}.csv" for name in "ab"]
    gap.diagnose(robots / "servo.xml", logs, out=tmp_path, n_threads=1, **FEW)
    before = contents(tmp_path)
    with pytest.raises(gap.InputError, match="is in the way"):
        gap.diagnose_fleet(robots / "fleet.toml", tmp_path, workers=2, **FEW)
    assert contents(tmp_path) == before


def test_what_is_in_the_way_of_an_asset_stays(tmp_path: Path) -> None:
    from walkerkit.gap.fleet.engine import Done
    from walkerkit.gap.fleet.fleet import _written
    from walkerkit.gap.fleet.member import Made

    (tmp_path / "unit-1").mkdir()
    (tmp_path / "unit-1/foot.stl").write_text("mine")
    made = Made(files={"diagnosis.json": b"{}", "foot.stl": b"ours"}, key="key")
    outcome = _written(tmp_path, "unit-1", Done(index=0, value=made), False)
    assert outcome.failure is not None
    assert outcome.failure.refused
    assert "foot.stl: is in the way" in outcome.failure.message
    assert contents(tmp_path) == {"unit-1/foot.stl": b"mine"}


def test_what_is_wrong_before_the_work_stops_it(robots: Path, tmp_path: Path) -> None:
    ended: list[Outcome] = []
    for options, says in (
        ({"effects": ["torque_bia"]}, "torque_bia"),
        ({"window": 0.0}, "window is 0.0 s"),
        ({"window": "1 s"}, "window is '1 s'; give a positive number"),
        ({"engine": "spark"}, "'spark'"),
    ):
        with pytest.raises(gap.InputError, match=says):
            gap.diagnose_fleet(
                robots / "fleet.toml",
                tmp_path / "out",
                ended=lambda one, number, total: ended.append(one),
                **options,  # type: ignore[arg-type]
            )
    assert ended == []
    assert not (tmp_path / "out").exists()
