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
import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextvars import ContextVar
from copy import copy
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_WORTH_THREADS = 6  # simulations
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
_KINDS = {
    "singular inertia": mujoco.mjtWarning.mjWARN_INERTIA,
    "too many contacts": mujoco.mjtWarning.mjWARN_CONTACTFULL,
    "too many constraints": mujoco.mjtWarning.mjWARN_CNSTRFULL,
    "bad position": mujoco.mjtWarning.mjWARN_BADQPOS,
    "bad velocity": mujoco.mjtWarning.mjWARN_BADQVEL,
    "bad acceleration": mujoco.mjtWarning.mjWARN_BADQACC,
    "bad control": mujoco.mjtWarning.mjWARN_BADCTRL,
}
_NO_STAGE, _VELOCITY = (
    int(stage) for stage in (mujoco.mjtStage.mjSTAGE_NONE, mujoco.mjtStage.mjSTAGE_VEL)
)
_NO_SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
_NO_ISLANDS = int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
_NO_CONTACTS = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
_BITS = frozenset({"geom_contype", "geom_conaffinity"})
_SENSED = frozenset({"sensordata", "cacc", "cfrc_int", "cfrc_ext"})  # found for sensors alone
_CHECKED_EVERY = 16  # steps that one which has diverged may go on for
# MuJoCo prints every instability and writes MUJOCO_LOG.TXT; a candidate that diverges is an
# ordinary event here. The handler is called from threads without the interpreter lock, so it has
# to be a C function: strlen reads the message and does nothing else.
_IGNORE = ctypes.CFUNCTYPE(ctypes.c_size_t, ctypes.c_char_p)(("strlen", ctypes.CDLL(None)))
# MuJoCo reads the clock some thirty times a step, which takes as long as the rest of a small
# model's. None gives it its own clock back, so it gets a C function that always says the same.
_NO_CLOCK = ctypes.CFUNCTYPE(ctypes.c_double)(("PyFloat_GetMin", ctypes.pythonapi))
_COUNTING = threading.Lock()
_COUNTED: ContextVar[Counter[str] | None] = ContextVar("warnings", default=None)


class _Quiet:
    """MuJoCo's one handler of warnings, and its one clock, ignored while any thread simulates."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._depth = 0
        self._handler: Any = None
        self._clock: Any = None

    def __enter__(self) -> None:
        with self._lock:
            if self._depth == 0:
                self._handler = mujoco.get_mju_user_warning()
                mujoco.set_mju_user_warning(_IGNORE)
                self._clock = mujoco.get_mjcb_time()
                mujoco.set_mjcb_time(_NO_CLOCK)
            self._depth += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._depth -= 1
            if self._depth == 0:
                mujoco.set_mju_user_warning(self._handler)
                mujoco.set_mjcb_time(self._clock)


_QUIET = _Quiet()


def without_warnings() -> contextlib.AbstractContextManager[None]:
    """Keeps MuJoCo from printing its warnings and from writing MUJOCO_LOG.TXT."""
    return _QUIET


@contextlib.contextmanager
def counted_warnings() -> Iterator[Counter[str]]:
    """Counts the simulations in lock step that MuJoCo warns of, by the kind of its warning."""
    counter: Counter[str] = Counter()
    token = _COUNTED.set(counter)
    try:
        yield counter
    finally:
        _COUNTED.reset(token)


def warnings_counted() -> dict[str, int]:
    """What `counted_warnings` has counted so far; nothing outside of it."""
    return dict(_COUNTED.get() or {})


def count_warnings(counts: Mapping[str, int]) -> None:
    """Adds to what `counted_warnings` counts."""
    counter = _COUNTED.get()
    if counter is not None:
        with _COUNTING:
            counter.update(counts)


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
        only_rollouts: it is not asked for single steps.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        n_sims: int,
        *,
        fields: Mapping[str, FloatArray] | None = None,
        n_threads: int = 0,
        only_rollouts: bool = False,
    ):
        self.model = model
        self.n_sims = n_sims
        # Waking a second thread takes longer than a step of a few simulations.
        alone = n_sims < (2 if only_rollouts else _WORTH_THREADS)
        # What each has of its own is copied in every step, so that what all have is the model's.
        shared = {name: own[0] for name, own in (fields or {}).items() if (own == own[:1]).all()}
        own = {name: values for name, values in (fields or {}).items() if name not in shared}
        self._batch = Batch(_with(model, shared), n_sims, 1 if alone else n_threads)
        self._own_flags = int(model.opt.disableflags)
        if model.ntree == 1:  # all that is constrained is one island then, which MuJoCo looks for
            self._own_flags |= _NO_ISLANDS
        if not _can_touch(model, fields or ()):
            self._own_flags |= _NO_CONTACTS
        self._flags = self._batch.expand("opt.disableflags")
        self._flags[...] = self._own_flags
        for name, values in own.items():
            self._batch.expand(name)[...] = values
        if not _SET_CONST_INPUTS.isdisjoint(own):
            with _QUIET:
                self._batch.set_const()

    def parameter(self, name: str) -> FloatArray:
        """A model field of which each simulation has its own, (n_sims, *shape), live and writable.

        Args:
            name: the field; none that other constants are derived from.
        """
        return self._batch.expand(name)  # type: ignore[no-any-return]

    def derived(self, name: str) -> FloatArray:
        """A field that MuJoCo derives from the state, (n_sims, *shape), as of the last step.

        Args:
            name: for instance `qfrc_constraint`.
        """
        return self._batch.bind(name)  # type: ignore[no-any-return]

    def forward(self, state: FloatArray, *, ctrl: FloatArray, name: str) -> FloatArray:
        """A field that MuJoCo derives from a state, without advancing it.

        Args:
            state: (n_sims, nstate) rows of `mjSTATE_INTEGRATION`.
            ctrl: (n_sims, nu) controls.
            name: for instance `qfrc_constraint`.

        Returns:
            (n_sims, *shape) its values.
        """
        field = self._batch.bind(name)
        self._batch.state[...] = state
        self._batch.bind("ctrl")[...] = ctrl
        with _QUIET:
            self._batch.forward()
        return np.array(field)

    def rollout(
        self,
        state: FloatArray,
        *,
        ctrl: FloatArray,
        qfrc_applied: FloatArray | None = None,
        record: Sequence[str] = ("qpos",),
        lengths: NDArray[np.intp] | None = None,
    ) -> Rollout:
        """Advances every simulation from `state` under the given controls.

        Args:
            state: (n_sims, nstate) rows of `mjSTATE_INTEGRATION`.
            ctrl: (n_sims, n_steps, nu) controls, one row per step.
            qfrc_applied: (n_sims, n_steps, nv) applied joint effort [N·m or N], or None.
            record: MjData fields to keep after every step.
            lengths: (n_sims,) the steps that count of each; all by default. A record means nothing
                after them.

        Returns:
            The records and which simulations failed.
        """
        batch = self._batch
        batch.state[...] = state
        self._sense(not _SENSED.isdisjoint(record))
        control, spec = _controls(ctrl, qfrc_applied)
        n_steps = ctrl.shape[1]
        shapes = {name: getattr(batch._data, name).shape for name in record}
        out = {name: np.empty((self.n_sims, n_steps, *shapes[name])) for name in record}
        # MuJoCo resets a simulation that diverges, and its counts of warnings with it, so that only
        # counts from zero tell a failure.
        batch.warning[...] = 0
        failed = np.zeros(self.n_sims, dtype=bool)

        def run(ids: NDArray[np.intp] | None, length: int, into: dict[str, FloatArray]) -> None:
            own = control if ids is None else control[ids, :length]
            try:
                batch.rollout(length, own, spec, record, ids, into)
            except SimulationError as error:
                failed[error.ids] = True

        def stopped() -> NDArray[np.bool_]:
            # MuJoCo goes no further with what it warns of, whatever the warning.
            found: NDArray[np.bool_] = failed | (batch.warning[:, :, 1] > 0).any(axis=1)
            return found

        with _QUIET:
            run(None, n_steps, out)
            if lengths is not None:
                # Whether it was before its end that one stopped is seen where it runs no longer.
                early = stopped() & (lengths < n_steps)
                for length in np.unique(lengths[early]):
                    ids = np.flatnonzero(early & (lengths == length))
                    batch.state[ids], batch.warning[ids], failed[ids] = state[ids], 0, False
                    again = {name: np.empty((len(ids), length, *shapes[name])) for name in record}
                    run(ids, int(length), again)
                    for name in record:
                        out[name][ids, :length] = again[name]
        return self._done(out, stopped())

    @property
    def batch(self) -> Batch:
        """MuJoCo's own; actuators are initialized with what has one."""
        return self._batch

    def advance(
        self,
        n_steps: int,
        before: Callable[[int], None],
        *,
        steady: bool = False,
        ids: NDArray[np.intp] | None = None,
    ) -> NDArray[np.bool_]:
        """Advances simulations from where they are, asking before each step what to apply.

        What MuJoCo derives from positions and velocities is then that of the state reached, as in
        dm_control. Sensors are read in the last step only.

        Args:
            n_steps: how many steps, at least 1.
            before: called with the number of the step.
            steady: what is applied holds: call it ahead of the first and the last step only.
            ids: the simulations, rising; None for all.

        Returns:
            (n_sims,) which simulations MuJoCo warned of or failed in, as `control.PhysicsError`
            does in dm_control.
        """
        batch = self._batch
        batch.warning[...] = 0
        failed = np.zeros(self.n_sims, dtype=bool)
        most = n_steps - 1
        early = [(0, most)] if steady and most else [(k, 1) for k in range(most)]
        with _QUIET:
            for first, steps in [*early, (most, 1)]:
                before(first)
                last = first == most
                if last or first == 0:
                    self._sense(last)
                try:
                    batch.step(ids, steps, _VELOCITY if last else _NO_STAGE)
                except SimulationError as error:
                    failed[error.ids] = True
        failed |= (batch.warning[:, :, 1] > 0).any(axis=1)
        return failed

    def _sense(self, wanted: bool) -> None:
        """Whether the next steps read the sensors, unless some keep a history of every step."""
        if self.model.nsensor and not self.model.sensor_history[:, 0].any():
            self._flags[...] = self._own_flags if wanted else self._own_flags | _NO_SENSORS

    def live(self, name: str) -> FloatArray:
        """A field of the simulations' states, (n_sims, *shape), live and writable.

        Args:
            name: the MjData field, e.g. `qpos`, `ctrl` or `qfrc_applied`.
        """
        return self._batch.bind(name)  # type: ignore[no-any-return]

    def step_by_step(
        self,
        state: FloatArray,
        n_steps: int,
        before: Callable[[int], None],
        *,
        record: Sequence[str] = ("qpos",),
        lengths: NDArray[np.intp] | None = None,
    ) -> Rollout:
        """Advances every simulation from `state`, asking before each step what to apply.

        Args:
            state: (n_sims, nstate) rows of `mjSTATE_INTEGRATION`.
            n_steps: how many steps.
            before: called with the number of the step; reads and writes what is `live`, such as
                `ctrl` and `qfrc_applied`.
            record: MjData fields to keep after every step.
            lengths: as `rollout` has them; after its own, a simulation is not stepped any more.

        Returns:
            The records and which simulations failed.
        """
        batch = self._batch
        batch.state[...] = state
        self._sense(not _SENSED.isdisjoint(record))
        kept = [(batch.bind(name), name) for name in record]
        out = {name: np.empty((self.n_sims, n_steps, *now.shape[1:])) for now, name in kept}
        batch.warning[...] = 0
        failed, checked = np.zeros(self.n_sims, dtype=bool), _CHECKED_EVERY
        going: NDArray[np.intp] | None = None
        ends = set() if lengths is None else set(lengths.tolist()) - {n_steps}
        with _QUIET:
            for k in range(n_steps):
                before(k)
                try:
                    batch.step(going)
                except SimulationError as error:
                    failed[error.ids] = True
                    checked = 1
                for now, name in kept:
                    out[name][:, k] = now
                if k % checked and k + 1 not in ends:
                    continue
                failed |= (batch.warning[:, _DIVERGED, 1] > 0).any(axis=1)
                if failed.any() or k + 1 in ends:
                    # Nothing that has diverged is worth another step, nor what has come to its end.
                    over = failed if lengths is None else failed | (lengths <= k + 1)
                    going = np.flatnonzero(~over)
                    checked = 1 if failed.any() else checked
                    if not going.size:
                        break
        return self._done(out, failed)

    def _done(self, out: dict[str, FloatArray], failed: NDArray[np.bool_]) -> Rollout:
        """What was recorded, of the simulations that did not fail; counts MuJoCo's warnings."""
        warned = self._batch.warning[:, :, 1] > 0
        kinds = {kind: int(warned[:, int(index)].sum()) for kind, index in _KINDS.items()}
        kinds["error"] = int((failed & ~warned.any(axis=1)).sum())
        count_warnings({kind: count for kind, count in kinds.items() if count})
        failed = failed | warned[:, _DIVERGED].any(axis=1)
        for values in out.values():
            values[failed] = np.nan
        return Rollout(records=out, failed=failed)


def _controls(ctrl: FloatArray, qfrc_applied: FloatArray | None) -> tuple[FloatArray, int]:
    """Controls, with applied efforts beside them, and the components of the state that they are."""
    spec = int(mujoco.mjtState.mjSTATE_CTRL.value)
    if qfrc_applied is None:
        return ctrl, spec
    # State components are laid out in the order of their bits: ctrl comes first.
    spec |= int(mujoco.mjtState.mjSTATE_QFRC_APPLIED.value)
    return np.concatenate([ctrl, qfrc_applied], axis=-1), spec


def _can_touch(model: mujoco.MjModel, fields: Collection[str]) -> bool:
    """Whether any two geoms of a model may, of which each simulation has some fields of its own."""
    if model.npair or model.nflex or not _BITS.isdisjoint(fields):
        return True
    meet = (model.geom_contype[:, None] & model.geom_conaffinity) != 0
    np.fill_diagonal(meet, False)
    return bool(meet.any())


def _with(model: mujoco.MjModel, fields: Mapping[str, NDArray[Any]]) -> mujoco.MjModel:
    """A model with other values of some fields; itself where it has these."""
    changed = {}
    for name, value in fields.items():
        prefix, _, attribute = name.rpartition(".")
        if not np.array_equal(getattr(model.opt if prefix else model, attribute), value):
            changed[prefix, attribute] = value
    if not changed:
        return model
    other = copy(model)
    for (prefix, attribute), value in changed.items():
        if prefix and not np.ndim(value):
            setattr(other.opt, attribute, value.item())
        else:
            getattr(other.opt if prefix else other, attribute)[...] = value
    if not _SET_CONST_INPUTS.isdisjoint(name for _, name in changed):
        with _QUIET:
            mujoco.mj_setConst(other, mujoco.MjData(other))
    return other
