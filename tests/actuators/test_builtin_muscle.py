import math
from typing import Any

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from hypothesis import given, settings
from hypothesis import strategies as st
from mujoco.batch import Batch
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Actuator
from walkerkit.actuators.builtin_muscle import BuiltinMuscleActuatorCfg
from walkerkit.actuators.command import ActuatorCmd
from walkerkit.actuators.delayed import DelayedActuatorCfg

FloatArray = NDArray[np.float64]

LEAKY = """
  <default>
    <general gear="7 1 1" dyntype="filterexact" gaintype="affine" biastype="affine"
      dynprm="3 1 4 1 5 9 2 6 5 3" gainprm="5 8 9 7 9 3 2 3 8 4" biasprm="2 6 4 3 3 8 3 2 7 9"
      forcelimited="true" forcerange="-0.01 0.01" ctrllimited="true" ctrlrange="-0.1 0.1"
      actlimited="true" actrange="-0.1 0.1" damping="4 5 6" armature="3" nsample="4" delay="0.003"
      interp="linear" actdim="3" input="pos vel"/>
  </default>
"""
BODY = """
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="implicitfast"/>
  {default}
  <worldbody>
    <site name="hook" pos="0.1 0 -0.05"/>
    <body>
      <joint name="elbow" axis="0 1 0" damping="0.1" range="-1 1.5"/>
      <geom size="0.05" pos="0 0 -0.2" mass="0.5"/>
      <site name="wrist" pos="0.02 0 -0.15"/>
      <body pos="0 0 -0.4">
        <joint name="hand" axis="0 1 0" damping="0.1" range="-1 1"/>
        <geom size="0.05" pos="0 0 -0.2" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="biceps"><site site="hook"/><site site="wrist"/></spatial>
    <fixed name="cord"><joint joint="hand" coef="0.03"/></fixed>
  </tendon>
"""
CURVES = {"lmin": 0.4, "lmax": 1.7, "vmax": 2.0, "fpmax": 1.1, "fvmax": 1.4}
TABLE: dict[str, tuple[str, dict[str, Any]]] = {
    "defaults": ("", {}),
    "force": ('force="40"', {"force": 40.0}),
    "scale": ('scale="90"', {"scale": 90.0}),
    "times": (
        'timeconst="0.02 0.06" tausmooth="0.2"',
        {"activation_time": 0.02, "deactivation_time": 0.06, "tausmooth": 0.2},
    ),
    "range": ('range="0.8 1.2"', {"range": (0.8, 1.2)}),
    "length range": ('lengthrange="-0.4 0.7"', {"lengthrange": (-0.4, 0.7)}),
    "curves": (
        " ".join(f'{name}="{value}"' for name, value in CURVES.items()),
        CURVES,
    ),
    "lever": ('gear="-0.05"', {"moment_arm": -0.05}),
}
TABLE["all"] = (
    " ".join(xml for xml, _ in TABLE.values()),
    {field: value for _, fields in TABLE.values() for field, value in fields.items()},
)
DRIVEN = {"joint": ("elbow", "hand"), "tendon": ("biceps", "cord")}


def config(**fields: Any) -> BuiltinMuscleActuatorCfg:
    return BuiltinMuscleActuatorCfg(**{"joint_names_expr": (".*",), **fields})


def compiled(actuator: Actuator) -> mjcf.Physics:
    root = mjcf.from_xml_string(f"<mujoco>{BODY.format(default=LEAKY)}</mujoco>")
    actuator.edit_mjcf(root)
    return mjcf.Physics.from_mjcf_model(root)


def ready(cfg: Any) -> tuple[Any, mjcf.Physics]:
    actuator = cfg.build()
    physics = compiled(actuator)
    actuator.initialize(physics)
    actuator.reset()
    return actuator, physics


def excitations(steps: int) -> FloatArray:
    time = np.arange(steps)[:, None] * 1e-3
    return 0.5 + 0.7 * np.sin(time * [9.0, 14.0] + [0.4, 1.0])  # beyond 0 and 1 as well


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


@pytest.mark.parametrize("kind", DRIVEN)
@pytest.mark.parametrize("name", TABLE)
def test_is_bit_for_bit_mujocos_own_muscle(name: str, kind: str) -> None:
    attributes, fields = TABLE[name]
    muscles = "".join(f'<muscle {kind}="{driven}" {attributes}/>' for driven in DRIVEN[kind])
    own = mujoco.MjModel.from_xml_string(
        f"<mujoco>{BODY.format(default='')}<actuator>{muscles}</actuator></mujoco>"
    )
    actuator, physics = ready(config(transmission=kind, **fields))
    ours = physics.model.ptr
    assert_same_actuators(ours, own)
    assert (ours.na, ours.nu) == (own.na, own.nu)

    data = mujoco.MjData(own)
    data.qpos[:] = physics.data.qpos[:] = start = np.array([0.3, -0.5])
    arm = fields.get("moment_arm", 1.0)
    for target in excitations(1000):
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(ActuatorCmd(effort_target=target))
        mujoco.mj_step(ours, physics.data.ptr)
        data.ctrl[:] = target
        mujoco.mj_step(own, data)
        np.testing.assert_array_equal(physics.data.qpos, data.qpos)
        np.testing.assert_array_equal(physics.data.qvel, data.qvel)
        np.testing.assert_array_equal(actuator.activation, data.act)
        np.testing.assert_array_equal(actuator.applied_effort, arm * data.actuator_force)
    assert np.abs(data.qpos - start).min() > 1e-3
    assert data.act.min() > 1e-3


def test_the_table_has_every_field() -> None:
    inherited = {"joint_names_expr", "transmission", "gear", "armature", "frictionloss"}
    fields = {*BuiltinMuscleActuatorCfg.__dataclass_fields__} - inherited - {"viscous_damping"}
    assert {*TABLE["all"][1]} == fields


# The muscle's curves, by hand: MuJoCo, "Modeling", muscle actuators.


def force_length(length: float, lmin: float, lmax: float) -> float:
    below, above = (lmin + 1) / 2, (1 + lmax) / 2
    if length <= lmin or length >= lmax:
        return 0.0
    if length <= below:
        return 0.5 * ((length - lmin) / (below - lmin)) ** 2
    if length <= 1:
        return 1 - 0.5 * ((1 - length) / (1 - below)) ** 2
    if length <= above:
        return 1 - 0.5 * ((length - 1) / (above - 1)) ** 2
    return 0.5 * ((lmax - length) / (lmax - above)) ** 2


def force_velocity(speed: float, fvmax: float) -> float:
    room = fvmax - 1
    if speed <= -1:
        return 0.0
    if speed <= 0:
        return (speed + 1) ** 2
    return fvmax - (room - speed) ** 2 / room if speed <= room else fvmax


def passive(length: float, lmax: float, fpmax: float) -> float:
    above = (1 + lmax) / 2
    if length <= 1:
        return 0.0
    x = (length - 1) / (above - 1)
    return fpmax * 0.5 * x * x if x <= 1 else fpmax * (x - 0.5)


PEAK = 30.0
REFERENCE = {"force": PEAK, "range": (0.7, 1.5), "moment_arm": 0.05, **CURVES}
ELBOW = ready(config(joint_names_expr=("elbow",), **REFERENCE))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.floats(-1, 1.5), st.floats(-20, 20), st.floats(0, 1))
def test_the_force_is_the_product_of_its_curves(q: float, qd: float, act: float) -> None:
    actuator, physics = ELBOW
    physics.data.qpos[0], physics.data.qvel[0], physics.data.act[0] = q, qd, act
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    shortest, longest = physics.model.actuator_lengthrange[0]
    optimal = (longest - shortest) / (1.5 - 0.7)
    length = 0.7 + (0.05 * q - shortest) / optimal
    speed = 0.05 * qd / optimal / CURVES["vmax"]
    active = force_length(length, CURVES["lmin"], CURVES["lmax"])
    share = act * active * force_velocity(speed, CURVES["fvmax"])
    share += passive(length, CURVES["lmax"], CURVES["fpmax"])
    assert actuator.applied_effort[0] == pytest.approx(-0.05 * PEAK * share, abs=1e-9)
    assert actuator.applied_effort[0] <= 0
    assert actuator.computed_effort[0] == actuator.applied_effort[0]


def test_activation_rises_faster_than_it_falls() -> None:
    actuator, physics = ready(config(joint_names_expr=("elbow",)))
    act = 0.0
    for step in range(200):
        excitation = float(step < 60)
        physics.data.ctrl[:] = actuator.compute(ActuatorCmd(effort_target=np.array([excitation])))
        mujoco.mj_step(physics.model.ptr, physics.data.ptr)
        pace = 0.5 + 1.5 * act
        act += 1e-3 * (excitation - act) / (0.01 * pace if excitation > act else 0.04 / pace)
        assert actuator.activation == pytest.approx(act, rel=1e-9, abs=1e-12)
        assert step != 59 or act > 0.9
    assert 0.01 < act < 0.5


def test_the_passive_force_halfway_to_lmax_is_half_of_fpmax() -> None:
    halfway = (1 + CURVES["lmax"]) / 2
    fields = {**REFERENCE, "range": (1.0, halfway), "lengthrange": (0.0, 0.05)}
    actuator, physics = ready(config(joint_names_expr=("elbow",), **fields))
    physics.data.qpos[0] = 1.0
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    assert actuator.applied_effort == pytest.approx(-0.05 * PEAK * CURVES["fpmax"] / 2)


def test_peak_force_without_a_force_is_scale_over_the_joints_acceleration() -> None:
    by_scale, weak = ready(config(joint_names_expr=("elbow",), scale=120.0))
    peak = 120.0 / float(weak.model.actuator_acc0[0])
    by_force, strong = ready(config(joint_names_expr=("elbow",), force=peak))
    for physics in (weak, strong):
        physics.data.act[:] = 1.0
        physics.data.qpos[:] = 0.2
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    assert by_scale.applied_effort == pytest.approx(by_force.applied_effort, rel=1e-12)
    assert by_scale.applied_effort[0] < 0


def test_controls_are_clipped_to_what_a_nerve_sends() -> None:
    actuator, _ = ready(config())
    controls = actuator.compute(ActuatorCmd(effort_target=np.array([-3.0, 1.7])))
    np.testing.assert_array_equal(controls, [0.0, 1.0])


@pytest.mark.parametrize("fields", [{"force": 40.0}, {}])
def test_strength_is_a_factor_of_the_force(fields: dict[str, float]) -> None:
    actuator, physics = ready(config(joint_names_expr=("elbow",), **fields))
    physics.data.act[:] = 0.7
    physics.data.qpos[:] = 1.4  # where it is passively stretched, too

    def effort() -> float:
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
        return float(actuator.applied_effort[0])

    nominal = effort()
    assert nominal < 0
    actuator.set("strength", 0.6)
    assert effort() == pytest.approx(0.6 * nominal, rel=1e-12)
    assert actuator.get("strength") == 0.6
    assert actuator.nominal("strength") == 1.0
    actuator.initialize(physics)
    assert effort() == nominal


def test_one_physics_and_a_batch_go_the_same_way_and_resets_leave_the_others_alone() -> None:
    cfg = config(transmission="tendon")
    single, physics = ready(cfg)
    batched = cfg.build()
    batch = Batch(compiled(batched).model.ptr, 3)
    batched.initialize(batch)
    batched.reset()
    batched.set("strength", 0.5, env_ids=[2])
    ctrl, qpos = batch.bind("ctrl"), batch.bind("qpos")
    for step, target in enumerate(excitations(60)):
        if step == 30:
            batched.reset(env_ids=[1])
            assert not batched.activation[1].any()
            assert batched.activation[[0, 2]].all()
        physics.data.ctrl[single.ctrl_ids] = single.compute(ActuatorCmd(effort_target=target))
        mujoco.mj_step(physics.model.ptr, physics.data.ptr)
        every = ActuatorCmd(effort_target=np.tile(target, (3, 1)))
        ctrl[:, batched.ctrl_ids] = batched.compute(every)
        batch.step()
        np.testing.assert_array_equal(qpos[0], physics.data.qpos)
        np.testing.assert_array_equal(batched.applied_effort[0], single.applied_effort)
    assert np.abs(qpos[1] - qpos[0]).min() > 0
    assert np.abs(qpos[2] - qpos[0]).min() > 0


def test_a_delay_shifts_the_excitation() -> None:
    cfg = config()
    delayed, _ = ready(
        DelayedActuatorCfg(base_cfg=cfg, delay_target="effort", delay_min_lag=3, delay_max_lag=3)
    )
    prompt, _ = ready(cfg)
    targets = excitations(20)
    late = [delayed.compute(ActuatorCmd(effort_target=target)) for target in targets]
    at_once = [prompt.compute(ActuatorCmd(effort_target=target)) for target in targets]
    assert not delayed.native
    np.testing.assert_array_equal(late[3:], at_once[:-3])
    np.testing.assert_array_equal(late[:3], [at_once[0]] * 3)


def test_mujocos_own_delay_is_the_same() -> None:
    cfg = config()
    delayed, physics = ready(
        DelayedActuatorCfg(base_cfg=cfg, delay_target="effort", delay_min_lag=3, delay_max_lag=3)
    )
    native = cfg.build()
    native.delay_natively(3)
    own = compiled(native)
    native.initialize(own)
    native.reset()
    for target in excitations(50):
        for actuator, simulated in ((delayed, physics), (native, own)):
            controls = actuator.compute(ActuatorCmd(effort_target=target))
            simulated.data.ctrl[actuator.ctrl_ids] = controls
            mujoco.mj_step(simulated.model.ptr, simulated.data.ptr)
        np.testing.assert_array_equal(physics.data.qpos, own.data.qpos)


def test_numbers_per_muscle() -> None:
    arms = {"elbow": 0.05, "hand": -0.02}
    _, physics = ready(config(moment_arm=arms, force={"elbow": 30.0, "hand": 10.0}))
    np.testing.assert_array_equal(physics.model.actuator_gear[:, 0], [0.05, -0.02])
    np.testing.assert_array_equal(physics.model.actuator_gainprm[:, 2], [30.0, 10.0])


@pytest.mark.parametrize(
    ("fields", "error", "message"),
    [
        ({"force": 0.0}, ValueError, r"force should be above 0, got 0\.0"),
        ({"force": -1.0}, ValueError, r"force should be above 0, got -1\.0"),
        ({"scale": math.inf}, ValueError, "scale should be finite, got inf"),
        ({"moment_arm": 0.0}, ValueError, "moment_arm=0.0: a muscle without a lever"),
        ({"moment_arm": {"elbow": 0.0}}, ValueError, r"moment_arm=\{'elbow': 0.0\}: a muscle"),
        ({"activation_time": 0.0}, ValueError, "activation_time should be above 0"),
        ({"deactivation_time": -1.0}, ValueError, "deactivation_time should be above 0"),
        ({"tausmooth": -0.1}, ValueError, "tausmooth should be at least 0"),
        ({"range": (1.1, 0.9)}, ValueError, r"range should be two finite .*lower first, got \(1.1"),
        ({"range": (-0.1, 0.9)}, ValueError, r"range=\(-0.1, 0.9\) should be two lengths"),
        ({"range": None}, ValueError, "range=None should be two lengths"),
        ({"range": 0.9}, TypeError, "range should be two numbers, the lower first, got 0.9"),
        ({"lengthrange": (0.2, 0.2)}, ValueError, "lengthrange should be two finite"),
        ({"lengthrange": (0.2, math.nan)}, ValueError, "lengthrange should be two finite"),
        ({"lengthrange": (0.1, 0.2, 0.3)}, TypeError, "lengthrange should be two numbers"),
        ({"lmin": 1.2}, ValueError, "lmin should be above 0 and at most 1, got 1.2"),
        ({"lmax": 0.9}, ValueError, "lmax should be at least 1, got 0.9"),
        ({"fvmax": 0.9}, ValueError, "fvmax should be at least 1, got 0.9"),
        (
            {"transmission": "site", "gear": (0, 0, 1, 0, 0, 0)},
            ValueError,
            "transmission='site': a muscle pulls along a length",
        ),
    ],
)
def test_refuses_what_makes_no_muscle(
    fields: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        config(**fields)


@pytest.mark.parametrize(
    ("cmd", "message"),
    [
        (ActuatorCmd(np.ones(2), effort_target=np.ones(2)), "cannot follow a position_target"),
        (ActuatorCmd(velocity_target=np.zeros(2)), "needs a effort_target"),
        (ActuatorCmd(effort_target=np.ones(3)), r"effort_target has shape \(3,\)"),
    ],
)
def test_refuses_targets_that_it_does_not_take(cmd: ActuatorCmd, message: str) -> None:
    actuator, _ = ready(config())
    with pytest.raises(ValueError, match=message):
        actuator.compute(cmd)
