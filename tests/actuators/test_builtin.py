"""Actuators that MuJoCo has: their laws, and what default classes and integrators make of them."""

from __future__ import annotations

import numpy as np
import pytest
from dm_control import mjcf

from tests.actuators.contract import EXPRESSIONS, DeterministicContract
from tests.actuators.reference import clip, pd
from tests.actuators.robots import ROBOT, compiled, robot
from walkerkit.actuators import (
    ActuatorCmd,
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
)


class TestPosition(DeterministicContract):
    limits = (5.0, 5.0, 7.0)
    cfg = BuiltinPositionActuatorCfg(
        joint_names_expr=EXPRESSIONS,
        stiffness=25.0,
        damping=0.4,
        effort_limit={"hip": 5.0, "knee": 5.0, "rail": 7.0},
    )

    def expected(self, j, history, q, qd):
        asked = pd(25.0, 0.4, history[-1][0], None, None, q, qd)
        return asked, clip(asked, -self.limits[j], self.limits[j])


class TestVelocity(DeterministicContract):
    words = ("velocity",)
    scale = 5.0
    limits = (1.5, 1.5, 1.5)
    cfg = BuiltinVelocityActuatorCfg(
        joint_names_expr=EXPRESSIONS, damping={"rail": 0.7, "hip|knee": 0.3}, effort_limit=1.5
    )

    def expected(self, j, history, q, qd):
        asked = (0.3, 0.3, 0.7)[j] * (history[-1][1] - qd)
        return asked, clip(asked, -1.5, 1.5)


class TestMotor(DeterministicContract):
    words = ("effort",)
    limits = (0.5, 0.5, 0.5)
    cfg = BuiltinMotorActuatorCfg(joint_names_expr=EXPRESSIONS, effort_limit=0.5)

    def expected(self, j, history, q, qd):
        return history[-1][2], clip(history[-1][2], -0.5, 0.5)


class TestUnlimitedMotor(DeterministicContract):
    words = ("effort",)
    cfg = BuiltinMotorActuatorCfg(joint_names_expr=EXPRESSIONS)

    def expected(self, j, history, q, qd):
        return history[-1][2], history[-1][2]


class TestPd(DeterministicContract):
    words = ("position", "velocity", "effort")
    limits = (6.0, 6.0, 6.0)
    cfg = BuiltinPdActuatorCfg(
        joint_names_expr=EXPRESSIONS, stiffness=25.0, damping=0.4, effort_limit=6.0
    )

    def expected(self, j, history, q, qd):
        asked = pd(25.0, 0.4, *history[-1], q, qd)
        return asked, clip(asked, -6.0, 6.0)


# Default classes. Each of these changes a plain <general>, or keeps it from compiling.

LEAKS = (
    '<general dyntype="filter" dynprm="0.3 2 3"/>',
    '<general dyntype="integrator" actlimited="true" actrange="-1 1" actdim="1"/>',
    '<general gear="7 1 2"/>',
    '<general forcerange="-1 1"/>',
    '<general ctrlrange="-0.1 0.1"/>',
    '<general biastype="affine" biasprm="1 2 3"/>',
    '<general gaintype="affine" gainprm="5 6 7"/>',
    '<general damping="1 2 3" armature="0.4"/>',
    '<general delay="0.02" nsample="10" interp="linear"/>',
    '<general actearly="true"/>',
    '<position kp="3" kv="2" timeconst="0.1" gear="4"/>',
    '<position kp="3" inheritrange="1"/>',
    '<velocity kv="3"/>',
    '<motor gear="3" ctrlrange="-1 1" ctrllimited="true"/>',
    "<muscle/>",
)
BASE = {"joint_names_expr": EXPRESSIONS, "stiffness": 25.0, "damping": 0.4}
ADDED = {
    "position": BuiltinPositionActuatorCfg(**BASE),
    "velocity": BuiltinVelocityActuatorCfg(joint_names_expr=EXPRESSIONS, damping=0.4),
    "motor": BuiltinMotorActuatorCfg(joint_names_expr=EXPRESSIONS),
    "pd": BuiltinPdActuatorCfg(**BASE),
    "explicit": IdealPdActuatorCfg(**BASE),
    "native delay": DelayedActuatorCfg(
        base_cfg=BuiltinPositionActuatorCfg(**BASE), delay_min_lag=3, delay_max_lag=3
    ),
}


def forces(cfg, default):
    """Force of every actuator over some steps, in a model of which the spare motor is taken out."""
    root = mjcf.from_xml_string(
        ROBOT.format(default=default, actuator="").replace(
            '<motor name="spare" joint="spare"/>', ""
        )
    )
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    physics = compiled(root)
    actuator.initialize(physics)
    actuator.reset()
    rng = np.random.default_rng(3)
    record = []
    for _ in range(12):
        cmd = ActuatorCmd(**{name: rng.standard_normal(3) for name in actuator.takes})
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(cmd)
        physics.step()
        record.append((physics.data.actuator_force.copy(), physics.data.qpos.copy()))
    return record


@pytest.mark.parametrize("cfg", ADDED.values(), ids=ADDED)
def test_default_classes_do_not_reach_what_is_added(cfg):
    plain = forces(cfg, "")
    for leak in LEAKS:
        for one, other in zip(forces(cfg, leak), plain, strict=True):
            np.testing.assert_array_equal(one[0], other[0], err_msg=leak)
            np.testing.assert_array_equal(one[1], other[1], err_msg=leak)


# Native against explicit.

PENDULUM = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="{integrator}"/>
  <worldbody><body><joint name="j" axis="0 1 0" armature="0.01"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.5"/></body></worldbody>
</mujoco>
"""


def swing(cfg, integrator, targets):
    """Position of a pendulum that follows the targets."""
    root = mjcf.from_xml_string(PENDULUM.format(integrator=integrator))
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    actuator.initialize(physics)
    actuator.reset()
    record = []
    for target in targets:
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(target)
        physics.step()
        record.append(float(physics.data.qpos[0]))
    return np.array(record)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("kind", ["position", "pd"])
def test_native_and_explicit_pd_agree_at_small_gains(integrator, kind):
    gains = {"joint_names_expr": ("j",), "stiffness": 4.0, "damping": 0.2}
    time = 0.002 * np.arange(1000)
    position = 0.3 * (1 - np.cos(3.0 * time))
    targets = [ActuatorCmd(position_target=[p]) for p in position]
    if kind == "pd":
        targets = [
            ActuatorCmd(position_target=[p], velocity_target=[v], effort_target=[e])
            for p, v, e in zip(position, 0.9 * np.sin(3.0 * time), 0.1 * position, strict=True)
        ]
    native = {"position": BuiltinPositionActuatorCfg, "pd": BuiltinPdActuatorCfg}[kind](**gains)
    one = swing(native, integrator, targets)
    other = swing(IdealPdActuatorCfg(**gains), integrator, targets)
    assert np.ptp(one) > 0.3
    assert np.abs(one - other).max() < 1e-3
    # Only implicitfast integrates the damping of one of them in another way.
    assert (np.abs(one - other).max() > 1e-9) == (integrator == "implicitfast")


def test_builtin_bears_gains_that_explicit_does_not():
    gains = {"joint_names_expr": ("j",), "stiffness": 1000.0, "damping": 40.0}
    targets = [ActuatorCmd(position_target=[0.4])] * 1000
    settled = swing(BuiltinPdActuatorCfg(**gains), "implicitfast", targets)
    assert settled[-1] == pytest.approx(0.4, abs=0.01)
    for cfg, integrator in (
        (IdealPdActuatorCfg(**gains), "implicitfast"),
        (BuiltinPdActuatorCfg(**gains), "Euler"),
    ):
        with pytest.warns(UserWarning, match="joint 'j': damping 40 is beyond"):
            exploded = swing(cfg, integrator, targets[:10])
        assert np.abs(exploded).max() > 1.0


# Gains that change.


def test_a_gain_that_was_zero_follows_its_target():
    gains = {"joint_names_expr": EXPRESSIONS, "damping": 0.4}
    root = robot()
    actuator = BuiltinPositionActuatorCfg(stiffness=0.0, **gains).build()
    actuator.edit_mjcf(root)
    actuator.initialize(compiled(root))
    actuator.set("stiffness", 12.0)
    actuator.compute(ActuatorCmd(position_target=[0.5, 0.5, 0.5]))
    np.testing.assert_allclose(actuator.computed_effort, 6.0)


@pytest.mark.parametrize("name", ["stiffness", "damping", "strength"])
def test_changed_gains_are_those_of_another_config(name):
    values = {"stiffness": 25.0, "damping": 0.4, "strength": 1.0}
    changed = {**values, name: 2.0 * values[name]}
    strength = changed.pop("strength")
    cmd = ActuatorCmd(position_target=[0.5, -0.4, 0.3])
    for cls in (BuiltinPositionActuatorCfg, BuiltinPdActuatorCfg):
        efforts = []
        for gains in (values, changed):
            root = robot()
            actuator = cls(
                joint_names_expr=EXPRESSIONS,
                stiffness=gains["stiffness"],
                damping=gains["damping"],
                effort_limit=11.0,
            ).build()
            actuator.edit_mjcf(root)
            physics = compiled(root)
            actuator.initialize(physics)
            if gains is values:
                actuator.set(name, 2.0 * values[name])
            physics.data.qvel[:] = 0.3
            physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(cmd)
            physics.step()
            efforts.append((actuator.applied_effort, physics.data.actuator_force[1:].copy()))
        factor = strength if name == "strength" else 1.0
        np.testing.assert_allclose(efforts[0][0], factor * efforts[1][0], rtol=1e-12)
        np.testing.assert_allclose(efforts[0][1], factor * efforts[1][1], rtol=1e-12)


def test_no_strength_at_all():
    for limit in (None, 3.0):
        root = robot()
        cfg = BuiltinMotorActuatorCfg(joint_names_expr=EXPRESSIONS, effort_limit=limit)
        actuator = cfg.build()
        actuator.edit_mjcf(root)
        actuator.initialize(compiled(root))
        actuator.set("strength", 0.0)
        actuator.compute(ActuatorCmd(effort_target=np.full(3, 9.0)))
        np.testing.assert_array_equal(actuator.applied_effort, np.zeros(3))
