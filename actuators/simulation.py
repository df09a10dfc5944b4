"""One physics or a batch of them, seen alike.

    simulation = Simulation.of(physics)            # dm_control's Physics: arrays (nq,)
    simulation = Simulation.of(batch)              # mujoco.batch.Batch: arrays (n_sims, nq)
    simulation = Simulation.of((model, data))      # plain MuJoCo

Its arrays are live: what the next physics step reads, and what the last one wrote.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_SET_CONST_INPUTS = frozenset(mujoco.MjModel._setconst_inputs)


class Simulation:
    """Live arrays of a compiled model and its state.

    Attributes:
        model: the compiled model.
        batch_shape: () for one physics, (n_sims,) for a batch.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData | None, batch: Batch | None):
        self.model = model
        self.batch_shape: tuple[int, ...] = () if batch is None else (batch.nsim,)
        self._data = data
        self._batch = batch

    @classmethod
    def of(cls, physics: Any) -> Simulation:
        """The simulation behind what people have in hand.

        Args:
            physics: dm_control's `Physics` (suite or PyMJCF), a `mujoco.batch.Batch`, an object
                with such a `batch`, or a pair (MjModel, MjData).

        Raises:
            TypeError: it is none of these.
        """
        batch = getattr(physics, "batch", physics)
        if isinstance(batch, Batch):
            return cls(batch.model, None, batch)
        if isinstance(physics, tuple) and len(physics) == 2:
            model, data = physics
        else:
            model, data = getattr(physics, "model", None), getattr(physics, "data", None)
        model, data = getattr(model, "ptr", model), getattr(data, "ptr", data)
        if not (isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData)):
            raise TypeError(
                f"physics should be a dm_control Physics, a mujoco.batch.Batch or a pair (MjModel, "
                f"MjData), got {physics!r}"
            )
        return cls(model, data, None)

    def state(self, name: str) -> FloatArray:
        """A field of MjData, (..., *shape), live.

        What MuJoCo derives from the state, as `ten_length`, is in a batch that of its last call:
        step it with `stage=mjSTAGE_VEL`, and call `forward` after a reset, where that is used.

        Args:
            name: for instance `qpos`, `qvel`, `ctrl`, `actuator_length`.
        """
        if self._batch is not None:
            array = np.asarray(self._batch.bind(name))
            if not array.flags.writeable:
                # Derived, and zero until the next call.
                self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)
            return array
        return np.asarray(getattr(self._data, name))

    def parameter(self, name: str) -> FloatArray:
        """A field of MjModel, (..., *shape), live and writable: of each simulation its own.

        Args:
            name: for instance `dof_armature`. After writing, call `commit`.
        """
        if self._batch is not None:
            return self._batch.expand(name)  # type: ignore[no-any-return]
        return np.asarray(getattr(self.model, name))

    def commit(self, *names: str, rows: NDArray[np.intp] | None = None) -> None:
        """Lets the constants that MuJoCo derives from these model fields follow them.

        Args:
            names: the fields that were written to.
            rows: simulations of the batch, rising; None for all.
        """
        if not _SET_CONST_INPUTS.intersection(names):
            return
        if self._batch is not None:
            self._batch.set_const(rows)
            return
        # mj_setConst moves its data to the reference pose: never the one that is being simulated.
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))


def indexer(ids: NDArray[np.intp] | list[int]) -> slice | NDArray[np.intp]:
    """The ids, as a slice where they follow one another: a view instead of a copy."""
    ids = np.asarray(ids, dtype=np.intp)
    if len(ids) and (np.diff(ids) == 1).all():
        return slice(int(ids[0]), int(ids[-1]) + 1)
    return ids


def last_axis(array: FloatArray, ids: Any) -> Any:
    """What indexes these columns of an array.

    A vector is indexed by the ids alone: behind an ellipsis numpy takes nine times as long, which
    counts before every physics step.

    Args:
        array: (..., n).
        ids: columns.
    """
    at = indexer(ids)
    return (..., at) if isinstance(at, slice) or array.ndim > 1 else at


def viewed(array: FloatArray, ids: Any) -> tuple[FloatArray, Any]:
    """Columns of an array: a live view and None where there is one, else with what indexes them.

    Args:
        array: (..., n).
        ids: columns.
    """
    at = last_axis(array, ids)
    return (array[at], None) if isinstance(indexer(ids), slice) else (array, at)
