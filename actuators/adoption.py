"""Simulations of a batch that begin as one physics does.

    adoption = Adoption(batch_group)           # initialized with a mujoco.batch.Batch
    single_group.reset(random_state=state)     # of the same configs, initialized with one physics
    adoption.adopt(3, single_group)            # simulation 3 goes on as the single one would

So whatever draws actuators and lags for one physics draws them for a batch, simulation by
simulation, with the same result to the last bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.delayed import DelayedActuator
from walkerkit.actuators.group import ActuatorGroup

FloatArray = NDArray[np.float64]


class Adoption:
    """Carries what an episode begins with from one physics to simulations of a batch.

    Args:
        group: the batch's actuators, initialized.
    """

    def __init__(self, group: ActuatorGroup):
        self._group = group
        n_sims = group.simulation.batch_shape[0]
        # What each simulation has by now: few parameters ever change, and reading them from a batch
        # gives every simulation a copy of its own.
        self._known = [
            {name: np.tile(actuator.nominal(name), (n_sims, 1)) for name in actuator.parameters}
            for actuator in group.actuators
        ]

    def adopt(self, row: int, group: ActuatorGroup) -> None:
        """Resets one simulation to what a group of one physics has been reset to.

        Args:
            row: the simulation.
            group: of the same configs; it has been reset and nothing was computed since.
        """
        actuators = zip(self._group.actuators, group.actuators, self._known, strict=True)
        for mine, other, known in actuators:
            for name, values in known.items():
                now = other.get(name)
                if not np.array_equal(now, values[row]):
                    mine.set(name, now[None], env_ids=[row])
                    values[row] = now
        self._group.reset(env_ids=[row])
        for mine, other in zip(self._group.actuators, group.actuators, strict=True):
            if isinstance(mine, DelayedActuator) and isinstance(other, DelayedActuator):
                for lags, others in zip(mine.lags, other.lags, strict=True):
                    lags.adopt(row, others)
