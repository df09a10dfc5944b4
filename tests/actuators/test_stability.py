"""The bound of explicit gains, held against simulated joints on both sides of it."""

from __future__ import annotations

import re
import warnings

import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from walkerkit.actuators import (
    ActuatorCmd,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
)
from walkerkit.actuators.stability import joint_inertia, stability_bounds

JOINT = """
<mujoco><option timestep="{timestep}" gravity="0 0 0" integrator="{integrator}"/>
  <worldbody><body><joint name="j" type="{type}" axis="0 1 0" armature="{armature}"
      damping="{damping}"/>
    <inertial pos="0 0 0" mass="0.03" diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>
"""


def joint(type_="hinge", timestep=0.002, integrator="Euler", armature=0.0, damping=0.0):
    """One joint of inertia 0.01 (0.03 on a slide) and its armature."""
    return mjcf.from_xml_string(
        JOINT.format(
            type=type_,
            timestep=timestep,
            integrator=integrator,
            armature=armature,
            damping=damping,
        )
    )


def diverges(root, kp, kd, n_steps=20000):
    """Whether a joint runs away from a small disturbance, faster than by a tiny growth."""
    actuator = IdealPdActuatorCfg(joint_names_expr=("j",), stiffness=kp, damping=kd).build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        actuator.initialize(physics)
    model, data = physics.model.ptr, physics.data.ptr
    data.qvel[0] = 1e-6
    cmd = ActuatorCmd(position_target=[0.0])
    for _ in range(n_steps):
        data.ctrl[:] = actuator.compute(cmd)
        mujoco.mj_step(model, data)
        size = abs(data.qpos[0]) + model.opt.timestep * abs(data.qvel[0])
        if size > 1e-3:
            return True
        if size < 1e-12:
            return False
    return False


@pytest.mark.parametrize("type_", ["hinge", "slide"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"integrator": "implicitfast"},
        {"timestep": 0.005, "armature": 0.02},
        {"damping": 3.0},
        {"damping": 0.4, "integrator": "implicitfast", "armature": 0.01},
    ],
)
@pytest.mark.parametrize("at", ["damping", "stiffness", "both"])
def test_just_below_is_stable_and_just_above_diverges(type_, options, at):
    """Warned of where it diverges, and nowhere else."""
    inertia = (0.01 if type_ == "hinge" else 0.03) + options.get("armature", 0.0)
    h, own = options.get("timestep", 0.002), options.get("damping", 0.0)
    # From the stability of the discrete-time recursion, by hand: h/(I + h b) (kd + b) < 2, and
    # h² kp/(I + h b) < 4 − 2 h (kd + b)/(I + h b).
    most = 2 * inertia / h + own
    kd = {"damping": most, "stiffness": 0.1 * most, "both": 0.7 * most}[at]
    kp = 0.0 if at == "damping" else 2 * (most - kd) / h
    for factor, beyond in ((0.98, False), (1.02, True)):
        gains = (kp, factor * kd) if at == "damping" else (factor * kp, kd)
        assert diverges(joint(type_, **options), *gains) == beyond
        assert bool(warned(joint(type_, **options), *gains)) == beyond


def warned(root, kp, kd, cls=IdealPdActuatorCfg, **options):
    """The warnings of `initialize`."""
    gains = {"stiffness": kp, "damping": kd}
    if cls is BuiltinVelocityActuatorCfg:
        del gains["stiffness"]
    cfg = cls(joint_names_expr=("j",), **gains, **options)
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        actuator.initialize(physics)
    assert all(issubclass(warning.category, UserWarning) for warning in caught)
    return [str(warning.message) for warning in caught]


def test_the_warning_names_joint_bound_and_remedy():
    (message,) = warned(joint(), 10.0, 12.0)
    for part in ("joint 'j'", "damping 12 is beyond 10", "0.01", "0.002 s", "BuiltinPdActuatorCfg"):
        assert part in message
    (message,) = warned(joint(damping=3.0), 10.0, 15.0)
    assert "damping 15 is beyond 13 = 2 I/h + 3 (the joint's own), the bound" in message
    assert "inertia 0.01 kg·m²" in message
    (message,) = warned(joint(), 2000.0, 9.0)
    for part in ("joint 'j'", "stiffness 2000 is beyond 1e+03 beside damping 9", "smaller gains"):
        assert part in message


MOTOR = {"effort_limit": 1.0, "saturation_effort": 2.0, "velocity_limit": 3.0}


@pytest.mark.parametrize("own", [0.0, 3.0])
@pytest.mark.parametrize(("kp", "kd"), [(10.0, 16.0), (9000.0, 8.0), (2e5, 0.5), (0.0, 40.0)])
@pytest.mark.parametrize(
    ("cls", "options"),
    [
        (IdealPdActuatorCfg, {}),
        (DcMotorActuatorCfg, MOTOR),
        (BuiltinPositionActuatorCfg, {}),
        (BuiltinPdActuatorCfg, {}),
    ],
)
def test_every_remedy_is_one(cls, options, kp, kd, own):
    (message,) = warned(joint(damping=own), kp, kd, cls, **options)
    shorter = float(re.search(r"a timestep of (\S+) s", message)[1])
    assert warned(joint(damping=own, timestep=shorter), kp, kd, cls, **options) == []
    assert warned(joint(damping=own, timestep=1.05 * shorter), kp, kd, cls, **options)
    native = "Builtin" in cls.__name__
    if "implicitfast" in message:
        assert cls is not DcMotorActuatorCfg
        assert ("BuiltinPdActuatorCfg" in message) == (not native)
        same = cls if native else BuiltinPdActuatorCfg
        implicit = joint(damping=own, integrator="implicitfast")
        assert warned(implicit, kp, kd, same) == []
    else:
        assert cls is DcMotorActuatorCfg or kp > 1e5
        assert ("Python" in message) == (cls is DcMotorActuatorCfg)
        more = float(re.search(r"\((\S+) kg·m² more\)", message)[1])
        assert warned(joint(damping=own, armature=more), kp, kd, cls, **options) == []
        assert warned(joint(damping=own, armature=0.95 * more), kp, kd, cls, **options)


def test_implicit_integration_is_no_remedy_where_it_diverges_as_well():
    """Just below and just above what MuJoCo's own position servo bears under implicitfast."""
    kd, h, inertia = 1.0, 0.002, 0.01
    most = 4 * inertia / h**2 + 2 * kd / h
    for kp, named in ((0.98 * most, True), (1.02 * most, False)):
        (message,) = warned(joint(), kp, kd, BuiltinPositionActuatorCfg)
        assert ("implicitfast" in message) == named
        root = joint(integrator="implicitfast")
        cfg = BuiltinPositionActuatorCfg(joint_names_expr=("j",), stiffness=kp, damping=kd)
        actuator = cfg.build()
        actuator.edit_mjcf(root)
        physics = mjcf.Physics.from_mjcf_model(root)
        physics.data.qvel[0] = 1e-6
        most_q, steps = 0.0, 0
        while most_q < 1e-3 and steps < 3000:
            mujoco.mj_step(physics.model.ptr, physics.data.ptr)
            most_q, steps = max(most_q, abs(float(physics.data.qpos[0]))), steps + 1
        assert (most_q < 1e-3) == named


@pytest.mark.parametrize(
    "cls", [BuiltinPositionActuatorCfg, BuiltinPdActuatorCfg, BuiltinVelocityActuatorCfg]
)
def test_builtin_ones_warn_where_the_integrator_is_explicit(cls):
    assert warned(joint(integrator="implicitfast"), 1e4, 1e3, cls) == []
    assert "damping 1000 is beyond" in warned(joint(integrator="Euler"), 1e4, 1e3, cls)[0]
    assert warned(joint(integrator="Euler"), 100.0, 1.0, cls) == []


def test_sane_gains_are_no_warning():
    assert warned(joint(), 100.0, 1.0) == []
    assert warned(joint(), 0.0, 0.0) == []
    cfg = DelayedActuatorCfg(
        base_cfg=IdealPdActuatorCfg(joint_names_expr=("j",), stiffness=100.0, damping=1.0),
        delay_max_lag=3,
    )
    root = joint()
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    actuator.initialize(mjcf.Physics.from_mjcf_model(root))


def test_only_the_joints_concerned_are_named():
    root = mjcf.from_xml_string(
        """<mujoco><worldbody><body><joint name="a" armature="1"/><geom size="0.1"/></body>
        <body><joint name="b" armature="0.0001"/><geom size="0.01"/></body></worldbody></mujoco>"""
    )
    cfg = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=1.0, damping={"a": 3.0, "b": 2.0})
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    with pytest.warns(UserWarning, match="joint 'b': damping 2 is beyond") as caught:
        actuator.initialize(mjcf.Physics.from_mjcf_model(root))
    assert len(caught) == 1


def test_inertia_is_what_an_effort_accelerates():
    root = mjcf.from_xml_string(
        """<mujoco><option gravity="0 0 0"><flag contact="disable"/></option><worldbody>
        <body><freejoint/><geom size="0.1"/>
          <body><joint name="a" axis="0 1 0" armature="0.01"/>
            <geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.3"/>
            <body pos="0 0 -0.3"><joint name="b" axis="0 1 0"/>
              <geom type="capsule" size="0.02" fromto="0 0 0 0 0.1 -0.3"/></body></body></body>
        </worldbody></mujoco>"""
    )
    physics = mjcf.Physics.from_mjcf_model(root)
    model, data = physics.model.ptr, physics.data.ptr
    dofs = np.array([6, 7])
    inertia = joint_inertia(model, dofs)
    for dof, value in zip(dofs, inertia, strict=True):
        data.qfrc_applied[:] = 0.0
        data.qfrc_applied[dof] = 1.0
        mujoco.mj_forward(model, data)
        assert value == pytest.approx(1.0 / data.qacc[dof], rel=1e-9)


def test_bounds_are_never_negative():
    damping = np.array([0.0, 5.0, 50.0])
    most_damping, most_stiffness = stability_bounds(np.full(3, 0.01), 0.002, damping)
    np.testing.assert_allclose(most_damping, 10.0)
    np.testing.assert_allclose(most_stiffness, [10000.0, 5000.0, 0.0])
