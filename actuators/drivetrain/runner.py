"""Drivetrain laws around the actuators of a robot, in one physics or in a batch.

    runner = LawRunner([StribeckFriction(joint_names_expr=(".*",), breakaway=0.3, velocity=0.05)])
    runner.initialize(group)     # after the group was initialized
    runner.reset()
    runner.apply(cmd)            # instead of group.apply(cmd), before every physics step

What the laws change of an effort goes to `qfrc_applied` of their joints, dry friction to
`dof_frictionloss`: both belong to the runner then. A dm_control physics with `legacy_step` (its
default) has collected its friction before the laws run, and takes theirs up one step later.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.actuator import rows_of
from walkerkit.actuators.command import ActuatorCmd
from walkerkit.actuators.drivetrain.bank import LawBank
from walkerkit.actuators.drivetrain.drivetrain_law import DrivetrainLaw, Step
from walkerkit.actuators.group import ActuatorGroup
from walkerkit.actuators.play_joint import play_joint
from walkerkit.actuators.selection import select

FloatArray = NDArray[np.float64]


class LawRunner:
    """Runs laws of the controller before the actuators, and those of drive and joint after them.

    Args:
        laws: the laws; one of a kind acts on a joint once.
    """

    def __init__(self, laws: Sequence[DrivetrainLaw]):
        self._laws = tuple(laws)
        self._group: ActuatorGroup | None = None
        self._dry_of: mujoco.MjModel | None = None

    def initialize(self, group: ActuatorGroup) -> None:
        """Finds the laws' joints in the compiled model; again after each compilation.

        Args:
            group: the robot's actuators, initialized.

        Raises:
            ValueError: an expression matches none of the group's joints, two laws of a kind claim
                one joint, or the actuator of a joint drives something else.
        """
        simulation, names = group.simulation, group.joint_names
        shape = (*simulation.batch_shape, len(names))
        parameters: dict[type[DrivetrainLaw], dict[str, FloatArray]] = {}
        claimed: set[tuple[type[DrivetrainLaw], int]] = set()
        for law in self._laws:
            kind = type(law)
            chosen = list(select(law.joint_names_expr, names))
            twice = next((i for i in chosen if (kind, i) in claimed), None)
            if twice is not None:
                raise ValueError(
                    f"joint {names[twice]!r} has {kind.name} twice: make one of the expressions "
                    "narrower"
                )
            claimed.update((kind, i) for i in chosen)
            of_law = parameters.setdefault(
                kind, {name: np.full(len(names), kind.neutral[name]) for name in kind.neutral}
            )
            for name, values in law.numbers(tuple(names[i] for i in chosen)).items():
                of_law[name][chosen] = values
        model = simulation.model
        self._bank = LawBank(list(parameters.items()), shape, float(model.opt.timestep))
        self._dofs = model.jnt_dofadr[group.joint_ids].astype(np.intp)
        self._qposes = model.jnt_qposadr[group.joint_ids].astype(np.intp)
        self._qpos, self._qvel = simulation.state("qpos"), simulation.state("qvel")
        self._applied = simulation.state("qfrc_applied")
        self._held = simulation.state("qfrc_constraint") if self._bank.reads_held else None
        self._plays = _plays(model, group) if self._bank.reads_play else []
        self._dry = simulation.parameter("dof_frictionloss")
        if self._dry_of is not model:
            self._own_dry = model.dof_frictionloss[self._dofs].copy()
            self._dry_of = model
        else:
            self.restore()
        self._time = np.zeros((*simulation.batch_shape, 1))
        self._changed = np.zeros(shape)
        self._stiffness, self._damping, self._limit = (
            _parameter(group, name, shape, missing)
            for name, missing in (("stiffness", 0.0), ("damping", 0.0), ("effort_limit", np.inf))
        )
        self._group = group

    def restore(self) -> None:
        """Gives the joints back the dry friction that they have without the laws.

        What randomizes it comes between this and `reset`.
        """
        self._dry[..., self._dofs] = self._own_dry

    def reset(self, env_ids: ArrayLike | None = None) -> None:
        """Forgets what happened, and takes up the present gains and, for all, dry friction.

        Args:
            env_ids: simulations of the batch; None for all.
        """
        group = self._started()
        rows = rows_of(env_ids, group.simulation.batch_shape)
        at = slice(None) if rows is None else rows
        self._bank.reset(rows)
        self._time[at] = 0.0
        if rows is None:
            self._own_dry = self._dry[..., self._dofs].copy()
        shape = (*group.simulation.batch_shape, len(group.joint_names))
        self._stiffness = _parameter(group, "stiffness", shape, 0.0)
        self._damping = _parameter(group, "damping", shape, 0.0)
        self._limit = _parameter(group, "effort_limit", shape, np.inf)

    def apply(self, cmd: ActuatorCmd) -> None:
        """Runs laws and actuators for the next physics step.

        Args:
            cmd: as in `ActuatorGroup.apply`.
        """
        group = self._started()
        q, qd = self._qpos[..., self._qposes], self._qvel[..., self._dofs]
        target = q.copy() if cmd.position_target is None else np.array(cmd.position_target)
        zeros = np.zeros_like(q)
        step = Step(
            dt=float(group.simulation.model.opt.timestep),
            time=self._time,
            q=q,
            qd=qd,
            stiffness=self._stiffness,
            damping=self._damping,
            limit=self._limit,
            target=target,
            effort=zeros,
            extra=zeros.copy(),
            friction=zeros.copy(),
            dry=self._own_dry,
            held=zeros if self._held is None else self._held[..., self._dofs],
            play=zeros.copy(),
            play_speed=zeros.copy(),
        )
        for column, qpos, dof in self._plays:
            step.play[..., column] = self._qpos[..., qpos]
            step.play_speed[..., column] = self._qvel[..., dof]
        if self._bank.has("controller") and cmd.position_target is not None:
            self._bank.run("controller", step)
            cmd = ActuatorCmd(
                position_target=step.target,
                velocity_target=cmd.velocity_target,
                effort_target=cmd.effort_target,
            )
        group.apply(cmd)
        made = group.applied_effort
        step.effort = made
        self._bank.run("drive", step)
        self._bank.run("joint", step)
        self._changed = step.effort - made
        self._applied[..., self._dofs] = self._changed + step.extra
        self._dry[..., self._dofs] = np.maximum(self._own_dry + step.friction, 0.0)
        self._time += step.dt

    @property
    def laws(self) -> tuple[DrivetrainLaw, ...]:
        """The laws."""
        return self._laws

    @property
    def changed_effort(self) -> FloatArray:
        """What laws changed of the effort that the drives report, in the last step [N·m; N]."""
        self._started()
        return self._changed.copy()

    def _started(self) -> ActuatorGroup:
        if self._group is None:
            raise RuntimeError("call initialize(group) after the actuators were initialized")
        return self._group


def _plays(model: mujoco.MjModel, group: ActuatorGroup) -> list[tuple[int, int, int]]:
    """Of what gives way behind the group's joints: the joint, and addresses in qpos and qvel."""
    found = []
    for column, joint in enumerate(group.joint_ids):
        play = play_joint(model, int(joint))
        if play is not None:
            found.append((column, int(model.jnt_qposadr[play]), int(model.jnt_dofadr[play])))
    return found


def _parameter(
    group: ActuatorGroup, name: str, shape: tuple[int, ...], missing: float
) -> FloatArray:
    values = np.full(shape, missing)
    columns = {joint: i for i, joint in enumerate(group.joint_names)}
    for actuator in group.actuators:
        if name in actuator.parameters:
            values[..., [columns[joint] for joint in actuator.joint_names]] = actuator.get(name)
    return values
