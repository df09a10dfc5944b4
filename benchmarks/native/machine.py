"""The machine: MuJoCo itself at a quarter of a millisecond, with forces, delays and sensors added.

Unlike the rehearsal's hardware it has MuJoCo's own actuators, which are the law of this project's
models, but other friction: bristles (Canudas de Wit et al., IEEE Transactions on Automatic Control
40, 1995) or MuJoCo's own as dry as it goes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.native.robots import Robot
from walkerkit.gap import Recording

FloatArray = NDArray[np.float64]
Force = Callable[[float, float], float]  # of a joint's position and velocity

STEP = 2.5e-4  # s
_SETTLED = 1.0  # s at the first target of a servo
_SUBSTEPS = 4  # of bristles


class Bristles:
    """LuGre friction, with its bristles' deflection.

    Args:
        coulomb: at speed [N·m].
        breakaway: at rest [N·m].
        stribeck: velocity of the change between these [rad/s].
        stiffness: of the bristles [N·m/rad].
        damping: of the bristles [N·m·s/rad].
    """

    def __init__(
        self,
        coulomb: float,
        *,
        stiffness: float,
        damping: float,
        breakaway: float | None = None,
        stribeck: float = 1.0,
    ):
        self._coulomb, self._breakaway = coulomb, coulomb if breakaway is None else breakaway
        self._stribeck, self._stiffness, self._damping = stribeck, stiffness, damping
        self._deflection = 0.0

    def __call__(self, position: float, velocity: float) -> float:
        """The force after one more step."""
        more = (self._breakaway - self._coulomb) * np.exp(-((velocity / self._stribeck) ** 2))
        rate = 0.0
        for _ in range(_SUBSTEPS):
            bent = abs(velocity) * self._stiffness / (self._coulomb + more) * self._deflection
            rate = velocity - bent
            self._deflection += rate * STEP / _SUBSTEPS
        return -float(self._stiffness * self._deflection + self._damping * rate)


@dataclass(frozen=True, kw_only=True)
class Machine:
    """What the machine has that its model lacks.

    Attributes:
        change: writes to the compiled model of the machine.
        forces: joint to what makes a force on it; made anew for each experiment.
        delay: age of the targets at the drives [s].
        offset: joint to what its encoder shows too much [rad; m].
    """

    change: Callable[[mujoco.MjModel], None] | None = None
    forces: dict[str, Callable[[], Force]] | None = None
    delay: float = 0.0
    offset: dict[str, float] | None = None


def log(
    robot: Robot,
    machine: Machine,
    motions: dict[str, FloatArray],
    signals: Sequence[str],
    rng: np.random.Generator,
) -> list[Recording]:
    """What a machine's log shows of some motions.

    Args:
        robot: the robot.
        machine: what it has besides.
        motions: name to (T, n_joints) targets.
        signals: of each joint, beside its targets: `position`, `velocity`, `effort`.
        rng: noise.
    """
    model = mujoco.MjModel.from_xml_string(robot.xml)
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.dof_solref, model.dof_solimp[:, :2] = (2 * STEP, 1.0), 0.99
    if machine.change is not None:
        machine.change(model)
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return [_run(robot, machine, model, name, own, signals, rng) for name, own in motions.items()]


def _run(
    robot: Robot,
    machine: Machine,
    model: mujoco.MjModel,
    name: str,
    wanted: FloatArray,
    signals: Sequence[str],
    rng: np.random.Generator,
) -> Recording:
    data = mujoco.MjData(model)
    forces = {model.joint(j).id: make() for j, make in (machine.forces or {}).items()}
    late = round(machine.delay / STEP)
    underway = deque([wanted[0] if robot.targets != "effort" else 0 * wanted[0]] * (late + 1))

    def step(target: FloatArray) -> None:
        underway.append(target)
        underway.popleft()
        data.ctrl[:] = underway[0] * np.array(robot.ctrl)
        data.qfrc_applied[:] = 0
        for joint, force in forces.items():
            data.qfrc_applied[joint] = force(data.qpos[joint], data.qvel[joint])
        mujoco.mj_step(model, data)

    if robot.targets == "position":
        for _ in range(round(_SETTLED / STEP)):
            step(wanted[0])
    sent, q, qd, effort = (np.empty_like(wanted) for _ in range(4))
    for k, target in enumerate(wanted):
        sent[k], q[k], qd[k] = target, data.qpos, data.qvel
        if robot.targets == "effort":
            kp, kd = np.array(robot.gains)
            asked = kp * (target - data.qpos) - kd * data.qvel
            sent[k] = np.clip(asked, -robot.most, robot.most)
        step(sent[k])
        effort[k] = data.qfrc_actuator
        for _ in range(round(1 / robot.rate / STEP) - 1):
            step(sent[k])
    joints = [model.joint(j).name for j in range(model.njnt)]
    q += [(machine.offset or {}).get(joint, 0.0) for joint in joints]
    q += robot.noise * rng.standard_normal(q.shape)
    q = robot.quantum * np.round(q / robot.quantum)
    effort *= 1 + 0.01 * rng.standard_normal(q.shape)
    logged = {"position": q, "velocity": np.gradient(q, 1 / robot.rate, axis=0), "effort": effort}
    columns = {}
    for j, joint in enumerate(joints):
        columns[f"{joint}/{robot.targets}_target"] = sent[:, j]
        columns |= {f"{joint}/{signal}": logged[signal][:, j] for signal in signals}
    return Recording(name=name, time=np.arange(len(wanted)) / robot.rate, columns=columns)
