"""Actuators of tendons and sites."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.actuators.contract import ActuatorContract, DeterministicContract
from tests.actuators.reference import clip, pd
from tests.actuators.robots import built, compiled, place, robot, run
from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    BuiltinMotorActuatorCfg,
    BuiltinPositionActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
)


class OfTendons(DeterministicContract):
    joints = ("pair", "lone")
    of_joints = False

    def measured(self, physics, actuator):
        """Length and speed from the joints: hip/2 − 2 knee, and 3 rail."""
        model = actuator.simulation.model
        data = getattr(physics, "data", physics)
        ids = [model.joint(f"robot/{name}").id for name in ("hip", "knee", "rail")]
        for array, at in ((data.qpos, model.jnt_qposadr), (data.qvel, model.jnt_dofadr)):
            hip, knee, rail = (array[..., at[i]] for i in ids)
            yield np.stack([0.5 * hip - 2.0 * knee, 3.0 * rail], axis=-1)


class TestBuiltinTendon(OfTendons):
    limits = (3.0, 3.0)
    cfg = BuiltinPositionActuatorCfg(
        joint_names_expr=("lone", "pair"),
        transmission="tendon",
        stiffness=12.0,
        damping=0.2,
        effort_limit=3.0,
        armature=0.01,
    )

    def expected(self, j, history, q, qd):
        asked = pd(12.0, 0.2, history[-1][0], None, None, q, qd)
        return asked, clip(asked, -3.0, 3.0)


class TestExplicitTendon(OfTendons):
    words = ("position", "velocity", "effort")
    limits = (3.0, 3.0)
    cfg = DelayedActuatorCfg(
        base_cfg=IdealPdActuatorCfg(
            joint_names_expr=(".*",),
            transmission="tendon",
            stiffness={"pair": 12.0, "lone": 9.0},
            damping=0.2,
            effort_limit=3.0,
        ),
        delay_target="effort",
        delay_min_lag=2,
        delay_max_lag=2,
    )

    def expected(self, j, history, q, qd):
        late = history[max(len(history) - 3, 0)][2]
        asked = pd((12.0, 9.0)[j], 0.2, *history[-1][:2], late, q, qd)
        return asked, clip(asked, -3.0, 3.0)


class TestXmlTendon(OfTendons):
    cfg = XmlPositionActuatorCfg(joint_names_expr=(".*",), transmission="tendon")
    actuator = """<position name="pair" tendon="pair" kp="12" gear="-0.5"/>
      <position name="lone" tendon="lone" kp="7" kv="0.1"/>"""

    def expected(self, j, history, q, qd):
        asked = pd((12.0 * 0.25, 7.0)[j], (0.0, 0.1)[j], history[-1][0], None, None, q, qd)
        return asked, asked


class TestSite(ActuatorContract):
    joints = ("sole",)
    of_joints = False
    words = ("effort",)
    scale = 8.0
    limits = (6.0,)
    cfg = BuiltinMotorActuatorCfg(
        joint_names_expr=("sole",),
        transmission="site",
        gear=(0, 0, 1, 0, 0.5, 0),
        effort_limit=6.0,
    )


def test_a_site_is_pushed_and_turned_along_its_own_axes():
    actuator, physics = built(TestSite.cfg, robot())
    model, data = physics.model.ptr, physics.data.ptr
    for _ in range(40):  # somewhere, not straight
        physics.step()
    site = model.site("robot/sole").id
    force, torque = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, force, torque, site)
    frame = data.site_xmat[site].reshape(3, 3)
    expected = 4.0 * (frame[:, 2] @ force + 0.5 * frame[:, 1] @ torque)
    physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(ActuatorCmd(effort_target=[4.0]))
    physics.step()
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(data.qfrc_actuator, expected, rtol=1e-10, atol=1e-10)


def test_explicit_damping_of_a_site():
    gear = (0, 1, 0, 0, 0, 0)
    cfg = IdealPdActuatorCfg(
        joint_names_expr=("sole",), transmission="site", gear=gear, stiffness=0.0, damping=3.0
    )
    actuator, physics = built(cfg, robot())
    assert actuator.needs == frozenset()
    physics.data.qvel[:] = np.linspace(-1.0, 1.0, len(physics.data.qvel))
    physics.forward()
    velocity = np.zeros(6)
    site = physics.model.ptr.site("robot/sole").id
    mujoco.mj_objectVelocity(
        physics.model.ptr, physics.data.ptr, mujoco.mjtObj.mjOBJ_SITE, site, velocity, 1
    )
    actuator.compute(ActuatorCmd())
    assert abs(velocity[4]) > 0.01
    assert actuator.applied_effort[0] == pytest.approx(-3.0 * velocity[4], rel=1e-12)


def test_a_tendon_and_a_joint_of_one_name_have_a_column_each():
    root = robot()
    root.find("tendon", "lone").name = "rail"
    group = ActuatorGroup(
        (
            BuiltinMotorActuatorCfg(joint_names_expr=("rail",), transmission="tendon"),
            BuiltinMotorActuatorCfg(joint_names_expr=("rail", "hip")),
        )
    )
    group.edit_mjcf(root)
    physics = compiled(root)
    group.initialize(physics)
    assert group.joint_names == ("hip", "rail", "rail")
    place(physics)
    group.apply(ActuatorCmd(effort_target=[1.0, 2.0, 5.0]))
    physics.step()
    rail = physics.model.ptr.joint("robot/rail").dofadr[0]
    assert physics.data.qfrc_actuator[rail] == pytest.approx(2.0 + 3 * 5.0)


def test_unknown_tendons_and_sites():
    for transmission, names in (("tendon", "'pair', 'lone'"), ("site", "'sole'")):
        gear = (1, 0, 0, 0, 0, 0) if transmission == "site" else None
        cfg = BuiltinMotorActuatorCfg(
            joint_names_expr=("hip",), transmission=transmission, gear=gear
        )
        with pytest.raises(ValueError, match=f"'hip' matches none of {names}"):
            cfg.build().edit_mjcf(robot())


def test_a_wrapped_tendon_without_an_actuator():
    with pytest.raises(ValueError, match="tendon 'pair' has 0 actuators in the XML"):
        XmlMotorActuatorCfg(joint_names_expr=("pair",), transmission="tendon").build().edit_mjcf(
            robot('<motor joint="hip"/>')
        )


def test_effort_on_a_tendon_reaches_its_joints():
    cfg = BuiltinMotorActuatorCfg(joint_names_expr=("pair",), transmission="tendon")
    actuator, physics = built(cfg, robot())
    record = run(actuator, physics, [ActuatorCmd(effort_target=[2.0])])
    model = physics.model.ptr
    dofs = [model.joint(f"robot/{name}").dofadr[0] for name in ("hip", "knee", "rail")]
    np.testing.assert_allclose(record.exerted[0, dofs], [1.0, -4.0, 0.0])
