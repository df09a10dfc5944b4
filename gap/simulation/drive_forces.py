"""What affine drives are about to make of their controls, in many simulations at once.

forces = DriveForces(model, joints, fields, n_sims=64)
effort = forces.effort(ctrl, q, qd)       # (n_sims, n_joints) [N·m; N]
target = forces.targets(ctrl)             # in joint units
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drive import Drive
from walkerkit.gap.simulation.robot import Joint

FloatArray = NDArray[np.float64]

DRIVE_FIELDS = (
    "actuator_gear",
    "actuator_gainprm",
    "actuator_biastype",
    "actuator_biasprm",
    "actuator_forcelimited",
    "actuator_forcerange",
)
_OF_EACH = (
    *("_per_control", "_constant", "_per_position", "_per_velocity", "_lowest", "_highest"),
    *("stiffness", "damping", "limit"),
)
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
_NONE, _EXACT = int(mujoco.mjtDyn.mjDYN_NONE), int(mujoco.mjtDyn.mjDYN_FILTEREXACT)


class DriveForces:
    """Efforts of the affine drives of some joints, of each its first.

    Args:
        model: the model.
        joints: the joints.
        fields: model fields of which each simulation has its own, (n_sims, *shape).
        n_sims: number of simulations.
        number: a number of the law of a joint whose drive is in Python, (n_sims,) or None; its
            effort is here that of a servo with the law's gains about rest.

    Attributes:
        columns: which of the joints have a drive.
        ctrl: its control, or its target where its law runs in Python.
        native: which of these controls are MuJoCo's, and which controls these are.
        stiffness, damping, limit: of the joints' drives, (n_sims, n_joints); a limit is infinite
            where there is none.
        filters: what lies between their controls and their gains, or None.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        joints: Sequence[Joint],
        fields: Mapping[str, NDArray[Any]],
        n_sims: int,
        number: Callable[[str, str], FloatArray | None] | None = None,
    ):
        driven = [k for k, joint in enumerate(joints) if joint.drives]
        self.columns = adjoining(driven)
        drives: list[Drive] = [joint.drives[0] for joint in joints if joint.drives]
        ids = [drive.actuator for drive in drives]
        outputs = model.actuator_outadr[ids]
        controls = [drive.ctrl for drive in drives]
        self.ctrl = adjoining(controls)
        native = [k for k, drive in enumerate(drives) if not drive.in_python]
        self.native = adjoining(native), adjoining([controls[k] for k in native])
        self._slope = np.array([drive.slope for drive in drives])
        self._offset = np.array([drive.offset for drive in drives])
        self._n_joints = len(joints)

        def field(name: str) -> FloatArray:
            own = fields.get(name)
            if own is None:
                own = np.asarray(getattr(model, name))[None]
            return np.asarray(own, dtype=np.float64)

        gear = field("actuator_gear")[:, outputs, 0]
        affine = field("actuator_biastype")[:, ids, None] == _AFFINE
        bias = np.where(affine, field("actuator_biasprm")[:, ids, :3], 0.0)
        limited = field("actuator_forcelimited")[:, ids, None] != 0
        force = np.where(limited, field("actuator_forcerange")[:, ids], [-np.inf, np.inf])
        self._per_control = gear * field("actuator_gainprm")[:, ids, 0]
        self._constant = gear * bias[..., 0]
        self._per_position = gear**2 * bias[..., 1]
        self._per_velocity = gear**2 * bias[..., 2]
        ends = gear[..., None] * force
        self._lowest, self._highest = ends.min(axis=-1), ends.max(axis=-1)
        # A motor takes whatever a law in Python makes.
        of_native = np.array([0 if drive.in_python else drive.ctrl for drive in drives], np.intp)
        bounded = model.actuator_ctrllimited[of_native].astype(bool)[:, None]
        bounded &= np.array([not drive.in_python for drive in drives], dtype=bool)[:, None]
        bounds = np.where(bounded, model.actuator_ctrlrange[of_native], [[-np.inf, np.inf]])
        self._bounds = (bounds[:, 0], bounds[:, 1]) if bounded.any() else None
        self.filters = _Filters.of(model, ids)

        if number is not None and len(native) < len(drives):
            self._take_programs(drives, [j.name for j in joints if j.drives], n_sims, number)

        shape = (n_sims, len(joints))
        self.stiffness, self.damping = np.zeros(shape), np.zeros(shape)
        self.limit = np.full(shape, np.inf)
        self.stiffness[:, self.columns] = -self._per_position
        self.damping[:, self.columns] = -self._per_velocity
        self.limit[:, self.columns] = np.maximum(np.abs(self._lowest), np.abs(self._highest))

    def _take_programs(
        self,
        drives: Sequence[Drive],
        names: Sequence[str],
        n_sims: int,
        number: Callable[[str, str], FloatArray | None],
    ) -> None:
        """Puts servos with their gains about rest in the places of laws in Python."""
        for name in _OF_EACH[:-3]:
            setattr(
                self, name, np.array(np.broadcast_to(getattr(self, name), (n_sims, len(drives))))
            )
        for k, (drive, joint) in enumerate(zip(drives, names, strict=True)):
            if not drive.in_python:
                continue
            gain, known = self._per_control[:, k].copy(), number(joint, "effort_limit")
            own = {"stiffness": drive.stiffness, "damping": drive.damping}
            kp, kd = (
                own[one] if values is None or own[one] == 0 else values
                for one in own
                for values in [number(joint, one)]
            )
            limit = gain * (np.inf if known is None else known)
            asked = {"position": kp, "velocity": kd, "effort": np.ones(n_sims)}[drive.kind]
            self._per_control[:, k] = gain * asked
            self._per_position[:, k], self._per_velocity[:, k] = -gain * kp, -gain * kd
            self._lowest[:, k] = np.maximum(self._lowest[:, k], -limit)
            self._highest[:, k] = np.minimum(self._highest[:, k], limit)

    def joins(self, other: DriveForces) -> bool:
        """Whether these drives differ from others in their efforts' numbers only."""
        if self.filters is not None or other.filters is not None:
            return False
        pairs = [
            (self._slope, other._slope),
            (self._offset, other._offset),
            (np.arange(self._n_joints)[self.columns], np.arange(other._n_joints)[other.columns]),
        ]
        if self._bounds is not None and other._bounds is not None:
            pairs += zip(self._bounds, other._bounds, strict=True)
        bounded = [one._bounds is not None for one in (self, other)]
        return bounded[0] == bounded[1] and all(np.array_equal(*pair) for pair in pairs)

    @classmethod
    def joined(cls, parts: Sequence[DriveForces]) -> DriveForces:
        """The drives of some simulations, and then of others, that differ in numbers only."""
        forces = copy(parts[0])
        for name in _OF_EACH:
            each = [
                np.broadcast_to(values, (len(part.stiffness), *values.shape[1:]))
                for part in parts
                for values in [getattr(part, name)]
            ]
            setattr(forces, name, np.concatenate(each))
        return forces

    def some(self, rows: NDArray[np.intp]) -> DriveForces:
        """The drives of some of the simulations."""
        forces, n_sims = copy(self), len(self.stiffness)
        for name in _OF_EACH:
            values = getattr(self, name)
            setattr(forces, name, values[rows] if len(values) == n_sims else values)
        return forces

    def targets(self, ctrl: FloatArray) -> FloatArray:
        """The targets that controls ask for, (..., n_joints); 0 where there is no drive.

        Args:
            ctrl: (..., n_drives).
        """
        return self._of_joints((ctrl - self._offset) / self._slope)

    def moved(self, ctrl: FloatArray, by: FloatArray) -> FloatArray:
        """Controls that ask for targets elsewhere; the same bits where these have not moved.

        Args:
            ctrl: (n_sims, n_drives).
            by: (n_sims, n_joints) how far the targets moved.
        """
        moved: FloatArray = ctrl + self._slope * by[:, self.columns]
        return moved

    def asked(self, ctrl: FloatArray, act: FloatArray | None = None) -> FloatArray:
        """The part of the efforts that goes with the controls, as these.

        Args:
            ctrl: (..., n_sims, n_drives) controls.
            act: (n_sims, na) activations, of a model whose drives have some.
        """
        if self._bounds is not None:
            ctrl = np.minimum(np.maximum(ctrl, self._bounds[0]), self._bounds[1])
        if self.filters is not None and act is not None:
            ctrl = self.filters.passed(ctrl, act)
        asked: FloatArray = self._per_control * ctrl + self._constant
        return asked

    def effort(self, asked: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Effort of each joint's drive, (n_sims, n_joints).

        Args:
            asked: (n_sims, n_drives) what `asked` says.
            q: (n_sims, n_joints) positions [rad; m].
            qd: (n_sims, n_joints) velocities [rad/s; m/s].
        """
        if self._slope.size < self._n_joints:
            q, qd = q[:, self.columns], qd[:, self.columns]
        effort = asked + self._per_position * q
        effort += self._per_velocity * qd
        np.maximum(effort, self._lowest, out=effort)
        np.minimum(effort, self._highest, out=effort)
        return self._of_joints(effort)

    def ahead(self, effort: FloatArray, ctrl: FloatArray, by: FloatArray) -> FloatArray:
        """What efforts would be with targets elsewhere, over what they are, (n_sims, n_joints).

        Args:
            effort: (n_sims, n_joints) as they are [N·m; N].
            ctrl: (n_sims, n_drives) the controls that ask for them.
            by: (n_sims, n_joints) how far the targets are moved.
        """
        if self.filters is not None:  # nothing that comes through a filter jumps
            return np.zeros_like(effort)
        now = effort[:, self.columns]
        moved = now + (self.asked(self.moved(ctrl, by)) - self.asked(ctrl))
        np.maximum(moved, np.minimum(self._lowest, now), out=moved)
        np.minimum(moved, np.maximum(self._highest, now), out=moved)
        return self._of_joints(moved - now)

    def _of_joints(self, values: FloatArray) -> FloatArray:
        if values.shape[-1] == self._n_joints:
            return values
        all_joints = np.zeros((*values.shape[:-1], self._n_joints))
        all_joints[..., self.columns] = values
        return all_joints


class _Filters:
    """First-order filters between controls and gains, as MuJoCo's activations have them."""

    def __init__(self, model: mujoco.MjModel, ids: Sequence[int]):
        step, constant = float(model.opt.timestep), model.actuator_dynprm[ids, 0]
        kinds = model.actuator_dyntype[ids]
        part = step / np.maximum(constant, step)
        exact = (kinds == _EXACT) & (constant > 0)
        part[exact] = -np.expm1(-step / constant[exact])
        self._filtered = kinds != _NONE
        self._act = np.where(self._filtered, model.actuator_actadr[ids], 0)
        # An early activation is that of the end of the step.
        self._part = np.where(model.actuator_actearly[ids], part, 0.0)

    @classmethod
    def of(cls, model: mujoco.MjModel, ids: Sequence[int]) -> _Filters | None:
        """None where no actuator has one."""
        return cls(model, ids) if (model.actuator_dyntype[ids] != _NONE).any() else None

    def passed(self, ctrl: FloatArray, act: FloatArray) -> FloatArray:
        """What is left of controls (n_sims, n_drives) behind the filters."""
        behind = act[:, self._act]
        return np.where(self._filtered, behind + self._part * (ctrl - behind), ctrl)


def adjoining(indices: Sequence[int]) -> slice | NDArray[np.intp]:
    """Indices as a slice where they follow each other, which makes views of arrays."""
    if indices and list(indices) == list(range(indices[0], indices[0] + len(indices))):
        return slice(indices[0], indices[0] + len(indices))
    return np.array(indices, dtype=np.intp)
