"""The experiments.toml of a diagnosis names what there is, and can be read."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.gap.servo import SERVO
from walkerkit.gap import steps
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.report.experiments import mended_experiments, next_experiments

CHANGED = "next_experiment.xml"


def log(path: Path, rate: float) -> Path:
    time = np.arange(0, 1.0, 1 / 250)
    columns = {"knee/position": 0.29 * np.sin(rate * time - 0.06)}
    columns["knee/position_target"] = 0.3 * np.sin(rate * time)
    path.parent.mkdir(parents=True, exist_ok=True)
    Recording(name=path.stem, time=time, columns=columns).save(path)
    return path


@pytest.fixture
def logs(tmp_path: Path) -> list[Path]:
    names = ("sub/a.parquet", "sub/b.csv", "c.npz")
    return [log(tmp_path / name, rate) for name, rate in zip(names, (3.0, 5.0, 4.0), strict=True)]


def read(text: str, folder: Path) -> list[dict[str, Any]]:
    """The experiments; the new one's files are put in place, and all can be loaded."""
    (folder / CHANGED).write_text(SERVO)
    log(folder / "RECORDED.csv", 6.0)
    (folder / "next_experiments.toml").write_text(text, encoding="utf-8")
    load_experiments(folder / "next_experiments.toml", allow_code=True)
    found: list[dict[str, Any]] = tomllib.loads(text)["experiment"]
    return found


def names(paths: Sequence[Path]) -> list[str]:
    return [str(path) for path in paths]


def test_the_next_experiment_beside_what_there_is(tmp_path: Path, logs: list[Path]) -> None:
    model = tmp_path / 'my "robot".xml'
    model.write_text(SERVO)
    problem = steps.load(model, logs, held_out=[logs[0]])
    (tmp_path / "elsewhere").mkdir()
    old, new = read(next_experiments(problem, CHANGED), tmp_path / "elsewhere")
    assert old == {
        "model": str(model),
        "recordings": names(logs[1:]),
        "held_out": names(logs[:1]),
    }
    assert new == {"model": CHANGED, "recordings": ["RECORDED.csv"]}


def test_blocks_of_a_recording_are_one_file(tmp_path: Path, logs: list[Path]) -> None:
    (tmp_path / "servo.xml").write_text(SERVO)
    problem = steps.load(tmp_path / "servo.xml", logs[:1])
    old, _ = read(next_experiments(problem, CHANGED), tmp_path)
    assert old == {"model": str(tmp_path / "servo.xml"), "recordings": names(logs[:1])}
    (mended,) = tomllib.loads(mended_experiments(problem, ["model.xml"]))["experiment"]
    assert mended == {**old, "model": "model.xml"}


def test_a_model_may_be_a_callable_and_a_recording_no_file(
    tmp_path: Path, logs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = f"import mujoco\ndef spec():\n    return mujoco.MjSpec.from_string({SERVO!r})\n"
    (tmp_path / "servos.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    loaded = Recording.load(logs[0])
    unnamed = Recording(name="walk", time=loaded.time, columns=loaded.columns)
    problem = steps.load("servos:spec", [unnamed])
    sys.modules.pop("servos", None)
    text = next_experiments(problem, CHANGED)
    assert "--allow-code" in text
    assert "recording.save" in text
    log(tmp_path / "walk.csv", 3.0)
    assert read(text, tmp_path)[0] == {"model": "servos:spec", "recordings": ["walk.csv"]}
