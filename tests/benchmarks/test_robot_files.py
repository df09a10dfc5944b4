"""A few files of the benchmark, and what it says of them."""

from __future__ import annotations

import mujoco
import pytest

from benchmarks import robot_files
from benchmarks.robots.checks import Outcome, check, configs, written_file
from benchmarks.robots.written import WRITTEN


def test_a_file_is_checked():
    outcome = check("pair", written_file("pair", WRITTEN["pair"]), diagnose=False)
    assert outcome.tried == len(outcome.walkers) == len(outcome.repeats)
    assert outcome.own.startswith("no_gap")
    assert not outcome.refused
    assert not outcome.tracebacks
    assert Outcome.from_json(outcome.to_json()) == outcome


def test_outcomes_are_kept(tmp_path):
    known = Outcome(
        file="pair",
        walkers=("its own",),
        tried=2,
        repeats=("its own",),
        refused=("PD: refused: why",),
        own="unexplained (0.1 rad)",
        found="refused: why",
        hidden="armature",
        tracebacks=(),
    )
    (tmp_path / "robot_files.jsonl").write_text(known.to_json() + "\n", encoding="utf-8")
    assert list(robot_files.outcomes(["pair"], tmp_path)) == [known]
    rows = {row.what: (row.result, row.reference) for row in robot_files.rows([known])}
    assert rows["are walkers, or one sentence"] == ("1 + 1", "2")
    assert rows["own log leaves no gap, or one sentence"] == ("0", "1")
    assert rows["what is hidden is named, or one sentence"] == ("1", "1")


@pytest.mark.parametrize("name", WRITTEN)
def test_what_was_written_compiles(name):
    model = mujoco.MjModel.from_xml_string(WRITTEN[name])
    assert model.nu > 0
    assert configs(model)["its own"] is None


def test_there_are_files():
    assert len(robot_files.FILES) + len(WRITTEN) >= 40
    assert all(path.is_file() for path in robot_files.FILES.values())
