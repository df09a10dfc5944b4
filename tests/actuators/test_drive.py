"""Drives: the control that asks for a target is found from MuJoCo's own forces, law by law."""

import mujoco
import numpy as np
import pytest

from walkerkit.actuators.drive import drives_of_joint

ARM = """
<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
  <body><joint name="other" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.2"/>
    <body pos="0 0 -0.3"><joint name="j" type="{type}" axis="0 1 0"/><geom size="0.1"/></body>
  </body>
</worldbody>
<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>
<actuator>{actuators}</actuator></mujoco>
"""

SERVOS = {
    "position": '<position joint="j" kp="40" kv="3"/>',
    "position, geared": '<position joint="j" kp="4" kv="0.3" gear="-2.5"/>',
    "position, filtered": '<position joint="j" kp="40" timeconst="0.1"/>',
    "velocity": '<velocity joint="j" kv="3"/>',
    "velocity, geared": '<velocity joint="j" kv="0.3" gear="-2.5"/>',
    "scaled position": (
        '<general joint="j" biastype="affine" gainprm="32" biasprm="8 -40 -2" ctrlrange="-1 1"/>'
    ),
    "scaled position, geared": (
        '<general joint="j" gear="3" biastype="affine" gainprm="-5" biasprm="0.7 -4"/>'
    ),
    "scaled velocity": '<general joint="j" biastype="affine" gainprm="9" biasprm="1.5 0 -3"/>',
    "in the parent's frame": '<position jointinparent="j" kp="40"/>',
}
MOTORS = {
    "motor": '<motor joint="j"/>',
    "motor, geared": '<motor joint="j" gear="-9"/>',
    "general": '<general joint="j" gainprm="0.1" gear="7"/>',
    "with a bias": '<general joint="j" gainprm="2" biastype="affine" biasprm="0.8"/>',
}
UNREADABLE = {
    "muscle": '<muscle joint="j" lengthrange="0 1"/>',
    "motor with losses": '<dcmotor joint="j" motorconst="0.1" resistance="1"/>',
    "integrator": '<intvelocity joint="j" kp="4" actrange="-1 1"/>',
    "damper": '<damper joint="j" kv="1" ctrlrange="0 1"/>',
    "several inputs": '<pid joint="j" kp="10" input="pos vel ff"/>',
    "no gain": '<general joint="j" gainprm="0" biastype="affine" biasprm="0 -3"/>',
    "tendon": '<position tendon="t" kp="4"/>',
    "another joint": '<position joint="other" kp="4"/>',
}


def load(actuators, kind="hinge"):
    model = mujoco.MjModel.from_xml_string(ARM.format(actuators=actuators, type=kind))
    return model, model.joint("j")


def effort(model, joint, control, q, qd):
    """The drives' effort on the joint, from MuJoCo, with activations settled at the control."""
    data = mujoco.MjData(model)
    data.ctrl[:] = control
    if model.na:
        data.act[:] = control
    data.qpos[joint.qposadr], data.qvel[joint.dofadr] = q, qd
    mujoco.mj_forward(model, data)
    return float(data.qfrc_actuator[joint.dofadr[0]])


@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("actuator", SERVOS.values(), ids=SERVOS)
def test_control_of_a_target_is_where_the_servo_rests(actuator, kind):
    model, joint = load(actuator, kind)
    (drive,) = drives_of_joint(model, joint.id)
    for target in (-0.4, 0.0, 0.7):
        control = drive.control(target)
        at = (target, 0.0) if drive.kind == "position" else (0.3, target)
        assert effort(model, joint, control, *at) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("actuator", MOTORS.values(), ids=MOTORS)
def test_control_of_an_effort_gives_it(actuator):
    model, joint = load(actuator)
    (drive,) = drives_of_joint(model, joint.id)
    assert drive.kind == "effort"
    constant = effort(model, joint, 0.0, 0.0, 0.0)
    for wanted in (-3.0, 0.5):
        made = effort(model, joint, drive.control(wanted), 0.2, 1.0)
        assert made - constant == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("actuator", (SERVOS | MOTORS).values(), ids=SERVOS | MOTORS)
def test_stiffness_and_damping_are_finite_differences_of_the_effort(actuator):
    model, joint = load(actuator)
    (drive,) = drives_of_joint(model, joint.id)
    slope_q, slope_qd = (
        effort(model, joint, 0.3, 0.2 + dq, 0.1 + dqd)
        - effort(model, joint, 0.3, 0.2 - dq, 0.1 - dqd)
        for dq, dqd in ((0.5, 0.0), (0.0, 0.5))
    )
    np.testing.assert_allclose(
        [drive.stiffness, drive.damping], [-slope_q, -slope_qd], rtol=1e-12, atol=1e-12
    )


def test_many_targets_at_once_are_each_alone():
    model, joint = load(SERVOS["scaled position, geared"])
    (drive,) = drives_of_joint(model, joint.id)
    targets = np.random.default_rng(0).normal(size=(3, 4))
    together = drive.control(targets)
    for index, target in np.ndenumerate(targets):
        assert together[index] == drive.control(float(target))


def test_control_in_joint_units_keeps_its_meaning_beside_a_constant_effort():
    model, joint = load(
        '<general joint="j" input="pos" gear="2" biastype="affine" gainprm="9" biasprm="1.5 -9"/>'
    )
    (drive,) = drives_of_joint(model, joint.id)
    assert drive.in_joint_units
    assert drive.control(0.3) == pytest.approx(0.6)
    # At its target the servo gives the constant effort alone.
    assert effort(model, joint, drive.control(0.3), 0.3, 0.0) == pytest.approx(2 * 1.5)


@pytest.mark.parametrize("actuator", UNREADABLE.values(), ids=UNREADABLE)
def test_other_laws_and_other_targets_are_left_out(actuator):
    model, joint = load(actuator)
    assert drives_of_joint(model, joint.id) == ()


def test_order_is_the_models_and_controls_are_addressed_behind_several_inputs():
    model, joint = load(
        '<pid joint="other" kp="10" input="pos vel ff"/>'
        '<motor joint="j" gear="5"/><position joint="j" kp="8"/>'
    )
    motor, servo = drives_of_joint(model, joint.id)
    assert (motor.kind, servo.kind) == ("effort", "position")
    assert (motor.actuator, servo.actuator) == (1, 2)
    control = np.zeros(model.nu)
    control[motor.ctrl], control[servo.ctrl] = motor.control(2.0), servo.control(0.5)
    assert effort(model, joint, control, 0.1, 0.0) == pytest.approx(2.0 + 8 * (0.5 - 0.1))


def test_an_actuator_behind_one_with_several_inputs():
    model, joint = load(
        '<pid joint="other" kp="10" input="pos vel ff"/>'
        '<position joint="j" kp="7" gear="3" ctrlrange="-1 2"/>'
    )
    (drive,) = drives_of_joint(model, joint.id)
    assert (drive.actuator, drive.ctrl, drive.slope) == (1, 3, 3.0)
