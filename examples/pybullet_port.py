"""A robot that moved from PyBullet to MuJoCo: what its PyBullet environment adds in silence.

    pip install 'walkerkit[pybullet]'
    python examples/pybullet_port.py [OUT]

A log from another simulator is a log. The same leg is written as URDF and as MJCF, masses, inertias
and axes alike; PyBullet runs the URDF under a PD controller and logs it, and the logs are diagnosed
against the MJCF. Twice:

- `as_described`: PyBullet does what the URDF says and nothing more. Nothing is missing.
- `with_motors`: velocity motors hold thigh and knee back. They are how PyBullet's environments make
  dry friction, since PyBullet does not apply that of a URDF; so it is in an environment's code (as
  `SetJointFriction` of the Minitaur that comes with it) and in no file that a converter sees.

Three of PyBullet's defaults have to be undone before the two simulators agree, see `load`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pybullet
from _arguments import argument

from walkerkit import gap
from walkerkit.tasks.excitation import BATTERY

STEP = 0.001
"""Physics step of both simulators [s]."""
ROW = 2
"""Physics steps from one row of the log to the next, over which a target is held."""
REST = 1.0
"""Time at the first target before the log begins [s]."""
EXPERIMENTS = ("chirp", "slow_triangle", "steps")
FRICTION = {"thigh": 0.25, "knee": 0.4}
"""Largest torque of the velocity motors [N·m]."""
STIFFNESS, DAMPING = 40.0, 1.0
"""Gains of the controller [N·m/rad, N·m·s/rad]."""


@dataclass(frozen=True, kw_only=True)
class Link:
    """A link with the joint that carries it; lengths in m, in the frame of its parent or its own.

    Attributes:
        joint: name of the joint, at the link's origin.
        axis: of the joint.
        origin: where the link's frame is in its parent's.
        mass: [kg].
        com: centre of mass.
        inertia: principal moments about the centre of mass, along the frame's axes [kg·m²].
        targets: lowest and highest target of the joint [rad].
    """

    joint: str
    axis: tuple[int, int, int]
    origin: tuple[float, float, float]
    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float]
    targets: tuple[float, float]


LEG = (
    Link(
        joint="hip",
        axis=(1, 0, 0),
        origin=(0.0, 0.0, 0.0),
        mass=0.7,
        com=(0.0, 0.05, 0.0),
        inertia=(0.002, 0.001, 0.002),
        targets=(-0.5, 0.5),
    ),
    Link(
        joint="thigh",
        axis=(0, 1, 0),
        origin=(0.0, 0.08, 0.0),
        mass=1.0,
        com=(0.0, 0.0, -0.08),
        inertia=(0.006, 0.006, 0.001),
        targets=(-0.2, 1.2),
    ),
    Link(
        joint="knee",
        axis=(0, 1, 0),
        origin=(0.0, 0.0, -0.2),
        mass=0.4,
        com=(0.0, 0.0, -0.09),
        inertia=(0.002, 0.002, 0.0002),
        targets=(-1.8, -0.4),
    ),
)
JOINTS = tuple(link.joint for link in LEG)


def urdf(links: Sequence[Link] = LEG) -> str:
    """The leg as URDF, hung from a base of no mass."""
    # PyBullet warns of links without an inertial.
    none = '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'
    base = f'  <link name="base"><inertial><mass value="0"/>{none}</inertial></link>'
    parts = ['<robot name="leg">', base]
    parent = "base"
    for link in links:
        ixx, iyy, izz = link.inertia
        parts.append(
            f"""  <link name="{link.joint}_link">
    <inertial>
      <origin xyz="{_text(link.com)}"/>
      <mass value="{link.mass}"/>
      <inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="{link.joint}" type="continuous">
    <parent link="{parent}"/>
    <child link="{link.joint}_link"/>
    <origin xyz="{_text(link.origin)}"/>
    <axis xyz="{_text(link.axis)}"/>
  </joint>"""
        )
        parent = f"{link.joint}_link"
    return "\n".join([*parts, "</robot>", ""])


def mjcf(links: Sequence[Link] = LEG) -> str:
    """The leg as MJCF, with the controller as position actuators."""
    bodies = "".join(
        f"""
<body name="{link.joint}_link" pos="{_text(link.origin)}">
  <inertial pos="{_text(link.com)}" mass="{link.mass}" diaginertia="{_text(link.inertia)}"/>
  <joint name="{link.joint}" axis="{_text(link.axis)}"/>"""
        for link in links
    )
    actuators = "\n".join(
        f'  <position name="{link.joint}" joint="{link.joint}" kp="{STIFFNESS}" kv="{DAMPING}"/>'
        for link in links
    )
    return f"""<mujoco model="leg">
<compiler angle="radian"/>
<option timestep="{STEP}" integrator="Euler"/>
<worldbody>{bodies}
{"</body>" * len(links)}
</worldbody>
<actuator>
{actuators}
</actuator>
</mujoco>
"""


def load(path: Path, friction: Mapping[str, float], client: int) -> tuple[int, list[int]]:
    """Loads the leg so that PyBullet does what the file says, plus the given friction.

    Returns:
        PyBullet's number of the robot, and those of JOINTS.
    """
    pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
    pybullet.setTimeStep(STEP, physicsClientId=client)
    # Without the flag the inertias are those of the collision shapes at the file's masses.
    flags = pybullet.URDF_USE_INERTIA_FROM_FILE
    robot = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
    # 0.04 each by default: a drag on every link, whatever its joint.
    pybullet.changeDynamics(robot, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    found = {
        pybullet.getJointInfo(robot, joint, physicsClientId=client)[1].decode(): joint
        for joint in range(pybullet.getNumJoints(robot, physicsClientId=client))
    }
    numbers = [found[joint] for joint in JOINTS]
    # By default a motor holds every joint at rest with 1 N·m·s a step, 1000 N·m at this one.
    pybullet.setJointMotorControlArray(
        robot,
        numbers,
        pybullet.VELOCITY_CONTROL,
        targetVelocities=[0.0] * len(numbers),
        forces=[friction.get(joint, 0.0) for joint in JOINTS],
        physicsClientId=client,
    )
    return robot, numbers


def simulate(
    path: Path, name: str, targets: np.ndarray, friction: Mapping[str, float]
) -> gap.Recording:
    """Sends targets to the leg in PyBullet.

    Args:
        path: the leg as URDF.
        name: the recording's name.
        targets: shape (T, 3), one row each ROW physics steps [rad].
        friction: largest torque of the velocity motors by joint [N·m].

    Returns:
        The log, whose effort is what the controller asked for.
    """
    client = pybullet.connect(pybullet.DIRECT)
    try:
        robot, numbers = load(path, friction, client)
        for number, start in zip(numbers, targets[0], strict=True):
            pybullet.resetJointState(robot, number, start, physicsClientId=client)
        rows = []
        resting = round(REST / (ROW * STEP))
        for target in np.concatenate([np.tile(targets[0], (resting, 1)), targets]):
            for substep in range(ROW):
                states = pybullet.getJointStates(robot, numbers, physicsClientId=client)
                position = np.array([state[0] for state in states])
                velocity = np.array([state[1] for state in states])
                effort = STIFFNESS * (target - position) - DAMPING * velocity
                if substep == 0:
                    rows.append((position, velocity, effort, target))
                pybullet.setJointMotorControlArray(
                    robot,
                    numbers,
                    pybullet.TORQUE_CONTROL,
                    forces=effort.tolist(),
                    physicsClientId=client,
                )
                pybullet.stepSimulation(physicsClientId=client)
    finally:
        pybullet.disconnect(client)
    log = np.array(rows[resting:])
    return gap.Recording(
        name=name,
        time=np.arange(len(log)) * ROW * STEP,
        columns={
            f"{joint}/{signal}": log[:, i, j]
            for j, joint in enumerate(JOINTS)
            for i, signal in enumerate(("position", "velocity", "effort", "position_target"))
        },
    )


def record(
    path: Path, friction: Mapping[str, float], seconds: float = 4.0, seed: int = 0
) -> list[gap.Recording]:
    """The experiments, each of so many seconds."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, ROW * STEP)
    lower, upper = np.array([link.targets for link in LEG]).T
    return [
        simulate(
            path,
            name,
            BATTERY[name](time, lower=lower, upper=upper, rng=rng, max_velocity=6.0),
            friction,
        )
        for name in EXPERIMENTS
    ]


def diagnose(
    out: Path, friction: Mapping[str, float], seconds: float = 4.0, effects: Sequence[str] = ()
) -> gap.Result:
    """Writes both robots, records the one in PyBullet and diagnoses the logs against the other.

    Args:
        out: folder for both files and for the result.
        friction: largest torque of the velocity motors by joint [N·m].
        seconds: length of each experiment.
        effects: what to consider; the whole catalogue where none is given.
    """
    out.mkdir(parents=True, exist_ok=True)
    (out / "leg.urdf").write_text(urdf(), encoding="utf-8")
    (out / "leg.xml").write_text(mjcf(), encoding="utf-8")
    recordings = record(out / "leg.urdf", friction, seconds)
    result = gap.diagnose(out / "leg.xml", recordings, effects=effects or None)
    result.save(out / "diagnosis")
    return result


def main(out: Path) -> None:
    """Diagnoses both, and prints what was found."""
    for run, friction in (("as_described", {}), ("with_motors", FRICTION)):
        print(f"{run}\n{'=' * len(run)}\n{diagnose(out / run, friction)}\n", flush=True)


def _text(numbers: Sequence[float]) -> str:
    return " ".join(str(number) for number in numbers)


if __name__ == "__main__":
    main(argument(__doc__, "OUT", Path("pybullet-port")))
