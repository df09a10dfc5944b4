"""Several actuators of one robot: columns, refusals, and what a whole-robot command means."""

from __future__ import annotations

import ast
import dataclasses

import numpy as np
import pytest
from dm_control import mjcf
from mujoco.batch import Batch

from tests.actuators.reference import clip, pd
from tests.actuators.robots import (
    JOINTS,
    TIMESTEP,
    batch_of,
    commands,
    compiled,
    place,
    robot,
    run,
)
from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    XmlMotorActuatorCfg,
)

RAIL = BuiltinVelocityActuatorCfg(joint_names_expr=("rail",), damping=2.0, effort_limit=3.0)
KNEE = DelayedActuatorCfg(
    base_cfg=IdealPdActuatorCfg(
        joint_names_expr=("knee",), stiffness=20.0, damping=0.3, effort_limit=5.0
    ),
    delay_min_lag=2,
    delay_max_lag=2,
)
HIP = BuiltinPositionActuatorCfg(joint_names_expr=("hip",), stiffness=30.0, damping=0.5)
MIXED = (RAIL, KNEE, HIP)
SPARE = XmlMotorActuatorCfg(joint_names_expr=("spare",))


def grouped(cfgs, root=None):
    """A group, initialized, and its physics."""
    root = root or robot()
    group = ActuatorGroup(cfgs)
    group.edit_mjcf(root)
    physics = compiled(root)
    group.initialize(physics)
    place(physics)
    group.reset()
    return group, physics


def refused(cfgs, root, error=ValueError):
    """The message of a refusal, which leaves the model as it was."""
    before = root.to_xml_string()
    with pytest.raises(error) as caught:
        ActuatorGroup(cfgs).edit_mjcf(root)
    assert root.to_xml_string() == before
    return str(caught.value)


def test_columns_are_in_kinematic_order_whatever_the_order_of_the_configs():
    for cfgs in (MIXED, MIXED[::-1], (KNEE, RAIL, HIP)):
        group, physics = grouped(cfgs)
        model = physics.model.ptr
        assert group.joint_names == JOINTS
        assert [model.joint(i).name for i in group.joint_ids] == [f"robot/{n}" for n in JOINTS]
        assert [element.name for element in group.elements] == [*JOINTS]
        for i, element in zip(group.ctrl_ids, group.elements, strict=True):
            assert i == model.actuator(element.full_identifier).id
        assert group.takes == {"position_target", "velocity_target", "effort_target"}
        assert group.computed_effort.shape == group.applied_effort.shape == (3,)


@pytest.mark.parametrize("n_sims", [None, 3])
def test_every_joint_follows_its_own_law(n_sims):
    group, physics = grouped(MIXED)
    shape = (3,)
    if n_sims is not None:
        physics = batch_of(physics, n_sims)
        group.initialize(physics)
        group.reset()
        shape = (n_sims, 3)
    # Efforts only where the knee's actuator makes them.
    script = [
        ActuatorCmd(
            position_target=cmd.position_target,
            velocity_target=cmd.velocity_target,
            effort_target=cmd.effort_target * [0.0, 1.0, 0.0],
        )
        for cmd in commands(30, shape, ("position", "velocity", "effort"))
    ]
    states = []

    def look(k):
        data = getattr(physics, "data", physics)
        model = group.simulation.model
        q = np.array(data.qpos[..., model.jnt_qposadr[group.joint_ids]])
        states.append((q, np.array(data.qvel[..., model.jnt_dofadr[group.joint_ids]])))

    record = run(group, physics, script, look)
    for row in np.ndindex(shape[:-1]):
        for k, (q, qd) in enumerate(states):
            cmd = script[k]
            late = script[max(k - 2, 0)]
            hip, knee, rail = ((*row, j) for j in range(3))
            asked = [
                pd(30.0, 0.5, cmd.position_target[hip], None, None, q[hip], qd[hip]),
                pd(
                    20.0,
                    0.3,
                    late.position_target[knee],
                    late.velocity_target[knee],
                    late.effort_target[knee],
                    q[knee],
                    qd[knee],
                ),
                2.0 * (cmd.velocity_target[rail] - qd[rail]),
            ]
            left = [asked[0], clip(asked[1], -5.0, 5.0), clip(asked[2], -3.0, 3.0)]
            np.testing.assert_allclose(record.computed[k][row], asked, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(record.applied[k][row], left, rtol=1e-12, atol=1e-12)


def test_apply_writes_what_compute_gives():
    script = commands(30, (3,), ("position", "velocity"), hold=5)
    records = []
    for apply in (True, False):
        group, physics = grouped(MIXED)
        positions = []
        for cmd in script:
            if apply:
                group.apply(cmd)
            else:
                physics.data.ctrl[group.ctrl_ids] = group.compute(cmd)
            physics.step()
            positions.append(physics.data.qpos.copy())
        records.append(np.array(positions))
    np.testing.assert_array_equal(records[0], records[1])


def test_efforts_are_those_of_every_step_also_while_the_controls_hold():
    late_hip = DelayedActuatorCfg(base_cfg=HIP, delay_min_lag=4, delay_max_lag=4)
    group, physics = grouped((RAIL, KNEE, late_hip))
    dofs = physics.model.ptr.jnt_dofadr[group.joint_ids]
    seen = []
    for cmd in commands(30, (3,), ("position", "velocity"), hold=10):
        group.apply(cmd)
        physics.step()
        exerted = physics.data.qfrc_actuator[dofs]
        np.testing.assert_allclose(group.applied_effort, exerted, rtol=1e-12, atol=1e-12)
        seen.append(group.applied_effort)
    assert (np.diff(seen, axis=0) != 0).any(axis=0).all()


def test_apply_leaves_other_controls_alone():
    group, physics = grouped(MIXED)
    spare = physics.model.ptr.actuator("robot/spare").id
    physics.data.ctrl[spare] = 0.7
    group.apply(ActuatorCmd(position_target=[1.0] * 3, velocity_target=[1.0] * 3))
    assert physics.data.ctrl[spare] == 0.7
    assert (physics.data.ctrl[group.ctrl_ids] != 0).all()


@pytest.mark.parametrize("n_sims", [None, 2])
def test_a_command_that_stays_is_applied_again_after_a_reset_and_after_changes(n_sims):
    cfgs = (
        BuiltinPdActuatorCfg(joint_names_expr=("hip", "knee"), stiffness=10.0, damping=0.1),
        BuiltinMotorActuatorCfg(joint_names_expr=("rail",)),
    )
    group, physics = grouped(cfgs)
    shape = (3,)
    if n_sims is not None:
        physics, shape = batch_of(physics, n_sims), (n_sims, 3)
        group.initialize(physics)
    data = getattr(physics, "data", physics)
    cmd = ActuatorCmd(position_target=np.ones(shape), effort_target=np.full(shape, 0.5))
    group.apply(cmd)
    np.testing.assert_array_equal(data.ctrl[..., group.ctrl_ids], np.full(shape, [10.5, 10.5, 0.5]))
    place(physics)
    assert (data.ctrl == 0).all()
    group.reset()
    group.apply(cmd)
    np.testing.assert_array_equal(data.ctrl[..., group.ctrl_ids], np.full(shape, [10.5, 10.5, 0.5]))
    group.actuators[0].set("stiffness", 20.0)
    group.apply(cmd)
    np.testing.assert_array_equal(data.ctrl[..., group.ctrl_ids], np.full(shape, [20.5, 20.5, 0.5]))
    # What holds is not written at every step.
    data.ctrl[...] = 0.0
    group.apply(cmd)
    assert (data.ctrl == 0).all()


def test_targets_that_other_joints_follow_are_no_error():
    group, _ = grouped(MIXED)
    everything = ActuatorCmd(position_target=np.ones(3), velocity_target=np.ones(3))
    controls = group.compute(everything)
    assert controls[0] == 1.0
    assert controls[2] == 1.0


@pytest.mark.parametrize("cfgs", [(HIP,), (HIP, KNEE.base_cfg), (HIP, RAIL)])
def test_targets_that_no_joint_can_follow_are_refused(cfgs):
    group, _ = grouped(cfgs)
    n = len(group.joint_names)
    targets = {"position_target": np.ones(n), "velocity_target": np.ones(n)}
    effort = ActuatorCmd(**targets, effort_target=np.ones(n))
    if "velocity_target" in group.takes:
        group.compute(ActuatorCmd(**targets))
    else:
        with pytest.raises(ValueError, match="'hip' cannot follow a velocity_target"):
            group.compute(ActuatorCmd(**targets))
    with pytest.raises(ValueError, match="cannot follow a"):
        group.compute(effort)


def test_two_positions_and_a_velocity_that_nobody_takes():
    knee = BuiltinPositionActuatorCfg(joint_names_expr=("knee",), stiffness=1.0, damping=0.1)
    group, _ = grouped((HIP, knee))
    with pytest.raises(ValueError, match="cannot follow a velocity_target"):
        group.compute(ActuatorCmd(position_target=np.ones(2), velocity_target=np.ones(2)))


@pytest.mark.parametrize("call", ["compute", "apply"])
@pytest.mark.parametrize("cfgs", [MIXED, (HIP,)])
def test_wrong_shape(cfgs, call):
    group, _ = grouped(cfgs)
    with pytest.raises(ValueError) as error:
        getattr(group, call)(ActuatorCmd(position_target=np.zeros(7)))
    for part in ("(7,)", str((len(group.joint_names),)), "'hip'"):
        assert part in str(error.value)


def test_missing_target():
    group, _ = grouped(MIXED)
    with pytest.raises(ValueError, match="'rail' needs a velocity_target"):
        group.compute(ActuatorCmd(position_target=np.zeros(3)))


def test_order_of_calls():
    group = ActuatorGroup(MIXED)
    with pytest.raises(RuntimeError, match="edit_mjcf"):
        group.initialize(compiled(robot()))
    root = robot()
    group.edit_mjcf(root)
    with pytest.raises(RuntimeError, match=r"initialize\(physics\)"):
        group.compute(ActuatorCmd(position_target=np.zeros(3)))
    group.initialize(compiled(root))
    with pytest.raises(ValueError, match="the model's timestep"):
        group.update(2 * TIMESTEP)
    group.update(TIMESTEP)


def test_partial_resets_reach_every_actuator():
    group, physics = grouped(MIXED)
    batch = Batch(physics.model.ptr, 3, 1)
    group.initialize(batch)
    group.reset()
    script = commands(20, (3, 3), ("position", "velocity"))
    whole = run(group, batch, script)
    place(batch)
    batch.qpos[...] = batch.qpos[0]
    first = batch_of(physics, 3)
    group.initialize(first)
    group.reset()
    again = run(group, first, script)

    second = batch_of(physics, 3)
    group.initialize(second)
    group.reset()

    def reset(k):
        if k == 8:
            place(second, [0, 2])
            group.reset([0, 2])

    partly = run(group, second, script, reset)
    assert partly.row(1) == again.row(1)
    assert partly.row(0) != again.row(0)
    assert whole.row(1).ctrl.shape == again.row(1).ctrl.shape


# Refusals.


def test_a_joint_claimed_twice():
    hips = IdealPdActuatorCfg(joint_names_expr=("h.*", "knee"), stiffness=1.0, damping=0.1)
    message = refused((HIP, hips), robot())
    for part in (
        "joint 'hip' is claimed by BuiltinPositionActuatorCfg(joint_names_expr=('hip',))",
        "and by IdealPdActuatorCfg(joint_names_expr=('h.*', 'knee'))",
        "narrower",
    ):
        assert part in message
    assert "DelayedActuatorCfg(joint_names_expr=('knee',))" in refused((KNEE, hips), robot())
    assert "'spare' is claimed by" in refused((SPARE, SPARE), robot())


@pytest.mark.parametrize(
    ("last", "part"),
    [
        (
            IdealPdActuatorCfg(joint_names_expr=("spare",), stiffness=1.0, damping=0.1),
            "already has",
        ),
        (XmlMotorActuatorCfg(joint_names_expr=("knee",), armature=1.0), "has 0 actuators"),
        (BuiltinMotorActuatorCfg(joint_names_expr=("ankle",)), "'ankle' matches none of"),
        (BuiltinMotorActuatorCfg(joint_names_expr=("knee",), armature={"k": 1.0}), "'k' matches"),
    ],
)
def test_a_refusal_of_the_last_one_undoes_nothing_because_nothing_was_done(last, part):
    assert part in refused((HIP, RAIL, last), robot())


def test_what_is_no_config():
    with pytest.raises(ValueError, match="actuators is empty"):
        ActuatorGroup(())
    with pytest.raises(TypeError, match="should be actuator configs, got 'hip'"):
        ActuatorGroup((HIP, "hip"))
    with pytest.raises(TypeError, match="should be actuator configs"):
        ActuatorGroup((HIP.build(),))
    assert len(ActuatorGroup(HIP).actuators) == 1


G1 = ("left_hip_pitch_joint", "left_hip_roll_joint", "right_hip_pitch_joint", "waist_yaw_joint")


def g1():
    bodies = "".join(f'<body><joint name="{name}"/><geom size="0.1"/></body>' for name in G1)
    return mjcf.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")


@pytest.mark.parametrize("turned", [False, True])
def test_groups_that_overlap_are_told_how_to_be_narrower(turned):
    """The groups of the document's humanoid, of which one claims what is also another's."""
    all_hips = BuiltinPositionActuatorCfg(
        joint_names_expr=(".*_hip_.*", "waist_yaw_joint"), stiffness=180.0, damping=18.0
    )
    pitch = BuiltinPositionActuatorCfg(
        joint_names_expr=("left_hip_pitch_joint", "right_hip_pitch_joint"),
        stiffness=200.0,
        damping=20.0,
    )
    cfgs = (pitch, all_hips) if turned else (all_hips, pitch)
    message = refused(cfgs, g1())
    assert "'left_hip_pitch_joint', 'right_hip_pitch_joint' are claimed by" in message
    assert f"make the {'second' if turned else 'first'} narrower" in message
    advice = ast.literal_eval(message.rsplit("joint_names_expr=", 1)[1])
    mended = dataclasses.replace(all_hips, joint_names_expr=advice)
    group = ActuatorGroup([mended if cfg is all_hips else cfg for cfg in cfgs])
    group.edit_mjcf(g1())
    assert group.joint_names == G1


def test_ids_before_there_is_a_model():
    group = ActuatorGroup((HIP, KNEE))
    for name in ("joint_names", "joint_ids", "ctrl_ids", "elements", "driven", "positions"):
        with pytest.raises(RuntimeError, match=r"edit_mjcf\(root\) before the model is compiled"):
            getattr(group, name)
    group.edit_mjcf(robot())
    assert group.joint_names == ("hip", "knee")
    for name in ("joint_ids", "ctrl_ids", "positions"):
        with pytest.raises(RuntimeError, match=r"call initialize\(physics\)"):
            getattr(group, name)
