"""What a vectorised environment asks of a task: numpy functions over all copies at once."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.tasks.vector.copies import Copies

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Function = Callable[[Copies], Any]
"""Of the copies, an array with a row for each, (n_sims, ...)."""


class VectorTask(abc.ABC):
    """Rewards, observations and ends of episodes of one task, for many copies."""

    def edit(self, spec: mujoco.MjSpec, physics: Any) -> None:  # noqa: B027  most add nothing
        """Adds to the model what the task has to know and MuJoCo's batch does not tell.

        Args:
            spec: the model before compilation; its motion is to stay as it is.
            physics: of the composer task.
        """

    @abc.abstractmethod
    def attach(self, copies: Copies) -> None:
        """Makes ready for the copies; called once."""

    @abc.abstractmethod
    def begin(self, row: int) -> None:
        """Keeps what the composer task drew for the episode that begins in one simulation."""

    def observations(self) -> Mapping[str, Function]:
        """What the task observes beside the walker, by the names of composer."""
        return {}

    @abc.abstractmethod
    def reward(self, copies: Copies) -> FloatArray:
        """Of each simulation, (n_sims,)."""

    @abc.abstractmethod
    def terminated(self, copies: Copies) -> BoolArray:
        """The simulations whose episode ends with discount 0, (n_sims,)."""
