"""An arm of two joints under position servos, one of them behind a delay."""

from __future__ import annotations

import mujoco

from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel
from walkerkit.gap.simulation.robot import Robot

_ARM = """
<mujoco><compiler angle="radian"/>
<option timestep="{step}" integrator="{integrator}" gravity="0 0 {gravity}"/>
<worldbody><body><joint name="hip" axis="0 1 0" damping="{damping}" armature="0.01"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="{mass}"/>
  <body pos="0 0 -0.3"><joint name="knee" axis="0 1 0" damping="0.05" frictionloss="{dry}"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body></body></worldbody>
<actuator>
  <position name="hip" joint="hip" kp="{kp}" kv="2" forcerange="-8 8" {hip}/>
  <position name="knee" joint="knee" kp="25" kv="1" delay="0.004" nsample="2" {knee}/>
</actuator></mujoco>
"""
_AS_IT_IS = {
    **{"step": 0.002, "integrator": "implicitfast", "gravity": -9.81},
    **{"damping": 0.1, "dry": 0.1, "mass": 1, "kp": 60, "hip": "", "knee": ""},
}
CHANNELS = tuple(
    Channel(joint=joint, signal=signal)
    for signal in ("position", "velocity", "effort")
    for joint in ("hip", "knee")
)


def arm_text(**changed: object) -> str:
    """Its MJCF, with other values of what is in braces above."""
    return _ARM.format(**{**_AS_IT_IS, **changed})


def arm(**changed: object) -> Robot:
    """The robot."""
    return robot_from_spec(mujoco.MjSpec.from_string(arm_text(**changed)), "arm.xml")
