"""Explicit actuators that are computed in one go do what each of them does alone, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from dm_control import mjcf
from mujoco.batch import Batch

from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    BuiltinPositionActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    RemotizedPdActuatorCfg,
)

ROBOT = """
<mujoco><compiler angle="radian"/><worldbody>{}</worldbody>
  <tendon><fixed name="cord"><joint joint="0_0" coef="1"/></fixed></tendon></mujoco>
"""
LEG = """<body pos="0 {0} 0"><joint name="{0}_0" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.2"/>
  <body pos="0 0 -0.3"><joint name="{0}_1" axis="0 1 0" armature="0.02"/>
  <geom size="0.08" pos="0 0 -0.2"/></body></body>"""
N = 6
MOTOR = {"saturation_effort": 6.0, "velocity_limit": 8.0, "effort_limit": 4.0}


def pd(*names, kp=8.0, kd=0.3, **more):
    return IdealPdActuatorCfg(joint_names_expr=names, stiffness=kp, damping=kd, **more)


def dc(*names, kp=8.0, kd=0.3, **more):
    return DcMotorActuatorCfg(joint_names_expr=names, stiffness=kp, damping=kd, **{**MOTOR, **more})


def late(cfg, **delay):
    return DelayedActuatorCfg(base_cfg=cfg, **delay)


ROBOTS = {
    "two": (dc("._1", kp=5.0), dc("._0")),
    "in turns": (dc("0_0", "2_1"), dc("1_.", kp=3.0), dc("0_1", "2_0", kd=0.5)),
    "of two laws": (pd("0_."), dc("1_."), pd("2_.", kp=2.0, effort_limit=1.0)),
    "two of each": (pd("0_0"), dc("0_1"), pd("1_0", kp=2.0), dc("1_1"), pd("2_.")),
    "late": (late(dc("._0"), delay_max_lag=3), dc("._1", kp=4.0)),
    "late by different lags": (
        late(pd("._0"), delay_min_lag=2, delay_max_lag=2),
        late(
            pd("._1"),
            delay_target=("position", "velocity", "effort"),
            delay_max_lag=4,
            delay_hold_prob=0.5,
            seed=3,
        ),
    ),
    "beside others": (
        dc("0_0"),
        BuiltinPositionActuatorCfg(joint_names_expr=("1_.",), stiffness=4.0, damping=0.1),
        dc("2_."),
        RemotizedPdActuatorCfg(
            joint_names_expr=("0_1",),
            stiffness=4.0,
            damping=0.1,
            effort_lookup=((-1.0, 1.0), (1.0, 2.0)),
        ),
    ),
}


def model():
    return mjcf.from_xml_string(ROBOT.format("".join(LEG.format(i) for i in range(N // 2))))


def started(cfgs):
    root = model()
    group = ActuatorGroup(cfgs)
    group.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    group.initialize(physics)
    group.reset(random_state=np.random.RandomState(1))
    return group, physics


def targets(rng, cfgs):
    everything = all(not isinstance(cfg, BuiltinPositionActuatorCfg) for cfg in cfgs)
    given = {"position_target": rng.uniform(-1, 1, N)}
    if everything:
        given |= {"velocity_target": rng.uniform(-1, 1, N), "effort_target": rng.uniform(-1, 1, N)}
    return ActuatorCmd(**given)


def together(group, physics, cmd):
    group.apply(cmd)


def alone(group, physics, cmd):
    """Each by itself, as a group does whose actuators cannot be joined."""
    physics.data.ctrl[group.ctrl_ids] = group.compute(cmd)


def rollout(cfgs, step, change=None):
    group, physics = started(cfgs)
    rng = np.random.default_rng(5)
    rows = []
    for k in range(120):
        if k % 4 == 0:
            cmd = targets(rng, cfgs)
        if change is not None:
            change(group, k)
        step(group, physics, cmd)
        rows += [physics.data.ctrl.copy(), group.computed_effort, group.applied_effort]
        physics.step()
        rows.append(physics.data.qpos.copy())
    return np.concatenate(rows)


def vary(group, k):
    """Parameters, strengths and resets, one after the other."""
    first, last = group.actuators[0], group.actuators[-1]
    if k == 20:
        first.set("stiffness", np.linspace(1, 9, len(first.joint_names)))
    if k == 40:
        last.set("strength", 0.5)
    if k == 60:
        group.reset(random_state=np.random.RandomState(2))
    if k == 80:
        last.set("damping", last.nominal("damping") * 2)
    if k == 100:
        first.reset(random_state=np.random.RandomState(3))


@pytest.mark.parametrize("change", [None, vary])
@pytest.mark.parametrize("name", ROBOTS)
def test_bit_for_bit(name, change):
    cfgs = ROBOTS[name]
    np.testing.assert_array_equal(rollout(cfgs, together, change), rollout(cfgs, alone, change))


@pytest.mark.parametrize(
    ("name", "lots"),
    [("two", [2]), ("in turns", [3]), ("of two laws", [2]), ("two of each", [3, 2]), ("late", [2])],
)
def test_which_are_joined(name, lots):
    group, _ = started(ROBOTS[name])
    assert sorted(len(lot._bases) for lot in group._joined) == sorted(lots)
    assert len(group._apart) == len(group.actuators) - sum(lots)


def test_what_is_not_joined():
    cord = IdealPdActuatorCfg(
        joint_names_expr=("cord",), transmission="tendon", stiffness=1.0, damping=0.1
    )
    for cfgs in ((pd("0_0"), dc("0_1")), (pd("._1"), cord), (pd(".*"),)):
        group, _ = started(cfgs)
        assert group._joined == []


# Lags that are drawn differ between a batch and one physics, unless `Adoption` carries them over.
@pytest.mark.parametrize("name", [name for name in ROBOTS if not name.startswith("late")])
def test_a_batch_is_joined_and_comes_to_the_same(name):
    cfgs = ROBOTS[name]
    group, physics = started(cfgs)
    batch = Batch(physics.model.ptr, 2, 1)
    twin = ActuatorGroup(cfgs)
    twin.edit_mjcf(model())
    twin.initialize(batch)
    twin.reset()
    assert len(twin._joined) == len(group._joined)
    for target in np.linspace(-1, 1, 5):
        cmd = ActuatorCmd(position_target=np.linspace(-target, target, N))
        both = ActuatorCmd(position_target=np.tile(cmd.position_target, (2, 1)))
        for _ in range(6):
            group.apply(cmd)
            twin.apply(both)
            physics.step()
            batch.step()
            np.testing.assert_array_equal(twin.applied_effort[1], group.applied_effort)
    np.testing.assert_array_equal(batch.qpos[0], physics.data.qpos)
    np.testing.assert_array_equal(batch.qpos[1], physics.data.qpos)


def test_simulations_of_a_batch_differ_where_their_parameters_do():
    group, physics = started(ROBOTS["in turns"])
    batch = Batch(physics.model.ptr, 2, 1)
    group.initialize(batch)
    group.reset()
    first = group.actuators[0]
    first.set("stiffness", 2 * first.nominal("stiffness")[None], env_ids=[1])
    first.set("strength", 0.5, env_ids=[1])
    group.apply(ActuatorCmd(position_target=np.full((2, N), 0.01)))
    ratio = group.computed_effort[1] / group.computed_effort[0]
    mine = [name in first.joint_names for name in group.joint_names]
    np.testing.assert_allclose(ratio, np.where(mine, 2.0, 1.0))
    ratio = group.applied_effort[1] / group.applied_effort[0]
    np.testing.assert_allclose(ratio, 1.0)


def test_commands_are_checked():
    group, _ = started(ROBOTS["two"])
    with pytest.raises(ValueError, match="needs a position_target"):
        group.apply(ActuatorCmd(velocity_target=np.zeros(N)))
    with pytest.raises(ValueError, match=r"shape \(3,\)"):
        group.apply(ActuatorCmd(position_target=np.zeros(3)))
    group.apply(ActuatorCmd(position_target=np.zeros(N)))


def test_what_was_handed_out_stays():
    group, physics = started(ROBOTS["two"])
    group.apply(ActuatorCmd(position_target=np.ones(N)))
    first = group.applied_effort
    kept = first.copy()
    physics.step()
    group.apply(ActuatorCmd(position_target=-np.ones(N)))
    np.testing.assert_array_equal(first, kept)
    group.applied_effort[...] = 99.0
    assert not (group.applied_effort == 99.0).any()
    group.reset()
    np.testing.assert_array_equal(group.applied_effort, 0.0)


def test_again_after_another_compilation():
    group, physics = started(ROBOTS["in turns"])
    cmd = ActuatorCmd(position_target=np.linspace(-1, 1, N))
    group.apply(cmd)
    before = physics.data.ctrl.copy()
    group.actuators[0].set("stiffness", 1.0)
    other = mjcf.Physics.from_mjcf_model(group.elements[0].root)
    group.initialize(other)
    group.reset()
    group.apply(cmd)
    np.testing.assert_array_equal(other.data.ctrl, before)


def test_what_a_lot_needs_is_asked_of_every_command():
    group, _ = started(ROBOTS["two"])
    everything = {f"{word}_target": np.zeros(N) for word in ("position", "velocity", "effort")}
    group.apply(ActuatorCmd(**everything))
    del everything["position_target"]
    for _ in range(2):
        with pytest.raises(ValueError, match=r"'0_1'.* needs a position_target"):
            group.apply(ActuatorCmd(**everything))
