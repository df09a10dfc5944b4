"""The simulated robot at work: all its parts, stepped together, and what they leave behind.

ran = run(model, drives, hidden, sent, start=lead, stride=stride, seeds=seeds)
ran.position, ran.effort                # (n_steps, n_experiments, n_joints)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drive import SCALAR_JOINTS
from walkerkit.gap.rehearsal.hardware_base import WIDTH, free_joint, home
from walkerkit.gap.rehearsal.hardware_companion import Companion
from walkerkit.gap.rehearsal.hardware_controller import Controller
from walkerkit.gap.rehearsal.hardware_drive import Drives
from walkerkit.gap.rehearsal.hardware_friction import Friction
from walkerkit.gap.rehearsal.hardware_ground import Soil
from walkerkit.gap.rehearsal.hardware_motor import Motor
from walkerkit.gap.rehearsal.hardware_mount import HINGES, Stand
from walkerkit.gap.rehearsal.hardware_transmission import Stops, Transmission
from walkerkit.gap.rehearsal.hardware_troubles import Troubles
from walkerkit.gap.rehearsal.hidden import HiddenEffect

Array = NDArray[np.float64]

SETTLE: Final = 1.5
"""How long the robot holds the first target before the log begins, s."""

_STIFF = 0.5  # b h/I of a damping that explicit steps no longer follow; at 2 they diverge
_LOST = 1e4  # rad/s: no joint of a walking robot comes back from there
_LOOK = 64  # steps from one look for it to the next


@dataclass(frozen=True, kw_only=True, eq=False)
class Ran:
    """What a run leaves behind, at each step: arrays are (n_steps, n_experiments, …).

    Attributes:
        position, speed: of each joint as its encoder reads it [rad; rad/s].
        effort: of each joint as its drive reports it [N·m].
        base: state of a base that floats, 13 numbers, or none.
        swung: positions and speeds of the joints that nothing drives.
        told: the computer beside the robot, where there is one.
        feet: their names.
        loads: what the ground pushes each foot up with [N].
    """

    position: Array
    speed: Array
    effort: Array
    base: Array
    swung: Array
    told: Companion | None
    feet: tuple[str, ...]
    loads: Array


def run(
    model: mujoco.MjModel,
    drives: Drives,
    hidden: Sequence[HiddenEffect],
    sent: Array,
    *,
    start: int,
    stride: int,
    seeds: Sequence[Sequence[int]],
) -> Ran:
    """Steps all experiments together.

    Args:
        model: the bare rigid bodies; rotors are taken out of it.
        drives: what moves them.
        hidden: what drives and bodies do not say.
        sent: where the joints should be, shape (n_steps, n_experiments, n_joints), rad.
        start: the step at which the log begins.
        stride: steps from one row of the log to the next.
        seeds: of each experiment.

    Raises:
        RuntimeError: the robot went unstable.
    """
    step, n_sims = float(model.opt.timestep), sent.shape[1]
    controller = Controller(drives, hidden, step=step, n_sims=n_sims)
    told = None
    if set(drives.kinds) != {"position"}:
        told = Companion(drives, hidden, step=step, start=start, stride=stride, shape=sent.shape)
    robot = _Robot(model, drives, hidden, sent, start=start, seeds=seeds)
    for k, target in enumerate(controller.arriving(sent, start=start)):
        robot.read(k)
        if told is not None:
            target = told.arrived(k, sent[k], robot.position[k], robot.speed[k])
        robot.move(k, controller.asked(target, robot.position[k], robot.speed[k]))
        if k % _LOOK == 0 or k == len(sent) - 1:
            robot.check(k)
    return robot.ran(told)


class _Robot:
    """The robot but for its controller, in all experiments.

    Attributes:
        position, speed: (n_steps, n_experiments, n_joints) as the encoders read them so far.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        drives: Drives,
        hidden: Sequence[HiddenEffect],
        sent: Array,
        *,
        start: int,
        seeds: Sequence[Sequence[int]],
    ) -> None:
        self._drives, self._step = drives, float(model.opt.timestep)
        step, n_sims = self._step, sent.shape[1]
        self._motor = Motor(drives, hidden, step=step, start=start)
        self._friction = Friction(model, drives, hidden, step=step, n_sims=n_sims)
        self._stops = Stops(model, drives, hidden)
        self._troubles = Troubles(drives, hidden, step=step, n_steps=len(sent), seeds=seeds)
        self._transmission = Transmission(model, drives, hidden, step=step, n_sims=n_sims)
        self._stand = Stand(model, hidden)
        self._soil = soil = Soil(model, hidden, step=step, n_sims=n_sims)
        _follow_damping(model, drives, step)
        # Only a persistent batch goes on from the velocities that the ground asks for.
        self._batch = batch = mujoco.batch.Batch(model, n_sims, nthread=1, persistent=soil.any)
        self._stage = mujoco.mjtStage.mjSTAGE_VEL if soil.any else mujoco.mjtStage.mjSTAGE_NONE
        self._qpos, self._qvel = batch.bind("qpos"), batch.bind("qvel")
        self._applied = batch.bind("qfrc_applied")
        self._qpos[:] = home(model)
        ranges = np.where(model.jnt_limited[:, None], model.jnt_range, [-np.inf, np.inf])
        lower, upper = ranges[model.dof_jntid[drives.dofs]].T
        first = (sent[0] - drives.offset) / drives.slope
        self._qpos[:, drives.qpos] = np.clip(first, lower, upper)
        self.position, self.speed, self._effort = np.empty((3, *sent.shape))
        self._free, swinging = free_joint(model), passive(model, drives)
        self._base = np.empty((*sent.shape[:2], 0 if self._free is None else WIDTH))
        self._loads = np.zeros((*sent.shape[:2], len(soil.names)))
        self._at, self._its_dofs = model.jnt_qposadr[swinging], model.jnt_dofadr[swinging]
        self._swung = np.empty((*sent.shape[:2], 2 * len(swinging)))
        self._q = self._angle = self.position[0]
        self._qd = self._rate = self.speed[0]
        if soil.any:
            soil.watch(batch)

    def read(self, k: int) -> None:
        """Reads the sensors at step k."""
        qpos, qvel, drives = self._qpos, self._qvel, self._drives
        self._q, self._qd = qpos[:, drives.qpos], qvel[:, drives.dofs]
        self._angle, self._rate = self._transmission.motor_side(self._q, self._qd)
        self.position[k], self.speed[k] = drives.read(self._angle, self._rate)
        self._swung[k] = np.hstack([qpos[:, self._at], qvel[:, self._its_dofs]])
        if self._free is not None:
            self._base[k, :, :7] = qpos[:, self._free[0] : self._free[0] + 7]
            self._base[k, :, 7:] = qvel[:, self._free[1] : self._free[1] + 6]

    def move(self, k: int, asked: Array) -> None:
        """Takes step k, of which the sensors have been read, with these efforts asked for."""
        qpos, qvel, applied, drives = self._qpos, self._qvel, self._applied, self._drives
        q, qd, angle, rate = self._q, self._qd, self._angle, self._rate
        self._effort[k] = self._motor.made(asked, rate)
        shaft = self._motor.delivered(self._effort[k], angle)
        if self._transmission.any:
            # The losses of a drive with a rotor are before its teeth.
            turning = qvel.copy()
            turning[:, drives.dofs] = rate
            applied[:] = self._friction.effort(turning, angle, shaft)
        else:
            applied[:] = self._friction.effort(qvel, q, shaft)
        made = shaft + applied[:, drives.dofs]
        load = self._transmission.link_effort(made, q, qd) + drives.springs(q)
        if self._stops.any:
            load += self._stops.effort(q, qd)
        if self._troubles.any:
            load += self._troubles.effort(k, q)
        applied[:, drives.dofs] = load
        if self._stand.any:
            applied[:, self._stand.dofs] += self._stand.effort(qpos, qvel)
        if self._soil.any:
            self._soil.push(self._batch)
            self._loads[k] = self._soil.carried
        self._batch.step(stage=self._stage)

    def check(self, k: int) -> None:
        """Raises RuntimeError where the robot went unstable before step k was done."""
        lost = ~(np.abs(self._qvel).max(axis=1) < _LOST)
        if lost.any():
            raise RuntimeError(
                f"experiment {int(np.argmax(lost))} went unstable before "
                f"{k * self._step - SETTLE:.3f} s after its start; soften the model's gains, hide "
                "less, or raise substeps"
            )

    def ran(self, told: Companion | None) -> Ran:
        """What it leaves behind, with the computer beside it."""
        return Ran(
            position=self.position,
            speed=self.speed,
            effort=self._effort,
            base=self._base,
            swung=self._swung,
            told=told,
            feet=self._soil.names,
            loads=self._loads,
        )


def passive(model: mujoco.MjModel, drives: Drives) -> list[int]:
    """Joints that swing by themselves and have encoders; those of loops and stands have none."""
    return [
        joint
        for joint in range(model.njnt)
        if model.jnt_type[joint] in SCALAR_JOINTS
        and model.joint(joint).name
        and model.joint(joint).name not in (*drives.joints, *HINGES)
        and not model.neq
    ]


def _follow_damping(model: mujoco.MjModel, drives: Drives, step: float) -> None:
    """Lets light joints with much damping be stepped, as MuJoCo's own damping is.

    All efforts here are explicit, f(v): I (v' − v) = h f(v). Where a damping b stops a joint within
    a step or so, that diverges. As of MuJoCo's own damping, it is then (I + h b)(v' − v) = h f(v),
    which is as exact for all that is slower. It takes an armature of h b, of the bodies alone.
    """
    drag = drives.damping[0].copy()
    drag[drives.dofs] += np.maximum(-drives.bias[2], 0.0)
    stiff = drag * step * model.dof_invweight0 > _STIFF
    model.dof_armature[stiff] += step * drag[stiff]
