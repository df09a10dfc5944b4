"""The engines, with real workers: what dies is run again, what fails is reported, others go on."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest
from joblib.externals.loky import get_reusable_executor

from walkerkit.gap.errors import InputError
from walkerkit.gap.fleet import clusters
from walkerkit.gap.fleet.engine import ENGINES, TRIES, Done, run

PATIENCE = 120.0  # s, for a worker to begin


@pytest.fixture
def jobs(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module of the jobs, where the workers that are started here find it too."""
    folder = str(Path(__file__).parent)
    monkeypatch.syspath_prepend(folder)
    known = os.environ.get("PYTHONPATH")
    monkeypatch.setenv("PYTHONPATH", f"{folder}:{known}" if known else folder)
    monkeypatch.setenv("RAY_worker_niceness", "0")  # other tests run beside these
    get_reusable_executor().shutdown()  # workers of other tests would not find it
    return importlib.import_module("fleet_jobs")


def kill(mark: Path) -> None:
    """Kills the worker that leaves the mark when it begins."""
    end = time.monotonic() + PATIENCE
    while not mark.exists():
        assert time.monotonic() < end, "the job to kill has not begun"
        time.sleep(0.05)
    os.kill(int(mark.read_text()), signal.SIGKILL)


def asked(told: list[str], folder: Path) -> list[tuple[str, int, str]]:
    """What the jobs are called with."""
    return [(what, number, str(folder)) for number, what in enumerate(told)]


@pytest.mark.parametrize("engine", ENGINES)
def test_a_killed_worker_loses_nothing(jobs: ModuleType, tmp_path: Path, engine: str) -> None:
    told = ["wait once", "go", "raise", "refuse", "go"]
    found: dict[int, Done[tuple[int, int]]] = {}
    for done in run(jobs.act, asked(told, tmp_path), engine=engine, workers=2):
        if not found:  # another job is done, so that there are two workers
            assert done.index != 0
            kill(tmp_path / "begun")
        assert done.index not in found
        found[done.index] = done
    assert sorted(found) == [0, 1, 2, 3, 4]
    squares = {index: done.value[0] for index, done in found.items() if done.value is not None}
    assert squares == {0: 0, 1: 1, 4: 16}
    processes = {done.value[1] for done in found.values() if done.value is not None}
    assert os.getpid() not in processes
    raised, refused = (found[index].failure for index in (2, 3))
    assert raised is not None
    assert (raised.message, raised.refused) == ("KeyError: 'knee'", False)
    assert "in act" in raised.details
    assert refused is not None
    assert (refused.message, refused.refused) == ("leg.xml: no such file. Check the path.", True)


def test_a_job_that_kills_its_workers_ends_alone(jobs: ModuleType, tmp_path: Path) -> None:
    found = {done.index: done for done in run(jobs.act, asked(["die", "go", "go"], tmp_path))}
    assert sorted(found) == [0, 1, 2]
    assert found[0].failure is not None
    assert f"its worker died {TRIES} times" in found[0].failure.message
    assert {found[1].failure, found[2].failure} == {None}


def test_one_worker_is_another_process_and_runs_one_job_at_a_time(
    jobs: ModuleType, tmp_path: Path
) -> None:
    found = list(run(jobs.act, asked(["go"] * 3, tmp_path), workers=1))
    assert [done.index for done in found] == [0, 1, 2]
    assert {done.value[1] for done in found if done.value is not None}.isdisjoint({os.getpid()})


def test_no_jobs_need_no_engine() -> None:
    assert list(run(len, [], engine="ray")) == []


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        ({"engine": "rai"}, ("'rai'", "did you mean 'ray'?", "processes, ray, dask")),
        ({"address": "tcp://a:1"}, ("'tcp://a:1'", "this machine alone", "--engine")),
        ({"workers": 0}, ("workers is 0", "1 or more")),
        (
            {"engine": "dask", "address": "tcp://127.0.0.1:9"},
            ("Dask does not answer at tcp://127.0.0.1:9", "`dask scheduler`", "--address"),
        ),
        ({"engine": "dask", "address": "what://ever"}, ("Dask does not answer at what://ever",)),
        (
            {"engine": "ray", "address": "127.0.0.1:9"},
            ("Ray does not answer at 127.0.0.1:9", "`ray start --head`", "--address"),
        ),
    ],
)
def test_an_engine_that_cannot_be_used_is_refused(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, str | int], parts: tuple[str, ...]
) -> None:
    monkeypatch.setattr(clusters, "_ANSWER", 1)
    with pytest.raises(InputError) as refused:
        list(run(len, ["job"], **options))  # type: ignore[arg-type]
    assert len(str(refused.value).splitlines()) == 1
    for part in parts:
        assert part in str(refused.value)


@pytest.mark.parametrize(("engine", "module"), [("ray", "ray"), ("dask", "distributed")])
def test_an_engine_that_is_not_installed_names_its_extra(
    monkeypatch: pytest.MonkeyPatch, engine: str, module: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=rf"pip install 'walkerkit\[{engine}\]'"):
        list(run(len, ["job"], engine=engine))
