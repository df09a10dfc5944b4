"""Actuators whose law MuJoCo runs itself: forces that its integrator knows how to differentiate.

Their control depends on the targets alone, so it need not be computed at every physics step.
"""

from __future__ import annotations

import abc
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Random, Rows
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.targeted import TargetedActuator

FloatArray = NDArray[np.float64]

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
        self._started = np.zeros((*self.simulation.batch_shape, 1), dtype=bool)
        self._all_started = not self._lag
        if self._lag:
            model, ids = self.simulation.model, self._actuator_ids
            # Its timestep may have been set after edit_mjcf, as composer tasks do.
            model.actuator_delay[ids] = self._lag * model.opt.timestep
            if self.simulation.batch_shape:
                self.simulation.parameter("actuator_delay")[:, ids] = model.actuator_delay[ids]
            first = np.asarray(model.actuator_historyadr[ids], dtype=np.intp)
            self._cursor_at = first + 1
            self._values_at = (first + _HISTORY_HEAD + self._lag)[:, None] + np.arange(self._lag)

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
            history = self.simulation.state("history")
            past = history[..., self._values_at]
            history[..., self._values_at] = np.where(
                self._started[..., None], past, control[..., None]
            )
            self._started[...] = True
            self._all_started = True
        self._control = control
        self._changed = False
        self.look()
        return control

    def look(self) -> None:
        """Keeps what efforts are read from later, when the physics may have gone on."""
        self._arriving = self._oldest() if self._lag else self._control
        q, qd = self.state()
        self._q, self._qd = q.copy(), qd.copy()
        self._look()

    def _look(self) -> None:
        """Keeps what else the law depends on."""

    def _reset(self, rows: Rows, random_state: Random | None) -> None:
        del random_state
        at = slice(None) if rows is None else rows
        if self._lag:
            self._started[at] = False
            self._all_started = False
        self._arriving, self._q, self._qd = (a.copy() for a in (self._arriving, self._q, self._qd))
        for array in (self._arriving, self._q, self._qd):
            array[at] = 0.0

    def _oldest(self) -> FloatArray:
        """The control in MuJoCo's history that the next physics step uses, (..., n_joints)."""
        history = self.simulation.state("history")
        newest = history[..., self._cursor_at].astype(np.intp)
        oldest = self._values_at[:, 0] + (newest + 1) % self._lag
        return np.take_along_axis(history, oldest, axis=-1)

    @property
    def holds(self) -> bool:
        """As in `Actuator`; not while a gain has changed, which some controls depend on."""
        return not self._changed
