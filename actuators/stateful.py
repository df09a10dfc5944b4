"""Native actuators that remember: their law has states of its own in MuJoCo's `act`.

Their efforts are what MuJoCo made in the last physics step. It limits them on the way and keeps
only the result, so `computed_effort` and `applied_effort` are the same.
"""

from __future__ import annotations

import abc

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Random, Rows
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.limits import mapped, range_behind, unlimited
from walkerkit.actuators.native import NativeActuator

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


class StatefulActuator(NativeActuator):
    """A native actuator with hidden states, which a reset sets to zero.

    Args:
        cfg: the config.
    """

    def __init__(self, cfg: TargetedActuatorCfg):
        super().__init__(cfg)
        self._act_ids: IntArray = np.zeros((0, 0), dtype=np.intp)
        self._out_ids: IntArray = np.zeros(0, dtype=np.intp)
        self._force: FloatArray = np.zeros(0)
        self._behind: FloatArray = unlimited(0)

    @property
    @abc.abstractmethod
    def _gear(self) -> FloatArray:
        """Effort per force of MuJoCo's actuator, (n_joints,)."""

    def _bind(self) -> None:
        super()._bind()
        model, ids = self.simulation.model, self._actuator_ids
        first = np.asarray(model.actuator_actadr[ids], dtype=np.intp)
        self._act_ids = first[:, None] + np.arange(model.actuator_actnum[ids[0]])
        # Forces have places of their own: some actuators of MuJoCo have several.
        self._out_ids = np.asarray(model.actuator_outadr[ids], dtype=np.intp)
        self._force = self.simulation.state("actuator_force")
        self._behind = mapped(range_behind(model, ids), self._gear)

    def _reset(self, rows: Rows, random_state: Random | None) -> None:
        super()._reset(rows, random_state)
        act = self.simulation.state("act")
        at = (..., self._act_ids.ravel()) if rows is None else np.ix_(rows, self._act_ids.ravel())
        act[at] = 0.0

    @property
    def computed_effort(self) -> FloatArray:
        """As `applied_effort`: MuJoCo keeps nothing from before its limits."""
        return self.applied_effort

    @property
    def applied_effort(self) -> FloatArray:
        """What MuJoCo made in the last physics step, and the joint let through [N·m; N]."""
        made = self._gear * self._force[..., self._out_ids]
        return np.clip(made, self._behind[:, 0], self._behind[:, 1])
