"""Actuators of the XML with several controls for one joint."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from mujoco.batch import Batch

from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    DelayedActuatorCfg,
    XmlInputsActuatorCfg,
    XmlPositionActuatorCfg,
)

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="shoulder" axis="0 1 0" damping="0.1" armature="0.02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/>
      <body pos="0 0 -0.3">
        <joint name="elbow" axis="0 1 0" damping="0.1" armature="0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>{}</actuator>
</mujoco>
"""
PAIR = (
    '<position name="p" joint="elbow" kp="20" gear="2"/>'
    '<velocity name="v" joint="elbow" kv="0.8" gear="-3"/>'
)
ELBOW = ("elbow",)


def general(**attributes):
    """An element that PyMJCF has no name for, as MuJoCo writes it."""
    return "<general " + " ".join(f'{k}="{v}"' for k, v in attributes.items()) + "/>"


PID = general(
    name="pid",
    joint="elbow",
    input="pos vel ff",
    dyntype="pid",
    gaintype="pid",
    biastype="affine",
    gainprm="3",
    biasprm="0 -20 -0.8",
    actdim="1",
)
MOTOR = {
    "joint": "elbow",
    "gear": "9",
    "dyntype": "dcmotor",
    "gaintype": "dcmotor",
    "biastype": "dcmotor",
    "actearly": "true",
}


def built(actuators, cfg=None, n_sims=None):
    root = mjcf.from_xml_string(ARM.format(actuators))
    group = ActuatorGroup(cfg or XmlInputsActuatorCfg(joint_names_expr=ELBOW))
    group.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    if n_sims is None:
        group.initialize(physics)
        return group, physics
    batch = Batch(physics.model.ptr, n_sims, 1)
    group.initialize(batch)
    return group, batch


def command(position=0.4, velocity=0.5, effort=None):
    every = {"position_target": position, "velocity_target": velocity, "effort_target": effort}
    return ActuatorCmd(**{k: np.array([v]) for k, v in every.items() if v is not None})


def test_each_target_goes_to_its_own_actuator():
    group, physics = built(PAIR)
    assert group.takes == {"position_target", "velocity_target"}
    assert [e.name for e in group.elements] == ["p"]
    assert [e.name for e in group.beside] == ["v"]
    group.apply(command())
    np.testing.assert_allclose(physics.data.ctrl, [2 * 0.4, -3 * 0.5])
    physics.step()
    np.testing.assert_allclose(group.applied_effort, [4 * 20 * 0.4 + 9 * 0.8 * 0.5], rtol=1e-9)


def test_what_is_not_said_is_zero_but_for_the_first():
    group, physics = built(PAIR)
    group.apply(command(velocity=None))
    np.testing.assert_array_equal(physics.data.ctrl, [0.8, 0.0])
    with pytest.raises(ValueError, match="position_target"):
        group.apply(ActuatorCmd(velocity_target=np.zeros(1)))


def test_a_pid_moves_as_it_does_natively():
    group, physics = built(PID)
    assert group.takes == {"position_target", "velocity_target", "effort_target"}
    model = physics.model.ptr
    data = mujoco.MjData(model)
    for k in range(200):
        target = 0.3 * np.sin(0.05 * k)
        group.apply(command(target, 0.1, 0.2))
        physics.step()
        data.ctrl[:] = target, 0.1, 0.2
        mujoco.mj_step(model, data)
    np.testing.assert_array_equal(physics.data.qpos, data.qpos)
    assert np.abs(data.act).max() > 0


def test_a_reset_forgets_an_integral():
    group, physics = built(PID)
    runs = []
    for _ in range(2):
        with physics.reset_context():
            group.reset()
        for _ in range(50):
            group.apply(command())
            physics.step()
        runs.append(physics.data.qpos.copy())
    np.testing.assert_array_equal(*runs)


def test_volts_are_asked_for_by_an_effort():
    motor = general(name="m", **MOTOR, input="voltage", gainprm="0.5 0.1", dynprm="0")
    group, physics = built(motor)
    group.apply(ActuatorCmd(effort_target=np.array([3.0])))
    np.testing.assert_array_equal(physics.data.ctrl, [3.0])
    physics.step()
    np.testing.assert_allclose(group.applied_effort, [9 * 0.1 * 3.0 / 0.5])


def test_a_target_of_limited_slope_sets_out_from_the_joint():
    slow = "0 0 0 0 0 0 0 1"
    motor = general(
        name="m", **MOTOR, input="pos", gainprm="0.5 0.1 0 0 5", dynprm=slow, actdim="1"
    )
    group, physics = built(motor)
    physics.data.qpos[:] = 0.0, 0.7
    group.apply(command(0.7, None))
    np.testing.assert_allclose(physics.data.act, [9 * 0.7])


def test_a_delay_remembers_the_first_command():
    late = PAIR.replace('gear="2"', 'gear="2" delay="0.01" nsample="5"')
    group, physics = built(late)
    group.apply(command())
    physics.step()
    np.testing.assert_allclose(group.applied_effort, [4 * 20 * 0.4 + 9 * 0.8 * 0.5], rtol=1e-9)


def test_a_batch_moves_as_one_does():
    group, physics = built(PAIR)
    batched, batch = built(PAIR, n_sims=2)
    for k in range(20):
        cmd = command(0.1 + 0.01 * k)
        group.apply(cmd)
        physics.step()
        batched.apply(
            ActuatorCmd(
                position_target=np.tile(cmd.position_target, (2, 1)),
                velocity_target=np.tile(cmd.velocity_target, (2, 1)),
            )
        )
        batch.step()
    for row in np.asarray(batch.bind("qpos")):
        np.testing.assert_array_equal(row, physics.data.qpos)


def test_targets_can_be_late():
    base = XmlInputsActuatorCfg(joint_names_expr=ELBOW)
    cfg = DelayedActuatorCfg(
        base_cfg=base, delay_target=("position", "velocity"), delay_min_lag=3, delay_max_lag=3
    )
    group, physics = built(PAIR, cfg)
    group.apply(command(0.0, 0.0))
    for _ in range(3):
        group.apply(command())
        np.testing.assert_array_equal(physics.data.ctrl, [0.0, 0.0])
    group.apply(command())
    np.testing.assert_allclose(physics.data.ctrl, [0.8, -1.5])


def test_scales_that_were_saved():
    scales = {"position_target": {"elbow": (5.0, 0.25)}}
    group, physics = built(PAIR, XmlInputsActuatorCfg(joint_names_expr=ELBOW, scales=scales))
    group.apply(command())
    np.testing.assert_allclose(physics.data.ctrl, [5 * 0.4 + 0.25, -1.5])


@pytest.mark.parametrize(
    ("actuators", "expressions", "message"),
    [
        (PAIR, (".*",), "no actuator of joint 'shoulder' takes a target"),
        (
            PAIR + '<motor name="m" joint="shoulder"/>',
            (".*",),
            r"'shoulder' takes \['effort_target'\] and 'elbow' takes .*config of its own",
        ),
        ('<muscle name="m" joint="elbow" lengthrange="0 1"/>', ELBOW, "a muscle"),
    ],
)
def test_refusals(actuators, expressions, message):
    root = mjcf.from_xml_string(ARM.format(actuators))
    before = root.to_xml_string()
    with pytest.raises(ValueError, match=message):
        ActuatorGroup(XmlInputsActuatorCfg(joint_names_expr=expressions)).edit_mjcf(root)
    assert root.to_xml_string() == before


def test_a_config_of_one_kind_points_here():
    root = mjcf.from_xml_string(ARM.format(PAIR))
    with pytest.raises(ValueError, match="take all of them over with XmlInputsActuatorCfg"):
        ActuatorGroup(XmlPositionActuatorCfg(joint_names_expr=ELBOW)).edit_mjcf(root)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"transmission": "tendon"}, "takes over the actuators of joints"),
        ({"scales": {"volts": {}}}, "should be of some of"),
        ({"scales": {"effort_target": {"elbow": (1.0, np.inf)}}}, r"should be \(slope, offset\)"),
    ],
)
def test_bad_configs(given, message):
    with pytest.raises(ValueError, match=message):
        XmlInputsActuatorCfg(joint_names_expr=ELBOW, **given)
