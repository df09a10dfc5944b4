"""Every block of the specification's examples, in this library: each compiles and works."""

from __future__ import annotations

from itertools import pairwise
from math import pi

import numpy as np
import pytest
from dm_control import mjcf

from walkerkit.actuators import (
    MOTORS,
    ActuatorCmd,
    ActuatorGroup,
    BuiltinMotorActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    ElectricActuator,
    IdealPdActuatorCfg,
    LearnedMlpActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
    XmlVelocityActuatorCfg,
    gains_from_bandwidth,
    parallel_linkage,
    randomize_effort_limits,
    randomize_pd_gains,
    reflected_inertia_from_two_stage_planetary,
)
from walkerkit.actuators.networks.mlp import Mlp
from walkerkit.tasks import JointPositionAction
from walkerkit.walkers.drivetrain import Drivetrain

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
    both = "joints 'left_hip_pitch_joint', 'right_hip_pitch_joint' are claimed by"
    assert both in str(error.value)
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


ROTOR_INERTIAS_7520_14 = (0.489e-4, 0.098e-4, 0.533e-4)
GEARS_7520_14 = (1, 4.5, 1 + (48 / 22))
ARMATURE_7520_14 = reflected_inertia_from_two_stage_planetary(ROTOR_INERTIAS_7520_14, GEARS_7520_14)
ACTUATOR_7520_14 = ElectricActuator(
    reflected_inertia=ARMATURE_7520_14, velocity_limit=32.0, effort_limit=88.0
)


def test_hardware_parameters_of_a_motor():
    stiffness, damping = gains_from_bandwidth(ARMATURE_7520_14, 10 * 2 * pi, 2.0)
    assert pytest.approx(0.0101775200413, abs=1e-12) == ARMATURE_7520_14
    assert stiffness == pytest.approx(40.17923864, abs=1e-8)
    assert damping == pytest.approx(2.557889775, abs=1e-9)
    assert stiffness == pytest.approx(ARMATURE_7520_14 * (10 * 2 * pi) ** 2, rel=1e-12)
    _, physics = works(
        BuiltinPositionActuatorCfg(
            joint_names_expr=(".*_hip_pitch_joint",),
            stiffness=stiffness,
            damping=damping,
            effort_limit=ACTUATOR_7520_14.effort_limit,
            armature=ACTUATOR_7520_14.reflected_inertia,
        )
    )
    dof = physics.model.ptr.joint("left_hip_pitch_joint").dofadr[0]
    assert physics.model.dof_armature[dof] == ARMATURE_7520_14


def test_parallel_linkage_of_an_ankle():
    motor = MOTORS["unitree_5020"].actuator()
    gains = gains_from_bandwidth(motor.reflected_inertia, 10 * 2 * pi, 2.0)
    (ankle,) = parallel_linkage([motor, motor])
    assert ankle.reflected_inertia == 2 * motor.reflected_inertia
    assert ankle.effort_limit == 2 * motor.effort_limit
    group, _ = works(
        BuiltinPositionActuatorCfg(
            joint_names_expr=(".*_ankle_pitch_joint", ".*_ankle_roll_joint"),
            stiffness=gains.stiffness * 2,
            damping=gains.damping * 2,
            effort_limit=ankle.effort_limit,
            armature=ankle.reflected_inertia,
        )
    )
    assert group.joint_names == of_both_legs(*ANKLES)


def test_action_term():
    root = mjcf.from_xml_string(HUMANOID)
    cfg = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=20.0, damping=1.0)
    home = {"left_knee_joint": 0.4, "right_knee_joint": 0.4}
    action = JointPositionAction(joint_names_expr=(".*",), scale=1.0, use_default_offset=True)
    drivetrain = Drivetrain(root, cfg, action=action, default=home)
    drivetrain.initialize(mjcf.Physics.from_mjcf_model(root))
    drivetrain.reset(np.random.RandomState(0))
    drivetrain.act(np.full(13, 0.25))
    expected = [0.25 + home.get(name, 0.0) for name in drivetrain.group.joint_names]
    np.testing.assert_allclose(drivetrain.command.position_target, expected, rtol=1e-15)


def test_domain_randomization():
    group, _ = works(
        IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=20.0, damping=1.0, effort_limit=50.0)
    )
    (actuator,) = group.actuators
    random_state = np.random.default_rng(0)
    for _ in range(20):  # resets do not compound
        randomize_pd_gains(
            group,
            kp_range=(0.8, 1.2),
            kd_range=(0.8, 1.2),
            joint_names_expr=(".*",),
            distribution="uniform",
            operation="scale",
            random_state=random_state,
        )
        randomize_effort_limits(
            group,
            effort_limit_range=(0.7, 1.0),
            joint_names_expr=(".*_hip_.*",),
            operation="scale",
            random_state=random_state,
        )
        for name, low, high in (("stiffness", 16, 24), ("damping", 0.8, 1.2)):
            assert ((actuator.get(name) >= low) & (actuator.get(name) <= high)).all()
    limits = dict(zip(actuator.joint_names, actuator.get("effort_limit"), strict=True))
    for name, limit in limits.items():
        assert 35 <= limit < 50 if "_hip_" in name else limit == 50
