"""An arm of six joints whose model has servo gains a hundredth of the robot's, and no dry friction.

    python -m benchmarks arm             # four logs of 40 s at 50 Hz
    python -m benchmarks arm --quick     # four of 10 s

Files of arms are often shipped with gains that somebody chose so that they look calm. The robot is
simulated hardware, which shares no law with the workflow. Its diagnosis runs in a process of its
own, of which the kernel tells the most memory that was resident.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks import Row
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.tasks.excitation import BATTERY

FloatArray = NDArray[np.float64]

RATE: Final = 50.0
SECONDS, QUICK_SECONDS = 40.0, 10.0
SIGNALS: Final = ("multisine", "slow_triangle", "chirp", "steps")
SOFTER: Final = 100.0
"""By which the model's kp and kv are smaller than the robot's."""
DRY: Final = (3.0, 4.0, 2.5, 0.8, 0.8, 0.5)
"""Dry friction of the robot's joints [N·m]."""
LONGEST, LARGEST = 120.0, 1.0
"""Seconds of a diagnosis, and GiB."""

_SPEED = 1.0  # rad/s
_REACH = 1.2  # rad, to both sides
_ARM = """
<mujoco model="arm">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <geom type="capsule" contype="0" conaffinity="0"/>
    <joint range="-2.8 2.8" armature="0.2" damping="2"/>
  </default>
  <worldbody>
    <body name="shoulder" pos="0 0 0.16">
      <joint name="pan" axis="0 0 1"/> <geom size="0.06" fromto="0 0 -0.05 0 0 0.05" mass="3.7"/>
      <body name="upper_arm">
        <joint name="lift" axis="0 1 0"/> <geom size="0.06" fromto="0 0 0 0.42 0 0" mass="8.4"/>
        <body name="forearm" pos="0.42 0 0">
          <joint name="elbow" axis="0 1 0"/> <geom size="0.05" fromto="0 0 0 0.39 0 0" mass="2.3"/>
          <body name="wrist_1" pos="0.39 0.1 0">
            <joint name="flex" axis="0 1 0" armature="0.05" damping="0.5"/>
            <geom size="0.04" fromto="0 -0.04 0 0 0.04 0" mass="1.2"/>
            <body name="wrist_2" pos="0 0 -0.1">
              <joint name="turn" axis="0 0 1" armature="0.05" damping="0.5"/>
              <geom size="0.04" fromto="0 0 -0.04 0 0 0.04" mass="1.2"/>
              <body name="hand" pos="0.05 0 0">
                <joint name="roll" axis="1 0 0" armature="0.03" damping="0.3"/>
                <geom type="box" size="0.05 0.03 0.02" pos="0.05 0.02 0" mass="0.6"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
_KP, _KV = (4000, 6000, 4000, 800, 800, 400), (200, 300, 200, 30, 30, 15)
_DIAGNOSED = """
import json
from benchmarks.measured.memory import peak
from walkerkit import gap
found = gap.diagnose({model!r}, {logs!r}, n_threads=2).diagnosis
print(json.dumps(dict(
    seconds=found.seconds, gib=peak(helpers=1), before=found.gap.position.before,
    after=found.gap.position.after, named=[one.effect for one in found.effects],
    estimates=[
        [one.name, one.place, one.value, one.std] for e in found.effects for one in e.parameters
    ],
)))
"""


def write_arm(path: Path, *, softer: float = 1.0) -> Path:
    """Writes the arm's MJCF, with gains that many times smaller than the robot's."""
    spec = mujoco.MjSpec.from_string(_ARM)
    for joint, kp, kv in zip(spec.joints, _KP, _KV, strict=True):
        servo = spec.add_actuator(name=joint.name, target=joint.name)
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=kp / softer, kv=kv / softer)
    spec.compile()
    path.write_text(spec.to_xml())
    return path


def write_logs(folder: Path, *, seconds: float, seed: int = 0) -> list[Path]:
    """Runs the robot and writes what it logs.

    Args:
        folder: for the robot and its logs.
        seconds: of each log.
        seed: of targets and noise.

    Returns:
        Paths of the logs, an experiment each.
    """
    robot = write_arm(folder / "robot.xml")
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    room = np.full(len(DRY), _REACH)
    targets = [
        BATTERY[signal](time, lower=-room, upper=room, rng=rng, max_velocity=_SPEED)
        for signal in SIGNALS
    ]
    joints = [joint.name for joint in mujoco.MjSpec.from_file(str(robot)).joints]
    dry = HiddenEffect(
        effect="coulomb_friction",
        joints=tuple(joints),
        values={f"{joint}/frictionloss": value for joint, value in zip(joints, DRY, strict=True)},
    )
    found = []
    for recording in run_hardware(
        robot, targets, rate=RATE, hidden=[dry], seed=seed, names=SIGNALS
    ):
        path = folder / f"{recording.name}.csv"
        recording.save(path)
        found.append(path)
    return found


def run(*, quick: bool) -> list[Row]:
    """Writes the logs, diagnoses them and says what it took."""
    seconds = QUICK_SECONDS if quick else SECONDS
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        logs = write_logs(folder, seconds=seconds)
        model = write_arm(folder / "arm.xml", softer=SOFTER)
        code = _DIAGNOSED.format(model=str(model), logs=[str(log) for log in logs])
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
    told = json.loads(done.stdout.splitlines()[-1])
    for name, place, value, std in told["estimates"]:
        print(f"  {name} {place}: {value:.4g} ± {std or 0:.2g}")
    return [
        Row(
            what=f"an arm of 6 joints, gains / {SOFTER:g}, 4 × {seconds:g} s at {RATE:g} Hz",
            result=f"{told['seconds']:.0f} s, {told['gib']:.2f} GiB",
            required=f"<= {LONGEST:g} s, {LARGEST:g} GiB",
        ),
        Row(
            what="its held-out gap, and what is named",
            result=f"{1e3 * told['before']:.3g} to {1e3 * told['after']:.3g} mrad",
            reference=", ".join(told["named"]),
            required="position_gain and coulomb_friction first",
        ),
    ]
