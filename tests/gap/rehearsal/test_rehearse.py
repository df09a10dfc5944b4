"""Rehearsals and the demonstration: what they record, what they hide, and that it is found."""

from __future__ import annotations

import functools
import json
import re
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from walkerkit.gap import cli, workflow
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal import demo
from walkerkit.gap.rehearsal.hideable import GROUND, HIDEABLE, NOT_THE_ROBOTS
from walkerkit.gap.rehearsal.rehearse import EXPERIMENTS, LONGEST, RATE, Rehearsal, rehearse
from walkerkit.gap.rehearsal.standing import write_standing
from walkerkit.gap.report.output import check_free
from walkerkit.walkers.leg import LEG_XML

ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" armature="0.01" range="-1 2" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
      <body name="lower" pos="0 0 -0.25">
        <joint name="elbow" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="elbow" kp="20" kv="0.5"/>
    <position joint="shoulder" kp="30" kv="1"/>
  </actuator>
  <keyframe><key name="home" qpos="1.8 0.7"/></keyframe>
</mujoco>
"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return path


@pytest.mark.parametrize(
    "beside",
    [
        {"laws": {"elbow": {"controller_deadband": {"width": 0.01}}}},
        {"measurement": {"elbow": {"encoder_gain": 1.02}}},
    ],
)
def test_what_a_file_mends_beside_the_model_is_not_left_out(
    arm: Path, beside: dict[str, Any]
) -> None:
    entry = {"hold": "zero_order", "command": {}, "measurement": {}, "laws": {}}
    content = {"schema": 1, "effects": [], "models": {arm.name: {**entry, **beside}}}
    (arm.parent / "actuators.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"arm\.xml: actuators\.json .* before it was mended"):
        rehearse(arm, ["none"], seconds=1.0)
    content["models"][arm.name] = entry
    (arm.parent / "actuators.json").write_text(json.dumps(content))
    assert len(rehearse(arm, ["none"], seconds=1.0).recordings) == len(EXPERIMENTS)


def same(one: Rehearsal, other: Rehearsal) -> bool:
    return [str(h) for h in one.hidden] == [str(h) for h in other.hidden] and all(
        np.array_equal(a.columns[name], b.columns[name])
        for a, b in zip(one.recordings, other.recordings, strict=True)
        for name in a.columns
    )


def test_it_records_every_experiment_with_all_signals(arm: Path) -> None:
    rehearsal = rehearse(arm, ["none"], seconds=1.5)
    assert rehearsal.hidden == ()
    assert tuple(recording.name for recording in rehearsal.recordings) == EXPERIMENTS
    for recording in rehearsal.recordings:
        assert set(recording.joints) == {"shoulder", "elbow"}
        assert len(recording.time) == 1.5 * RATE
        assert recording.rate == pytest.approx(RATE)
        for joint in recording.joints:
            for signal in ("position", "velocity", "effort", "position_target"):
                assert recording.signal(joint, signal) is not None


@pytest.mark.parametrize(("timestep", "rate"), [("0.0025", 400.0), ("0.005", 200.0)])
def test_the_rate_is_one_that_the_timestep_allows(arm: Path, timestep: str, rate: float) -> None:
    text = arm.read_text(encoding="utf-8")
    arm.write_text(re.sub(r'timestep="[\d.]+"', f'timestep="{timestep}"', text), encoding="utf-8")
    for recording in rehearse(arm, ["none"], seconds=1.0).recordings:
        assert np.diff(recording.time) == pytest.approx(1 / rate)


def test_targets_stay_around_home_and_inside_the_joints_range(arm: Path) -> None:
    for recording in rehearse(arm, ["none"], seconds=3.0).recordings:
        shoulder = recording.columns["shoulder/position_target"]
        elbow = recording.columns["elbow/position_target"]
        # 35 % of the shoulder's 3 rad around its home at 1.8, which is close to the stop at 2.
        assert 1.8 - 0.525 - 1e-9 <= shoulder.min() < shoulder.max() <= 2.0
        # The elbow has no range.
        assert 0.7 - 0.5 - 1e-9 <= elbow.min() < elbow.max() <= 0.7 + 0.5 + 1e-9


def test_a_seed_gives_the_same_rehearsal_and_another_seed_another(arm: Path) -> None:
    one, again, other = (rehearse(arm, seed=seed, seconds=1.0) for seed in (3, 3, 4))
    assert same(one, again)
    assert not same(one, other)


def test_by_default_one_effect_is_drawn(arm: Path) -> None:
    drawn = [rehearse(arm, seed=seed, seconds=1.0).hidden for seed in range(4)]
    assert {len(hidden) for hidden in drawn} == {1}
    assert len({hidden[0].effect for hidden in drawn} & set(HIDEABLE)) > 2


def test_what_is_hidden_shows_in_the_recordings(arm: Path) -> None:
    nothing = rehearse(arm, ["none"], seed=1, seconds=1.0)
    biased = rehearse(arm, ["torque_bias"], seed=1, seconds=1.0)
    for one, other in zip(nothing.recordings, biased.recordings, strict=True):
        moved = 0.0
        for joint in one.joints:
            target = f"{joint}/position_target"
            np.testing.assert_array_equal(one.columns[target], other.columns[target])
            position = f"{joint}/position"
            moved += float(np.abs(one.columns[position] - other.columns[position]).mean())
        assert moved > 1e-3


def test_several_effects_can_be_hidden_at_once(arm: Path) -> None:
    hidden = rehearse(arm, ["torque_bias", "none", "payload"], seconds=1.0).hidden
    assert [effect.effect for effect in hidden] == ["torque_bias", "payload"]


def test_all_of_the_catalogue_can_be_hidden_but_what_no_robot_has() -> None:
    assert {*HIDEABLE, *GROUND, *NOT_THE_ROBOTS} == {*CATALOGUE}
    assert [*NOT_THE_ROBOTS] == ["timestep"]
    with pytest.raises(InputError, match="the simulation's, not the robot's") as refused:
        rehearse("leg.xml", ["timestep"])
    assert "did you mean" not in str(refused.value)


@pytest.mark.parametrize("effect", GROUND)
def test_the_ground_can_be_hidden_under_a_robot_that_keeps_standing(
    tmp_path: Path, effect: str
) -> None:
    path = write_standing(tmp_path)
    found = rehearse(path, [effect], seed=1, seconds=1.0)
    assert [one.effect for one in found.hidden] == [effect]
    home = mujoco.MjModel.from_xml_path(str(path)).key_qpos[0, 2]
    for recording in found.recordings:
        height = recording.columns["base/position_z"]
        assert height.min() > 0.85 * home
        assert recording.columns["base/quaternion_w"].min() > 0.9


def test_a_walker_is_hung_up_unless_the_ground_is_hidden(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_standing(tmp_path)
    (tmp_path / "standing.py").write_text(
        "from walkerkit.walkers import MjcfWalker\n"
        "def robot(): return MjcfWalker.from_file('quadruped_standing.xml')\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    hung = rehearse("standing:robot", ["none"], seconds=1.0).recordings[0]
    assert not any(name.startswith("base/") for name in hung.columns)
    stood = rehearse("standing:robot", ["ground_friction"], seconds=1.0).recordings[0]
    assert "base/position_z" in stood.columns


def test_what_cannot_be_rehearsed_is_refused(arm: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'grit' cannot be hidden.*choose from none, viscous"):
        rehearse(arm, ["grit"])
    for seconds in (0.0, 0.99, -1.0, float("nan"), float("inf"), 1.01 * LONGEST):
        with pytest.raises(InputError, match=f"seconds is {seconds:g}"):
            rehearse(arm, seconds=seconds)
    with pytest.raises(InputError, match="no such model file"):
        rehearse(tmp_path / "none.xml")
    muscle = tmp_path / "muscle.xml"
    drive = 'muscle joint="elbow" lengthrange="-1 1"'
    muscle.write_text(ARM.replace('position joint="elbow" kp="20" kv="0.5"', drive))
    with pytest.raises(InputError, match="neither a plain servo nor a plain motor"):
        rehearse(muscle)


# The demonstration


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Experiments of 2 s instead of 10, to be quick."""
    monkeypatch.setattr(demo, "rehearse", functools.partial(rehearse, seconds=2.0))


@pytest.mark.usefixtures("short")
def test_the_demonstration_finds_what_it_hid(monkeypatch: pytest.MonkeyPatch) -> None:
    # The whole catalogue is the benchmark's: `python -m benchmarks demo_seeds`.
    few = ("sensor_delay", "command_delay", "viscous_friction", "torque_bias")
    monkeypatch.setattr(demo, "diagnose", functools.partial(workflow.diagnose, effects=few))
    told: list[str] = []
    result, rehearsal = demo.run(
        seed=1, hide=["sensor_delay"], n_threads=1, progress=lambda stage, done: told.append(stage)
    )
    (hidden,) = rehearsal.hidden
    (named,) = result.diagnosis.effects
    assert named.effect == hidden.effect == "sensor_delay"
    assert named.parameters[0].value == pytest.approx(hidden.values["delay"], rel=0.1)
    assert result.diagnosis.verdict == "explained"
    assert set(result.diagnosis.recordings) == set(EXPERIMENTS)
    assert result.problem.robots[0].source == str(LEG_XML)
    assert told[0] == "recording the leg"


@pytest.mark.usefixtures("short")
def test_the_demonstration_raises_no_false_alarm() -> None:
    result, rehearsal = demo.run(seed=0, hide=["none"], n_threads=1)
    assert rehearsal.hidden == ()
    assert result.diagnosis.effects == ()
    assert result.diagnosis.verdict == "no_gap"


@pytest.mark.usefixtures("short")
def test_the_command_says_what_was_hidden_and_where_to_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["demo", "--hide", "none", "--seed", "2", "--out", str(out), "--threads", "1"]
    monkeypatch.setattr(sys, "argv", ["walkerkit", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    captured = capsys.readouterr()
    assert not ended.value.code
    assert captured.err == ""
    *_, hidden, look = captured.out.splitlines()
    assert hidden == "What was hidden: nothing"
    assert look == str(out / "report.html")
    assert json.loads((out / "diagnosis.json").read_text())["verdict"] == "no_gap"
    assert {"report.html", "model.xml", "actuators.json"} <= {file.name for file in out.iterdir()}
    # Whoever wants to can do the same by hand.
    files = [out / "recordings" / f"{name}.csv" for name in EXPERIMENTS]
    again = workflow.compare(out / "leg.xml", files, n_threads=1)
    content = json.loads((out / "diagnosis.json").read_text())
    assert again.gap.position.before == pytest.approx(content["gap"]["before"], rel=1e-5)
    # The next demo may replace all of it, and nothing else may.
    files = [out / demo.LEG, *(out / name for name in demo.FILES.values())]
    assert all(file.is_file() for file in files)
    own = [file.relative_to(out).as_posix() for file in files] + ["model.xml"]
    check_free(out, own, kind=demo.KIND, overwrite=False)
    with pytest.raises(InputError, match=r"leg.xml: is in the way"):
        check_free(out, own, kind="rehearsal", overwrite=False)


@pytest.mark.parametrize("mine", ["leg.xml", "recordings/steps.csv"])
def test_a_demo_leaves_files_of_the_users_own_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mine: str
) -> None:
    def work(*arguments: object, **options: object) -> None:
        raise AssertionError("worked in vain")

    monkeypatch.setattr(demo, "rehearse", work)
    (tmp_path / mine).parent.mkdir(exist_ok=True)
    (tmp_path / mine).write_text("mine")
    with pytest.raises(InputError, match=rf"{mine}: is in the way.*--overwrite"):
        demo.run(out=tmp_path)
    assert (tmp_path / mine).read_text() == "mine"


def test_joints_that_nothing_drives_are_logged(tmp_path: Path) -> None:
    path = tmp_path / "cart.xml"
    path.write_text(
        """<mujoco><option timestep="0.002"/><worldbody><body>
        <joint name="cart" type="slide" axis="1 0 0" damping="1"/><geom size="0.1" mass="2"/>
        <body><joint name="pole" axis="0 1 0" damping="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02" mass="0.3"/></body>
        </body></worldbody>
        <actuator><position joint="cart" kp="300" kv="30"/></actuator></mujoco>""",
        encoding="utf-8",
    )
    for recording in rehearse(path, ["none"], seconds=1.0).recordings:
        assert set(recording.joints) == {"cart", "pole"}
        position, velocity = (recording.columns[f"pole/{s}"] for s in ("position", "velocity"))
        assert np.ptp(position) > 0.01
        slope = np.gradient(position, recording.time)
        assert np.corrcoef(slope[20:-20], velocity[20:-20])[0, 1] > 0.8
        assert "pole/effort" not in recording.columns
