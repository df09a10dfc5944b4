"""The folder that a diagnosis leaves: complete, of the documented form, and loadable again."""

from __future__ import annotations

import html
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from walkerkit.gap import workflow
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.report.gaps import Gap
from walkerkit.gap.report.output import check_folder
from walkerkit.tasks.excitation import BATTERY

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
  <actuator><position joint="knee" kp="30" kv="1" forcerange="-20 20"/></actuator>
</mujoco>
"""
# The same drive as dm_control scales it: -1 to 1 stands for -1 to 2 rad.
SCALED = re.sub(
    "<position.*/>",
    '<general joint="knee" ctrllimited="true" ctrlrange="-1 1" biastype="affine" '
    'gainprm="45" biasprm="15 -30 -1" forcerange="-20 20"/>',
    SERVO,
)
RATE = 250.0

Record = Callable[..., list[Path]]


@pytest.fixture(scope="module")
def servo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("servo") / "servo.xml"
    path.write_text(SERVO)
    return path


def targets(seconds: float) -> list[Any]:
    time = np.arange(0.0, seconds, 1 / RATE)
    rng = np.random.default_rng(0)
    return [
        BATTERY[name](
            time, lower=np.array([-0.8]), upper=np.array([0.8]), rng=rng, max_velocity=6.0
        )
        for name in ("multisine", "slow_triangle", "chirp")
    ]


RECORDED: dict[str, list[Recording]] = {}


def record(
    model: Path, folder: Path, *hidden: HiddenEffect, seconds: float = 2.0, prefix: str = ""
) -> list[Path]:
    """Files of three experiments on simulated hardware."""
    key = f"{model.read_text()} {hidden} {seconds}"
    if key not in RECORDED:
        RECORDED[key] = run_hardware(model, targets(seconds), rate=RATE, hidden=hidden, seed=1)
    files = []
    for recording in RECORDED[key]:
        files.append(folder / f"{prefix}{recording.name}.csv")
        recording.save(files[-1])
    return files


def hide(effect: str, **values: float) -> HiddenEffect:
    return HiddenEffect(effect=effect, joints=("knee",), values=values)


def same_gap(gap: Gap, after: Gap) -> None:
    """`gap`, of a mended model that was loaded again, is what was promised."""
    assert gap.position.before == pytest.approx(after.position.after, rel=1e-4, abs=1e-9)
    for joint, size in gap.joints.items():
        assert size.before == pytest.approx(after.joints[joint].after, rel=1e-4, abs=1e-9)
    assert set(gap.signals) == set(after.signals)
    for signal, size in gap.signals.items():
        assert size.before == pytest.approx(after.signals[signal].after, rel=1e-4, abs=1e-9)


# The form of diagnosis.json

NUMBER = float
EFFECT = {
    "effect": str,
    "joints": [str],
    "confidence": NUMBER,
    "parameters": [
        {
            "name": str,
            "joint": str,
            "value": NUMBER,
            "std": (NUMBER, None),
            "unit": str,
            "was": (NUMBER, None),
            "is": (NUMBER, None),
            "field": str,
            "lower": (NUMBER, None),
            "upper": (NUMBER, None),
            "at_bound": bool,
        }
    ],
    "gap_after": NUMBER,
    "indistinguishable_from": [str],
}
REASONED = EFFECT | {"reasons": {str: str}}
BODY_EFFECT = EFFECT | {
    "bodies": [str],
    "parameters": [
        {"body" if key == "joint" else key: form for key, form in EFFECT["parameters"][0].items()}
    ],
}
REASONED_BODY = BODY_EFFECT | {"reasons": {str: str}}
FITTED = ("effect", "joints", "bodies", "parameters")
RIVAL = {
    "effect": str,
    "in_place_of": str,
    "effects": [
        tuple({key: form[key] for key in FITTED if key in form} for form in (EFFECT, BODY_EFFECT))
    ],
}
EXPERIMENT = {"excitation": str, "between": [str], "separation": NUMBER, "file": (str, None)}
SET_UP = EXPERIMENT | {"set_up": str, "instruction": str, "model": (str, None)}
SIZE = {"before": NUMBER, "after": NUMBER, "noise_floor": NUMBER}
DIAGNOSIS = {
    "schema": int,
    "verdict": str,
    "unknown": (NUMBER, None),
    "gap": {
        "unit": str,
        "horizon": (NUMBER, None),
        **SIZE,
        "numerical_floor": NUMBER,
        "held_out": bool,
        "joints": {str: SIZE},
        "signals": {str: {"unit": str, **SIZE}},
    },
    "locations": [{"joint": str, "regime": str, "signal": str, "share": NUMBER, "lift": NUMBER}],
    "effects": [(EFFECT, BODY_EFFECT, REASONED, REASONED_BODY)],
    "next_experiment": (EXPERIMENT, SET_UP, None),
    "recordings": [str],
    "held_out": [str],
    "searched": bool,
    "notes": [str],
    "seconds": NUMBER,
}


def fits(value: Any, form: Any) -> bool:
    """Whether a value has a form, key by key; a tuple lists what may be instead of each other."""
    match form:
        case tuple():
            return any(fits(value, one) for one in form)
        case None:
            return value is None
        case [item]:
            return isinstance(value, list) and all(fits(one, item) for one in value)
        case dict() if str in form:
            return isinstance(value, dict) and all(fits(one, form[str]) for one in value.values())
        case dict():
            return (
                isinstance(value, dict)
                and set(value) == set(form)
                and all(fits(value[key], form[key]) for key in form)
            )
    return type(value) is form


def check_diagnosis(content: dict[str, Any]) -> None:
    for key, form in DIAGNOSIS.items():
        assert fits(content[key], form), (key, content[key])
    assert set(content) - {"only", "hints", "correlation", "rivals"} == set(DIAGNOSIS)
    assert fits(content.get("rivals", []), [RIVAL])
    assert fits(content.get("only", []), [str])
    assert content["schema"] == 2
    assert content["verdict"] in ("explained", "partly_explained", "no_gap", "unexplained")
    gap = content["gap"]
    assert (gap["before"], gap["after"]) == (
        gap["signals"]["position"]["before"],
        gap["signals"]["position"]["after"],
    )
    for named in content["effects"]:
        assert set(named.get("reasons", ())) <= set(named["indistinguishable_from"])
        assert {named["effect"], *named["indistinguishable_from"]} <= set(CATALOGUE)
        assert 0 <= named["confidence"] <= 1
        for parameter in named["parameters"]:
            assert parameter["std"] is None or (parameter["std"] > 0 and not parameter["at_bound"])
    assert all(0 <= at["share"] <= 1 for at in content["locations"])


def test_the_check_can_fail() -> None:
    good = {"joint": "knee", "regime": "late", "signal": "effort", "share": 0.5, "lift": 1.5}
    (form,) = DIAGNOSIS["locations"]  # type: ignore[misc]
    assert fits(good, form)
    for bad in ({**good, "lift": 1}, {**good, "more": 1.0}, {"joint": "knee"}, good | {"joint": 1}):
        assert not fits(bad, form)


# What is written


@pytest.fixture(scope="module")
def delayed(servo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a diagnosis with a confusion set: a delay, seen in the positions alone."""
    folder = tmp_path_factory.mktemp("delayed")
    files = []
    for file in record(servo, folder, hide("command_delay", delay=0.01)):
        whole = Recording.load(file)
        kept = {k: v for k, v in whole.columns.items() if k.endswith(("position", "target"))}
        Recording(name=whole.name, time=whole.time, columns=kept).save(file)
        files.append(file)
    few = ["command_delay", "sensor_delay", "payload"]
    workflow.diagnose(servo, files, effects=few, n_threads=1).save(folder / "out")
    return folder / "out"


def test_the_folder_has_every_file_and_nothing_else(delayed: Path) -> None:
    assert {path.name for path in delayed.iterdir()} == {
        "diagnosis.json",
        "report.html",
        "model.xml",
        "actuators.json",
        "next_experiment.csv",
        "motions.npz",
    }


def test_diagnosis_json_has_the_documented_form(delayed: Path) -> None:
    text = (delayed / "diagnosis.json").read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=pytest.fail)  # neither NaN nor Infinity is JSON
    check_diagnosis(content)
    assert content["verdict"] in ("explained", "partly_explained")
    assert content["gap"]["horizon"] is None
    assert content["gap"]["held_out"] is True
    assert set(content["gap"]["joints"]) == {"knee"}
    assert set(content["gap"]["signals"]) == {"position"}
    assert content["recordings"] == ["experiment_0", "experiment_1", "experiment_2"]
    (named,) = content["effects"]
    assert {named["effect"], *named["indistinguishable_from"]} == {"command_delay", "sensor_delay"}
    (other,) = named["indistinguishable_from"]
    assert named["reasons"].keys() == {other}
    assert "late" in named["reasons"][other]
    (rival,) = content["rivals"]
    assert (rival["effect"], rival["in_place_of"]) == (other, named["effect"])
    (instead,) = [one for one in rival["effects"] if one["effect"] == other]
    assert instead["parameters"][0]["value"] == pytest.approx(0.01, abs=0.002)
    following = content["next_experiment"]
    assert following["file"] == "next_experiment.csv"
    assert following["set_up"] == "effort_logged"  # positions alone never tell
    assert following["model"] is None


def test_the_next_experiment_can_be_played(delayed: Path) -> None:
    following = Recording.load(delayed / "next_experiment.csv")
    assert following.joints == ("knee",)
    assert following.duration > 5
    target = following.columns["knee/position_target"]
    # Inside what the recordings have reached.
    assert -1.2 < target.min() < target.max() < 1.2


def test_actuators_json_has_what_mjcf_cannot_say(delayed: Path) -> None:
    content = json.loads((delayed / "actuators.json").read_text(encoding="utf-8"))
    assert content["schema"] == 1
    diagnosis = json.loads((delayed / "diagnosis.json").read_text(encoding="utf-8"))
    assert [one["effect"] for one in content["effects"]] == [
        one["effect"] for one in diagnosis["effects"]
    ]
    assert set(content["models"]) == {"model.xml"}
    entry = content["models"]["model.xml"]
    assert entry["hold"] in ("zero_order", "linear", "next")
    assert entry["command"]["knee"]["position"] == {"slope": 1.0, "offset": 0.0}


def test_the_report_is_one_page_about_the_model(delayed: Path) -> None:
    page = (delayed / "report.html").read_text(encoding="utf-8")
    (named,) = json.loads((delayed / "diagnosis.json").read_text(encoding="utf-8"))["effects"]
    for text in ("servo", named["effect"], html.escape(CATALOGUE[named["effect"]].equation)):
        assert text in page


def test_the_mended_model_loads_in_plain_mujoco(delayed: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(delayed / "model.xml"))
    assert model.nu == 1
    mujoco.mj_step(model, mujoco.MjData(model), 10)


# What is written reproduces what was promised. Here through files and the whole workflow, by the
# effects that change a model in ways of their own; each effect does it alone under its contract
# (tests/gap/effects).

EFFECTS = {
    "viscous_friction": hide("viscous_friction", damping=0.2),
    "position_gain": hide("position_gain", delta_kp=6.0),
    "torque_constant": hide("torque_constant", alpha=0.15),
    "torque_bias": hide("torque_bias", bias=0.3),
    "parallel_spring": hide("parallel_spring", stiffness=2.0, springref=0.3),
    "effort_limit": hide("effort_limit", forcerange=0.6),
    "command_delay": hide("command_delay", delay=0.011),
    "sensor_delay": hide("sensor_delay", delay=0.011),
    "encoder_offset": hide("encoder_offset", offset=0.05),
    "base_tilt": HiddenEffect(effect="base_tilt", values={"roll": 0.02, "pitch": 0.1}),
    "payload": HiddenEffect(effect="payload", bodies=("arm",), values={"mass": 0.15}),
}


# One of each way: a field of joints, of drives or of bodies, the command, the law, the sensors.
WAYS = (
    *("viscous_friction", "position_gain", "torque_constant", "parallel_spring", "effort_limit"),
    *("command_delay", "sensor_delay", "encoder_offset", "base_tilt", "payload"),
)


@pytest.mark.parametrize("effect", WAYS)
def test_the_mended_model_reproduces_its_gap(servo: Path, tmp_path: Path, effect: str) -> None:
    files = record(servo, tmp_path, EFFECTS[effect])
    result = workflow.diagnose(servo, files, held_out=files[2:], effects=[effect], n_threads=1)
    out = result.save(tmp_path / "out")
    content = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    check_diagnosis(content)
    assert [named["effect"] for named in content["effects"]] == [effect]
    again = workflow.compare(out / "model.xml", files, held_out=files[2:], n_threads=1)
    same_gap(again.gap, result.diagnosis.gap)
    assert again.gap.position.before < result.diagnosis.gap.position.before


def test_several_effects_at_once_reproduce_their_gap(servo: Path, tmp_path: Path) -> None:
    names = ("torque_constant", "sensor_delay", "torque_bias")
    files = record(servo, tmp_path, *(EFFECTS[name] for name in names))
    result = workflow.diagnose(servo, files, effects=names, n_threads=1)
    assert {named.effect for named in result.diagnosis.effects} == set(names)
    out = tmp_path / "out"
    out.mkdir()
    (out / "model.xml").write_text("my own", encoding="utf-8")
    with pytest.raises(InputError, match=r"out/model\.xml: is in the way"):
        result.save(out, overwrite=False)
    assert (out / "model.xml").read_text(encoding="utf-8") == "my own"
    result.save(out)
    same_gap(workflow.compare(out / "model.xml", files, n_threads=1).gap, result.diagnosis.gap)


def test_nothing_more_is_found_on_a_mended_model(servo: Path, tmp_path: Path) -> None:
    late = hide("sensor_delay", delay=0.01)
    files = record(servo, tmp_path, EFFECTS["torque_bias"], late)
    first = workflow.diagnose(servo, files, n_threads=1, effects=["torque_bias", "sensor_delay"])
    assert len(first.diagnosis.effects) == 2
    out = first.save(tmp_path / "out")
    second = workflow.diagnose(out / "model.xml", files, n_threads=1)
    assert second.diagnosis.verdict == "no_gap"
    assert second.diagnosis.effects == ()
    # Mended once more, it is what it was.
    again = second.save(tmp_path / "again")
    assert (again / "model.xml").read_text() == (out / "model.xml").read_text()
    third = workflow.compare(again / "model.xml", files, n_threads=1)
    same_gap(third.gap, first.diagnosis.gap)


def test_a_folder_may_be_written_over_the_model_that_it_mends(servo: Path, tmp_path: Path) -> None:
    files = record(servo, tmp_path, EFFECTS["torque_bias"], EFFECTS["sensor_delay"])
    out = tmp_path / "out"
    first = workflow.diagnose(servo, files, n_threads=1, effects=["torque_bias"])
    first.save(out)
    second = workflow.diagnose(out / "model.xml", files, n_threads=1, effects=["sensor_delay"])
    second.save(out)
    assert [named.effect for named in second.diagnosis.effects] == ["sensor_delay"]
    same_gap(workflow.compare(out / "model.xml", files, n_threads=1).gap, second.diagnosis.gap)


@pytest.mark.parametrize("effect", ["position_gain", "torque_constant"])
def test_scaled_actuators_are_mended_in_their_own_units(
    servo: Path, tmp_path: Path, effect: str
) -> None:
    scaled = tmp_path / "scaled.xml"
    scaled.write_text(SCALED)
    files = record(servo, tmp_path, EFFECTS[effect])
    plain = workflow.diagnose(servo, files, effects=[effect], n_threads=1)
    result = workflow.diagnose(scaled, files, effects=[effect], n_threads=1)
    for one, other in zip(result.diagnosis.effects, plain.diagnosis.effects, strict=True):
        assert one.effect == effect
        assert one.parameters[0].value == pytest.approx(other.parameters[0].value, rel=1e-3)
    out = result.save(tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(out / "model.xml"))
    assert model.actuator_ctrlrange.tolist() == [[-1.0, 1.0]]
    same_gap(workflow.compare(out / "model.xml", files, n_threads=1).gap, result.diagnosis.gap)


# Several models


def manifest(folder: Path, kept: slice, held_out: bool) -> Path:
    """Two P gains with the same friction, and how their recordings are used."""
    text = []
    for kp in (30, 60):
        model = folder / f"kp{kp}.xml"
        model.write_text(SERVO.replace('kp="30"', f'kp="{kp}"'))
        files = record(model, folder, EFFECTS["viscous_friction"], prefix=f"kp{kp}_")[kept]
        names = [file.name for file in files]
        text.append(f'[[experiment]]\nmodel = "{model.name}"')
        text.append(f"recordings = {json.dumps(names[:-1] if held_out else names)}")
        if held_out:
            text.append(f"held_out = {json.dumps(names[-1:])}")
    path = folder / "experiments.toml"
    path.write_text("\n".join(text))
    return path


@pytest.mark.parametrize(
    ("kept", "held_out"),
    [(slice(0, 3), True), (slice(0, 2), False), (slice(0, 1), False)],
    ids=["held out as told", "every third", "blocks of time"],
)
def test_models_of_a_manifest_share_the_effect(tmp_path: Path, kept: slice, held_out: bool) -> None:
    path = manifest(tmp_path, kept, held_out)
    few = ["viscous_friction", "armature"]
    result = workflow.diagnose(path, effects=few, n_threads=1)
    (named,) = result.diagnosis.effects
    assert named.effect == "viscous_friction"
    assert len(named.parameters) == 1
    assert named.parameters[0].value == pytest.approx(0.2, rel=0.1)
    out = result.save(tmp_path / "out")
    assert {file.name for file in out.iterdir()} == {
        "model_kp30.xml",
        "model_kp60.xml",
        "actuators.json",
        "experiments.toml",
        "diagnosis.json",
        "report.html",
        "motions.npz",
    }
    assert "kp30, kp60" in (out / "report.html").read_text(encoding="utf-8")
    check_diagnosis(json.loads((out / "diagnosis.json").read_text(encoding="utf-8")))
    for kp in (30, 60):
        model = mujoco.MjModel.from_xml_path(str(out / f"model_kp{kp}.xml"))
        assert model.actuator_gainprm[0, 0] == kp
        assert model.dof_damping[0] == pytest.approx(0.1 + named.parameters[0].value, rel=1e-6)
    same_gap(workflow.compare(out / "experiments.toml", n_threads=1).gap, result.diagnosis.gap)


def test_models_of_one_name_do_not_overwrite_each_other(servo: Path, tmp_path: Path) -> None:
    text = []
    for k, kp in enumerate((30, 60)):
        folder = tmp_path / f"robot_{k}"
        folder.mkdir()
        (folder / "robot.xml").write_text(SERVO.replace('kp="30"', f'kp="{kp}"'))
        (file, *_) = record(folder / "robot.xml", folder, seconds=1.0, prefix=f"{k}_")
        text.append(
            f'[[experiment]]\nmodel = "robot_{k}/robot.xml"\nrecordings = ["robot_{k}/{file.name}"]'
        )
    (tmp_path / "experiments.toml").write_text("\n".join(text))
    result = workflow.diagnose(tmp_path / "experiments.toml", effects=["payload"], n_threads=1)
    out = result.save(tmp_path / "out")
    gains = [
        mujoco.MjModel.from_xml_path(str(out / name)).actuator_gainprm[0, 0]
        for name in ("model_robot.xml", "model_robot_2.xml")
    ]
    assert gains == [30, 60]
    same_gap(workflow.compare(out / "experiments.toml", n_threads=1).gap, result.diagnosis.gap)


# Where it is written


@pytest.fixture(scope="module")
def saved(servo: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    files = record(servo, tmp_path_factory.mktemp("logs"), seconds=1.0)
    return workflow.diagnose(servo, files, effects=[], n_threads=1).save


def test_files_of_before_are_replaced_and_others_left(
    saved: Callable[[Path], Path], tmp_path: Path
) -> None:
    out = tmp_path / "deep/er/out"
    out.mkdir(parents=True)
    (out / "model.xml").write_text("old")
    (out / "mine.txt").write_text("mine")
    assert saved(out) == out
    assert (out / "mine.txt").read_text() == "mine"
    assert (out / "model.xml").read_text() != "old"
    assert not [path for path in out.iterdir() if path.name.startswith(".")]


def test_a_folder_that_cannot_be_written_is_refused(
    saved: Callable[[Path], Path], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file/sub"):
        with pytest.raises(InputError, match=f"{out}: cannot be written .*--out"):
            saved(out)


def test_nothing_appears_where_writing_fails(
    saved: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: object, **options: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("walkerkit.gap.report.output.write_report", full)
    with pytest.raises(InputError, match="No space left on device"):
        saved(tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_check_folder_makes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    for good in (tmp_path, tmp_path / "new", tmp_path / "new/er", Path("new")):
        check_folder(good)
    for bad in (tmp_path / "file", tmp_path / "file/sub", tmp_path / "file/sub/sub"):
        with pytest.raises(InputError, match=f"{bad}: cannot be written .*file is a file"):
            check_folder(bad)
    with pytest.raises(InputError, match="cannot be written"):
        check_folder(tmp_path / ("long" * 100))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    # Tests may run as root, whom no permission stops.
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(InputError, match=f"no permission to write in {tmp_path}"):
        check_folder(tmp_path / "new")
