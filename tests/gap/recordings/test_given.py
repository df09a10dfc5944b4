"""What users give in Python that is no list of files: taken for what it is, or refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
from dm_control import mjcf

from tests.gap.servo import SERVO
from walkerkit import gap
from walkerkit.gap.errors import InputError
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.given import listed, model_name, recording_of
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.workflow import effect_names
from walkerkit.walkers import MjcfWalker

TIME = np.arange(200) / 100
COLUMNS = {
    "knee/position": 0.3 * np.sin(3 * TIME - 0.05),
    "knee/position_target": 0.3 * np.sin(3 * TIME),
}


def recording(name: str = "a") -> Recording:
    return Recording(name=name, time=TIME, columns=COLUMNS)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("one.xml").write_text(SERVO, encoding="utf-8")
    for name in ("a", "b"):
        recording(name).save(f"{name}.csv")
    return tmp_path


@pytest.mark.parametrize("one", ["a.csv", Path("a.csv"), recording()], ids=["str", "Path", "log"])
def test_one_recording_is_a_list_of_one(folder: Path, one: Any) -> None:
    (experiment,) = load_experiments("one.xml", one)
    assert [r.name for r in experiment.recordings] == ["a"]
    (experiment,) = load_experiments("one.xml", "b.csv", held_out=one)
    assert experiment.held_out == {"a"}
    assert gap.compare("one.xml", one).recordings == ("a",)


def test_more_of_them_may_come_in_anything(folder: Path) -> None:
    for some in (["a.csv", "b.csv"], ("a.csv", "b.csv"), folder.glob("?.csv")):
        (experiment,) = load_experiments("one.xml", some)  # type: ignore[arg-type]
        assert sorted(r.name for r in experiment.recordings) == ["a", "b"]
    assert listed(()) == []


def test_one_effect_is_a_list_of_one(folder: Path) -> None:
    assert effect_names("armature") == effect_names(["armature"]) == ("armature",)
    assert effect_names(None) is None
    with pytest.raises(InputError, match=r"'armatur' .* \(did you mean 'armature'"):
        effect_names("armatur")
    found = gap.diagnose("one.xml", "a.csv", effects="armature", n_threads=1)
    assert {considered.effect for considered in found.diagnosis.considered} <= {"armature"}


def walker_of_file() -> MjcfWalker:
    return MjcfWalker.from_file("one.xml")


MODELS: dict[str, tuple[Callable[[], Any], str]] = {
    "MjModel": (lambda: mujoco.MjModel.from_xml_string(SERVO), "Give the file that it was comp"),
    "MjSpec": (lambda: mujoco.MjSpec.from_string(SERVO), r"write_text\(spec\.to_xml\(\)\)"),
    "RootElement": (lambda: mjcf.from_xml_string(SERVO), '"my_robot:make" for make'),
    "MjcfWalker": (walker_of_file, '"my_robot:make" for make'),
    "function": (lambda: walker_of_file, r'as in "tests\.gap\.recordings\.test_given:walker_of_f'),
    "NoneType": (lambda: None, "Give its file"),
}


@pytest.mark.parametrize("kind", MODELS)
def test_a_model_that_is_an_object_is_refused(folder: Path, kind: str) -> None:
    make, remedy = MODELS[kind]
    model = make()
    for use in (
        lambda: gap.diagnose(model, ["a.csv"]),
        lambda: gap.compare(model, "a.csv"),
        lambda: gap.load(model, "a.csv"),
        lambda: load_robot(model),
        lambda: rehearse(model, ["none"]),
    ):
        with pytest.raises(InputError, match=rf"^the model is an object of type {kind}.*{remedy}"):
            use()


def test_what_the_remedies_say_works(folder: Path) -> None:
    spec = mujoco.MjSpec.from_string(SERVO)
    spec.compile()
    Path("robot.xml").write_text(spec.to_xml(), encoding="utf-8")
    assert [*load_robot("robot.xml").joints] == ["knee"]
    assert [*load_robot(f"{__name__}:walker_of_file").joints] == ["knee"]
    frame = pd.DataFrame({"time": TIME, "mode": 1, **COLUMNS})
    frame.to_csv("log.csv", index=False)
    assert Recording.load("log.csv").joints == ("knee",)
    columns = {name: frame[name] for name in COLUMNS}
    assert Recording(name="log", time=frame["time"], columns=columns).joints == ("knee",)  # type: ignore[arg-type]


def test_mjcf_text_is_refused(folder: Path) -> None:
    with pytest.raises(InputError, match=r"^the model is MJCF text\. Save it to a file\."):
        gap.compare(SERVO, "a.csv")


def test_names_of_models_pass() -> None:
    assert model_name(Path("leg.xml")) == "leg.xml"
    assert model_name("package.module:make") == "package.module:make"


FRAME = pd.DataFrame({"time": TIME, **COLUMNS})


@pytest.mark.parametrize("given", [FRAME, [FRAME], ["a.csv", FRAME]], ids=["one", "list", "second"])
def test_a_data_frame_is_refused_with_how_to_save_it(folder: Path, given: Any) -> None:
    message = r'^a recording is an object of type DataFrame of pandas\. .*to_csv\("log\.csv"'
    with pytest.raises(InputError, match=message):
        gap.compare("one.xml", given)
    with pytest.raises(InputError, match=message):
        gap.compare("one.xml", "b.csv", held_out=given)


@pytest.mark.parametrize(
    ("given", "kind"),
    [(dict(COLUMNS), "dict"), ([COLUMNS], "dict"), (3, "int"), (None, "NoneType")],
)
def test_what_else_is_no_recording(folder: Path, given: Any, kind: str) -> None:
    with pytest.raises(
        InputError, match=rf"^a recording is an object of type {kind}\. .*gap\.Recording\(name="
    ):
        gap.compare("one.xml", given)
    with pytest.raises(InputError, match="a recording is"):
        recording_of(given)
