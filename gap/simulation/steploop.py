"""Simulations in lock step with laws that MuJoCo does not have, run before each of their steps.

The model's own drives still make the effort, so that MuJoCo integrates their damping as it always
does; what the laws change of it is applied to the joint beside them. `DriveForces` says what a
drive is about to make.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drive import Drive
from walkerkit.actuators.drivetrain import LAWS, DrivetrainLaw, LawBank, Step
from walkerkit.gap.simulation.robot import Joint
from walkerkit.gap.simulation.trials import Trials
from walkerkit.walkers.batch import LockStep, Rollout

FloatArray = NDArray[np.float64]

DRIVE_FIELDS = (
    "actuator_gear",
    "actuator_gainprm",
    "actuator_biastype",
    "actuator_biasprm",
    "actuator_forcelimited",
    "actuator_forcerange",
)
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)


class DriveForces:
    """Efforts of the affine drives of some joints, in many simulations at once.

    Args:
        model: the model.
        joints: the joints, each with one drive at most that follows a target (the first).
        fields: model fields of which each simulation has its own, (n_sims, *shape).
        n_sims: number of simulations.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        joints: Sequence[Joint],
        fields: Mapping[str, NDArray[Any]],
        n_sims: int,
    ):
        self.columns = np.array([k for k, joint in enumerate(joints) if joint.drives], dtype=int)
        drives: list[Drive] = [joint.drives[0] for joint in joints if joint.drives]
        ids = [drive.actuator for drive in drives]
        outputs = model.actuator_outadr[ids]
        self.ctrl = np.array([drive.ctrl for drive in drives], dtype=int)
        self.slope = np.array([drive.slope for drive in drives])
        self.offset = np.array([drive.offset for drive in drives])
        self.positions = np.array([drive.kind == "position" for drive in drives])

        def field(name: str) -> FloatArray:
            own = fields.get(name)
            if own is None:
                own = np.asarray(getattr(model, name))[None]
            return np.asarray(own, dtype=np.float64)

        self._gear = field("actuator_gear")[:, outputs, 0]
        self._gain = field("actuator_gainprm")[:, ids, 0]
        affine = field("actuator_biastype")[:, ids, None] == _AFFINE
        self._bias = np.where(affine, field("actuator_biasprm")[:, ids, :3], 0.0)
        limited = field("actuator_forcelimited")[:, ids, None] != 0
        self._limits = np.where(limited, field("actuator_forcerange")[:, ids], [-np.inf, np.inf])
        controlled = model.actuator_ctrllimited[self.ctrl].astype(bool)[:, None]
        self._ctrl_limits = np.where(
            controlled, model.actuator_ctrlrange[self.ctrl], [[-np.inf, np.inf]]
        )
        shape = (n_sims, len(joints))
        self.stiffness, self.damping = np.zeros(shape), np.zeros(shape)
        self.limit = np.full(shape, np.inf)
        at = self.columns
        self.stiffness[:, at] = -self._bias[..., 1] * self._gear**2
        self.damping[:, at] = -self._bias[..., 2] * self._gear**2
        self.limit[:, at] = self._limits[..., 1] * np.abs(self._gear)

    def effort(self, ctrl: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Effort of each joint's drive, (n_sims, n_joints).

        Args:
            ctrl: (n_sims, n_drives) controls.
            q: (n_sims, n_joints) positions [rad; m].
            qd: (n_sims, n_joints) velocities [rad/s; m/s].
        """
        at = self.columns
        control = np.clip(ctrl, self._ctrl_limits[:, 0], self._ctrl_limits[:, 1])
        length, speed = self._gear * q[:, at], self._gear * qd[:, at]
        force = self._gain * control + self._bias[..., 0]
        force += self._bias[..., 1] * length + self._bias[..., 2] * speed
        total = np.zeros_like(q)
        total[:, at] = self._gear * np.clip(force, self._limits[..., 0], self._limits[..., 1])
        return total


def law_arguments(
    model: mujoco.MjModel,
    joints: Sequence[Joint],
    fields: Mapping[str, NDArray[Any]],
    trials: Trials,
    n_segments: int,
) -> dict[str, Any]:
    """The drives and the laws of all segments of all variants, for `rollout_with_laws`."""
    n_sims, names = trials.n * n_segments, [joint.name for joint in joints]
    repeated = {
        name: np.repeat(values, n_segments, axis=0)
        for name, values in fields.items()
        if name in DRIVE_FIELDS
    }
    parameters: dict[type[DrivetrainLaw], dict[str, FloatArray]] = {}
    for (law, joint, name), values in trials.laws.items():
        if joint in names:
            of_law = parameters.setdefault(
                law, {p: np.full((n_sims, len(joints)), law.neutral[p]) for p in law.neutral}
            )
            of_law[name][:, names.index(joint)] = np.repeat(values, n_segments)
    return {
        "forces": DriveForces(model, joints, repeated, n_sims),
        "bank": LawBank(
            [(law, parameters[law]) for law in LAWS.values() if law in parameters],
            (n_sims, len(joints)),
        ),
    }


def rollout_with_laws(
    batch: LockStep,
    state: FloatArray,
    *,
    ctrl: FloatArray,
    qfrc_applied: FloatArray | None,
    record: Sequence[str],
    joints: Sequence[Joint],
    forces: DriveForces,
    bank: LawBank,
) -> tuple[Rollout, FloatArray]:
    """As `LockStep.rollout`, with laws before each step.

    Args:
        batch: the simulations.
        state: (n_sims, nstate) where they start.
        ctrl: (n_sims, n_steps, nu) controls as the drives receive them.
        qfrc_applied: (n_sims, n_steps, nv) effort applied beside them, or None.
        record: fields to keep after every step.
        joints: the joints that the laws act on.
        forces: their drives.
        bank: the laws.

    Returns:
        What was recorded, and (n_sims, n_steps, n_joints) what the laws changed of the effort that
        the drives report.
    """
    qposes, dofs = [joint.qpos for joint in joints], [joint.dof for joint in joints]
    n_sims, n_steps = ctrl.shape[:2]
    changed = np.zeros((n_sims, n_steps, len(joints)))
    dry = batch.parameter("dof_frictionloss")
    own_dry = dry[:, dofs].copy()
    dt = float(batch.model.opt.timestep)
    zeros = np.zeros((n_sims, len(joints)))

    def before(k: int, qpos: FloatArray, qvel: FloatArray, now: FloatArray) -> FloatArray:
        q, qd = qpos[:, qposes], qvel[:, dofs]
        target = zeros.copy()
        target[:, forces.columns] = (ctrl[:, k, forces.ctrl] - forces.offset) / forces.slope
        step = Step(
            dt=dt,
            time=np.full((n_sims, 1), k * dt),
            q=q,
            qd=qd,
            stiffness=forces.stiffness,
            damping=forces.damping,
            limit=forces.limit,
            target=target,
            effort=zeros,
            extra=zeros.copy(),
            friction=zeros.copy(),
        )
        bank.run("controller", step)
        now[...] = ctrl[:, k]
        control = forces.slope * step.target[:, forces.columns] + forces.offset
        now[:, forces.ctrl] = control
        made = forces.effort(control, q, qd)
        step.effort = made
        bank.run("drive", step)
        bank.run("joint", step)
        changed[:, k] = step.effort - made
        dry[:, dofs] = np.maximum(own_dry + step.friction, 0.0)
        applied = np.zeros((n_sims, batch.model.nv))
        applied[:, dofs] = changed[:, k] + step.extra
        if qfrc_applied is not None:
            applied += qfrc_applied[:, k]
        return applied

    return batch.step_by_step(state, n_steps, before, record=record), changed
