"""A joint that a position servo holds, as MJCF, and logs of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.tasks.excitation import BATTERY

SERVO = """
<mujoco model="servo">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="knee" axis="0 1 0" armature="0.005" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
    </body>
  </worldbody>
  <actuator><position joint="knee" kp="30" kv="1"/></actuator>
</mujoco>
"""

RATE, SECONDS = 250.0, 3.0


def recorded(model: Path, *hidden: HiddenEffect) -> list[Recording]:
    """Three motions of simulated hardware with something hidden."""
    time = np.arange(0.0, SECONDS, 1 / RATE)
    rng, room = np.random.default_rng(0), np.array([0.9])
    targets = [
        BATTERY[name](time, lower=-room, upper=room, rng=rng, max_velocity=6.0)
        for name in ("multisine", "slow_triangle", "chirp")
    ]
    return run_hardware(model, targets, rate=RATE, hidden=hidden, seed=1)
