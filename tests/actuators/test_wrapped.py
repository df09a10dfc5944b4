"""Actuators that the robot's XML has: found, read, and driven in units of the joint."""

from __future__ import annotations

import numpy as np
import pytest
from dm_control import mjcf
from dm_control.locomotion.walkers import scaled_actuators

from tests.actuators.contract import EXPRESSIONS, DeterministicContract
from tests.actuators.reference import clip, pd
from tests.actuators.robots import compiled, robot
from walkerkit.actuators import (
    ActuatorCmd,
    BuiltinMotorActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
    XmlVelocityActuatorCfg,
    add_effort_actuator,
)


class TestPosition(DeterministicContract):
    """A plain one, a geared one whose force is limited, and one with a limited control."""

    cfg = XmlPositionActuatorCfg(joint_names_expr=EXPRESSIONS)
    actuator = """<position name="rail" joint="rail" kp="40" kv="1" ctrlrange="-0.1 0.2"/>
      <position name="hip" joint="hip" kp="25" kv="0.4"/>
      <position name="knee" joint="knee" kp="3" kv="0.05" gear="-2.7" forcerange="-1 2"/>"""
    limits = (np.inf, 2.7 * 2, np.inf)

    def expected(self, j, history, q, qd):
        p = history[-1][0]
        if j == 0:
            asked = pd(25.0, 0.4, p, None, None, q, qd)
            return asked, asked
        if j == 1:
            asked = pd(3 * 2.7**2, 0.05 * 2.7**2, p, None, None, q, qd)
            return asked, clip(asked, -2.7 * 2, 2.7 * 1)
        asked = pd(40.0, 1.0, clip(p, -0.1, 0.2), None, None, q, qd)
        return asked, asked


class TestVelocity(DeterministicContract):
    cfg = XmlVelocityActuatorCfg(joint_names_expr=EXPRESSIONS)
    words = ("velocity",)
    scale = 4.0
    actuator = """<velocity name="hip" joint="hip" kv="0.5"/>
      <velocity name="rail" joint="rail" kv="0.2" gear="3"/>
      <velocity name="knee" joint="knee" kv="2" forcerange="-1 1" gear="-0.5"/>"""
    limits = (np.inf, 0.5, np.inf)

    def expected(self, j, history, q, qd):
        asked = (0.5, 2 * 0.25, 0.2 * 9)[j] * (history[-1][1] - qd)
        return asked, clip(asked, -self.limits[j], self.limits[j])


class TestMotor(DeterministicContract):
    cfg = XmlMotorActuatorCfg(joint_names_expr=EXPRESSIONS)
    words = ("effort",)
    scale = 3.0
    actuator = """<motor name="hip" joint="hip" gear="9" ctrlrange="-0.1 0.1"/>
      <motor name="knee" joint="knee" gear="-2" forcerange="-1 1"/>
      <general name="rail" joint="rail" gainprm="0.3" gear="7"/>"""
    limits = (0.9, 2.0, np.inf)

    def expected(self, j, history, q, qd):
        e = history[-1][2]
        # What the control's range cuts off is never asked for.
        return (clip(e, -0.9, 0.9) if j == 0 else e), clip(e, -self.limits[j], self.limits[j])


class TestOneWayMotor(DeterministicContract):
    """A force range with zero at its end, as of a cable."""

    cfg = XmlMotorActuatorCfg(joint_names_expr=("hip",))
    joints = ("hip",)
    words = ("effort",)
    scale = 4.0
    actuator = '<motor name="hip" joint="hip" forcerange="-5 0"/>'
    limits = (5.0,)

    def expected(self, j, history, q, qd):
        return history[-1][2], clip(history[-1][2], -5.0, 0.0)


# dm_control's scaled actuators: a normalised control, targets in units of the joint.


def settle(actuator, physics, cmd, n_steps=4000):
    """Position and velocity where it comes to rest."""
    for _ in range(n_steps):
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(cmd)
        physics.step()
    return actuator.state()


def weightless(add):
    """A single joint, of which `add(joint)` makes the actuator."""
    root = mjcf.from_xml_string(
        """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody><body>
        <joint name="j" axis="0 1 0" damping="0.02"/><geom size="0.1" pos="0.2 0 0"/>
        </body></worldbody></mujoco>"""
    )
    add(root.find("joint", "j"))
    return root


@pytest.mark.parametrize("qposrange", [(-1.0, 1.0), (-0.3, 1.7), (0.2, 0.9)])
@pytest.mark.parametrize("ctrlrange", [(-1, 1), (0, 10)])
def test_scaled_position_lands_on_the_joint_target(qposrange, ctrlrange):
    root = weightless(
        lambda joint: scaled_actuators.add_position_actuator(
            joint, qposrange, ctrlrange=ctrlrange, kp=20.0, name="j"
        )
    )
    actuator = XmlPositionActuatorCfg(joint_names_expr=("j",), viscous_damping=1.0).build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    actuator.initialize(physics)
    low, high = qposrange
    for target in (low, high, 0.5 * (low + high), 0.9 * low + 0.1 * high):
        control = actuator.compute(ActuatorCmd(position_target=[target]))
        share = (target - low) / (high - low)
        assert control[0] == pytest.approx(ctrlrange[0] + share * np.ptp(ctrlrange), abs=1e-12)
        q, _ = settle(actuator, physics, ActuatorCmd(position_target=[target]))
        assert q[0] == pytest.approx(target, abs=1e-4)
        assert actuator.applied_effort[0] == pytest.approx(-20.0 * (q[0] - target), abs=1e-9)
    beyond = ActuatorCmd(position_target=[high + 1.0])
    q, _ = settle(actuator, physics, beyond)
    assert q[0] == pytest.approx(high, abs=1e-4)  # what the XML limits stays limited


def test_scaled_velocity_lands_on_the_joint_target():
    root = weightless(
        lambda joint: scaled_actuators.add_velocity_actuator(joint, (-2.0, 6.0), kv=3.0, name="j")
    )
    actuator = XmlVelocityActuatorCfg(joint_names_expr=("j",), viscous_damping=0.0).build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    actuator.initialize(physics)
    for target in (-1.5, 0.0, 5.0):
        _, qd = settle(actuator, physics, ActuatorCmd(velocity_target=[target]), 1500)
        assert qd[0] == pytest.approx(target, abs=1e-6)


def test_a_constant_bias_of_a_motor_has_to_be_explained():
    def wrapped(**choice):
        root = weightless(lambda joint: add_effort_actuator(joint, (-2.0, 6.0), name="j"))
        actuator = XmlMotorActuatorCfg(joint_names_expr=("j",), **choice).build()
        actuator.edit_mjcf(root)
        physics = mjcf.Physics.from_mjcf_model(root)
        actuator.initialize(physics)
        actuator.compute(ActuatorCmd(effort_target=[3.0]))
        return actuator

    with pytest.raises(ValueError, match=r"constant bias of 2.*bias='offset'.*bias='effort'"):
        wrapped()
    assert wrapped(bias="offset").applied_effort[0] == pytest.approx(3.0)
    assert wrapped(bias="effort").applied_effort[0] == pytest.approx(5.0)
    with pytest.raises(ValueError, match=r"bias should be one of \['offset', 'effort'\], got 'no'"):
        XmlMotorActuatorCfg(joint_names_expr=("j",), bias="no")


def test_a_bias_that_mujoco_does_not_use_is_none():
    root = robot('<general name="hip" joint="hip" biastype="none" biasprm="0.5"/>')
    actuator = XmlMotorActuatorCfg(joint_names_expr=("hip",)).build()
    actuator.edit_mjcf(root)
    actuator.initialize(compiled(root))
    assert actuator.compute(ActuatorCmd(effort_target=[0.7]))[0] == 0.7


# Refusals.

KINDS = {
    "position": XmlPositionActuatorCfg,
    "velocity": XmlVelocityActuatorCfg,
    "motor": XmlMotorActuatorCfg,
}


@pytest.mark.parametrize("tag", KINDS)
@pytest.mark.parametrize("kind", KINDS)
def test_wrong_kind(tag, kind):
    root = robot(f'<{tag} name="mine" joint="knee"/>')
    actuator = KINDS[kind](joint_names_expr=("knee",)).build()
    actuator.edit_mjcf(root)
    if tag == kind:
        actuator.initialize(compiled(root))
        return
    with pytest.raises(ValueError) as error:
        actuator.initialize(compiled(root))
    for part in ("'knee'", f"use {KINDS[tag].__name__}"):
        assert part in str(error.value)


@pytest.mark.parametrize(
    "element",
    [
        '<general name="mine" joint="knee" dyntype="muscle" dynprm="0.01 0.04"/>',
        '<intvelocity name="mine" joint="knee" kp="4" actrange="-1 1"/>',
        '<damper name="mine" joint="knee" kv="1" ctrlrange="0 1"/>',
        '<motor name="mine" joint="knee" gear="0"/>',
        '<general name="mine" joint="knee" gainprm="0" biastype="affine" biasprm="0 -3"/>',
    ],
)
@pytest.mark.parametrize("kind", KINDS)
def test_laws_that_cannot_be_read(element, kind):
    root = robot(element)
    actuator = KINDS[kind](joint_names_expr=("knee",)).build()
    actuator.edit_mjcf(root)
    with pytest.raises(ValueError, match="actuator of 'knee' has a law that is not affine"):
        actuator.initialize(compiled(root))


def refused(cfg, root):
    """The message of a refusal, which leaves the model as it was."""
    before = root.to_xml_string()
    with pytest.raises(ValueError) as error:
        cfg.build().edit_mjcf(root)
    assert root.to_xml_string() == before
    return str(error.value)


def test_joints_with_none_or_several():
    message = refused(
        XmlMotorActuatorCfg(joint_names_expr=(".*",), armature=0.3), robot('<motor joint="hip"/>')
    )
    assert "joint 'knee' has 0 actuators in the XML" in message
    assert "Builtin" in message
    two = '<motor name="one" joint="hip"/><position name="two" joint="hip"/>'
    message = refused(XmlMotorActuatorCfg(joint_names_expr=("hip",), armature=0.3), robot(two))
    assert "joint 'hip' has 2 actuators in the XML: 'one', 'two'" in message
    assert "remove all but one" in message


def test_sites_are_refused():
    with pytest.raises(ValueError, match=r"transmission='site'.*BuiltinMotorActuatorCfg"):
        XmlMotorActuatorCfg(joint_names_expr=("s",), transmission="site", gear=(1, 0, 0, 0, 0, 0))


def test_builtin_ones_refuse_joints_that_have_an_actuator():
    root = robot('<position name="servo" joint="knee"/>')
    message = refused(BuiltinMotorActuatorCfg(joint_names_expr=("hip", "knee"), armature=1.0), root)
    assert "joint 'knee' already has the actuator 'servo'" in message
    assert "Xml… config" in message


def test_an_actuator_of_the_model_to_which_the_joint_is_attached_counts():
    arm, hand = (
        mjcf.from_xml_string(
            f'<mujoco model="{name}"><worldbody><body><joint name="{name}"/><geom size="0.1"/>'
            '<site name="s"/></body></worldbody></mujoco>'
        )
        for name in ("arm", "hand")
    )
    arm.find("site", "s").attach(hand)
    arm.actuator.add("motor", name="outer", joint=hand.find("joint", "hand"))
    assert "hand/hand" in refused(BuiltinMotorActuatorCfg(joint_names_expr=(".*hand",)), arm)
    assert "already has" in refused(BuiltinMotorActuatorCfg(joint_names_expr=("hand",)), hand)
    actuator = XmlMotorActuatorCfg(joint_names_expr=(".*hand",)).build()
    actuator.edit_mjcf(arm)
    actuator.initialize(mjcf.Physics.from_mjcf_model(arm))
    assert [element.name for element in actuator.elements] == ["outer"]


def test_defaults_are_read_from_the_compiled_model():
    root = robot(
        '<position name="hip" class="servo" joint="hip"/>',
        default='<default class="servo"><position kp="30" kv="0.5" forcerange="-4 4"/></default>',
    )
    actuator = XmlPositionActuatorCfg(joint_names_expr=("hip",)).build()
    actuator.edit_mjcf(root)
    actuator.initialize(compiled(root))
    assert actuator.nominal("stiffness") == 30.0
    assert actuator.nominal("damping") == 0.5
    assert actuator.nominal("effort_limit") == 4.0


@pytest.mark.parametrize("early", ["true", "false"])
@pytest.mark.parametrize("filtering", ["filter", "filterexact"])
def test_efforts_of_filtered_actuators(filtering, early):
    common = f'biastype="affine" dyntype="{filtering}" dynprm="0.02" actearly="{early}"'
    root = robot(
        f'<general name="hip" joint="hip" gainprm="30" biasprm="0 -30 -0.5" {common}/>'
        f'<general name="knee" joint="knee" gainprm="9" biasprm="1 -3 0" gear="2" {common}'
        ' actlimited="true" actrange="-0.01 0.02" ctrlrange="-0.3 0.3"/>'
        '<position name="rail" joint="rail" kp="30"/>'
    )
    actuator = XmlPositionActuatorCfg(joint_names_expr=EXPRESSIONS).build()
    actuator.edit_mjcf(root)
    physics = compiled(root)
    actuator.initialize(physics)
    dofs = physics.model.ptr.jnt_dofadr[actuator.joint_ids]
    for k in range(60):
        cmd = ActuatorCmd(position_target=np.array([0.3, 0.7, -0.1]) * np.cos(0.1 * k))
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(cmd)
        before = actuator.applied_effort
        physics.step()
        exerted = physics.data.qfrc_actuator[dofs]
        np.testing.assert_allclose(before, exerted, rtol=1e-12, atol=1e-12)
        # Efforts are those of the last compute, whatever the physics did since.
        np.testing.assert_array_equal(actuator.applied_effort, before)


@pytest.mark.parametrize("delay", ["0.004", "0.005"])
@pytest.mark.parametrize("interp", ["zoh", "linear"])
def test_a_delay_of_the_xml_starts_from_the_first_command_and_shows_in_efforts(delay, interp):
    text = f"""
    <mujoco><option timestep="0.002"/><worldbody><body><joint name="j" axis="0 1 0"/>
    <geom size="0.1" pos="0 0 -0.2"/></body></worldbody>
    <actuator><position name="j" joint="j" kp="30" kv="1" delay="{delay}" nsample="4"
      interp="{interp}"/></actuator></mujoco>"""
    root = mjcf.from_xml_string(text)
    actuator = XmlPositionActuatorCfg(joint_names_expr=("j",)).build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    actuator.initialize(physics)
    physics.legacy_step = False
    with physics.reset_context():
        physics.data.qpos[:] = 0.8
    actuator.reset()
    for k in range(12):
        target = 0.8 + 0.01 * k**2
        cmd = ActuatorCmd(position_target=np.array([target]))
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(cmd)
        physics.step()
        np.testing.assert_allclose(actuator.applied_effort, physics.data.actuator_force, atol=1e-9)
        if k == 0:
            assert abs(physics.data.actuator_force[0]) < 1e-12
