import math
from typing import Any

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from mujoco.batch import Batch
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Actuator
from walkerkit.actuators.builtin_dc_motor import (
    BuiltinDcMotorActuator,
    BuiltinDcMotorActuatorCfg,
)
from walkerkit.actuators.command import ActuatorCmd
from walkerkit.actuators.delayed import DelayedActuatorCfg

FloatArray = NDArray[np.float64]

LEAKY = """
  <default>
    <general gear="7 1 1" dyntype="filterexact" gaintype="affine" biastype="affine"
      dynprm="3 1 4 1 5 9 2 6 5 3" gainprm="5 8 9 7 9 3 2 3 8 4" biasprm="2 6 4 3 3 8 3 2 7 9"
      forcelimited="true" forcerange="-0.01 0.01" ctrllimited="true" ctrlrange="-0.1 0.1"
      actlimited="true" actrange="-0.1 0.1" damping="4 5 6" armature="3" nsample="4" delay="0.003"
      interp="linear" actdim="3" input="vel"/>
  </default>
"""
BODY = """
  <option timestep="0.001" integrator="{integrator}"/>
  {default}
  <worldbody>
    <body>
      <joint name="hip" axis="0 1 0" damping="0.02" armature="0.02"/>
      <geom size="0.05" pos="0 0 -0.2" mass="0.5"/>
      <body pos="0 0 -0.4">
        <joint name="knee" axis="0 1 0" damping="0.02" armature="0.02"/>
        <geom size="0.05" pos="0 0 -0.2" mass="0.3"/>
      </body>
    </body>
  </worldbody>
"""
STEPS = 1000
CONSTANTS = {"torque_constant": 0.3, "resistance": 2.0}
WINDING = 'motorconst="0.3 0" resistance="2"'
SERVO = {"stiffness": 7.0, "damping": 0.5, **CONSTANTS}

FEATURES: dict[str, tuple[str, dict[str, Any]]] = {
    "inductance": ('inductance="0.02 0"', {"inductance": 0.02}),
    "time constant": ('inductance="0 0.02"', {"electrical_time_constant": 0.02}),
    "cogging": (
        'cogging="0.2 12 0.3"',
        {"cogging_amplitude": 0.2, "cogging_periodicity": 12.0, "cogging_phase": 0.3},
    ),
    "LuGre": (
        'lugre="150 0.4 0.05 0.08 0.1"',
        {
            "bristle_stiffness": 150.0,
            "bristle_damping": 0.4,
            "coulomb_friction": 0.05,
            "static_friction": 0.08,
            "stribeck_velocity": 0.1,
        },
    ),
    "heat": (
        'thermal="0.7 0.9 0 0.004 20 35"',
        {
            "thermal_resistance": 0.7,
            "thermal_capacitance": 0.9,
            "temperature_coefficient": 0.004,
            "reference_temperature": 20.0,
            "ambient_temperature": 35.0,
        },
    ),
    "heat by time constant": (
        'thermal="0.7 0 0.5 0.00393 25 25"',
        {"thermal_resistance": 0.7, "thermal_time_constant": 0.5},
    ),
    "effort limit": ('saturation="0.4 0 0"', {"effort_limit": 0.4}),
    "current limit": ('saturation="0 1.7 0"', {"current_limit": 1.7}),
    "current rate": (
        'inductance="0.02 0" saturation="0 0 90"',
        {"inductance": 0.02, "current_rate_limit": 90.0},
    ),
}
EVERYTHING = (
    'inductance="0.02 0" saturation="0 1.7 90" cogging="0.2 12 0.3" '
    'lugre="150 0.4 0.05 0.08 0.1" thermal="0.7 0.9 0 0.004 20 35"',
    {
        **FEATURES["current rate"][1],
        **FEATURES["current limit"][1],
        **FEATURES["cogging"][1],
        **FEATURES["LuGre"][1],
        **FEATURES["heat"][1],
    },
)
TABLE: dict[str, tuple[str, dict[str, Any]]] = {
    "voltage": (WINDING, {"input": "voltage", **CONSTANTS}),
    **{
        f"voltage, {name}": (f"{WINDING} {xml}", {"input": "voltage", **CONSTANTS, **fields})
        for name, (xml, fields) in FEATURES.items()
    },
    "voltage, all": (
        f'{WINDING} {EVERYTHING[0]} ctrlrange="-6 6"',
        {"input": "voltage", "voltage_limit": 6.0, **CONSTANTS, **EVERYTHING[1]},
    ),
    "back-EMF constant": (
        'motorconst="0 0.3" resistance="2"',
        {"input": "voltage", "back_emf_constant": 0.3, "resistance": 2.0},
    ),
    "both constants": (
        'motorconst="0.3 0.4" resistance="2"',
        {
            "input": "voltage",
            "torque_constant": 0.3,
            "back_emf_constant": 0.4,
            "resistance": 2.0,
        },
    ),
    "nominal point": (
        'nominal="24 3.3 71"',
        {"input": "voltage", "nominal_voltage": 24.0, "stall_torque": 3.3, "no_load_speed": 71.0},
    ),
    "no-load speed and resistance": (
        'nominal="24 0 71" resistance="2"',
        {"input": "voltage", "nominal_voltage": 24.0, "no_load_speed": 71.0, "resistance": 2.0},
    ),
    "constant and stall torque": (
        'motorconst="0.3 0" nominal="24 3.3 0"',
        {
            "input": "voltage",
            "torque_constant": 0.3,
            "nominal_voltage": 24.0,
            "stall_torque": 3.3,
        },
    ),
    "position": (f'{WINDING} input="pos" controller="7 0 0.5"', {"input": "position", **SERVO}),
    "position, integral": (
        f'{WINDING} input="pos" controller="7 3 0.5 0 0.05"',
        {"input": "position", "integral_gain": 3.0, "integral_limit": 0.05, **SERVO},
    ),
    "position, all": (
        f'{WINDING} input="pos" controller="7 3 0.5 2 0.05 6" {EVERYTHING[0]}',
        {
            "input": "position",
            "integral_gain": 3.0,
            "integral_limit": 0.05,
            "slew_rate": 2.0,
            "voltage_limit": 6.0,
            **SERVO,
            **EVERYTHING[1],
        },
    ),
    "velocity": (
        f'{WINDING} input="vel" controller="0 0 0.5 2 0 6"',
        {
            "input": "velocity",
            "damping": 0.5,
            "slew_rate": 2.0,
            "voltage_limit": 6.0,
            **CONSTANTS,
        },
    ),
    "effort": (
        f'{WINDING} input="ff" controller="0 0 0.1 5 0 6" {EVERYTHING[0]}',
        {
            "input": "effort",
            "damping": 0.1,
            "slew_rate": 5.0,
            "voltage_limit": 6.0,
            **CONSTANTS,
            **EVERYTHING[1],
        },
    ),
    "effort through a gear": (
        f'{WINDING} gear="4" input="ff" controller="0 0 {0.1 / 16!r} {5 / 4!r} 0 6"',
        {
            "input": "effort",
            "gear_ratio": 4.0,
            "damping": 0.1,
            "slew_rate": 5.0,
            "voltage_limit": 6.0,
            **CONSTANTS,
        },
    ),
    "gear": (
        f'{WINDING} gear="4" input="pos" controller="{7 / 16!r} {3 / 16!r} {0.5 / 16!r} 8 0.2 6" '
        'saturation="0.1 0 0" cogging="0.01 12 0.3"',
        {
            "input": "position",
            "gear_ratio": 4.0,
            "integral_gain": 3.0,
            "integral_limit": 0.05,
            "slew_rate": 2.0,
            "voltage_limit": 6.0,
            "effort_limit": 0.4,
            **SERVO,
            **FEATURES["cogging"][1],
            "cogging_amplitude": 0.01,
        },
    ),
}
AMPLITUDE = {"voltage": 8.0, "position": 0.8, "velocity": 4.0, "effort": 0.6}


def config(**fields: Any) -> BuiltinDcMotorActuatorCfg:
    return BuiltinDcMotorActuatorCfg(**{"joint_names_expr": (".*",), "input": "voltage", **fields})


def compiled(
    actuator: Actuator, default: str = LEAKY, integrator: str = "implicitfast"
) -> mjcf.Physics:
    root = mjcf.from_xml_string(
        f"<mujoco>{BODY.format(default=default, integrator=integrator)}</mujoco>"
    )
    actuator.edit_mjcf(root)
    return mjcf.Physics.from_mjcf_model(root)


def ready(
    cfg: Any, default: str = LEAKY, integrator: str = "implicitfast"
) -> tuple[Any, mjcf.Physics]:
    actuator = cfg.build()
    physics = compiled(actuator, default, integrator)
    actuator.initialize(physics)
    actuator.reset()
    return actuator, physics


def command(cfg: BuiltinDcMotorActuatorCfg, target: FloatArray) -> ActuatorCmd:
    word = cfg.input if cfg.input in ("position", "velocity") else "effort"
    return ActuatorCmd(**{f"{word}_target": target})


def targets(cfg: BuiltinDcMotorActuatorCfg, steps: int = STEPS) -> FloatArray:
    time = np.arange(steps)[:, None] * 1e-3
    return AMPLITUDE[cfg.input] * np.sin(time * [9.0, 14.0] + [0.4, 1.0])


def assert_same_actuators(ours: mujoco.MjModel, own: mujoco.MjModel) -> None:
    """All that MuJoCo reads: neither the ranges of what has no limit nor how to interpolate."""
    for field in dir(own):
        if not field.startswith("actuator_"):
            continue
        one, other = getattr(ours, field), getattr(own, field)
        limited = field.replace("range", "limited")
        if field != limited and hasattr(own, limited):
            has = getattr(own, limited) != 0
            one, other = one[has], other[has]
        elif field == "actuator_history":
            one, other = one[:, 0], other[:, 0]
        np.testing.assert_array_equal(one, other, field)


@pytest.mark.parametrize("name", TABLE)
def test_is_bit_for_bit_mujocos_own_dcmotor(name: str) -> None:
    attributes, fields = TABLE[name]
    cfg = config(**fields)
    own = mujoco.MjModel.from_xml_string(
        f"<mujoco>{BODY.format(default='', integrator='implicitfast')}<actuator>"
        f'<dcmotor joint="hip" {attributes}/><dcmotor joint="knee" {attributes}/>'
        "</actuator></mujoco>"
    )
    actuator, physics = ready(cfg)
    ours = physics.model.ptr
    assert_same_actuators(ours, own)
    assert (ours.na, ours.nu) == (own.na, own.nu)

    data = mujoco.MjData(own)
    start = np.array([0.3, -0.5])
    data.qpos[:], physics.data.qpos[:] = start, start
    gear = fields.get("gear_ratio", 1.0)
    if "slew_rate" in fields and cfg.input == "position":
        data.act[:: own.na // 2] = gear * start  # ours sets out from where the joint is
    given = targets(cfg)
    factor = {"position": gear, "velocity": gear, "effort": 1 / gear}.get(cfg.input, 1.0)
    states = []
    for target in given:
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(command(cfg, target))
        mujoco.mj_step(ours, physics.data.ptr)
        data.ctrl[:] = factor * target
        mujoco.mj_step(own, data)
        np.testing.assert_array_equal(physics.data.qpos, data.qpos)
        np.testing.assert_array_equal(physics.data.qvel, data.qvel)
        np.testing.assert_array_equal(physics.data.act, data.act)
        np.testing.assert_array_equal(actuator.applied_effort, gear * data.actuator_force)
        states.append(np.array(data.act))
    assert np.abs(data.qpos - start).min() > 1e-3
    assert (np.abs(states).max(axis=0) > 1e-6).all()
    assert 2 * len(actuator.internal_state) == own.na


def test_the_table_has_every_field() -> None:
    used = {field for _, fields in TABLE.values() for field in fields}
    inherited = {"joint_names_expr", "transmission", "gear", "armature", "frictionloss"}
    fields = {*BuiltinDcMotorActuatorCfg.__dataclass_fields__} - inherited - {"viscous_damping"}
    assert used == fields


# The motor's equations, by hand, on one joint of inertia I without gravity.

SPINNING = """
<mujoco>
  <option timestep="1e-4" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="shaft" axis="0 0 1" limited="{limited}" range="-1e-6 1e-6"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.002 0.002 0.002"/>
    </body>
  </worldbody>
</mujoco>
"""
INERTIA = 0.002
NOMINAL = {"nominal_voltage": 24.0, "stall_torque": 3.0, "no_load_speed": 60.0}


def spinning(**fields: Any) -> tuple[BuiltinDcMotorActuator, mjcf.Physics]:
    actuator = config(**fields).build()
    root = mjcf.from_xml_string(SPINNING.format(limited="false"))
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    actuator.initialize(physics)
    actuator.reset()
    return actuator, physics


def run(
    actuator: BuiltinDcMotorActuator, physics: mjcf.Physics, target: float, seconds: float
) -> None:
    cmd = command(actuator.cfg, np.array([target]))
    for _ in range(round(seconds / physics.timestep())):
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(cmd)
        mujoco.mj_step(physics.model.ptr, physics.data.ptr)


def held(
    actuator: BuiltinDcMotorActuator,
    physics: mjcf.Physics,
    target: float,
    speed: float,
    seconds: float,
) -> None:
    """Turns the shaft at a speed that nothing changes."""
    cmd = command(actuator.cfg, np.array([target]))
    for _ in range(round(seconds / physics.timestep())):
        physics.data.qvel[:] = speed
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(cmd)
        mujoco.mj_step(physics.model.ptr, physics.data.ptr)


@pytest.mark.parametrize("gear", [1.0, 5.0])
def test_stall_torque_and_no_load_speed_are_those_of_the_nominal_point(gear: float) -> None:
    actuator, physics = spinning(**NOMINAL, gear_ratio=gear)
    held(actuator, physics, 24.0, 0.0, 1e-4)
    assert actuator.applied_effort == pytest.approx(3.0 * gear, rel=1e-12)
    held(actuator, physics, 12.0, 0.0, 1e-4)
    assert actuator.applied_effort == pytest.approx(1.5 * gear, rel=1e-12)
    physics.reset()
    run(actuator, physics, 24.0, 1.0)
    assert physics.data.qvel == pytest.approx(60.0 / gear, rel=1e-9)
    assert actuator.get("motor_constant") == pytest.approx(0.4)
    assert actuator.get("resistance") == pytest.approx(3.2)


def test_the_current_rises_with_the_electrical_time_constant() -> None:
    actuator, physics = spinning(**CONSTANTS, inductance=0.02)  # L/R = 10 ms
    for milliseconds in (1, 4, 10):
        held(actuator, physics, 6.0, 0.0, milliseconds * 1e-3 - physics.time())
        expected = 6.0 / 2.0 * (1 - math.exp(-milliseconds / 10))
        assert actuator.internal_state["current"] == pytest.approx(expected, rel=1e-9)
        assert actuator.applied_effort == pytest.approx(0.3 * expected, rel=1e-9)


def test_the_current_changes_no_faster_than_it_may() -> None:
    actuator, physics = spinning(**CONSTANTS, inductance=0.02, current_rate_limit=50.0)
    held(actuator, physics, 6.0, 0.0, 0.01)
    assert actuator.internal_state["current"] == pytest.approx(0.5, rel=0.01)


def test_the_winding_warms_up_to_what_its_loss_keeps_up() -> None:
    heat = {"thermal_resistance": 2.0, "thermal_time_constant": 0.05}
    actuator, physics = spinning(**CONSTANTS, **heat, temperature_coefficient=0.0)
    held(actuator, physics, 6.0, 0.0, 1.0)
    assert actuator.internal_state["temperature"] == pytest.approx(2.0 * 2.0 * 3.0**2, rel=1e-6)
    assert actuator.applied_effort == pytest.approx(0.9)

    actuator, physics = spinning(**CONSTANTS, **heat, ambient_temperature=45.0)
    held(actuator, physics, 6.0, 0.0, 1.0)
    warm = float(actuator.internal_state["temperature"][0])
    hot = 2.0 * (1 + 0.00393 * (warm + 45.0 - 25.0))
    assert warm == pytest.approx(2.0 * 6.0**2 / hot, rel=1e-4)
    assert actuator.applied_effort == pytest.approx(0.3 * 6.0 / hot, rel=1e-4)


@pytest.mark.parametrize("speed", [-3.0, -0.05, 0.05, 0.2, 3.0])
def test_lugre_friction_settles_on_the_stribeck_curve(speed: float) -> None:
    fields = FEATURES["LuGre"][1]
    actuator, physics = spinning(**CONSTANTS, **fields, gear_ratio=2.0)
    held(actuator, physics, 0.0, speed, 1.0)
    shaft = 2.0 * speed
    curve = 0.05 + (0.08 - 0.05) * math.exp(-((shaft / 0.1) ** 2))
    back_emf = 0.3**2 / 2.0 * shaft
    expected = -2.0 * (math.copysign(curve, speed) + back_emf)
    assert actuator.applied_effort == pytest.approx(expected, rel=1e-3)


def test_static_friction_is_coulomb_friction_where_it_is_not_given() -> None:
    actuator, physics = spinning(**CONSTANTS, bristle_stiffness=150.0, coulomb_friction=0.05)
    held(actuator, physics, 0.0, 0.01, 1.0)
    assert actuator.applied_effort == pytest.approx(-0.05 - 0.045 * 0.01, rel=1e-3)
    np.testing.assert_array_equal(physics.model.actuator_biasprm[0, 3:6], [0.05, 0.05, 0.0])


def test_cogging_and_friction_are_not_within_the_effort_limit() -> None:
    actuator, physics = spinning(
        **CONSTANTS, **FEATURES["cogging"][1], effort_limit=0.1, gear_ratio=2.0
    )
    physics.data.qpos[:] = 0.7
    held(actuator, physics, 24.0, 0.0, 1e-4)
    expected = 0.1 + 2.0 * 0.2 * math.sin(12.0 * 2.0 * 0.7 + 0.3)
    assert actuator.applied_effort == pytest.approx(expected, rel=1e-12)
    np.testing.assert_array_equal(actuator.computed_effort, actuator.applied_effort)


@pytest.mark.parametrize("gear", [1.0, 5.0])
@pytest.mark.parametrize(
    ("input_", "fields", "expected"),
    [
        ("position", {"stiffness": 7.0, "damping": 0.5}, 7 * (0.3 - 0.1) - 0.5 * 2),
        ("velocity", {"damping": 0.5}, 0.5 * (0.3 - 2.0)),
        ("effort", {}, 0.3),
        ("effort", {"damping": 0.5}, 0.3 - 0.5 * 2.0),
    ],
)
def test_a_drive_makes_the_effort_it_is_asked_for_whatever_the_speed(
    input_: str, fields: dict[str, float], expected: float, gear: float
) -> None:
    actuator, physics = spinning(input=input_, gear_ratio=gear, **CONSTANTS, **fields)
    physics.data.qpos[:] = 0.1
    held(actuator, physics, 0.3, 2.0, 1e-4)
    assert actuator.applied_effort == pytest.approx(expected, rel=1e-9)


def test_a_hot_motor_makes_less_than_its_drive_believes() -> None:
    heat = {"thermal_resistance": 2.0, "thermal_capacitance": 100.0}
    actuator, physics = spinning(input="effort", **CONSTANTS, **heat)
    physics.data.act[:] = 100.0
    held(actuator, physics, 0.9, 3.0, 1e-4)
    assert actuator.applied_effort == pytest.approx(0.9 / 1.393, rel=1e-6)


@pytest.mark.parametrize("input_", ["voltage", "effort"])
def test_the_supply_ends_at_its_voltage(input_: str) -> None:
    actuator, physics = spinning(input=input_, gear_ratio=5.0, voltage_limit=12.0, **CONSTANTS)
    held(actuator, physics, 1e3, 2.0, 1e-4)
    assert actuator.applied_effort == pytest.approx(5 * 0.3 * (12.0 - 0.3 * 10.0) / 2.0)
    held(actuator, physics, -1e3, 2.0, 1e-4)
    assert actuator.applied_effort == pytest.approx(5 * 0.3 * (-12.0 - 0.3 * 10.0) / 2.0)


def test_a_voltage_motor_follows_its_equations_step_by_step() -> None:
    actuator, physics = spinning(**CONSTANTS, inductance=0.004, gear_ratio=3.0)
    h, gear, k, r, tau = 1e-4, 3.0, 0.3, 2.0, 0.002
    q = qd = current = 0.0
    for step in range(2000):
        volts = 8.0 * math.sin(0.002 * step)
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(
            ActuatorCmd(effort_target=np.array([volts]))
        )
        mujoco.mj_step(physics.model.ptr, physics.data.ptr)
        towards = (volts - k * gear * qd) / r
        share = 1 - math.exp(-h / tau)
        current += (towards - current) * share
        # The new current's slope in q̇ is in the integrator's matrix.
        slope = gear * k * share * k * gear / r
        qd += h * gear * k * current / (INERTIA + h * slope)
        q += h * qd
        assert physics.data.qpos == pytest.approx(q, abs=1e-9)
        assert physics.data.qvel == pytest.approx(qd, abs=1e-7)
    assert abs(q) > 0.1


@pytest.mark.parametrize("reset", [True, False])
def test_slewed_targets_set_out_from_the_joint(reset: bool) -> None:
    cfg = config(input="position", slew_rate=2.0, gear_ratio=3.0, **SERVO)
    actuator = cfg.build()
    physics = compiled(actuator)
    actuator.initialize(physics)
    if reset:
        actuator.reset()
    physics.data.qpos[:] = [0.8, -0.2]
    target = np.array([0.8, 0.5])
    for step in range(1, 200):
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(ActuatorCmd(target))
        mujoco.mj_step(physics.model.ptr, physics.data.ptr)
        expected = [0.8, min(-0.2 + 2.0 * step * 1e-3, 0.5)]
        np.testing.assert_allclose(actuator.internal_state["slew"] / 3.0, expected, atol=1e-12)


# One physics, a batch, delays.


def batch_of(physics: mjcf.Physics, n: int) -> Batch:
    return Batch(physics.model.ptr, n)


EVERY = config(**TABLE["position, all"][1], gear_ratio=2.0)


def test_one_physics_and_a_batch_go_the_same_way_and_resets_leave_the_others_alone() -> None:
    single, physics = ready(EVERY)
    batched = EVERY.build()
    batch = batch_of(compiled(batched), 3)
    batched.initialize(batch)
    batched.reset()
    given = targets(EVERY, 60)
    ctrl, qpos, qvel = batch.bind("ctrl"), batch.bind("qpos"), batch.bind("qvel")
    for step, target in enumerate(given):
        if step == 30:
            qpos[1], qvel[1] = [0.2, 0.3], 0.0
            batched.reset(env_ids=[1])
            state = batched.internal_state
            assert not any(values[1].any() for values in state.values())
            assert all(values[[0, 2]].any() for values in state.values())
        physics.data.ctrl[single.ctrl_ids] = single.compute(ActuatorCmd(target))
        mujoco.mj_step(physics.model.ptr, physics.data.ptr)
        ctrl[:, batched.ctrl_ids] = batched.compute(ActuatorCmd(np.tile(target, (3, 1))))
        batch.step()
        if step == 30:
            lag = batched.internal_state["slew"][1] / 2.0 - [0.2, 0.3]
            np.testing.assert_allclose(np.abs(lag), 0.002, atol=1e-12)
        for row in (0, 2):
            np.testing.assert_array_equal(qpos[row], physics.data.qpos)
            np.testing.assert_array_equal(batched.applied_effort[row], single.applied_effort)
    assert not np.array_equal(qpos[1], qpos[0])


def test_a_second_reset_changes_nothing() -> None:
    actuator, physics = ready(EVERY)
    runs = []
    for resets in (1, 2):
        physics.reset()
        for _ in range(resets):
            actuator.reset()
        for target in targets(EVERY, 20):
            physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(ActuatorCmd(target))
            mujoco.mj_step(physics.model.ptr, physics.data.ptr)
        runs.append(np.array(physics.data.act))
    np.testing.assert_array_equal(runs[0], runs[1])


def test_a_motor_without_states_can_be_reset_in_a_batch() -> None:
    actuator = config(**CONSTANTS).build()
    batch = batch_of(compiled(actuator), 2)
    actuator.initialize(batch)
    actuator.reset(env_ids=[1])
    actuator.reset()
    assert actuator.internal_state == {}
    np.testing.assert_array_equal(
        actuator.compute(ActuatorCmd(effort_target=np.ones((2, 2)))), np.ones((2, 2))
    )


@pytest.mark.parametrize(("input_", "word"), [("voltage", "effort"), ("position", "position")])
def test_a_delay_shifts_the_command(input_: str, word: str) -> None:
    cfg = config(input=input_, **(SERVO if input_ == "position" else CONSTANTS))
    delayed, _ = ready(
        DelayedActuatorCfg(base_cfg=cfg, delay_target=word, delay_min_lag=3, delay_max_lag=3)
    )
    prompt, _ = ready(cfg)
    given = targets(cfg, 20)
    late = [delayed.compute(command(cfg, target)) for target in given]
    at_once = [prompt.compute(command(cfg, target)) for target in given]
    assert not delayed.native
    np.testing.assert_array_equal(late[3:], at_once[:-3])
    np.testing.assert_array_equal(late[:3], [at_once[0]] * 3)


def test_mujocos_own_delay_is_the_same() -> None:
    cfg = config(**CONSTANTS)
    delayed, physics = ready(
        DelayedActuatorCfg(base_cfg=cfg, delay_target="effort", delay_min_lag=3, delay_max_lag=3)
    )
    native = cfg.build()
    native.delay_natively(3)
    own = compiled(native)
    native.initialize(own)
    native.reset()
    for target in targets(cfg, 50):
        for actuator, simulated in ((delayed, physics), (native, own)):
            simulated.data.ctrl[actuator.ctrl_ids] = actuator.compute(command(cfg, target))
            mujoco.mj_step(simulated.model.ptr, simulated.data.ptr)
        np.testing.assert_array_equal(physics.data.qpos, own.data.qpos)


# Transmissions and parameters.


def test_drives_tendons_and_sites() -> None:
    xml = """
    <mujoco>
      <worldbody>
        <body>
          <freejoint/><geom size="0.1" mass="1"/><site name="propeller"/>
          <body><joint name="a" axis="0 1 0"/><geom size="0.1" mass="1"/></body>
        </body>
      </worldbody>
      <tendon><fixed name="belt"><joint joint="a" coef="0.5"/></fixed></tendon>
    </mujoco>
    """
    root = mjcf.from_xml_string(xml)
    belt = config(
        joint_names_expr=("belt",), transmission="tendon", gear_ratio=4.0, **CONSTANTS
    ).build()
    propeller = config(
        joint_names_expr=("propeller",), transmission="site", gear=(0, 0, 2, 0, 0, 0), **CONSTANTS
    ).build()
    belt.edit_mjcf(root)
    propeller.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    for actuator in (belt, propeller):
        actuator.initialize(physics)
        actuator.reset()
        volts = actuator.compute(ActuatorCmd(effort_target=np.array([6.0])))
        physics.data.ctrl[actuator.ctrl_ids] = volts
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    assert belt.applied_effort == pytest.approx(4 * 0.9)
    assert propeller.applied_effort == pytest.approx(0.9)
    assert physics.data.qfrc_actuator[2] == pytest.approx(2 * 0.9)
    assert physics.data.qfrc_actuator[-1] == pytest.approx(0.5 * 4 * 0.9)


def test_numbers_per_joint() -> None:
    actuator, physics = ready(
        config(
            nominal_voltage=24.0,
            stall_torque={"hip": 3.0, "knee": 1.5},
            no_load_speed=60.0,
            gear_ratio={"hip": 9.0, "knee": 3.0},
        )
    )
    physics.data.ctrl[:] = actuator.compute(ActuatorCmd(effort_target=np.array([24.0, 12.0])))
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    assert actuator.applied_effort == pytest.approx([27.0, 2.25])


def test_parameters_reach_the_model_and_start_from_the_nominal_again() -> None:
    cfg = config(input="position", inductance=0.02, current_limit=2.0, gear_ratio=2.0, **SERVO)
    actuator, physics = ready(cfg)
    model = physics.model.ptr
    before = model.actuator_gainprm.copy(), model.actuator_dynprm.copy()
    assert {"motor_constant", "resistance", "stiffness", "damping", "current_limit"} < {
        *actuator.parameters
    }
    actuator.set("resistance", actuator.nominal("resistance") * 2)
    actuator.set("motor_constant", 0.6)
    actuator.set("stiffness", [8.0, 12.0])
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], 4.0)
    np.testing.assert_allclose(model.actuator_gainprm[:, 1], 0.6)
    np.testing.assert_allclose(model.actuator_gainprm[:, 4], [2.0, 3.0])
    np.testing.assert_allclose(model.actuator_dynprm[:, 0], 0.005)  # L is what it was
    np.testing.assert_allclose(model.actuator_forcerange, [[-1.2, 1.2]] * 2)
    np.testing.assert_array_equal(actuator.get("stiffness"), [8.0, 12.0])
    np.testing.assert_array_equal(actuator.nominal("stiffness"), [7.0, 7.0])
    actuator.initialize(physics)
    np.testing.assert_array_equal(model.actuator_gainprm, before[0])
    np.testing.assert_array_equal(model.actuator_dynprm, before[1])
    with pytest.raises(KeyError, match=r"no parameter 'resistence' \(did you mean 'resistance'"):
        actuator.set("resistence", 1.0)


def test_parameters_of_one_simulation_of_a_batch() -> None:
    actuator = config(effort_limit=1.0, **CONSTANTS).build()
    batch = batch_of(compiled(actuator), 2)
    actuator.initialize(batch)
    actuator.reset()
    actuator.set("resistance", [4.0, 5.0], env_ids=[1])
    actuator.set("effort_limit", 0.3, env_ids=[0])
    batch.bind("ctrl")[:] = actuator.compute(ActuatorCmd(effort_target=np.full((2, 2), 6.0)))
    batch.step()
    np.testing.assert_allclose(actuator.applied_effort, [[0.3, 0.3], [0.45, 0.36]], rtol=1e-9)


def test_warns_of_a_back_emf_that_euler_does_not_bear() -> None:
    cfg = config(torque_constant=1.0, resistance=0.1, gear_ratio=3.0, joint_names_expr=("knee",))
    actuator = cfg.build()
    physics = compiled(actuator, integrator="Euler")
    with pytest.warns(UserWarning, match=r"joint 'knee': damping 90 is beyond"):
        actuator.initialize(physics)
    ready(cfg)


# Errors.


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "motor constant is missing: give torque_constant or back_emf_constant, or"),
        ({"torque_constant": 0.3}, "resistance is missing: give resistance, or nominal_voltage"),
        ({**CONSTANTS, "input": "volts"}, r"input should be one of .*'volts'.*'voltage'"),
        ({**CONSTANTS, "resistance": 0.0}, "resistance should be above 0, got 0.0"),
        ({**CONSTANTS, "gear_ratio": 0.0}, "gear_ratio should be above 0, got 0.0"),
        ({**CONSTANTS, "gear_ratio": {"hip": -1.0}}, r"gear_ratio\['hip'\] should be above 0"),
        ({**CONSTANTS, "inductance": math.nan}, "inductance should be finite, got nan"),
        ({**CONSTANTS, "no_load_speed": 9.0}, "torque_constant=0.3 and no_load_speed=9.0 say the"),
        ({**CONSTANTS, "stall_torque": 9.0}, "resistance=2.0 and stall_torque=9.0 say the same"),
        ({**CONSTANTS, "nominal_voltage": 9.0}, "nominal_voltage=9.0 means nothing without stall"),
        ({"stall_torque": 3.0, "no_load_speed": 9.0}, "stall_torque=3.0 means nothing without nom"),
        ({**CONSTANTS, "stiffness": 9.0}, "stiffness=9.0 with input='voltage': .*'position'"),
        ({**CONSTANTS, "slew_rate": 9.0}, "slew_rate=9.0 with input='voltage': .*'effort'"),
        (
            {**CONSTANTS, "input": "velocity", "damping": 1.0, "stiffness": 9.0},
            "stiffness=9.0 with input='velocity'",
        ),
        ({**CONSTANTS, "input": "position"}, "input='position' needs stiffness"),
        ({**CONSTANTS, "input": "velocity"}, "input='velocity' needs damping"),
        (
            {**CONSTANTS, "input": "position", "stiffness": 1.0, "integral_limit": 1.0},
            "integral_limit=1.0 means nothing without integral_gain",
        ),
        ({**CONSTANTS, "current_rate_limit": 9.0}, "current_rate_limit=9.0 means nothing without"),
        ({**CONSTANTS, "effort_limit": 1.0, "current_limit": 1.0}, "effort_limit=1.0 and current"),
        (
            {**CONSTANTS, "inductance": 1.0, "electrical_time_constant": 1.0},
            "inductance=1.0 and electrical_time_constant=1.0 say the same thing",
        ),
        ({**CONSTANTS, "cogging_amplitude": 1.0}, "cogging_amplitude=1.0 means nothing without c"),
        ({**CONSTANTS, "coulomb_friction": 1.0}, "coulomb_friction=1.0 means nothing without b"),
        ({**CONSTANTS, "thermal_resistance": 1.0}, "means nothing without thermal_capacitance or"),
        ({**CONSTANTS, "ambient_temperature": 1.0}, "ambient_temperature=1.0 means nothing with"),
        (
            {**CONSTANTS, **FEATURES["LuGre"][1], "coulomb_friction": 0.1},
            "static_friction=0.08 is below coulomb_friction=0.1",
        ),
        (
            {**CONSTANTS, **FEATURES["LuGre"][1], "static_friction": {"hip": 0.01, "knee": 1.0}},
            r"static_friction\['hip'\]=0.01 is below coulomb_friction\['hip'\]=0.05",
        ),
        (
            {
                **SERVO,
                "input": "position",
                "transmission": "site",
                "gear": (0, 0, 1, 0, 0, 0),
            },
            "input='position' and gear_ratio=1.0 with transmission='site': a site has no position",
        ),
        (
            {
                **CONSTANTS,
                "gear_ratio": 2.0,
                "transmission": "site",
                "gear": (0, 0, 1, 0, 0, 0),
            },
            "gear_ratio=2.0 with transmission='site'.*its gear is `gear`",
        ),
    ],
)
def test_refuses_what_makes_no_motor(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        config(**fields)


def test_the_input_has_to_be_said() -> None:
    with pytest.raises(TypeError, match="input"):
        BuiltinDcMotorActuatorCfg(joint_names_expr=(".*",), torque_constant=0.3, resistance=2.0)


@pytest.mark.parametrize(
    ("fields", "cmd", "message"),
    [
        (CONSTANTS, ActuatorCmd(np.zeros(2)), "needs a effort_target"),
        (
            {"input": "position", **SERVO},
            ActuatorCmd(np.ones(2), effort_target=np.ones(2)),
            "cannot follow a effort_target, it takes .'position_target'",
        ),
        (CONSTANTS, ActuatorCmd(effort_target=np.ones(3)), r"effort_target has shape \(3,\)"),
    ],
)
def test_refuses_targets_that_it_does_not_take(
    fields: dict[str, Any], cmd: ActuatorCmd, message: str
) -> None:
    actuator, _ = ready(config(**fields))
    with pytest.raises(ValueError, match=message):
        actuator.compute(cmd)
