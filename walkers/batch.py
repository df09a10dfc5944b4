"""The lock-step engine: many simulations of one model, some of which may fail.

A thin layer over `mujoco.batch.Batch` that replay, fitting and vectorised environments share:

    batch = LockStep(model, n_sims=64, fields={"dof_damping": damping}, n_threads=2)
    rollout = batch.rollout(state, ctrl=ctrl, record=("qpos", "qvel"))
    rollout.failed            # (64,) bool: diverged, or MuJoCo raised
    rollout.records["qpos"]   # (64, n_steps, nq), rows of failed simulations are NaN

A simulation that diverges is marked and its records are NaN; it never takes the others down.
Results do not depend on the number of threads.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Model fields that mj_setConst reads: constants derived from them must follow a change.
_SET_CONST_INPUTS = frozenset(mujoco.MjModel._setconst_inputs)
_DIVERGED = [
    int(warning)
    for warning in (
        mujoco.mjtWarning.mjWARN_INERTIA,
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
        mujoco.mjtWarning.mjWARN_BADCTRL,
    )
]
# MuJoCo prints every instability and writes MUJOCO_LOG.TXT; a candidate that diverges is an
# ordinary event here. The handler is called from threads without the interpreter lock, so it has
# to be a C function: strlen reads the message and does nothing else.
_IGNORE = ctypes.CFUNCTYPE(ctypes.c_size_t, ctypes.c_char_p)(("strlen", ctypes.CDLL(None)))


@contextlib.contextmanager
def _without_warnings() -> Iterator[None]:
    handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_IGNORE)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(handler)


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """What a lock-step rollout left behind.

    Attributes:
        records: recorded field to its (n_sims, n_steps, ...) array; NaN where a simulation failed.
        failed: (n_sims,) bool, True where the simulation diverged or MuJoCo raised.
    """

    records: Mapping[str, FloatArray]
    failed: NDArray[np.bool_]


class LockStep:
    """`n_sims` simulations of one model, each with its own values of some model fields.

    Args:
        model: the compiled model; never written to.
        n_sims: number of simulations.
        fields: model field (or `opt.` field) to its per-simulation values, (n_sims, *field shape).
        n_threads: threads of the pool, 0 for all cores.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        n_sims: int,
        *,
        fields: Mapping[str, FloatArray] | None = None,
        n_threads: int = 0,
    ):
        self.model = model
        self.n_sims = n_sims
        self._batch = Batch(model, n_sims, n_threads)
        for name, values in (fields or {}).items():
            self._batch.expand(name)[...] = values
        if any(name in _SET_CONST_INPUTS for name in fields or {}):
            self._batch.set_const()

    def parameter(self, name: str) -> FloatArray:
        """A model field of which each simulation has its own, (n_sims, *shape), live and writable.

        Args:
            name: the field; none that other constants are derived from.
        """
        return self._batch.expand(name)  # type: ignore[no-any-return]

    def rollout(
        self,
        state: FloatArray,
        *,
        ctrl: FloatArray,
        qfrc_applied: FloatArray | None = None,
        record: Sequence[str] = ("qpos",),
    ) -> Rollout:
        """Advances every simulation from `state` under the given controls.

        Args:
            state: (n_sims, nstate) rows of `mjSTATE_INTEGRATION`.
            ctrl: (n_sims, n_steps, nu) controls, one row per step.
            qfrc_applied: (n_sims, n_steps, nv) applied joint effort [N·m or N], or None.
            record: MjData fields to keep after every step.

        Returns:
            The records and which simulations failed.
        """
        self._batch.state[...] = state
        spec = mujoco.mjtState.mjSTATE_CTRL.value
        control = ctrl
        if qfrc_applied is not None:
            # State components are laid out in the order of their bits: ctrl comes first.
            spec |= mujoco.mjtState.mjSTATE_QFRC_APPLIED.value
            control = np.concatenate([ctrl, qfrc_applied], axis=-1)
        n_steps = ctrl.shape[1]
        shapes = {name: getattr(self._batch._data, name).shape for name in record}
        out = {name: np.empty((self.n_sims, n_steps, *shapes[name])) for name in record}
        # MuJoCo resets a simulation that diverges, and its counts of warnings with it, so that only
        # counts from zero tell a failure.
        self._batch.warning[...] = 0
        failed = np.zeros(self.n_sims, dtype=bool)
        try:
            with _without_warnings():
                self._batch.rollout(n_steps, control, spec, record, out=out)
        except SimulationError as error:
            failed[error.ids] = True
        failed |= (self._batch.warning[:, _DIVERGED, 1] > 0).any(axis=1)
        for values in out.values():
            values[failed] = np.nan
        return Rollout(records=out, failed=failed)

    def step_by_step(
        self,
        state: FloatArray,
        n_steps: int,
        before: Callable[[int, FloatArray, FloatArray, FloatArray], FloatArray],
        *,
        record: Sequence[str] = ("qpos",),
    ) -> Rollout:
        """Advances every simulation from `state`, asking before each step what to apply.

        Args:
            state: (n_sims, nstate) rows of `mjSTATE_INTEGRATION`.
            n_steps: how many steps.
            before: called with the number of the step, qpos (n_sims, nq), qvel (n_sims, nv) and
                ctrl (n_sims, nu), which it writes to; returns (n_sims, nv) applied joint effort
                [N·m or N].
            record: MjData fields to keep after every step.

        Returns:
            The records and which simulations failed.
        """
        batch = self._batch
        batch.state[...] = state
        qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
        ctrl, applied = batch.bind("ctrl"), batch.bind("qfrc_applied")
        live = {name: batch.bind(name) for name in record}
        out = {name: np.empty((self.n_sims, n_steps, *live[name].shape[1:])) for name in record}
        batch.warning[...] = 0
        failed = np.zeros(self.n_sims, dtype=bool)
        going: NDArray[np.intp] | None = None
        with _without_warnings():
            for k in range(n_steps):
                applied[...] = before(k, qpos, qvel, ctrl)
                try:
                    batch.step(going)
                except SimulationError as error:
                    failed[error.ids] = True
                for name, values in live.items():
                    out[name][:, k] = values
                diverged = failed | (batch.warning[:, _DIVERGED, 1] > 0).any(axis=1)
                if (diverged != failed).any() or (failed.any() and going is None):
                    # Nothing that has diverged is worth another step.
                    failed = diverged
                    going = np.flatnonzero(~failed)
                    if not going.size:
                        break
        for values in out.values():
            values[failed] = np.nan
        return Rollout(records=out, failed=failed)
