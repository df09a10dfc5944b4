"""The least of all that limits an actuator, held against MuJoCo driven as far as it goes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from hypothesis import given, settings
from hypothesis import strategies as st
from mujoco.batch import Batch

from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    BuiltinDcMotorActuatorCfg,
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    RemotizedPdActuatorCfg,
    XmlActuatorCfg,
    XmlMotorActuatorCfg,
    randomize_effort_limits,
    randomize_strength,
)
from walkerkit.actuators.limits import least, mapped

JOINT = """
<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body>
  <joint name="j" type="{type}" axis="0 1 0" {joint}/><geom size="0.1" pos="0 0 -0.3"/></body>
  </worldbody>
  <tendon><fixed name="t" {tendon}><joint joint="j" coef="1.5"/></fixed></tendon>
  <actuator>{actuator}</actuator></mujoco>
"""
FAR = 1e9


def model_of(actuator="", joint="", tendon="", type_="hinge"):
    return mjcf.from_xml_string(
        JOINT.format(actuator=actuator, joint=joint, tendon=tendon, type=type_)
    )


def stated(name, ends):
    return "" if ends is None else f'{name}="{float(ends[0])!r} {float(ends[1])!r}"'


def as_far_as_it_goes(root):
    """Efforts on the joint with the control as low and as high as it can be."""
    physics = mjcf.Physics.from_mjcf_model(root)
    efforts = []
    for control in (-FAR, FAR):
        physics.data.ctrl[0] = control
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
        efforts.append(float(physics.data.qfrc_actuator[0]))
    return sorted(efforts)


def started(cfg, root, n_sims=None):
    group = ActuatorGroup(cfg)
    group.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    simulation = physics if n_sims is None else Batch(physics.model.ptr, n_sims, 1)
    group.initialize(simulation)
    group.reset()
    return group, simulation


numbers = st.floats(0.01, 50)
even = st.none() | numbers.map(lambda x: (-x, x))
uneven = st.none() | st.tuples(numbers.map(lambda x: -x), numbers)
gears = st.sampled_from([1.0, 25.0, -0.3, -7.0])


@settings(max_examples=40, deadline=None)
@given(
    gear=gears,
    gain=st.sampled_from([1.0, 3.5, -2.0]),
    control=uneven,
    force=uneven,
    behind=uneven,
    on_tendon=st.booleans(),
)
def test_a_motor_can_be_asked_for_all_that_mujoco_lets_through(
    gear, gain, control, force, behind, on_tendon
):
    where = "tendon" if on_tendon else "joint"
    driven = "t" if on_tendon else "j"
    limits = {where: stated("actuatorfrcrange", behind)}
    root = model_of(
        f'<general {where}="{driven}" gainprm="{gain}" gear="{gear}" '
        f"{stated('ctrlrange', control)} {stated('forcerange', force)}/>",
        **limits,
    )
    native = as_far_as_it_goes(root)
    cfg = XmlMotorActuatorCfg(joint_names_expr=(driven,), transmission=where)
    group, physics = started(cfg, root)
    ends = group.reach("effort_target")[0]
    arm = 1.5 if on_tendon else 1.0
    if control is force is behind is None:
        assert not np.isfinite(ends).any()
        return
    np.testing.assert_allclose(arm * ends, native, rtol=1e-12)
    np.testing.assert_allclose(group.effort_range[0], ends, rtol=1e-14)
    for target in (*ends, 3 * ends[0], 3 * ends[1]):
        group.apply(ActuatorCmd(effort_target=[target]))
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
        exerted = physics.data.qfrc_actuator[0]
        assert arm * group.applied_effort[0] == pytest.approx(exerted, rel=1e-12)


CFGS = {
    "ideal": IdealPdActuatorCfg(joint_names_expr=("j",), stiffness=500.0, damping=0.0),
    "limited": IdealPdActuatorCfg(
        joint_names_expr=("j",), stiffness=500.0, damping=0.0, effort_limit=30.0
    ),
    "dc": DcMotorActuatorCfg(
        joint_names_expr=("j",),
        stiffness=500.0,
        damping=0.0,
        effort_limit=30.0,
        saturation_effort=40.0,
        velocity_limit=20.0,
    ),
    "remotized": RemotizedPdActuatorCfg(
        joint_names_expr=("j",), stiffness=500.0, damping=0.0, effort_lookup=((-1, 20), (1, 40))
    ),
    "position": BuiltinPositionActuatorCfg(joint_names_expr=("j",), stiffness=500.0, damping=0.0),
    "pd": BuiltinPdActuatorCfg(joint_names_expr=("j",), stiffness=500.0, damping=0.0),
    "motor": BuiltinMotorActuatorCfg(joint_names_expr=("j",), effort_limit=30.0),
    "dcmotor": BuiltinDcMotorActuatorCfg(
        joint_names_expr=("j",),
        input="position",
        torque_constant=0.5,
        resistance=0.4,
        gear_ratio=9.0,
        stiffness=500.0,
        damping=0.0,
    ),
}


@pytest.mark.parametrize("n_sims", [None, 2])
@pytest.mark.parametrize("behind", [(-5.0, 5.0), (-3.0, 8.0)])
@pytest.mark.parametrize("name", [*CFGS, "delayed"])
def test_applied_effort_is_what_the_joint_lets_through(name, behind, n_sims):
    cfg = CFGS.get(name) or DelayedActuatorCfg(base_cfg=CFGS["ideal"], delay_max_lag=2)
    group, simulation = started(cfg, model_of(joint=stated("actuatorfrcrange", behind)), n_sims)
    word = "effort_target" if name == "motor" else "position_target"
    shape = (*group.simulation.batch_shape, 1)
    if n_sims:
        exerted, forward = simulation.bind("qfrc_actuator"), simulation.forward
    else:
        model, data = simulation.model.ptr, simulation.data.ptr
        exerted = data.qfrc_actuator

        def forward():
            mujoco.mj_forward(model, data)

    for sign in (1.0, -1.0):
        for _ in range(4):
            group.apply(ActuatorCmd(**{word: np.full(shape, sign * 9)}))
            forward()
            np.testing.assert_allclose(group.applied_effort, exerted, rtol=1e-12)
            simulation.step()
        np.testing.assert_allclose(group.applied_effort, behind[int(sign > 0)], rtol=1e-12)
    np.testing.assert_allclose(group.effort_range, [behind], rtol=1e-12)


def test_effort_limits_are_those_that_act():
    """The nominal limit is the least, and what is drawn of it acts, wherever it was stated."""
    on_joint = stated("actuatorfrcrange", (-20.0, 20.0))
    for cfg, actuator, joint, nominal in (
        (XmlMotorActuatorCfg, '<motor joint="j" gear="2" ctrlrange="-4 4"/>', "", 8.0),
        (XmlMotorActuatorCfg, '<motor joint="j" gear="2"/>', on_joint, 20.0),
        (XmlActuatorCfg, '<position joint="j" kp="100" forcerange="-30 30"/>', on_joint, 20.0),
        (CFGS["ideal"], "", on_joint, 20.0),
        (CFGS["limited"], "", on_joint, 20.0),
        (CFGS["dc"], "", on_joint, 20.0),
    ):
        cfg = cfg(joint_names_expr=("j",)) if isinstance(cfg, type) else cfg
        group, physics = started(cfg, model_of(actuator, joint))
        (one,) = group.actuators
        word = "effort_target" if "position_target" not in one.takes else "position_target"
        rng = np.random.default_rng(0)
        np.testing.assert_allclose(one.nominal("effort_limit"), nominal)
        for share in (0.5, 0.25):
            randomize_effort_limits(
                group, effort_limit_range=(share, share + 1e-12), random_state=rng
            )
            group.apply(ActuatorCmd(**{word: [1e3]}))
            mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
            assert physics.data.qfrc_actuator[0] == pytest.approx(share * nominal)
            assert group.applied_effort[0] == pytest.approx(share * nominal)
        one.set("effort_limit", nominal)
        randomize_strength(group, strength_range=(0.5, 0.5 + 1e-12), random_state=rng)
        group.apply(ActuatorCmd(**{word: [1e3]}))
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
        assert group.applied_effort[0] == pytest.approx(0.5 * nominal)
        assert physics.data.qfrc_actuator[0] == pytest.approx(0.5 * nominal)
        group.initialize(physics)  # nominal again, and the model as it was compiled
        assert not physics.model.actuator_forcelimited[0] or "forcerange" in actuator


def test_limits_that_are_not_drawn_stay_bit_for_bit():
    joint = stated("actuatorfrcrange", (-0.7, 0.9))
    group, physics = started(
        XmlActuatorCfg(joint_names_expr=("j",)),
        model_of('<position joint="j" kp="100" kv="1" gear="0.3" forcerange="-30 30"/>', joint),
    )
    group.actuators[0].set("damping", [2.0])
    np.testing.assert_array_equal(physics.model.actuator_forcerange[0], [-30, 30])


@pytest.mark.parametrize(
    ("element", "joint", "target", "ends"),
    [
        ('<position joint="j" kp="9" ctrlrange="-0.5 0.8"/>', "", "position", (-0.5, 0.8)),
        ('<position joint="j" kp="9" ctrlrange="-5 8"/>', 'range="-60 90"', "position", None),
        (
            '<general joint="j" gainprm="20" biastype="affine" biasprm="4 -40 -1" '
            'ctrlrange="-1 1"/>',
            "",
            "position",
            (-0.4, 0.6),
        ),
        ('<position joint="j" kp="9" gear="-2" ctrlrange="-1 3"/>', "", "position", (-1.5, 0.5)),
        ('<velocity joint="j" kv="3" ctrlrange="-4 6"/>', "", "velocity", (-4, 6)),
        ('<velocity joint="j" kv="3" gear="2" ctrlrange="-4 6"/>', "", "velocity", (-2, 3)),
        ('<motor joint="j" gear="150" ctrlrange="-1 1"/>', "", "effort", (-150, 150)),
        (
            '<general joint="j" dyntype="filter" dynprm="0.1" gainprm="5" ctrlrange="-9 9" '
            'actrange="-2 3"/>',
            "",
            "effort",
            (-10, 15),
        ),
    ],
)
def test_targets_span_what_the_control_can_say(element, joint, target, ends):
    group, _ = started(XmlActuatorCfg(joint_names_expr=("j",)), model_of(element, joint))
    assert group.takes == {f"{target}_target"}
    if ends is None:
        ends = (-np.pi / 3, np.pi / 2)
    np.testing.assert_allclose(group.reach(f"{target}_target")[0], ends, rtol=1e-12)


def test_a_bias_that_the_drive_makes_besides_is_none_of_the_target():
    element = '<general joint="j" biastype="affine" biasprm="2" forcerange="-10 10"/>'
    for bias, ends in (("effort", (-12, 8)), ("offset", (-10, 10))):
        cfg = XmlMotorActuatorCfg(joint_names_expr=("j",), bias=bias)
        group, physics = started(cfg, model_of(element))
        np.testing.assert_allclose(group.reach("effort_target")[0], ends)
        for end, limit in zip(ends, (-10, 10), strict=True):
            group.apply(ActuatorCmd(effort_target=[end]))
            mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
            assert physics.data.qfrc_actuator[0] == pytest.approx(limit)


def test_least_and_mapped():
    inf = np.inf
    one = np.array([[-1.0, 2.0], [-inf, 4.0], [5.0, 6.0]])
    other = np.array([[-3.0, 1.0], [0.0, inf], [1.0, 2.0]])
    np.testing.assert_array_equal(least(one, other), [[-1, 1], [0, 4], [5, 6]])
    np.testing.assert_array_equal(
        mapped(one, np.array([2.0, -1.0, 1.0]), 1.0), [[-1, 5], [-3, inf], [6, 7]]
    )
