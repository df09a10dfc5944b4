"""Findings in other models of the same robot."""

import json
import shutil

import numpy as np
import pytest

from benchmarks.trainers.legs import diagnosed, leg_at
from tests.gap.deliver.robots import AWKWARD, text_for
from walkerkit.gap.deliver import apply
from walkerkit.gap.deliver.patch import differences
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.sidecar import with_sidecar

# Another revision: other units, names and places of actuators, two files, more around the robot.
FLOATING = """<mujoco>
  <compiler angle="radian"/>
  <include file="robot.xml"/>
  <worldbody><geom name="floor" type="plane" size="2 2 1"/></worldbody>
</mujoco>
"""
ROBOT = """<mujoco>
  <worldbody><body name="trunk" pos="0 0 1"><freejoint/><geom size="0.1" mass="3"/>
    <body name="thigh"><joint name="hip" axis="1 0 0" armature="0.01" damping="0.5"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/>
      <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" frictionloss="0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body></body>
  </body></worldbody>
  <actuator><general name="k" joint="knee" gear="2" gainprm="10" biastype="affine"
    biasprm="0 -20 -1"/><position joint="hip" kp="40" kv="1"/></actuator>
</mujoco>
"""


URDF = """<robot name="leg"><link name="thigh"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="shank">
<inertial><origin xyz="0 0 -0.1"/><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="knee" type="continuous"><parent link="thigh"/><child link="shank"/>
<axis xyz="0 1 0"/></joint></robot>"""


@pytest.fixture
def floating(tmp_path):
    folder = tmp_path / "floating"
    folder.mkdir()
    (folder / "scene.xml").write_text(FLOATING)
    (folder / "robot.xml").write_text(ROBOT)
    return folder / "scene.xml"


def tag_changes(before, after):
    """Pairs of lines that differ."""
    pairs = zip(before.splitlines(), after.splitlines(), strict=True)
    return [(one, other) for one, other in pairs if one != other]


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_diagnosed_model_becomes_the_mended_one(name, tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", text_for(name))
    mended = diagnosed(tmp_path / "result", robot, name)
    out = tmp_path / "own" / "new.xml"
    apply(tmp_path / "result", tmp_path / "own" / "leg.xml", out=out)
    again = with_sidecar(load_robot(out), out)
    unlike = differences(again.model, mended.model, ignored=("actuator_ctrlspec",))
    assert not unlike
    assert {j: dict(laws) for j, laws in again.laws.items()} == {
        j: {law: pytest.approx(dict(p), rel=1e-5) for law, p in laws.items()}
        for j, laws in mended.laws.items()
    }
    for joint in robot.joints:
        for one, other in zip(again.joints[joint].drives, mended.joints[joint].drives, strict=True):
            assert (one.slope, one.offset) == pytest.approx((other.slope, other.offset))
        assert vars(again.measured(joint)) == pytest.approx(
            vars(mended.measured(joint)), rel=1e-5, abs=1e-12
        )


def test_a_scene_keeps_all_but_the_attribute(floating, tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    mended = diagnosed(tmp_path / "result", robot, "coulomb_friction", ("knee",))
    done = apply(tmp_path / "result", floating, out=floating.parent / "new.xml")
    assert [path.name for path in done.files] == ["new.xml", "new_robot.xml"]
    ((_, line),) = tag_changes(FLOATING, (floating.parent / "new.xml").read_text())
    assert line.strip() == '<include file="new_robot.xml"/>'
    ((_, line),) = tag_changes(ROBOT, (floating.parent / "new_robot.xml").read_text())
    wanted = float(mended.model.dof_frictionloss[1])
    assert f'frictionloss="{wanted:.6g}"'[:-2] in line
    new = load_robot(floating.parent / "new.xml")
    assert new.model.dof_frictionloss[new.joints["knee"].dof] == pytest.approx(wanted, rel=1e-5)
    assert "was 0.05" in " ".join(done.notes)
    assert "joint knee: frictionloss 0.02 →" in done.changes[0]


def test_what_many_elements_change_alike_is_one_line(tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml")
    diagnosed(tmp_path / "result", robot, "command_delay")
    done = apply(tmp_path / "result", tmp_path / "own" / "leg.xml", out=tmp_path / "new.xml")
    assert len(done.changes) == len({line.partition(": ")[2] for line in done.changes})
    assert all(line.startswith("position hip, knee: ") for line in done.changes)


def test_an_actuator_says_it_in_its_own_units(floating, tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    mended = diagnosed(tmp_path / "result", robot, "position_gain", ("knee",))
    out = tmp_path / "elsewhere" / "scene.xml"
    apply(tmp_path / "result", floating, out=out)
    new = load_robot(out)
    kp = -mended.model.actuator_biasprm[1, 1]
    assert new.joints["knee"].drives[0].stiffness == pytest.approx(kp, rel=1e-5)
    assert (out.parent / "scene.xml").read_text() == FLOATING


def test_play_gets_a_joint_and_a_number_in_each_keyframe(tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    diagnosed(tmp_path / "result", robot, "backlash", ("hip",))
    out = tmp_path / "own" / "new.xml"
    apply(tmp_path / "result", tmp_path / "own" / "leg.xml", out=out)
    model = load_robot(out).model
    assert [model.joint(j).name for j in range(model.njnt)] == ["hip", "hip_play", "knee"]
    np.testing.assert_array_equal(model.key_qpos, [[0.1, 0.0, 0.2]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (AWKWARD.replace('"knee"', '"knie"'), r"no joint 'knee' \(did you mean 'knie'\?\)"),
        (
            AWKWARD.replace('class="leg" joint="knee" kp="25"', 'joint="hip"'),
            "cannot act on 'knee'",
        ),
        (URDF, "no MJCF file"),
    ],
)
def test_what_is_not_the_same_robot_is_refused(text, message, tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    effect = "armature" if text is URDF else "position_gain"
    diagnosed(tmp_path / "result", robot, effect, ("knee",))
    other = tmp_path / "other.xml"
    other.write_text(text)
    with pytest.raises(InputError, match=message):
        apply(tmp_path / "result", other, out=tmp_path / "new.xml")
    assert not (tmp_path / "new.xml").exists()


def test_nothing_is_replaced_unasked(tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    diagnosed(tmp_path / "result", robot, "armature")
    own = tmp_path / "own" / "leg.xml"
    with pytest.raises(InputError, match="--overwrite"):
        apply(tmp_path / "result", own, out=own)
    apply(tmp_path / "result", own, out=own, overwrite=True)
    assert own.read_text() != AWKWARD
    # What is there already is not added once more.
    before = own.read_text()
    apply(tmp_path / "result", own, out=own, overwrite=True)
    assert own.read_text() == before


def test_a_folder_that_is_none_is_refused(tmp_path):
    own = tmp_path / "leg.xml"
    own.write_text(AWKWARD)
    with pytest.raises(InputError, match="no folder of a diagnosis"):
        apply(tmp_path, own, out=tmp_path / "new.xml")
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    diagnosed(tmp_path / "result", robot, "armature")
    with pytest.raises(InputError, match=r"'armatur' was not named there \(did you mean"):
        apply(tmp_path / "result", own, out=tmp_path / "new.xml", effects=["armatur"])
    content = json.loads((tmp_path / "result" / "diagnosis.json").read_text())
    del content["effects"][0]["parameters"][0]["was"]
    (tmp_path / "result" / "diagnosis.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="Diagnose once more"):
        apply(tmp_path / "result", own, out=tmp_path / "new.xml")


def test_the_mount_of_a_robot_that_floats_is_left_out(floating, tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    diagnosed(tmp_path / "result", robot, "base_tilt")
    done = apply(tmp_path / "result", floating, out=floating.parent / "new.xml")
    assert not done.changes
    assert "this one floats" in done.notes[0]


def test_a_delay_of_servos_in_a_model_with_motors_is_told(tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml")
    diagnosed(tmp_path / "result", robot, "command_delay")
    servos = apply(tmp_path / "result", robot.path, out=tmp_path / "own" / "servos.xml")
    assert [note.partition(" act on")[0] for note in servos.notes] == ["the delayed actuators"]
    motors = tmp_path / "own" / "motors.xml"
    knee = '<position joint="knee" kp="30" kv="1"'
    text = robot.path.read_text().replace(knee, '<motor joint="knee"')
    motors.write_text(text)
    note, _ = apply(tmp_path / "result", motors, out=tmp_path / "own" / "new.xml").notes
    assert "joints take position targets" in note
    assert "(knee) take effort targets" in note


def test_what_mjcf_cannot_say_lies_beside(floating, tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    diagnosed(tmp_path / "result", robot, "slew_limit", ("hip",))
    shutil.copy(tmp_path / "result" / "actuators.json", floating.parent)
    done = apply(tmp_path / "result", floating, out=floating.parent / "new.xml")
    assert "hip: law slew_limit" in done.beside[0]
    beside = json.loads((floating.parent / "actuators.json").read_text())
    assert {*beside["models"]} == {"model.xml", "new.xml"}
