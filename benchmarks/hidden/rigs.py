"""The robots on which effects are hidden: of 1, 3 and 12 joints in the air, and one that stands.

path = write_rig("leg", folder)                               # the model
real = write_rig("leg", folder, nuisance=rng)                 # its numbers a little off
other = write_rig("leg", folder, robot=7)                     # a robot with other numbers
targets = experiments("leg", path, seed=0)                    # name to (T, n_joints)
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.rehearsal.hardware_drive import load_rig
from walkerkit.gap.rehearsal.standing import standing_targets, write_standing
from walkerkit.tasks.excitation import BATTERY
from walkerkit.tasks.room import room_about
from walkerkit.walkers import LEG_XML
from walkerkit.walkers.gait import Trot
from walkerkit.walkers.quadruped import QUADRUPED_XML

FloatArray = NDArray[np.float64]

RATE: Final = 500.0
"""Samples a second, of the robots as they are."""
SECONDS: Final = 12.0
"""Of an experiment."""
NUISANCE: Final = 0.2
"""By how much of themselves armature, damping and frictionloss of a robot may be off."""
EXPERIMENTS: Final[Mapping[str, tuple[tuple[str, float], ...]]] = {
    "sweeps": (("chirp", 6.0), ("slow_triangle", 6.0)),
    "jumps": (("steps", 6.0), ("micro_sine_on_ramp", 6.0)),
    "mixture": (("multisine", 4.0), ("steps", 4.0), ("slow_triangle", 4.0)),
}
"""What is asked of the robots: excitations with their seconds; the last is held out."""
RATES: Final = (250.0, 500.0, 1000.0)
"""Samples a second, of robots with other numbers."""
HEAVIER: Final = (0.3, 5.0)
"""How much heavier, with stronger drives, a robot with other numbers may be."""
OTHERWISE: Final = (0.6, 1.8)
"""Factors on each joint's gains, armature, damping and frictionloss beyond that."""

_SPEED = 6.0  # rad/s
_HANG = 0.8  # m, of the quadruped's trunk over the floor that is not there
_GAINS = {"hip": (64.0, 1.0, 23.7), "thigh": (64.0, 1.0, 23.7), "calf": (143.0, 2.3, 35.55)}

_PENDULUM = """
<mujoco model="pendulum">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="shoulder" axis="0 1 0" range="-2 2" armature="0.008" damping="0.08"
             frictionloss="0.05"/>
      <inertial pos="0.01 0 -0.22" mass="1.1" diaginertia="0.012 0.012 0.001"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.02" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="35" kv="1.2" forcerange="-12 12"/>
  </actuator>
</mujoco>
"""


def _pendulum() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(_PENDULUM)


def _leg() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(LEG_XML))


def _hung() -> mujoco.MjSpec:
    """The quadruped with its trunk held and its feet in the air."""
    spec = mujoco.MjSpec.from_file(str(QUADRUPED_XML))
    home = np.array(spec.keys[0].qpos)[7:]
    spec.delete(spec.keys[0])
    spec.delete(spec.joint("root"))
    spec.body("trunk").pos = [0.0, 0.0, _HANG]
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for joint in spec.joints:
        kp, kv, limit = _GAINS[joint.name.rpartition("_")[2]]
        servo = spec.add_actuator(name=joint.name, target=joint.name)
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=kp, kv=kv)
        servo.forcelimited, servo.forcerange = True, [-limit, limit]
    spec.add_key(name="home", qpos=home, ctrl=home)
    return spec


def _standing() -> mujoco.MjSpec:
    with tempfile.TemporaryDirectory() as folder:
        return mujoco.MjSpec.from_file(str(write_standing(folder)))


RIGS: Final[Mapping[str, Callable[[], mujoco.MjSpec]]] = {
    "pendulum": _pendulum,
    "leg": _leg,
    "hung_quadruped": _hung,
    "standing_quadruped": _standing,
    "trotting_quadruped": _standing,
}
"""The robots by name."""
ON_FEET: Final = ("standing_quadruped", "trotting_quadruped")
"""Those of them that stand or walk, at `RATE` and with the numbers that they have."""


def write_rig(
    name: str,
    folder: Path,
    *,
    file: str = "model.xml",
    coarser: float = 1.0,
    integrator: mujoco.mjtIntegrator | None = None,
    nuisance: np.random.Generator | None = None,
    robot: int | None = None,
) -> Path:
    """Writes a robot's MJCF.

    Args:
        name: from `RIGS`.
        folder: where.
        file: name of the file.
        coarser: factor on its timestep.
        integrator: in place of its own.
        nuisance: draws factors on the armature, damping and frictionloss of each joint.
        robot: seed of a robot with other numbers; the robot as it is by default.

    Returns:
        Path of the file.
    """
    spec = RIGS[name]()
    if robot is not None:
        _renumber(spec, np.random.default_rng(robot))
    spec.compile()
    spec.option.timestep *= coarser
    if integrator is not None:
        spec.option.integrator = integrator
    if nuisance is not None:
        for joint in spec.joints:
            armature, damping, dry = 1.0 + nuisance.uniform(-NUISANCE, NUISANCE, 3)
            joint.armature *= armature
            joint.damping = damping * np.asarray(joint.damping)
            joint.frictionloss *= dry
    spec.compile()
    path = folder / file
    path.write_text(spec.to_xml())
    return path


def rate_of(rig: str, robot: int | None) -> float:
    """Samples a second of a robot's log; see `write_rig` for the robots."""
    if robot is None or rig in ON_FEET:
        return RATE
    return float(np.random.default_rng(robot).choice(RATES))


def reads_first(rig: str, robot: int | None) -> bool:
    """Whether a robot's log shows efforts as of before the targets beside them."""
    if robot is None or rig in ON_FEET:
        return False
    rng = np.random.default_rng((robot, 1))
    return bool(rng.integers(2))


def _renumber(spec: mujoco.MjSpec, rng: np.random.Generator) -> None:
    """Makes another robot of the same build: heavier or lighter, with drives to match."""
    weight = float(np.exp(rng.uniform(*np.log(HEAVIER))))

    def other() -> float:
        return weight * float(np.exp(rng.uniform(*np.log(OTHERWISE))))

    for body in spec.bodies:
        if body.explicitinertial:
            body.mass *= weight
            body.inertia = weight * np.asarray(body.inertia)
    for geom in spec.geoms:
        geom.mass *= weight  # NaN where its density says it
        geom.density *= weight
    for joint in spec.joints:
        joint.armature *= other()
        joint.damping = other() * np.asarray(joint.damping)
        joint.frictionloss *= other()
    for servo in spec.actuators:
        kp, kv = other(), other()
        servo.gainprm[0] *= kp
        servo.biasprm[1] *= kp
        servo.biasprm[2] *= kv
        servo.forcerange = weight * np.asarray(servo.forcerange)


def experiments(
    rig: str, path: Path, *, seed: int, shorter: float = 1.0, rate: float = RATE
) -> dict[str, FloatArray]:
    """Targets of the three experiments, around the robot's home pose.

    Args:
        rig: name of the robot.
        path: its MJCF.
        seed: of phases and levels.
        shorter: by which their time is divided.
        rate: samples a second; `RATE` for a robot that stands.

    Returns:
        Name to position targets, (T, n_joints) at `rate` [rad].
    """
    if rig == "standing_quadruped":
        return standing_targets(np.random.default_rng(seed), seconds=SECONDS / shorter)
    if rig == "trotting_quadruped":
        return _trots(np.random.default_rng(seed), SECONDS / shorter)
    model, drives = load_rig(path)
    home = model.key_qpos[0] if model.nkey else model.qpos0
    ids = model.dof_jntid[drives.dofs]
    ranges = np.where(model.jnt_limited[ids, None], model.jnt_range[ids], [-np.inf, np.inf])
    lower, upper = room_about(home[drives.qpos], ranges)
    rng = np.random.default_rng(seed)
    return {
        name: np.concatenate(
            [
                BATTERY[signal](
                    np.arange(round(seconds / shorter * rate)) / rate,
                    lower=lower,
                    upper=upper,
                    rng=rng,
                    max_velocity=_SPEED,
                )
                for signal, seconds in parts
            ]
        )
        for name, parts in EXPERIMENTS.items()
    }


def _trots(rng: np.random.Generator, seconds: float) -> dict[str, FloatArray]:
    """Three trots, forward, backward and almost on the spot, from standing [rad]."""
    time = np.arange(round(seconds * RATE)) / RATE
    strides = {"forward": 0.12, "backward": -0.08, "on_the_spot": 0.02}
    return {
        name: Trot(
            stride=stride * rng.uniform(0.7, 1.0),
            frequency=rng.uniform(2.0, 2.8),
            lift=rng.uniform(0.04, 0.07),
        )(np.maximum(time - 1.0, 0.0))
        for name, stride in strides.items()
    }
