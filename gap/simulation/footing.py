"""How high a floating robot starts, so that the ground carries it as it was carried when measured.

A foot that starts a millimetre too deep in stiff ground is thrown out of it, and one that starts a
millimetre above it falls; but no floor, leg or base is measured that well, and a heavier or softer
footed variant of the robot stands deeper. So the height is looked for at which the ground gives
what the motion of the measured centre of mass asks for.

    footing = Footing(model, base)
    raised = footing.raised(batch, state, ctrl, fields, acceleration)     # (n_sims,) m
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.start import state_offset
from walkerkit.walkers.batch import LockStep

FloatArray = NDArray[np.float64]

_FIRST, _GROWTH, _DOUBLINGS = 2.5e-4, 4.0, 5  # m; up to 64 mm
_ITERATIONS = 12
_CARRIED = 0.25  # of the weight; a robot that the ground carries less is in flight


class Footing:
    """The height of a floating robot above its ground.

    Args:
        model: the robot's model.
        base: its base.

    Attributes:
        height: where the base's height is in a row of `mjSTATE_INTEGRATION`.
    """

    def __init__(self, model: mujoco.MjModel, base: Base):
        self._model = model
        self._base = base
        self.height = state_offset(model, mujoco.mjtState.mjSTATE_QPOS) + base.qpos + 2
        self._bodies = np.flatnonzero(model.body_rootid == base.id)

    def centre_speed(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Vertical speed of the centre of mass, (n, nq) and (n, nv) → (n,) m/s."""
        data = mujoco.MjData(self._model)
        jacobian = np.zeros((3, self._model.nv))
        speed = np.empty(len(qpos))
        for k, (position, velocity) in enumerate(zip(qpos, qvel, strict=True)):
            data.qpos[:] = position
            mujoco.mj_kinematics(self._model, data)
            mujoco.mj_comPos(self._model, data)
            mujoco.mj_jacSubtreeCom(self._model, data, jacobian, self._base.id)
            speed[k] = jacobian[2] @ velocity
        return speed

    def raised(
        self,
        batch: LockStep,
        state: FloatArray,
        ctrl: FloatArray,
        fields: Mapping[str, NDArray[Any]],
        acceleration: FloatArray,
    ) -> FloatArray:
        """How much higher than measured the base has to start.

        Args:
            batch: the simulations.
            state: (n_sims, nstate) their measured states.
            ctrl: (n_sims, nu) their first controls.
            fields: model fields of which each has its own.
            acceleration: (n_sims,) measured, of the centre of mass, upwards [m/s²].

        Returns:
            (n_sims,) m; 0 for a robot in flight, and where no height within reach carries it.
        """
        model = self._model
        mass = fields.get("body_mass", model.body_mass[None])[:, self._bodies].sum(axis=1)
        weight = -mass * fields.get("opt.gravity", model.opt.gravity[None])[:, 2]
        load = np.maximum(weight + mass * acceleration, 0.0)
        state = state.copy()
        measured = state[:, self.height].copy()

        def excess(raised: FloatArray) -> FloatArray:
            """How much more the ground gives than the load [N]."""
            state[:, self.height] = measured + raised
            force = batch.forward(state, ctrl=ctrl, name="qfrc_constraint")
            more: FloatArray = force[:, self._base.dof + 2] - load
            return more

        zero = np.zeros(len(measured))
        near, near_excess = zero.copy(), excess(zero)
        wrong = (near_excess > 0) | (load > _CARRIED * weight)
        way = np.where(near_excess > 0, 1.0, -1.0)
        far, far_excess = near.copy(), near_excess.copy()
        found = np.zeros(len(measured), dtype=bool)
        step = _FIRST
        for _ in range(_DOUBLINGS):
            if (found | ~wrong).all():
                break
            tried = np.where(found, far, way * step)
            tried_excess = excess(tried)
            crossed = way * tried_excess <= 0
            near = np.where(found | crossed, near, tried)
            near_excess = np.where(found | crossed, near_excess, tried_excess)
            far, far_excess = tried, tried_excess
            found |= crossed
            step *= _GROWTH
        root = _illinois(excess, near, near_excess, far, far_excess)
        return np.where(found & wrong, root, 0.0)


def _illinois(
    function: Any, a: FloatArray, fa: FloatArray, b: FloatArray, fb: FloatArray
) -> FloatArray:
    """Roots between a and b, many at once (Dowell and Jarratt, BIT 11, 1971)."""
    for _ in range(_ITERATIONS):
        slope = fb - fa
        flat = slope == 0
        c = np.where(flat, b, b - fb * (b - a) / np.where(flat, 1.0, slope))
        fc = function(c)
        crossed = fc * fb < 0
        a, fa = np.where(crossed, b, a), np.where(crossed, fb, 0.5 * fa)
        b, fb = c, fc
    return b
