"""Equality constraints at the start of a replay: what is not measured stands where they put it.

    loops = Loops(model)                        # connect, weld, joint and tendon equalities
    qpos, qvel = loops.closed(qpos, qvel, measured)
    loops.holds({"crank"})                      # {"crank", "coupler", "rocker"}

A loop of links has joints without encoders, and a joint that follows another has none as a rule. A
simulation that started them elsewhere would begin with a blow of the constraints. Positions are
found by Gauss–Newton on the constraints' own residuals and Jacobian, on the way from the pose at
rest to the measured one, so that they stay on the branch on which the model was assembled;
velocities are the least ones with which the constraints do not move.

Limits: what the constraints leave open stays at rest. All joints of a loop that are measured start
as measured, with the contradictions that their noise brings.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]

_EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
_WAY = 8  # parts of the way from rest to the measured pose
_FEW, _MOST = 2, 30  # iterations in each, and at its end
_CLOSED = 1e-12  # m or rad
_MOVES = 1e-6  # of a unit vector, that a dof takes part in


class Loops:
    """The equality constraints of a model.

    Args:
        model: the compiled model.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._data = rest(model)
        _, jacobian = self._residual() if model.neq else ([], np.zeros((0, model.nv)))
        self.any = bool(len(jacobian))
        """Whether there are such."""
        dofs = np.flatnonzero(np.abs(jacobian).max(axis=0, initial=0.0) > _MOVES)
        self.joints = frozenset(model.joint(j).name for j in np.unique(model.dof_jntid[dofs]))
        """Names of the joints that they bind."""

    def closed(
        self, qpos: FloatArray, qvel: FloatArray, known: Sequence[int]
    ) -> tuple[FloatArray, FloatArray]:
        """States with which the constraints agree.

        Args:
            qpos: (n, nq) positions, those at rest where they are not known.
            qvel: (n, nv) velocities, zero where they are not known.
            known: the degrees of freedom that are left as they are.

        Returns:
            Positions and velocities of the same shapes.
        """
        both = np.concatenate([qpos, qvel], axis=1)
        unique, where = np.unique(both, axis=0, return_inverse=True)
        at_rest = rest(self._model).qpos.copy()
        each = [self._closed(one, at_rest, known) for one in unique]
        found: FloatArray = np.stack(each)[where.reshape(-1)]
        return found[:, : self._model.nq], found[:, self._model.nq :]

    def _closed(self, state: FloatArray, at_rest: FloatArray, known: Sequence[int]) -> FloatArray:
        model, data = self._model, self._data
        qpos, qvel = state[: model.nq], state[model.nq :].copy()
        way = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, way, 1.0, at_rest, qpos)
        unknown = np.setdiff1d(np.arange(model.nv), known)
        data.qpos[:] = at_rest
        for part in range(_WAY):
            mujoco.mj_integratePos(model, data.qpos, way, 1 / _WAY)
            last = part == _WAY - 1
            if last:  # what is measured is so to the last bit
                settled = data.qpos.copy()
                data.qpos[:] = qpos
                data.qpos[_positions(model, unknown)] = settled[_positions(model, unknown)]
            for _ in range(_MOST if last else _FEW):
                residual, jacobian = self._residual()
                if np.abs(residual).max(initial=0.0) <= _CLOSED:
                    break
                step = np.zeros(model.nv)
                step[unknown] = -np.linalg.lstsq(jacobian[:, unknown], residual, rcond=1e-9)[0]
                mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        _, jacobian = self._residual()
        moved = jacobian @ qvel
        qvel[unknown] -= np.linalg.lstsq(jacobian[:, unknown], moved, rcond=1e-9)[0]
        return np.concatenate([data.qpos, qvel])

    def residual(self, qpos: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (n,) and Jacobian (n, nv) of the constraints at (nq,) positions [m; rad]."""
        self._data.qpos[:] = qpos
        return self._residual()

    def _residual(self) -> tuple[FloatArray, FloatArray]:
        """The same at the present positions."""
        model, data = self._model, self._data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        mujoco.mj_makeConstraint(model, data)
        rows = np.flatnonzero(data.efc_type[: data.nefc] == _EQUALITY)
        jacobian = np.zeros((data.nefc, model.nv))
        if data.nefc and mujoco.mj_isSparse(model):
            mujoco.mju_sparse2dense(
                jacobian, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
            )
        elif data.nefc:
            jacobian[:] = data.efc_J.reshape(data.nefc, model.nv)
        return np.array(data.efc_pos[rows]), jacobian[rows]

    def holds(self, held: Collection[str]) -> frozenset[str]:
        """Names of the joints that cannot move while some are held, with those.

        Args:
            held: names of joints.
        """
        if not self.any:
            return frozenset(held)
        model = self._model
        names = {model.joint(joint).name: joint for joint in range(model.njnt)}
        fixed = {int(model.jnt_dofadr[names[name]]) for name in held if name in names}
        free = [dof for dof in range(model.nv) if dof not in fixed]
        self._data.qpos[:] = rest(model).qpos
        _, jacobian = self._residual()
        open_ = null_space(jacobian[:, free]) if len(jacobian) and free else np.eye(len(free))
        stuck = {
            int(model.dof_jntid[dof])
            for dof, motion in zip(free, open_, strict=True)
            if np.abs(motion).max(initial=0.0) < _MOVES
        }
        return frozenset(held) | {name for name, joint in names.items() if joint in stuck and name}


def _positions(model: mujoco.MjModel, dofs: Sequence[int] | NDArray[np.intp]) -> NDArray[np.intp]:
    """Where the joints of some degrees of freedom are in `qpos`."""
    widths = {0: 7, 1: 4}
    found: list[int] = []
    for joint in np.unique(model.dof_jntid[dofs]):
        first = int(model.jnt_qposadr[joint])
        found += range(first, first + widths.get(int(model.jnt_type[joint]), 1))
    return np.array(found, dtype=np.intp)
