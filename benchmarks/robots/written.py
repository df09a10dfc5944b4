"""Robot files written for the benchmark: each has what is common and yet no plain servo of a joint.

Loops of links, tendons, joints that follow others, a door beside the robot, several controls for
one joint. Lengths in metres, angles in radians.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

_HEAD = """
<mujoco model="{}">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <geom type="capsule" size="0.02" contype="0" conaffinity="0"/>
    <joint axis="0 1 0" damping="0.1" armature="0.01"/>
    <site size="0.005"/>
  </default>
"""

_ARM = """
  <worldbody>
    <site name="beside" pos="0.5 0 0.7"/><site name="rail" pos="0.5 0 0.7" zaxis="1 0 0"/>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" range="-1.6 1.6"/>
      <geom fromto="0 0 0 0 0 -0.3" mass="0.8"/>
      <site name="pin" pos="0 0 -0.3"/>
      <body name="fore" pos="0 0 -0.3">
        <joint name="elbow" range="-1.6 1.6"/>
        <geom fromto="0 0 0 0 0 -0.25" mass="0.4"/>
        <site name="tip" pos="0 0 -0.25"/>
        {}
      </body>
    </body>
  </worldbody>
"""

_FINGERS = """
        <body name="left" pos="0 0.03 -0.27">
          <joint name="left_finger" type="slide" range="0 0.04" damping="2" armature="0.1"/>
          <geom type="box" size="0.01 0.005 0.03" mass="0.03"/>
        </body>
        <body name="right" pos="0 -0.03 -0.27">
          <joint name="right_finger" type="slide" axis="0 -1 0" range="0 0.04" damping="2"
            armature="0.1"/>
          <geom type="box" size="0.01 0.005 0.03" mass="0.03"/>
        </body>
"""

_SERVOS = """
    <position name="shoulder" joint="shoulder" kp="40" kv="1.5"/>
    <position name="elbow" joint="elbow" kp="25" kv="1"/>
"""

_LEG = """
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1" contype="1"/>
    <body name="base" pos="0 0 1">
      {}
      <geom type="sphere" size="0.1" mass="3" conaffinity="1"/>
      <body name="thigh">
        <joint name="hip" range="-1 1"/>
        <geom fromto="0 0 0 0 0 -0.4" size="0.03" mass="1"/>
        <body name="shank" pos="0 0 -0.4">
          <joint name="knee" range="-1.5 0.5"/>
          <geom fromto="0 0 0 0 0 -0.4" size="0.03" mass="0.8"/>
          {}
        </body>
      </body>
      {}
    </body>
    {}
  </worldbody>
"""

_LEG_SERVOS = """
    <position name="hip" joint="hip" kp="120" kv="6"/>
    <position name="knee" joint="knee" kp="120" kv="6"/>
"""


def _robot(name: str, bodies: str, actuators: str, more: str = "") -> str:
    return f"{_HEAD.format(name)}{bodies}{more}\n  <actuator>{actuators}</actuator>\n</mujoco>\n"


WRITTEN: Final[Mapping[str, str]] = MappingProxyType(
    {
        "pair": _robot(
            "pair",
            _ARM.format(""),
            '<position name="shoulder" joint="shoulder" kp="40" kv="1.5"/>'
            '<position name="p" joint="elbow" kp="25"/><velocity name="v" joint="elbow" kv="1"/>',
        ),
        "two_servos": _robot(
            "two_servos",
            _ARM.format(""),
            f'{_SERVOS}<position name="elbow_2" joint="elbow" kp="5" kv="0.2"/>',
        ),
        "door": _robot(
            "door",
            _LEG.format(
                "<freejoint/>",
                "",
                "",
                '<body name="door" pos="1 0 0"><joint name="hinge" axis="0 0 1"/>'
                '<geom type="box" size="0.4 0.02 1" pos="0.4 0 1" mass="10"/></body>',
            ),
            f'{_LEG_SERVOS}<position name="closer" joint="hinge" kp="5"/>',
        ),
        "mimic": _robot(
            "mimic",
            _ARM.format(_FINGERS),
            f'{_SERVOS}<position name="grip" joint="left_finger" kp="400" kv="20"/>',
            '<equality><joint joint1="right_finger" joint2="left_finger"/></equality>',
        ),
        "mimic_with_two_servos": _robot(
            "mimic_with_two_servos",
            _ARM.format(_FINGERS),
            f'{_SERVOS}<position name="grip" joint="left_finger" kp="400" kv="20"/>'
            '<position name="grip_2" joint="right_finger" kp="400" kv="20"/>',
            '<equality><joint joint1="right_finger" joint2="left_finger"/></equality>',
        ),
        "gripper_on_a_tendon": _robot(
            "gripper_on_a_tendon",
            _ARM.format(_FINGERS),
            f'{_SERVOS}<position name="grip" tendon="split" kp="400" kv="20" ctrlrange="0 0.04"/>',
            '<tendon><fixed name="split"><joint joint="left_finger" coef="0.5"/>'
            '<joint joint="right_finger" coef="0.5"/></fixed></tendon>'
            '<equality><joint joint1="left_finger" joint2="right_finger"/></equality>',
        ),
        "cable": _robot(
            "cable",
            _ARM.format(""),
            '<position name="shoulder" joint="shoulder" kp="40" kv="1.5"/>'
            '<position name="winch" tendon="cable" kp="200" kv="8"/>',
            '<tendon><spatial name="cable"><site site="beside"/><site site="tip"/></spatial>'
            "</tendon>",
        ),
        "site": _robot(
            "site",
            _ARM.format(""),
            '<position name="elbow" joint="elbow" kp="25" kv="1"/>'
            '<position name="pull" site="pin" refsite="beside" gear="1 0 0 0 0 0" kp="90" kv="4"/>',
        ),
        "slidercrank": _robot(
            "slidercrank",
            _ARM.format(""),
            '<position name="elbow" joint="elbow" kp="25" kv="1"/>'
            '<position name="piston" cranksite="pin" slidersite="rail" cranklength="0.6" kp="400" '
            'kv="15"/>',
        ),
        "joint_in_parent": _robot(
            "joint_in_parent",
            _ARM.format(""),
            '<position name="shoulder" joint="shoulder" kp="40" kv="1.5"/>'
            '<position name="elbow" jointinparent="elbow" kp="25" kv="1"/>',
        ),
        "four_bar": _robot(
            "four_bar",
            """
  <worldbody>
    <body name="crank" pos="0 0 1">
      <joint name="crank" range="-1 1"/>
      <geom fromto="0 0 0 0 0 0.1" mass="0.2"/>
      <body name="coupler" pos="0 0 0.1">
        <joint name="coupler" damping="0.01" armature="0.001"/>
        <geom fromto="0 0 0 0.2 0 0" mass="0.2"/>
        <site name="near" pos="0.2 0 0"/>
      </body>
    </body>
    <body name="rocker" pos="0.2 0 1">
      <joint name="rocker" damping="0.01" armature="0.001"/>
      <geom fromto="0 0 0 0 0 0.1" mass="0.2"/>
      <site name="far" pos="0 0 0.1"/>
    </body>
  </worldbody>
""",
            '<position name="crank" joint="crank" kp="30" kv="1"/>',
            '<equality><connect site1="near" site2="far"/></equality>',
        ),
        "leg_with_a_rod": _robot(
            "leg_with_a_rod",
            _LEG.format(
                "",
                '<body name="tarsus" pos="0 0 -0.4"><joint name="ankle" damping="0.05" '
                'armature="0.001"/><geom fromto="0 0 0 0.1 0 0" mass="0.2"/>'
                '<site name="heel" pos="-0.1 0 0"/></body>',
                '<body name="rod" pos="-0.1 0 0"><joint name="rod" type="ball" damping="0.01"/>'
                '<geom fromto="0 0 0 0 0 -0.8" size="0.01" mass="0.1"/>'
                '<site name="rod_end" pos="0 0 -0.8"/></body>',
                "",
            ),
            _LEG_SERVOS,
            '<equality><connect site1="heel" site2="rod_end"/></equality>',
        ),
        "dc_motors": _robot(
            "dc_motors",
            _ARM.format(""),
            '<dcmotor name="shoulder" joint="shoulder" motorconst=".1 .1" resistance=".5" gear="9" '
            'input="pos" controller="1 0 .05"/>'
            '<dcmotor name="elbow" joint="elbow" motorconst=".1 .1" resistance=".5" gear="9"/>',
        ),
        "many_inputs": _robot(
            "many_inputs",
            _ARM.format(""),
            '<pid name="shoulder" joint="shoulder" kp="40" kv="1.5" ki="3"/>'
            '<dcmotor name="elbow" joint="elbow" motorconst=".1 .1" resistance=".5" gear="9" '
            'input="pos vel ff" controller="1 0 .05"/>',
        ),
        "muscle": _robot(
            "muscle",
            _ARM.format(""),
            '<position name="shoulder" joint="shoulder" kp="40" kv="1.5"/>'
            '<muscle name="biceps" joint="elbow" lengthrange="-1 1"/>',
        ),
    }
)
