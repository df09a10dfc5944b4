"""What lies beside a mended model, as its walker takes it up."""

import json
import math

import numpy as np
import pytest
from dm_control import composer
from dm_control.locomotion.arenas import floors

from walkerkit.actuators import ActuatorCmd, XmlMotorActuatorCfg, XmlPositionActuatorCfg
from walkerkit.actuators.drivetrain import Cogging, StribeckFriction
from walkerkit.tasks import TrackJoints
from walkerkit.walkers import LEG_XML, MjcfWalker
from walkerkit.walkers.saved import FILE, saved_actuators

ARM = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="upper"><joint name="side/hip" axis="1 0 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03"/>
    <body name="lower" pos="0 0 -0.3"><joint name="wrist" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/></body></body></worldbody>
  <actuator><position name="h" joint="side/hip" kp="44" kv="2"/>
    <motor name="w" joint="wrist" gear="2"/></actuator></mujoco>
"""
COMMAND = {
    "side/hip": {"position": {"slope": 0.9, "offset": 0.01}},
    "wrist": {"effort": {"slope": 0.5, "offset": 0.0}},
}
LAWS = {
    "side/hip": {"stribeck_friction": {"breakaway": 0.2, "velocity": 0.1, "exponent": 1.0}},
    "wrist": {
        "stribeck_friction": {"breakaway": 0.1, "velocity": 0.3, "exponent": 2.0},
        "cogging": {"amplitude": 0.05, "periods": 12.0, "phase": 0.4},
    },
}


@pytest.fixture
def arm(tmp_path):
    def write(**entry):
        content = {"command": COMMAND, "measurement": {}, "laws": {}} | entry
        (tmp_path / "model.xml").write_text(ARM, encoding="utf-8")
        whole = json.dumps({"schema": 1, "effects": [], "models": {"model.xml": content}})
        (tmp_path / FILE).write_text(whole, encoding="utf-8")
        return tmp_path / "model.xml"

    return write


def test_configs_and_laws_have_the_numbers_of_the_file(arm):
    saved = saved_actuators(arm(laws=LAWS))
    servo, motor = saved.actuators
    assert isinstance(servo, XmlPositionActuatorCfg)
    assert isinstance(motor, XmlMotorActuatorCfg)
    assert list(servo.slope.values()) == [0.9]
    assert list(servo.offset.values()) == [0.01]
    assert list(motor.slope.values()) == [0.5]
    stribeck, cogging = saved.laws
    assert isinstance(stribeck, StribeckFriction)
    assert isinstance(cogging, Cogging)
    assert sorted(stribeck.breakaway.values()) == [0.1, 0.2]
    assert list(cogging.periods.values()) == [12.0]


def test_targets_keep_the_meaning_that_the_file_gives_them(arm):
    walker = MjcfWalker.from_file(arm(laws=LAWS))
    assert walker.actuator_group.joint_names == ("side\\hip", "wrist")
    task = TrackJoints(walker, joint_names_expr=(r"side\\hip",))
    environment = composer.Environment(task, random_state=0)
    environment.reset()
    walker.command = ActuatorCmd(position_target=[0.3, 0.0], effort_target=[0.0, 0.7])
    walker.drivetrain.run()
    control = environment.physics.bind(walker.actuators).ctrl
    np.testing.assert_allclose(control, [0.9 * 0.3 + 0.01, 0.5 * 0.7], rtol=1e-12)


def test_without_the_file_the_robot_s_own_actuators_are_taken_over(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM, encoding="utf-8")
    walker = MjcfWalker.from_file(tmp_path / "arm.xml")
    floor = floors.Floor()
    floor.attach(walker)
    assert [type(cfg).__name__ for cfg in walker.actuator_group.cfgs] == [
        "XmlPositionActuatorCfg",
        "XmlMotorActuatorCfg",
    ]
    assert MjcfWalker.from_file(LEG_XML).actuator_group.joint_names == ("hip", "thigh", "calf")


def test_a_model_that_the_file_does_not_know_is_as_its_xml(arm):
    path = arm(laws=LAWS)
    other = path.with_name("other.xml")
    other.write_text(ARM, encoding="utf-8")
    assert saved_actuators(other).laws == ()


def test_configs_that_are_given_count_alone(arm):
    cfgs = [
        XmlPositionActuatorCfg(joint_names_expr=(".*hip",)),
        XmlMotorActuatorCfg(joint_names_expr=("wrist",)),
    ]
    walker = MjcfWalker.from_file(arm(laws={"wrist": {"no_law": {}}}), cfgs)
    assert walker.actuator_group.cfgs == tuple(cfgs)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"laws": {"wrist": {"cogging": {"amplitude": 1.0}}}}, "KeyError: 'periods'"),
        ({"command": {"wrist": {"effort": {"slope": 1.0}}}}, "KeyError: 'offset'"),
        ({"command": None}, "write it with `walkerkit diagnose`"),
        ({"command": {"wrist": {"effort": {"slope": math.nan, "offset": 0}}}}, "not a finite"),
    ],
)
def test_a_file_that_is_none_of_ours_is_named_with_the_remedy(arm, entry, message):
    path = arm(**entry)
    with pytest.raises(
        ValueError, match=r"actuators\.json: is none of the gap workflow's"
    ) as caught:
        saved_actuators(path)
    assert message in str(caught.value)


def test_a_law_that_nobody_has_defined_is_named_with_the_remedy(arm):
    path = arm(laws={"wrist": {"stribek_friction": {}}})
    with pytest.raises(ValueError, match=r"did you mean 'stribeck_friction'.*Import the") as caught:
        saved_actuators(path)
    assert str(caught.value).startswith(f"{path.parent / 'actuators.json'}: ")


def test_a_robot_without_drives_asks_for_configs(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.partition("<actuator>")[0] + "</mujoco>", encoding="utf-8")
    with pytest.raises(ValueError, match="give configs of the actuators"):
        MjcfWalker.from_file(path)


def test_a_stopgap_that_is_not_there(arm):
    with pytest.raises(ValueError, match=r"has no stopgap for model\.xml"):
        saved_actuators(arm(), stopgap=True)


def test_slope_and_offset_go_together():
    with pytest.raises(ValueError, match="give both, or leave both out"):
        XmlPositionActuatorCfg(joint_names_expr=("wrist",), slope=2.0)
