"""Small robots for the tests of the tasks: a stool on three legs, and a pendulum on a bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from walkerkit.actuators import IdealPdActuatorCfg
from walkerkit.walkers import MjcfWalker

# Its home is neither the reference pose nor at the height that its feet ask for.
STOOL = """
<mujoco model="stool">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002"/>
  <worldbody>
    <body name="seat" pos="0 0 0.5">
      <freejoint/>
      <geom name="seat" type="box" size="0.12 0.12 0.03" mass="3"/>
      <body name="front" pos="0.1 0 -0.02">
        <joint name="front" axis="0 -1 0" range="-0.6 0.9" armature="0.01"/>
        <geom name="front" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.25"/>
        <body name="toe" pos="0 0 -0.3"><geom name="toe" size="0.02" mass="0.05"/></body>
      </body>
      <body name="left" pos="-0.1 0.1 -0.02">
        <joint name="left" axis="-1 0 0" range="-0.6 0.9" armature="0.01"/>
        <geom name="left" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.3"/>
      </body>
      <body name="right" pos="-0.1 -0.1 -0.02">
        <joint name="right" axis="1 0 0" range="-0.6 0.9" armature="0.01"/>
        <geom name="right" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <keyframe><key name="home" qpos="0 0 0.5 1 0 0 0 0.2 0.2 0.2"/></keyframe>
</mujoco>
"""
PENDULUM = """
<mujoco model="pendulum">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="bench" pos="0 0 0.8">
      <geom name="bench" size="0.05" mass="1" contype="0" conaffinity="0"/>
      <body name="arm">
        <joint name="shoulder" axis="0 1 0" range="-2 1" armature="0.01" damping="0.05"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4" contype="0"
          conaffinity="0"/>
        <body name="hand" pos="0 0 -0.2">
          <joint name="wrist" axis="0 1 0" armature="0.005" damping="0.05"/>
          <geom size="0.03" mass="0.1" contype="0" conaffinity="0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="40" kv="2" forcerange="-15 15"/>
    <motor name="wrist" joint="wrist" gear="2" ctrlrange="-1 1"/>
  </actuator>
  <keyframe><key name="home" qpos="-0.5 0.1"/></keyframe>
</mujoco>
"""
PD = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=60.0, damping=1.5, effort_limit=20.0)


def stool(folder: Path, actuators: Any = PD, **options: Any) -> MjcfWalker:
    """A floating robot of 3.9 kg that stands at home."""
    return _walker(folder, STOOL, actuators, options)


def pendulum(folder: Path, actuators: Any, **options: Any) -> MjcfWalker:
    """Two joints on a fixed base: a position servo and a motor."""
    return _walker(folder, PENDULUM, actuators, options)


def _walker(folder: Path, text: str, actuators: Any, options: dict[str, Any]) -> MjcfWalker:
    path = folder / "robot.xml"
    path.write_text(text, encoding="utf-8")
    return MjcfWalker.from_file(path, actuators, **options)
