import re
from typing import Any

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from hypothesis import given, settings
from hypothesis import strategies as st

from walkerkit.actuators.scaled import add_position_actuator

quick = settings(derandomize=True, max_examples=40, deadline=None)
RANGES_XML = """
<mujoco>
  <compiler angle="degree"/>
  <default>
    <joint range="-10 20"/>
    <default class="leg">
      <joint range="-45 90"/>
      <default class="ankle"><joint range="-30 15"/><general gear="-2"/></default>
    </default>
    <default class="loose"><joint limited="false"/></default>
    <default class="bare"><joint range="0 0"/></default>
  </default>
  <worldbody>
    <body name="floating" pos="0 0 1">
      <joint name="free" type="free"/>
      <geom size="0.1" mass="1"/>
      <body name="thigh" childclass="leg">
        <joint name="root class" class="/" axis="0 1 0"/>
        <joint name="child class" axis="0 1 0"/>
        <joint name="own range" range="-5 5" axis="1 0 0"/>
        <joint name="slide" type="slide" range="-0.1 0.3"/>
        <geom size="0.1" mass="1"/>
        <body name="shin">
          <joint name="inherited" axis="1 0 0"/>
          <joint axis="0 1 0" range="-3 4"/>
          <joint name="nested class" class="ankle"/>
          <geom size="0.1" mass="1"/>
          <body name="foot">
            <joint name="ball" type="ball" range="0 30"/>
            <geom size="0.1" mass="1"/>
            <body name="toe">
              <joint name="loose" class="loose"/>
              <joint name="bare" class="bare" axis="0 1 0"/>
              <geom size="0.1" mass="1"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="belt"><joint joint="inherited" coef="1"/></fixed></tendon>
</mujoco>
"""


def compiled_range(root: Any, joint: Any) -> np.ndarray:
    model = mujoco.MjModel.from_xml_string(root.root_model.to_xml_string())
    return np.asarray(model.joint(joint.full_identifier).range)


def targets_of(actuator: Any) -> np.ndarray:
    """The lengths that the ends of the control range ask for."""
    gain, (offset, stiffness) = actuator.gainprm[0], actuator.biasprm[:2]
    return np.asarray((gain * np.asarray(actuator.ctrlrange) + offset) / -stiffness)


SCALAR = ["root class", "child class", "own range", "slide", "inherited", "nested class"]


@pytest.mark.parametrize("angle", ["degree", "radian"])
@pytest.mark.parametrize("name", SCALAR)
def test_takes_the_joints_range_as_mujoco_compiles_it(name: str, angle: str) -> None:
    root = mjcf.from_xml_string(RANGES_XML)
    root.compiler.angle = angle
    joint = root.find("joint", name)
    before = root.to_xml_string()
    made = add_position_actuator(joint, "joint", (0, 2), kp=8, name="servo")
    np.testing.assert_allclose(targets_of(made), compiled_range(root, joint), rtol=1e-12)
    assert len(root.find_all("actuator")) == 1
    made.remove()
    assert root.to_xml_string() == before


def test_every_kind_of_range_is_a_different_one() -> None:
    # Else the test above could pass with the wrong class.
    root = mjcf.from_xml_string(RANGES_XML)
    ranges = {tuple(compiled_range(root, root.find("joint", name))) for name in SCALAR}
    assert len(ranges) == len(SCALAR) - 1
    assert tuple(np.deg2rad([-45, 90])) in ranges


@quick
@given(gear=st.floats(-50, 50).filter(lambda gear: abs(gear) > 1e-3))
def test_the_range_is_in_units_of_the_length(gear: float) -> None:
    root = mjcf.from_xml_string(RANGES_XML)
    joint = root.find("joint", "inherited")
    made = add_position_actuator(joint, "joint", kp=100, gear=[gear])
    expected = np.sort(gear * compiled_range(root, joint))
    np.testing.assert_allclose(targets_of(made), expected, rtol=1e-9)


def test_the_gear_of_a_default_class_counts() -> None:
    root = mjcf.from_xml_string(RANGES_XML)
    joint = root.find("joint", "own range")
    made = [
        add_position_actuator(joint, "joint", dclass="ankle"),
        add_position_actuator(joint, "joint", dclass="ankle", gear=[1]),
        add_position_actuator(joint, "joint"),
    ]
    for actuator, gear in zip(made, (2, 1, 1), strict=True):
        np.testing.assert_allclose(targets_of(actuator), gear * np.deg2rad([-5, 5]), rtol=1e-12)


def test_the_servo_reaches_both_ends_of_the_range() -> None:
    root = mjcf.from_xml_string(RANGES_XML)
    joint = root.find("joint", "inherited")
    add_position_actuator(joint, "joint", kp=100, gear=[-3])
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    data = mujoco.MjData(model)
    index = model.joint("inherited").qposadr[0]
    for control, bound in ((-1, 1), (1, 0)):  # a negative gear turns around
        data.ctrl[0] = control
        data.qpos[index] = model.joint("inherited").range[bound]
        mujoco.mj_forward(model, data)
        assert data.actuator_force[0] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("angle", "unit"), [("degree", np.pi / 180), ("radian", 1)])
def test_an_attached_model_has_the_units_of_the_outermost(angle: str, unit: float) -> None:
    arena = mjcf.RootElement(model="arena")
    arena.compiler.angle = angle
    legs = mjcf.from_xml_string(RANGES_XML)
    del legs.compiler.angle
    legs.find("joint", "root class").dclass = None  # which PyMJCF cannot attach
    legs.find("joint", "free").remove()
    arena.attach(legs)
    for joint in (legs.find("joint", "inherited"), legs.find("body", "shin").joint[1]):
        made = add_position_actuator(joint, "joint")
        np.testing.assert_allclose(targets_of(made), compiled_range(arena, joint), rtol=1e-12)
    np.testing.assert_allclose(targets_of(made), unit * np.array([-3, 4]), rtol=1e-12)


def test_the_range_of_a_model_that_does_not_compile_yet() -> None:
    root = mjcf.RootElement(model="half built")
    root.compiler.angle = "radian"
    root.asset.add("mesh", name="shell", file=mjcf.Asset(b"nothing", ".stl"))
    body = root.worldbody.add("body")
    body.add("geom", type="mesh", mesh="shell")
    made = add_position_actuator(body.add("joint", range=[-0.5, 1]), "joint")
    assert targets_of(made).tolist() == [-0.5, 1]


def refuse(message: str, joint: Any, **kwargs: Any) -> None:
    before = joint.root.to_xml_string()
    with pytest.raises(ValueError, match=re.escape(message)):
        add_position_actuator(joint, "joint", **kwargs)
    assert joint.root.to_xml_string() == before
    assert joint.root.find_all("actuator") == []


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("ball", "`qposrange=\"joint\"` needs a hinge or slide joint, and 'ball' turns freely"),
        ("free", "`qposrange=\"joint\"` needs a hinge or slide joint, and 'free' turns freely"),
        ("loose", "the range (-10, 20) of joint 'loose' is switched off: set limited=\"true\""),
        ("bare", "joint 'bare' has no range: give it one, itself or in its default class"),
    ],
)
def test_refuses_joints_without_a_range(name: str, message: str) -> None:
    root = mjcf.from_xml_string(RANGES_XML)
    refuse(message, root.find("joint", name))


def test_refuses_ranges_without_limits() -> None:
    root = mjcf.from_xml_string(RANGES_XML)
    root.compiler.autolimits = False
    message = "the range (-5, 5) of joint 'own range' is switched off"
    joint = root.find("joint", "own range")
    refuse(message, joint)
    joint.limited = True
    assert targets_of(add_position_actuator(joint, "joint")) == pytest.approx(np.deg2rad([-5, 5]))


def test_refuses_a_range_that_could_be_degrees_or_radians() -> None:
    # As in dm_control's CMU humanoid, which an arena in radians gives its unit.
    root = mjcf.from_xml_string(RANGES_XML)
    del root.compiler.angle
    message = (
        "the range (-5, 5) of joint 'own range' could be degrees or radians, for the model states "
        'neither: set root.compiler.angle to "radian" or "degree"'
    )
    joint = root.find("joint", "own range")
    refuse(message, joint)
    # Beyond a turn it can only be degrees, and metres are metres.
    for name in ("inherited", "slide"):
        joint = root.find("joint", name)
        made = add_position_actuator(joint, "joint")
        np.testing.assert_allclose(targets_of(made), compiled_range(root, joint), rtol=1e-12)


def test_refuses_a_gear_of_zero() -> None:
    root = mjcf.from_xml_string(RANGES_XML)
    joint = root.find("joint", "inherited")
    message = "the actuator of joint 'inherited' has gear 0, so that its length is always zero"
    refuse(message, joint, gear=[0])
