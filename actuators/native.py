"""Actuators whose law MuJoCo runs itself: forces that its integrator knows how to differentiate.

Their control depends on the targets alone, so it need not be computed at every physics step.
"""

from __future__ import annotations

import abc
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Random, Rows
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.targeted import TargetedActuator

FloatArray = NDArray[np.float64]

_ZOH = 0  # mjModel.actuator_history of a delay without interpolation
_ROUNDING = 1e-6  # steps
_HISTORY_HEAD = 2  # numbers before the times and the values of an actuator's history
_DEFAULT_TIMESTEP = 0.002  # MuJoCo's, s


class NativeActuator(TargetedActuator):
    """Sends targets to MuJoCo's own actuators; subclasses say which number the control is."""

    def __init__(self, cfg: TargetedActuatorCfg):
        super().__init__(cfg)
        self._lag = 0
        self._started: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._all_started = True
        self._changed = False
        self._control: FloatArray = np.zeros(0)
        self._arriving: FloatArray = np.zeros(0)
        self._q: FloatArray = np.zeros(0)
        self._qd: FloatArray = np.zeros(0)

    @abc.abstractmethod
    def _command(
        self, position: FloatArray | None, velocity: FloatArray | None, effort: FloatArray | None
    ) -> FloatArray:
        """The control that asks for the targets, a new array (..., n_joints)."""

    def delay_natively(self, lag: int) -> None:
        """Leaves a constant delay of its control to MuJoCo; to be called before `edit_mjcf`.

        Args:
            lag: the delay in physics steps.
        """
        self._lag = lag

    def _delay(self, root: Any) -> dict[str, Any]:
        """Attributes of an element with the delay; `_bind` corrects it for the final timestep."""
        if not self._lag:
            return {}
        timestep = root.root_model.option.timestep or _DEFAULT_TIMESTEP
        return {"nsample": self._lag, "delay": self._lag * timestep, "interp": "zoh"}

    def _bind(self) -> None:
        self._control = self._arriving = np.zeros(self.shape)
        self._q, self._qd = np.zeros(self.shape), np.zeros(self.shape)
        model, ids = self.simulation.model, self._actuator_ids
        if self._lag:
            # Its timestep may have been set after edit_mjcf, as composer tasks do.
            model.actuator_delay[ids] = self._lag * model.opt.timestep
            if self.simulation.batch_shape:
                self.simulation.parameter("actuator_delay")[:, ids] = model.actuator_delay[ids]
        self._past = _Past(model, ids)
        self._started = np.zeros((*self.simulation.batch_shape, 1), dtype=bool)
        self._all_started = not self._past.any

    def control(
        self,
        position_target: FloatArray | None,
        velocity_target: FloatArray | None,
        effort_target: FloatArray | None,
    ) -> FloatArray:
        """As in `Actuator`."""
        control = self._command(position_target, velocity_target, effort_target)
        if not self._all_started:
            # MuJoCo starts from a past of zeros, in which a standing robot would drop.
            self._past.fill(self.simulation.state("history"), control, self._started)
            self._started[...] = True
            self._all_started = True
        self._control = control
        self._changed = False
        self.look()
        return control

    def look(self) -> None:
        """Keeps what efforts are read from later, when the physics may have gone on."""
        self._arriving = self._control
        if self._past.any:
            self._arriving = self._past.read(self.simulation.state("history"), self._control)
        q, qd = self.state()
        self._q, self._qd = q.copy(), qd.copy()
        self._look()

    def _look(self) -> None:
        """Keeps what else the law depends on."""

    def _reset(self, rows: Rows, random_state: Random | None) -> None:
        del random_state
        at = slice(None) if rows is None else rows
        if self._past.any:
            self._started[at] = False
            self._all_started = False
        self._arriving, self._q, self._qd = (a.copy() for a in (self._arriving, self._q, self._qd))
        for array in (self._arriving, self._q, self._qd):
            array[at] = 0.0

    @property
    def holds(self) -> bool:
        """As in `Actuator`; not while a gain has changed, which some controls depend on."""
        return not self._changed


class _Past:
    """The past controls that MuJoCo keeps of actuators with a delay, ours or the XML's.

    Attributes:
        any: one of them has a delay.
    """

    def __init__(self, model: mujoco.MjModel, actuators: NDArray[np.intp]):
        samples, interpolation = model.actuator_history[actuators].T
        late = model.actuator_delay[actuators] / model.opt.timestep
        late = np.where(interpolation == _ZOH, np.ceil(late - _ROUNDING), late)
        self._columns = np.flatnonzero((samples > 0) & (late > 0))
        self.any = bool(self._columns.size)
        at = self._columns
        first = np.asarray(model.actuator_historyadr[actuators[at]], dtype=np.intp)
        self._samples = np.asarray(samples[at], dtype=np.intp)
        self._cursor, self._values = first + 1, first + _HISTORY_HEAD + self._samples
        self._whole = np.floor(late[at] + _ROUNDING).astype(np.intp)
        self._part = np.maximum(late[at] - self._whole, 0.0)
        places = [v + np.arange(n) for v, n in zip(self._values, self._samples, strict=True)]
        self._every = np.concatenate([np.zeros(0, dtype=np.intp), *places])
        self._of = np.repeat(at, self._samples)

    def fill(self, history: FloatArray, control: FloatArray, started: NDArray[np.bool_]) -> None:
        """Lets the control stand for all that came before it, but in simulations under way."""
        history[..., self._every] = np.where(
            started, history[..., self._every], control[..., self._of]
        )

    def read(self, history: FloatArray, control: FloatArray) -> FloatArray:
        """The controls that the next physics step uses, of which `control` are the newest."""
        used = control.copy()
        early = self._steps_ago(history, control, self._whole)
        late = self._steps_ago(history, control, self._whole + 1)
        used[..., self._columns] = np.where(
            self._part > _ROUNDING, (1 - self._part) * early + self._part * late, early
        )
        return used

    def _steps_ago(
        self, history: FloatArray, control: FloatArray, steps: NDArray[np.intp]
    ) -> FloatArray:
        newest = history[..., self._cursor].astype(np.intp)
        kept = np.minimum(steps, self._samples)
        places = self._values + (newest + 1 - kept) % self._samples
        remembered = np.take_along_axis(history, places, axis=-1)
        return np.where(steps > 0, remembered, control[..., self._columns])
