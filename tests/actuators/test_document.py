"""Every actuator of the specification's examples, in this library: each block compiles and works.

The blocks on action terms, randomization and hardware parameters are tested with the modules that
they are about.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from dm_control import mjcf

from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    BuiltinMotorActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    LearnedMlpActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
    XmlVelocityActuatorCfg,
)
from walkerkit.actuators.networks.mlp import Mlp

LEG = """
<body name="{side}_hip"><joint name="{side}_hip_pitch_joint" axis="0 1 0"/><geom size="0.06"/>
  <body><joint name="{side}_hip_roll_joint" axis="1 0 0"/><geom size="0.06"/>
    <body><joint name="{side}_hip_yaw_joint" axis="0 0 1"/>
      <geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.3"/>
      <body pos="0 0 -0.3"><joint name="{side}_knee_joint" axis="0 1 0"/>
        <geom type="capsule" size="0.04" fromto="0 0 0 0 0 -0.3"/>
        <body pos="0 0 -0.3"><joint name="{side}_ankle_pitch_joint" axis="0 1 0"/>
          <geom size="0.04"/>
          <body><joint name="{side}_ankle_roll_joint" axis="1 0 0"/>
            <geom type="box" size="0.1 0.04 0.02" pos="0 0 -0.03"/>
          </body></body></body></body></body></body>
"""
JOINT = '<default><joint armature="0.02"/></default>'
FLAGS = '<option timestep="0.002" integrator="implicitfast"><flag contact="disable"/></option>'
HUMANOID = f"""
<mujoco model="humanoid"><compiler angle="radian"/>{FLAGS}{JOINT}<worldbody>
  <body name="torso"><geom size="0.1"/>
    <body><joint name="waist_yaw_joint" axis="0 0 1"/><geom size="0.1"/>
    {LEG.format(side="left")}{LEG.format(side="right")}</body></body>
</worldbody></mujoco>
"""
MANIPULATOR = f"""
<mujoco model="manipulator"><compiler angle="radian"/>{FLAGS}{JOINT}<worldbody>
  <body><geom size="0.2"/>
    <body><joint name="left_wheel_joint" axis="0 1 0"/><geom size="0.1"/></body>
    <body><joint name="right_wheel_joint" axis="0 1 0"/><geom size="0.1"/></body>
    <body><joint name="arm_shoulder_joint" axis="0 1 0"/><geom size="0.05" pos="0.2 0 0"/>
      <body pos="0.2 0 0"><joint name="arm_elbow_joint" axis="0 1 0"/><geom size="0.05"/>
        <body pos="0.2 0 0"><joint name="arm_wrist_joint" axis="0 1 0"/><geom size="0.05"/>
    </body></body></body></body>
</worldbody></mujoco>
"""
HIPS = [f"hip_{axis}_joint" for axis in ("pitch", "roll", "yaw")]
ANKLES = ["ankle_pitch_joint", "ankle_roll_joint"]


def of_both_legs(*names):
    """Joint names in kinematic order."""
    return tuple(f"{side}_{name}" for side in ("left", "right") for name in names)


def works(actuators, text=HUMANOID, n_steps=50):
    """The group and its physics, after some steps towards random targets."""
    root = mjcf.from_xml_string(text)
    group = ActuatorGroup(actuators)
    group.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    group.initialize(physics)
    group.reset()
    rng = np.random.default_rng(0)
    n = len(group.joint_names)
    words = group.takes - {"effort_target"} or group.takes
    cmd = ActuatorCmd(**{name: 0.2 * rng.standard_normal(n) for name in words})
    dofs = physics.model.ptr.jnt_dofadr[group.joint_ids]
    most = np.zeros(n)
    for _ in range(n_steps):
        group.update(physics.timestep())
        group.apply(cmd)
        physics.step()
        exerted = physics.data.qfrc_actuator[dofs]
        np.testing.assert_allclose(exerted, group.applied_effort, rtol=1e-9, atol=1e-9)
        most = np.maximum(most, np.abs(exerted))
    assert (most > 1e-3).all()
    assert np.abs(physics.data.qpos).max() < 3.0
    return group, physics


def test_basic_pd_control():
    group, physics = works(
        BuiltinPositionActuatorCfg(
            joint_names_expr=(".*_hip_.*", ".*_knee_.*"),
            stiffness=80.0,
            damping=10.0,
            effort_limit=100.0,
        )
    )
    assert group.joint_names == of_both_legs(*HIPS, "knee_joint")
    model = physics.model.ptr
    np.testing.assert_array_equal(model.actuator_biasprm[:, :3], [[0.0, -80.0, -10.0]] * 8)
    np.testing.assert_array_equal(model.actuator_forcerange, [[-100.0, 100.0]] * 8)


def test_add_delays():
    group, _ = works(
        DelayedActuatorCfg(
            base_cfg=BuiltinPositionActuatorCfg(
                joint_names_expr=(".*",), stiffness=80.0, damping=10.0
            ),
            delay_target="position",
            delay_min_lag=2,  # physics steps
            delay_max_lag=5,
        )
    )
    assert len(group.joint_names) == 13
    assert 2 <= group.actuators[0].lag("position") <= 5


def test_interface():
    """Lifecycle and properties under their own names."""
    cfg = BuiltinMotorActuatorCfg(joint_names_expr=(".*_knee_joint",))
    root = mjcf.from_xml_string(HUMANOID)
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    actuator.initialize(physics)
    actuator.reset()
    actuator.update(physics.timestep())
    controls = actuator.compute(ActuatorCmd(effort_target=[1.0, 2.0]))
    assert controls.tolist() == [1.0, 2.0]
    assert actuator.joint_names == ("left_knee_joint", "right_knee_joint")
    assert actuator.joint_ids.shape == actuator.ctrl_ids.shape == (2,)


def test_mobile_manipulator():
    group, physics = works(
        (
            BuiltinPositionActuatorCfg(
                joint_names_expr=(".*_shoulder_.*", ".*_elbow_.*", ".*_wrist_.*"),
                stiffness=100.0,
                damping=10.0,
                effort_limit=150.0,
            ),
            BuiltinVelocityActuatorCfg(
                joint_names_expr=(".*_wheel_.*",), damping=20.0, effort_limit=50.0
            ),
        ),
        MANIPULATOR,
    )
    assert group.joint_names[:2] == ("left_wheel_joint", "right_wheel_joint")
    cmd = ActuatorCmd(position_target=np.zeros(5), velocity_target=[3.0, -2.0, 0.0, 0.0, 0.0])
    for _ in range(500):
        group.apply(cmd)
        physics.step()
    np.testing.assert_allclose(physics.data.qvel[:2], [3.0, -2.0], atol=1e-3)
    np.testing.assert_allclose(physics.data.qpos[2:], 0.0, atol=0.2)


def test_ideal_pd_and_dc_motor():
    group, _ = works(
        (
            IdealPdActuatorCfg(
                joint_names_expr=(".*_hip_.*",), stiffness=80.0, damping=10.0, effort_limit=100.0
            ),
            DcMotorActuatorCfg(
                joint_names_expr=(".*_knee_.*",),
                stiffness=80.0,
                damping=10.0,
                effort_limit=25.0,  # continuous
                saturation_effort=50.0,  # at standstill
                velocity_limit=30.0,  # without load, rad/s
            ),
        )
    )
    group.compute(ActuatorCmd(position_target=np.full(8, 2.0)))
    knees = [name.endswith("knee_joint") for name in group.joint_names]
    assert (np.abs(group.applied_effort[knees]) <= 25.0).all()
    assert (np.abs(group.computed_effort[knees]) > 25.0).all()
    assert (np.abs(group.applied_effort[~np.array(knees)]) <= 100.0).all()


def test_learned_mlp(tmp_path):
    rng = np.random.default_rng(0)
    sizes = (6, 16, 1)
    path = tmp_path / "ankle_actuator.npz"
    Mlp(
        weights=[0.5 * rng.standard_normal((b, a)) for a, b in pairwise(sizes)],
        biases=[np.zeros(size) for size in sizes[1:]],
        activations=["softsign", "identity"],
    ).save(path)
    group, _ = works(
        LearnedMlpActuatorCfg(
            joint_names_expr=(".*_ankle_.*",),
            network_file=path,
            pos_scale=1.0,
            vel_scale=0.05,
            torque_scale=10.0,
            input_order="pos_vel",
            history_length=3,  # the present one and two before it
            saturation_effort=50.0,
            velocity_limit=30.0,
            effort_limit=25.0,
        )
    )
    assert group.joint_names == of_both_legs(*ANKLES)


@pytest.mark.parametrize(
    ("tag", "cls"),
    [
        ("position", XmlPositionActuatorCfg),
        ("velocity", XmlVelocityActuatorCfg),
        ("motor", XmlMotorActuatorCfg),
    ],
)
def test_xml(tag, cls):
    gain = {"position": 'kp="100"', "velocity": 'kv="10"', "motor": ""}[tag]
    text = f"""<mujoco><compiler angle="radian"/><worldbody><body>
      <joint name="hip_joint" axis="0 1 0" armature="0.1"/><geom size="0.1"/></body></worldbody>
      <actuator><{tag} name="hip_joint" joint="hip_joint" {gain}/></actuator></mujoco>"""
    group, physics = works(cls(joint_names_expr=("hip_joint",)), text)
    assert physics.model.ptr.nu == 1
    assert group.elements[0].tag == tag


def test_delays_that_wander():
    base = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=80.0, damping=10.0)
    one = DelayedActuatorCfg(
        base_cfg=base,
        delay_target="position",
        delay_min_lag=2,
        delay_max_lag=5,
        delay_hold_prob=0.3,
        delay_update_period=10,
    )
    group, _ = works(one)
    assert 2 <= group.actuators[0].lag("position") <= 5
    several = DelayedActuatorCfg(
        base_cfg=base,
        delay_target=("position", "velocity", "effort"),
        delay_min_lag=2,
        delay_max_lag=5,
    )
    group, _ = works(several)
    for target in ("position", "velocity", "effort"):
        assert 2 <= group.actuators[0].lag(target) <= 5


PITCH = BuiltinPositionActuatorCfg(
    joint_names_expr=("left_hip_pitch_joint", "right_hip_pitch_joint"),
    stiffness=200.0,
    damping=20.0,
    effort_limit=88.0,
    armature=0.0015,
)
LOWER = (
    BuiltinPositionActuatorCfg(
        joint_names_expr=(".*_knee_joint",),
        stiffness=150.0,
        damping=15.0,
        effort_limit=139.0,
        armature=0.0025,
    ),
    BuiltinPositionActuatorCfg(
        joint_names_expr=(".*_ankle_.*",),
        stiffness=40.0,
        damping=5.0,
        effort_limit=25.0,
        armature=0.0008,
    ),
)


def hips(*expressions):
    """The first config of the humanoid, of some hips and the waist."""
    return BuiltinPositionActuatorCfg(
        joint_names_expr=(*expressions, "waist_yaw_joint"),
        stiffness=180.0,
        damping=18.0,
        effort_limit=88.0,
        armature=0.0015,
    )


def test_humanoid_as_printed_claims_the_hip_pitch_joints_twice():
    root = mjcf.from_xml_string(HUMANOID)
    before = root.to_xml_string()
    with pytest.raises(ValueError) as error:
        ActuatorGroup((hips(".*_hip_.*"), PITCH, *LOWER)).edit_mjcf(root)
    assert "joint 'left_hip_pitch_joint' is claimed by" in str(error.value)
    assert "'.*_hip_.*'" in str(error.value)
    assert root.to_xml_string() == before


def test_humanoid():
    group, physics = works((hips(".*_hip_(roll|yaw)_joint"), PITCH, *LOWER))
    assert group.joint_names == ("waist_yaw_joint", *of_both_legs(*HIPS, "knee_joint", *ANKLES))
    model = physics.model.ptr
    dofs = model.jnt_dofadr[group.joint_ids]
    armature = [0.0015] + 2 * [0.0015, 0.0015, 0.0015, 0.0025, 0.0008, 0.0008]
    np.testing.assert_array_equal(model.dof_armature[dofs], armature)
    stiffness = [180.0] + 2 * [200.0, 180.0, 180.0, 150.0, 40.0, 40.0]
    np.testing.assert_array_equal(-model.actuator_biasprm[group.ctrl_ids, 1], stiffness)
