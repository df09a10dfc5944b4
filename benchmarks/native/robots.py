"""The models that the workflow gets, and how their robots are driven and logged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A model, and the motions that its robot is put through.

    Attributes:
        xml: the model.
        targets: the kind of the logged targets. Where it is effort, they are those of a PD loop
            around the machine.
        low, high: (n_joints,) between which the motions lie [rad; m; rad/s for velocities].
        rate: rows a second.
        quantum: step of the encoders [rad; m].
        noise: standard deviation of the positions besides [rad; m].
        ctrl: (n_joints,) control of the model's actuator for a target of 1.
        gains: (2, n_joints) of the PD loop; its efforts stay within `most`.
        most: N·m.
        pace: how many times faster than others the motions are.
    """

    xml: str
    targets: Literal["position", "velocity", "effort"]
    low: tuple[float, ...]
    high: tuple[float, ...]
    rate: float
    quantum: float = 2 * np.pi / 16384
    noise: float = 1e-4
    ctrl: tuple[float, ...] = ()
    gains: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    most: float = np.inf
    pace: float = 1.0

    def motions(self, seconds: float, rng: np.random.Generator) -> dict[str, FloatArray]:
        """(T, n_joints) targets by name: a multisine, triangles, a chirp and steps."""
        time = np.arange(round(seconds * self.rate))[:, None] / self.rate
        low, high = np.array(self.low), np.array(self.high)
        middle, half, joints = (low + high) / 2, (high - low) / 2, len(low)
        hertz = self.pace * rng.uniform(0.1, 0.8, (5, joints))
        phase = rng.uniform(0, 2 * np.pi, (5, joints))
        waves = 1.6 * np.sin(2 * np.pi * hertz * time[:, None] + phase).mean(axis=1)
        waves -= waves[0] * np.exp(-time)
        turns = time * self.pace * rng.uniform(0.1, 0.25, joints) + 0.25
        triangles = 2 * np.abs(2 * (turns - np.floor(turns + 0.5))) - 1
        to = 2.0 * self.pace  # Hz
        swept = np.sin(2 * np.pi * (0.1 * time + (to - 0.1) / (2 * seconds) * time**2))
        changes = np.cumsum(rng.uniform(0.6, 1.4, (round(2 * seconds), joints)), axis=0)
        levels = rng.uniform(-0.6, 0.6, (len(changes) + 1, joints))
        steps = np.stack(
            [levels[np.searchsorted(changes[:, k], time[:, 0]), k] for k in range(joints)], axis=1
        )
        shapes = {
            "multisine": np.clip(waves, -1, 1),
            "triangles": 0.8 * triangles,
            "chirp": 0.5 * swept * np.where(np.arange(joints) % 2, -1, 1),
            "steps": steps,
        }
        return {name: middle + half * shape for name, shape in shapes.items()}


LEG = Robot(
    xml="""<mujoco model="leg"><compiler angle="radian"/><option timestep="0.0025"/><worldbody>
  <body name="thigh" pos="0 0 1">
    <joint name="hip" axis="0 1 0" range="-1.5 1.5" armature="0.01" frictionloss="0.1"
      damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.04" mass="2.2"/>
    <body name="shank" pos="0 0 -0.35">
      <joint name="knee" axis="0 1 0" range="0 2.4" armature="0.01" frictionloss="0.1"
        damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.03" mass="0.9"/></body></body>
  </worldbody><actuator>
    <motor joint="hip" ctrlrange="-60 60"/><motor joint="knee" ctrlrange="-60 60"/>
  </actuator></mujoco>""",
    targets="effort",
    low=(-0.8, 0.4),
    high=(0.8, 1.8),
    rate=400.0,
    ctrl=(1.0, 1.0),
    gains=((120.0, 100.0), (4.0, 3.0)),
    most=55.0,
    pace=2.0,
)
"""Two joints under torque, simulated by long steps that are those of its control loop."""

WHEEL = Robot(
    xml="""<mujoco model="wheel"><option timestep="0.002" integrator="implicitfast"/><worldbody>
  <body name="wheel"><joint name="axle" axis="0 1 0" armature="0.002" damping="0.01"/>
    <geom type="cylinder" size="0.1 0.02" euler="90 0 0" mass="0.8" pos="0.01 0 0"/></body>
  </worldbody><actuator><velocity joint="axle" kv="0.6" forcerange="-2 2"/></actuator></mujoco>""",
    targets="velocity",
    low=(-8.0,),
    high=(8.0,),
    rate=200.0,
    ctrl=(1.0,),
)
"""A wheel that is a little out of balance, with a velocity servo."""

GANTRY = Robot(
    xml="""<mujoco model="gantry"><option timestep="0.002" integrator="implicitfast"/><worldbody>
  <body name="bridge"><joint name="x" type="slide" axis="1 0 0" range="-1 1" damping="8"/>
    <geom type="box" size="0.1 0.05 0.03" mass="4"/>
    <body name="column" pos="0 0 0.1">
      <joint name="z" type="slide" axis="0 0 1" range="-0.6 0.6" damping="5"/>
      <geom type="box" size="0.05 0.05 0.1" mass="1.5"/></body></body></worldbody><actuator>
    <position name="x" joint="x" kp="2500" kv="60" forcerange="-150 150"/>
    <general name="z" joint="z" gear="4" biastype="affine" gainprm="300" biasprm="0 -75 -8"
      ctrlrange="-1 1" ctrllimited="true" forcerange="-30 30"/></actuator></mujoco>""",
    targets="position",
    low=(-0.5, -0.3),
    high=(0.5, 0.3),
    rate=200.0,
    quantum=1e-5,
    noise=2e-5,
    ctrl=(1.0, 75 * 4 / 300),
)
"""Two slides, one of them through a gear, with a general actuator that is scaled affinely."""

ARM = Robot(
    xml="""<mujoco model="arm"><compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/><worldbody><body name="base" pos="0 0 1">
    <joint name="j1" axis="0 0 1" range="-2.9 2.9" armature="0.02" damping="0.3"/>
    <geom type="cylinder" size="0.06 0.06" mass="3"/>
    <body name="upper" pos="0 0 0.08">
      <joint name="j2" axis="0 1 0" range="-2 2" armature="0.02" damping="0.3"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.04" mass="3"/>
      <body name="fore" pos="0 0 0.3">
        <joint name="j3" axis="0 1 0" range="-2.5 2.5" armature="0.01" damping="0.2"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.25" size="0.03" mass="1.6"/>
        <body name="roll" pos="0 0 0.25">
          <joint name="j4" axis="0 0 1" range="-2.9 2.9" armature="0.003" damping="0.05"/>
          <geom type="capsule" fromto="0 0 0 0 0 0.06" size="0.025" mass="0.5"/>
          <body name="pitch" pos="0 0 0.06">
            <joint name="j5" axis="0 1 0" range="-2 2" armature="0.003" damping="0.05"/>
            <geom type="capsule" fromto="0 0 0 0 0 0.06" size="0.025" mass="0.4"/>
            <body name="hand" pos="0 0 0.06">
              <joint name="j6" axis="0 0 1" range="-2.9 2.9" armature="0.002" damping="0.03"/>
              <geom type="box" pos="0.02 0 0.03" size="0.04 0.02 0.03" mass="0.3"/>
            </body></body></body></body></body></body></worldbody><actuator>
    <position joint="j1" kp="400" kv="20" forcerange="-80 80"/>
    <position joint="j2" kp="600" kv="25" forcerange="-80 80"/>
    <position joint="j3" kp="300" kv="10" forcerange="-40 40"/>
    <position joint="j4" kp="60" kv="2" forcerange="-10 10"/>
    <position joint="j5" kp="60" kv="2" forcerange="-10 10"/>
    <position joint="j6" kp="30" kv="0.8" forcerange="-6 6"/></actuator></mujoco>""",
    targets="position",
    low=(-1.0, -0.8, -1.0, -1.0, -1.0, -1.0),
    high=(1.0, 0.8, 1.0, 1.0, 1.0, 1.0),
    rate=250.0,
    ctrl=(1.0,) * 6,
)
"""Six joints one after the other."""
