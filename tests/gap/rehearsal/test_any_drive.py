"""Rehearsals of robots with light, damped joints, and of robots under torque."""

import mujoco
import numpy as np
import pytest

from walkerkit import gap
from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hardware_drive import Drives
from walkerkit.gap.rehearsal.rehearse import rehearse

ARM = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="{integrator}"/>
  <worldbody><body pos="0 0 1"><joint name="shoulder" axis="0 1 0" range="-1.6 1.6" {joint}/>
    <geom type="capsule" fromto="0 0 0 0 0 -{length}" size="{size}" mass="{mass}"/>
    <body pos="0 0 -{length}"><joint name="elbow" axis="0 1 0" range="-1.6 1.6" {joint}/>
      <geom type="capsule" fromto="0 0 0 0 0 -{length}" size="{size}" mass="{mass}"/></body></body>
  </worldbody><actuator>{drive}</actuator></mujoco>
"""
SHOULDER_AND_ELBOW = ("shoulder", "elbow")
ORDINARY = {"length": 0.25, "size": 0.02, "mass": 0.5, "joint": 'damping="0.1" armature="0.01"'}
# A finger: grams, no armature, and a damping that stops it within a hundredth of a step.
LIGHT = {"length": 0.03, "size": 0.006, "mass": 0.003}
DRIVES = {
    "motor": '<motor joint="{joint}" gear="-12" ctrlrange="-1 1" ctrllimited="true"/>',
    "velocity": '<velocity joint="{joint}" kv="0.4" gear="2" forcerange="-20 20"/>',
    "general": '<general joint="{joint}" gainprm="8" biastype="affine" biasprm="0 -30 -1"/>',
}


def written(folder, drive, integrator="implicitfast", **numbers):
    path = folder / "robot.xml"
    drives = "".join(drive.format(joint=joint) for joint in SHOULDER_AND_ELBOW)
    path.write_text(ARM.format(integrator=integrator, drive=drives, **numbers), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("integrator", "joint", "drive"),
    [
        ("Euler", 'damping="0.1"', '<position joint="{joint}" kp="1"/>'),
        ("implicitfast", 'damping="0.02"', '<position joint="{joint}" kp="2" kv="0.05"/>'),
        ("implicitfast", 'damping="0.001"', '<position joint="{joint}" kp="1" kv="0.1"/>'),
    ],
)
def test_light_joints_with_much_damping_are_rehearsed(tmp_path, integrator, joint, drive):
    path = written(tmp_path, drive, integrator, joint=joint, **LIGHT)
    model = mujoco.MjModel.from_xml_path(str(path))
    damping = model.dof_damping - model.actuator_biasprm[:, 2]
    assert (damping * model.opt.timestep * model.dof_invweight0 > 8).all()  # b h/I
    logs = rehearse(path, [], seed=2, seconds=1).recordings
    found = gap.compare(path, logs)
    assert found.gap.position.before < 3e-3  # rad, of half a radian
    moved = [np.ptp(log.columns[f"{j}/position"]) for log in logs for j in SHOULDER_AND_ELBOW]
    assert min(moved) > 0.2
    assert rehearse(path, ["viscous_friction"], seed=2, seconds=1).hidden


@pytest.mark.parametrize("kind", DRIVES)
def test_what_is_logged_of_any_drive_leaves_no_gap_in_its_own_model(tmp_path, kind):
    path = written(tmp_path, DRIVES[kind], **ORDINARY)
    logs = rehearse(path, [], seed=3, seconds=3).recordings
    target = {"motor": "effort_target", "velocity": "velocity_target"}.get(kind, "position_target")
    for log in logs:
        for joint in SHOULDER_AND_ELBOW:
            assert {
                f"{joint}/{signal}" for signal in ("position", "velocity", "effort", target)
            } <= {*log.columns}
            assert np.ptp(log.columns[f"{joint}/position"]) > 0.2
    assert len(logs[0].columns) == 8
    # A drive's damping acts on what its encoder reads, whose noise moves the joint.
    assert gap.compare(path, logs).gap.position.before < 1e-3  # rad


def test_a_motor_is_sent_no_more_than_its_control_takes(tmp_path):
    weak = DRIVES["motor"].replace('gear="-12"', 'gear="-0.5"')
    path = written(tmp_path, weak, **ORDINARY)
    drives = Drives(mujoco.MjModel.from_xml_path(str(path)))
    np.testing.assert_allclose(drives.command_range, [[-0.5, -0.5], [0.5, 0.5]])
    (log, *_) = rehearse(path, [], seed=3, seconds=2).recordings
    assert np.abs(log.columns["shoulder/effort_target"]).max() <= 0.5


def test_friction_hidden_in_a_robot_under_torque_is_named(tmp_path):
    path = written(tmp_path, DRIVES["motor"], **ORDINARY)
    rehearsal = rehearse(path, ["coulomb_friction"], seed=3, seconds=2)
    found = gap.diagnose(
        path, rehearsal.recordings, effects=["coulomb_friction", "torque_constant", "armature"]
    )
    assert found.diagnosis.effects[0].effect == "coulomb_friction"
    (hidden,) = rehearsal.hidden
    for parameter in found.diagnosis.effects[0].parameters:
        assert parameter.value == pytest.approx(
            hidden.values[f"{parameter.place}/frictionloss"], rel=0.2
        )


def test_what_only_servos_have_is_not_hidden_in_motors(tmp_path):
    path = written(tmp_path, DRIVES["motor"], **ORDINARY)
    with pytest.raises(InputError, match=r"position_gain.*a robot of position servos"):
        rehearse(path, ["position_gain"], seconds=2)


def test_a_robot_that_is_unstable_by_itself_is_refused_in_one_line(tmp_path):
    # A spring that pushes away harder than the servo holds.
    path = written(
        tmp_path,
        '<position joint="{joint}" kp="1"/>',
        **{**ORDINARY, "joint": 'armature="0.01" stiffness="-4000"'},
    )
    text = path.read_text(encoding="utf-8").replace('range="-1.6 1.6"', "")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="nothing hidden the rehearsed robot goes unstable"):
        rehearse(path, [], seconds=1)
