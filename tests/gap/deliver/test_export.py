"""Diagnoses in the words of trainers."""

import ast
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks.trainers.legs import LEG, diagnosed, leg_at
from tests.gap.deliver.robots import STANDING, text_for
from walkerkit.gap.deliver import apply, export
from walkerkit.gap.deliver.findings import read_findings
from walkerkit.gap.deliver.randomization_code import posterior, randomization_code
from walkerkit.gap.deliver.trainers import TRAINERS, table, way
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.simulation.load_robot import load_robot


@pytest.fixture
def saved(tmp_path):
    def make(name, sites=None, text=None):
        robot = leg_at(tmp_path / "own" / "leg.xml", text or text_for(name))
        mended = diagnosed(tmp_path / "result", robot, name, sites)
        return tmp_path / "result", mended

    return make


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_function_is_there_where_the_table_says_so(name, saved):
    folder, _ = saved(name)
    # One trainer each, in turn, and all that have it in a way of their own.
    ways = {way(name, trainer).kind: trainer for trainer in TRAINERS}
    others = {ways.get("config", "mjx"), ways.get("function", "mjx")}
    for trainer in {TRAINERS[[*CATALOGUE].index(name) % 4], *others}:
        done = export(folder, trainer)
        names = {path.name for path in done.files}
        assert {"model.xml", "randomization.py", "export.json"} <= names
        own = way(name, trainer)
        code = done.folder / "drivetrain.py"
        if own.kind == "function":
            function = own.says.split("`")[1]
            assert function in (name, "mjx_step")
            assert f"def {function}(" in code.read_text()
        elif own.kind == "config" and not code.exists():
            assert "drivetrain" not in own.says
        assert bool(done.lost) == (own.kind == "cannot")
        for path in done.folder.glob("*.py"):
            ast.parse(path.read_text())


def test_mjx_gets_no_delay_that_it_would_ignore(saved):
    folder, mended = saved("command_delay")
    done = export(folder, "mjx")
    model = load_robot(done.folder / "model.xml").model
    assert not model.actuator_delay.any()
    assert mended.model.actuator_delay.any()
    assert "'delay': array([" in (done.folder / "drivetrain.py").read_text()
    # Warp simulates it.
    assert load_robot(export(folder, "warp").folder / "model.xml").model.actuator_delay.any()


@pytest.mark.parametrize("limit", [' forcerange="-20 20"', ""])
def test_mjx_is_told_how_to_stop_damping_at_a_limit(saved, limit):
    folder, _ = saved("payload", text=LEG.replace(' forcerange="-20 20"', limit))
    done = export(folder, "mjx")
    code = done.folder / "drivetrain.py"
    assert code.exists() == bool(limit)
    assert any("call mjx_step" in note for note in done.notes) == bool(limit)
    if limit:
        assert "IMPLICIT_SERVOS = array([1.0])" in code.read_text()
        assert "LAWS = [\n]" in code.read_text()


def test_mjlab_gets_lags_in_steps_and_is_told_what_rounding_loses(saved):
    folder, mended = saved("command_delay")
    done = export(folder, "mjlab")
    text = (done.folder / "robot.py").read_text()
    delay = mended.model.actuator_delay[0]
    assert f"delay_min_lag={round(delay / 0.002)}" in text
    assert done.notes[0].startswith("the delay of hip, knee, ")  # one note for both
    assert "becomes" in done.notes[0]
    assert not (done.folder / "drivetrain.py").exists()


def test_mjlab_is_told_what_a_servo_takes_that_is_no_plain_element(saved):
    folder, mended = saved("encoder_gain")
    assert (mended.model.actuator_biasprm[:, 1] != -mended.model.actuator_gainprm[:, 0]).all()
    text = (export(folder, "mjlab").folder / "robot.py").read_text()
    assert "command_field='position'" in text


def test_the_robot_that_floats_is_exported_with_what_was_found_while_it_hung(saved, tmp_path):
    folder, mended = saved("command_delay")
    standing = leg_at(tmp_path / "standing" / "leg.xml", STANDING)
    hung = export(folder, "mjx")
    assert "--model" in hung.notes[-1]
    done = export(folder, "mjx", model=standing.path, out=tmp_path / "mjx")
    assert not any("--model" in note for note in done.notes)
    model = load_robot(done.folder / "model.xml").model
    assert (model.nq, model.nkey) == (standing.model.nq, standing.model.nkey)
    assert "interp" not in (done.folder / "model.xml").read_text()  # of MuJoCo 3.5
    code = (done.folder / "drivetrain.py").read_text()
    assert "QPOS = [7, 8]" in code
    assert "DOFS = [6, 7]" in code
    assert "QPOS = [0, 1]" in (hung.folder / "drivetrain.py").read_text()
    assert f"'delay': array([{mended.model.actuator_delay[0]:.6g}, " in code
    warp = load_robot(export(folder, "warp", model=standing.path).folder / "model.xml").model
    np.testing.assert_allclose(warp.actuator_delay, mended.model.actuator_delay, rtol=1e-5)


def test_a_robot_that_floats_starts_where_its_keyframe_has_it_on_the_ground_of_the_scene(
    saved, tmp_path
):
    folder, _ = saved("command_delay")
    floor = STANDING.replace("<option ", '<option cone="elliptic" impratio="10" ')
    standing = leg_at(tmp_path / "standing" / "leg.xml", floor)
    done = export(folder, "mjlab", model=standing.path)
    text = (done.folder / "robot.py").read_text()
    assert "pos=(0.0, 0.0, 0.52)" in text
    assert "joint_pos={'hip': 0.1, 'knee': 0.2}" in text
    assert "cone='elliptic'" in text
    assert "impratio=10.0" in text
    assert "mjGEOM_PLANE" in text  # is taken out there
    assert any("ground of model.xml is left out" in note for note in done.notes)
    assert "DELAYS = {'hip': 0.0" in text
    done = export(folder, "isaaclab", model=standing.path)
    text = (done.folder / "actuators.py").read_text()
    assert "'joint_pos': {'hip': 0.1, 'knee': 0.2}" in text
    assert "convert_mjcf.py model.xml robot.usd --import-sites\n" in text
    model = mujoco.MjModel.from_xml_path(str(done.folder / "model.xml"))
    assert not (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE).any()
    done = export(folder, "isaaclab", out=tmp_path / "hung")
    assert "--import-sites --fix-base" in (done.folder / "actuators.py").read_text()


BOXES = {  # what of the leg is a box, and what MJX makes of it
    "box": '<geom name="box" type="box" size="0.1 0.1 0.1" pos="1 0 0" mass="0.1"/>',
    "unnamed": '<geom name="box" type="box" size="0.1 0.1 0.1" pos="1 0 0" mass="0.1"/>',
    "pair": '<geom name="box" type="box" size="0.1 0.1 0.1" contype="0" conaffinity="0"/>',
}


@pytest.mark.parametrize("how", BOXES)
def test_mjx_gets_no_contacts_that_it_would_not_load(tmp_path, how):
    text = LEG.replace('<geom name="foot" type="capsule"', '<geom name="foot" type="cylinder"')
    body = '<body name="other" pos="1 0 0"><joint name="slide" type="slide"/>'
    body = f"{body}{BOXES[how]}<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/></body>"
    if how == "unnamed":
        body = body.replace(' name="other"', "")
    text = text.replace("</worldbody>", f"{body}</worldbody>")
    if how == "pair":
        contact = '<contact><pair geom1="box" geom2="foot"/></contact>'
        text = text.replace("<actuator>", f"{contact}<actuator>")
    robot = leg_at(tmp_path / "own" / "leg.xml", text)
    diagnosed(tmp_path / "result", robot, "armature", ("knee",))
    if how != "box":
        wanted = r"<pair> of geoms 'foot' and 'box'" if how == "pair" else "body without a name"
        with pytest.raises(InputError, match=wanted):
            export(tmp_path / "result", "mjx")
        return
    done = export(tmp_path / "result", "mjx")
    assert "contacts of 'shank and other': MJX has none" in done.lost[0]
    model = load_robot(done.folder / "model.xml").model
    shank, other = (model.body(name).id for name in ("shank", "other"))
    assert (shank << 16) + other in model.exclude_signature
    assert not export(tmp_path / "result", "warp").lost


def test_a_limit_that_was_set_for_the_recordings_can_stay_there(saved, tmp_path):
    folder, _ = saved("effort_limit")
    own = tmp_path / "own" / "leg.xml"
    done = export(folder, "warp", model=own)
    assert any("no property of the robot" in note for note in done.notes)
    notes = apply(folder, own, out=tmp_path / "own" / "new.xml").notes
    assert any("no property of the robot" in note for note in notes)
    content = json.loads((folder / "diagnosis.json").read_text())
    content["effects"].append(json.loads(json.dumps(content["effects"][0])))
    content["effects"][1] |= {"effect": "armature", "parameters": []}
    (folder / "diagnosis.json").write_text(json.dumps(content))
    note = next(n for n in export(folder, "warp", overwrite=True).notes if "no property" in n)
    assert "leave it out then, with --effect armature" in note
    with pytest.raises(InputError, match=r"--effect armature: the diagnosed model has all"):
        export(folder, "warp", effects=["armature"], out=tmp_path / "other")


def test_one_effect_is_exported_alone(saved, tmp_path):
    folder, _ = saved("effort_limit")
    content = json.loads((folder / "diagnosis.json").read_text())
    beside = diagnosed(tmp_path / "drag", leg_at(tmp_path / "own" / "leg.xml"), "armature")
    other = json.loads((tmp_path / "drag" / "diagnosis.json").read_text())["effects"]
    content["effects"] += other
    content.pop("correlation", None)
    (folder / "diagnosis.json").write_text(json.dumps(content))
    own = leg_at(tmp_path / "own" / "leg.xml")
    done = export(folder, "warp", model=own.path, effects=["armature"])
    model = load_robot(done.folder / "model.xml").model
    np.testing.assert_allclose(model.dof_armature, beside.model.dof_armature, rtol=1e-5)
    np.testing.assert_array_equal(model.actuator_forcerange, own.model.actuator_forcerange)
    assert "effort_limit" not in (done.folder / "randomization.py").read_text()


def test_the_memory_of_delayed_actuators_is_told(saved):
    folder, _ = saved("command_delay")
    assert any("init_ctrl_history" in note for note in export(folder, "warp").notes)
    assert not any("init_ctrl_history" in note for note in export(folder, "mjx").notes)


def test_the_mount_is_not_exported_with_a_robot_that_floats(saved, tmp_path):
    folder, _ = saved("base_tilt")
    standing = leg_at(tmp_path / "standing" / "leg.xml", STANDING)
    content = json.loads((folder / "diagnosis.json").read_text())
    content["correlation"] = np.eye(len(content["effects"][0]["parameters"])).tolist()
    (folder / "diagnosis.json").write_text(json.dumps(content))
    done = export(folder, "warp", model=standing.path)
    assert "this one floats" in done.notes[0]
    assert "RANGES = {\n}" in (done.folder / "randomization.py").read_text()
    assert json.loads((done.folder / "export.json").read_text())["effects"] == {}
    other = tmp_path / "other.xml"
    other.write_text(STANDING.replace('"knee"', '"knie"'))
    folder, _ = diagnosed_knee(tmp_path)
    with pytest.raises(InputError, match="did you mean 'knie'"):
        export(folder, "warp", model=other)


def diagnosed_knee(tmp_path):
    robot = leg_at(tmp_path / "hung" / "leg.xml", text_for("armature"))
    return tmp_path / "knee", diagnosed(tmp_path / "knee", robot, "armature", ("knee",))


def test_a_torque_speed_line_is_a_config(saved):
    folder, _ = saved("torque_speed_limit", ("knee",))
    text = (export(folder, "mjlab").folder / "robot.py").read_text()
    assert "DcMotorActuatorCfg" in text
    assert "REPLACED = ('knee',)" in text
    text = (export(folder, "isaaclab").folder / "actuators.py").read_text()
    assert "'knee': DCMotorCfg(" in text
    assert "'hip': IdealPDActuatorCfg(" in text


def test_what_would_be_ignored_without_a_word_is_refused(tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", SPRUNG)
    diagnosed(tmp_path / "result", robot, "armature")
    with pytest.raises(InputError, match="springs of joints that are not linear"):
        export(tmp_path / "result", "mjx")
    with pytest.raises(InputError, match=r"'mjxx'|mjxx: is no trainer"):
        export(tmp_path / "result", "mjxx")
    export(tmp_path / "result", "warp")
    with pytest.raises(InputError, match="--overwrite"):
        export(tmp_path / "result", "warp")


SPRUNG = """<mujoco><worldbody><body><joint name="j" axis="0 1 0" stiffness="1 2"/>
<geom size="0.1" mass="1" pos="0.1 0 0"/></body></worldbody>
<actuator><position joint="j" kp="9"/></actuator></mujoco>"""


def test_draws_are_correlated_and_within_bounds(saved, tmp_path):
    folder, _ = saved("viscous_friction")
    content = json.loads((folder / "diagnosis.json").read_text())
    content["correlation"] = [[1.0, -0.9], [-0.9, 1.0]]
    first, second = content["effects"][0]["parameters"]
    first |= {"std": 0.5, "lower": -1.0, "upper": 0.3}
    (folder / "diagnosis.json").write_text(json.dumps(content))
    known = posterior(read_findings(folder))
    drawn = known.draw(np.random.default_rng(0), 4000)
    moved = first["is"] - first["value"]
    assert drawn[:, 0].max() <= 0.3 + moved
    np.testing.assert_allclose(np.mean(drawn[:, 1]), second["is"], rtol=0.01)
    assert np.corrcoef(drawn.T)[0, 1] < -0.6
    made = {}
    exec(randomization_code(known, "warp"), made)
    again = made["draw"](np.random.default_rng(0), 4000)
    np.testing.assert_allclose(again["viscous_friction", "hip", "damping"], drawn[:, 0], rtol=1e-9)


def test_correlations_of_other_numbers_are_refused(saved):
    folder, _ = saved("viscous_friction")
    content = json.loads((folder / "diagnosis.json").read_text())
    content["correlation"] = [[0.1, 1.0], [1.0, 0.1]]
    (folder / "diagnosis.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"diagnosis\.json: its correlation is not symmetric"):
        posterior(read_findings(folder))


def test_what_is_no_estimate_is_not_drawn(saved):
    folder, _ = saved("viscous_friction")
    content = json.loads((folder / "diagnosis.json").read_text())
    first, second = content["effects"][0]["parameters"]
    first["at_bound"], second["std"] = True, None
    (folder / "diagnosis.json").write_text(json.dumps(content))
    known = posterior(read_findings(folder))
    assert known.keys == ()
    assert len(known.fixed) == 2
    exec(randomization_code(known, "warp"), made := {})
    assert made["draw"](np.random.default_rng(0), 3) == {}


def test_the_documented_table_is_the_one_in_the_code(repository: Path):
    assert table() in (repository / "docs" / "export.md").read_text(encoding="utf-8")
