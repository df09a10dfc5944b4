"""Joints: found by name, in order, wherever the model is attached, and edited as configured."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from mujoco.batch import Batch

from tests.actuators.robots import EXPRESSIONS, JOINTS, compiled, free, robot
from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    BuiltinMotorActuatorCfg,
    BuiltinPositionActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    XmlPositionActuatorCfg,
)

MOTOR = BuiltinMotorActuatorCfg(joint_names_expr=EXPRESSIONS)


def edited(cfg, root):
    """The actuator of a config, and the compiled model."""
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root.root_model)
    actuator.initialize(physics)
    return actuator, physics.model.ptr


def refused(cfg, root):
    """The message of a refusal, which leaves the model as it was."""
    before = root.to_xml_string()
    with pytest.raises(ValueError) as error:
        cfg.build().edit_mjcf(root)
    assert root.to_xml_string() == before
    return str(error.value)


# Which joints.


def test_everything_but_free_and_ball_joints():
    arena = free(robot())
    arena.find("actuator", "robot/spare").remove()
    actuator, model = edited(BuiltinMotorActuatorCfg(joint_names_expr=(".*",)), arena)
    assert actuator.joint_names == ("robot/spare", "robot/hip", "robot/knee", "robot/rail")
    assert model.njnt == 6  # with a free and a ball joint


def test_ball_joints_that_only_the_compiler_knows_are_refused():
    root = mjcf.from_xml_string(
        '<mujoco><default><default class="b"><joint type="ball"/></default></default><worldbody>'
        '<body><joint name="wrist" class="b"/><geom size="0.1"/></body></worldbody></mujoco>'
    )
    actuator = BuiltinMotorActuatorCfg(joint_names_expr=(".*",)).build()
    actuator.edit_mjcf(root)
    with pytest.raises(ValueError, match=r"joint 'wrist' is neither hinge nor slide.*leave it out"):
        actuator.initialize(mjcf.Physics.from_mjcf_model(root))


# A joint written after a child body, an unnamed one, and a hand attached halfway.
SCRAMBLED = """
<mujoco model="arm"><compiler angle="radian"/><worldbody>
  <body name="a"><geom size="0.1"/>
    <body name="b"><joint name="deep"/><geom size="0.1"/><site name="wrist"/></body>
    <joint name="late" axis="1 0 0"/>
    <body name="c"><joint axis="1 0 0"/><joint name="deeper" axis="0 1 0"/><geom size="0.1"/></body>
  </body>
  <body name="d"><joint name="last" type="slide"/><geom size="0.1"/></body>
</worldbody></mujoco>
"""
HAND = """
<mujoco model="hand"><worldbody><body><joint name="finger"/><geom size="0.1"/></body></worldbody>
</mujoco>
"""


def scrambled():
    """The arm, with its hand, in an arena."""
    root = mjcf.from_xml_string(SCRAMBLED)
    root.find("site", "wrist").attach(mjcf.from_xml_string(HAND))
    mjcf.RootElement(model="arena").attach(root)
    return root


ORDER = ("late", "deep", "hand/finger", "deeper", "last")


@pytest.mark.parametrize(
    "expressions", [(".*",), ("last", "deep.*", "hand/.*|late"), ORDER, tuple(reversed(ORDER))]
)
def test_kinematic_order_is_that_of_the_compiled_model(expressions):
    actuator, model = edited(BuiltinMotorActuatorCfg(joint_names_expr=expressions), scrambled())
    assert actuator.joint_names == ORDER
    assert (np.diff(actuator.joint_ids) > 0).all()
    names = [model.joint(i).name for i in actuator.joint_ids]
    assert names == [f"arm/{name}" for name in ORDER]


def test_each_joint_gets_its_own_control():
    group = ActuatorGroup(
        (
            BuiltinMotorActuatorCfg(joint_names_expr=("last", "deep")),
            IdealPdActuatorCfg(
                joint_names_expr=("hand/.*", "deeper", "late"), stiffness=0.0, damping=0.0
            ),
        )
    )
    root = scrambled()
    group.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root.root_model)
    group.initialize(physics)
    assert group.joint_names == ORDER
    efforts = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    group.apply(ActuatorCmd(effort_target=efforts))
    physics.step()
    dofs = physics.model.ptr.jnt_dofadr[group.joint_ids]
    np.testing.assert_array_equal(physics.data.qfrc_actuator[dofs], efforts)
    np.testing.assert_array_equal(physics.data.ctrl[group.ctrl_ids], efforts)


@pytest.mark.parametrize("when", ["never", "before", "after"])
def test_names_are_the_walkers_own_whether_attached_or_not(when):
    root = robot()
    if when == "before":
        arena = free(root)
    actuator = MOTOR.build()
    actuator.edit_mjcf(root)
    assert actuator.joint_names == JOINTS
    if when == "after":
        arena = free(root)
    physics = mjcf.Physics.from_mjcf_model(root if when == "never" else arena)
    actuator.initialize(physics)
    prefix = "" if when == "never" else "robot/"
    names = [physics.model.ptr.joint(i).name for i in actuator.joint_ids]
    assert names == [prefix + name for name in JOINTS]
    ids = [physics.model.ptr.actuator(prefix + name).id for name in JOINTS]
    assert actuator.ctrl_ids.tolist() == ids


def test_an_attached_robot_compiled_on_its_own():
    root = robot()
    arena = free(root)
    actuator = MOTOR.build()
    actuator.edit_mjcf(root)
    alone = mujoco.MjModel.from_xml_string(root.to_xml_string())
    actuator.initialize((alone, mujoco.MjData(alone)))
    assert [alone.joint(i).name for i in actuator.joint_ids] == [*JOINTS]
    actuator.initialize(mjcf.Physics.from_mjcf_model(arena))


def test_behind_an_actuator_with_several_controls():
    root = robot()
    actuator = IdealPdActuatorCfg(joint_names_expr=EXPRESSIONS, stiffness=9.0, damping=0.0).build()
    actuator.edit_mjcf(root)
    text = root.to_xml_string().replace(
        "<actuator>", '<actuator><pid name="first" joint="spare" kp="10" input="pos vel ff"/>'
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    actuator.initialize((model, data))
    efforts = actuator.compute(ActuatorCmd(position_target=[0.1, 0.2, 0.3]))
    data.ctrl[actuator.ctrl_ids] = efforts
    mujoco.mj_step(model, data)
    assert (actuator.ctrl_ids >= 3).all()
    exerted = data.qfrc_actuator[model.jnt_dofadr[actuator.joint_ids]]
    np.testing.assert_allclose(exerted, [0.9, 1.8, 2.7], rtol=1e-12)


def test_actuators_are_named_after_their_joints_unless_a_name_is_taken():
    actuator, _ = edited(MOTOR, robot('<motor name="hip" joint="spare"/>'))
    assert [element.name for element in actuator.elements] == ["hip_actuator", "knee", "rail"]


def test_no_joint_with_a_name():
    root = mjcf.from_xml_string(
        '<mujoco model="m"><worldbody><body><freejoint name="f"/><geom size="0.1"/></body>'
        "</worldbody></mujoco>"
    )
    message = refused(BuiltinMotorActuatorCfg(joint_names_expr=(".*",)), root)
    assert "the model 'm' has no hinge or slide joint with a name" in message


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        ({"joint_names_expr": ("hipp",)}, ("'hipp' matches none of", "did you mean 'hip'")),
        ({"joint_names_expr": ("hip", "h.*")}, ("'hip' is matched by 'hip' and by 'h.*'",)),
        ({"joint_names_expr": ("hip", "tail")}, ("'tail' matches none of",)),
        ({"armature": {"hip": 1.0, "knee": 2.0}}, ("armature has no number for 'rail'",)),
        ({"effort_limit": {".*": 1.0, "wrist": 2.0}}, ("effort_limit: 'wrist' matches none",)),
        ({"frictionloss": {".*": 1.0, "h.*": 2.0}}, ("frictionloss: 'hip' is matched by 'h.*'",)),
        ({"joint_names_expr": ("hip", "spare")}, ("'spare' already has the actuator 'spare'",)),
    ],
)
@pytest.mark.parametrize("late", [False, True])
def test_refusals_leave_the_model_as_it_was(options, parts, late):
    cfg = BuiltinMotorActuatorCfg(
        **{"joint_names_expr": EXPRESSIONS, "armature": 0.2, "frictionloss": 0.1, **options}
    )
    if late:
        cfg = DelayedActuatorCfg(base_cfg=cfg, delay_target="effort", delay_max_lag=3)
    message = refused(cfg, robot())
    for part in parts:
        assert part in message


def test_edited_twice():
    root = robot()
    MOTOR.build().edit_mjcf(root)
    assert "'hip' already has the actuator 'hip'" in refused(MOTOR, root)


# What comes along to the joint.

DEFAULTS = (
    '<joint armature="0.02" damping="0.3" frictionloss="0.06"/>'
    '<default class="knee"><joint armature="0.05"/></default>'
)
FIELDS = {
    "armature": "dof_armature",
    "viscous_damping": "dof_damping",
    "frictionloss": "dof_frictionloss",
}


def dofs_of(actuator, model):
    """Armature, damping and dry friction in the compiled model."""
    dofs = model.jnt_dofadr[actuator.joint_ids]
    return {name: getattr(model, field)[dofs].tolist() for name, field in FIELDS.items()}


@pytest.mark.parametrize("build", ["builtin", "explicit", "xml", "delayed"])
def test_none_keeps_what_the_xml_says_and_zero_overrides_it(build):
    actuator = '<position joint="hip"/><position joint="knee"/><position joint="rail"/>'

    def cfg(**options):
        options = {"joint_names_expr": EXPRESSIONS, **options}
        if build == "xml":
            return XmlPositionActuatorCfg(**options)
        gains = {"stiffness": 1.0, "damping": 0.01}
        if build == "builtin":
            return BuiltinPositionActuatorCfg(**options, **gains)
        explicit = IdealPdActuatorCfg(**options, **gains)
        return explicit if build == "explicit" else DelayedActuatorCfg(base_cfg=explicit)

    def values(cfg):
        root = robot(actuator if build == "xml" else "", DEFAULTS)
        root.find("joint", "knee").dclass = "knee"
        made, model = edited(cfg, root)
        got = dofs_of(made, model)
        for name, value in got.items():
            np.testing.assert_array_equal(made.nominal(name), value)
            np.testing.assert_array_equal(made.get(name), value)
        return got

    kept = {
        "armature": [0.01, 0.05, 0.02],
        "viscous_damping": [0.05, 0.3, 0.3],
        "frictionloss": [0.06, 0.02, 0.06],
    }
    assert values(cfg()) == kept
    for name in FIELDS:
        assert values(cfg(**{name: 0.0})) == {**kept, name: [0.0, 0.0, 0.0]}
        assert values(cfg(**{name: 0.07})) == {**kept, name: [0.07, 0.07, 0.07]}
        by_joint = {"rail": 0.3, "hip": 0.0, "kn.*": 0.2}
        assert values(cfg(**{name: by_joint})) == {**kept, name: [0.0, 0.2, 0.3]}


@pytest.mark.parametrize("angle", ["radian", "degree"])
def test_targets_are_radians_whatever_the_xml_is_written_in(angle):
    root = mjcf.from_xml_string(
        f"""<mujoco><compiler angle="{angle}"/><option gravity="0 0 0"/><worldbody><body>
        <joint name="j" axis="0 1 0" range="-90 90" limited="false"/>
        <geom size="0.1" pos="0.2 0 0"/></body></worldbody></mujoco>"""
    )
    root.compiler.angle = angle
    cfg = BuiltinPositionActuatorCfg(joint_names_expr=("j",), stiffness=30.0, damping=6.0)
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    actuator.initialize(physics)
    for _ in range(3000):
        physics.data.ctrl[:] = actuator.compute(ActuatorCmd(position_target=[1.2]))
        physics.step()
    assert physics.data.qpos[0] == pytest.approx(1.2, abs=1e-4)


def test_model_parameters_of_some_rows_and_what_follows_from_them():
    root = robot()
    actuator, model = edited(MOTOR, root)
    batch = Batch(model, 3, 1)
    actuator.initialize(batch)
    actuator.set("armature", [0.5, 0.6, 0.7], [1])
    dofs = model.jnt_dofadr[actuator.joint_ids]
    np.testing.assert_array_equal(batch.expand("dof_armature")[1, dofs], [0.5, 0.6, 0.7])
    np.testing.assert_array_equal(batch.expand("dof_armature")[0], model.dof_armature)
    weights = batch.expand("dof_invweight0")
    assert (weights[1, dofs] < weights[0, dofs]).all()
    with pytest.raises(ValueError, match="env_ids should be ids from 0 to 2"):
        actuator.set("armature", 1.0, [3])


def test_what_was_random_in_a_model_is_nominal_again_after_the_next_initialize():
    root = robot()
    cfg = BuiltinPositionActuatorCfg(
        joint_names_expr=EXPRESSIONS, stiffness=30.0, damping=1.0, effort_limit=9.0, armature=0.1
    )
    actuator, model = edited(cfg, root)
    physics = compiled(root)
    actuator.initialize(physics)
    model = physics.model.ptr
    fields = ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "dof_armature")
    before = {name: getattr(model, name).copy() for name in (*fields, "dof_invweight0")}
    for name in actuator.parameters:
        actuator.set(name, 1.3 * actuator.nominal(name) + 0.01)
    for name in fields:
        assert not np.array_equal(getattr(model, name), before[name]), name
    actuator.initialize(physics)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(model, name), value, err_msg=name)
