"""Effort from a neural network that has seen what a real joint does.

    τ = clip(torque_scale · net(position errors, velocities), DC motor)

The network's inputs are those of `networks.history`; what it puts out goes through the torque–speed
line of `laws.dc_motor`, so that it cannot ask for more than the motor has.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.laws.dc_motor import DcMotorClip
from walkerkit.actuators.laws.law import Law, Target
from walkerkit.actuators.networks.history import History

FloatArray = NDArray[np.float64]


class Forward(Protocol):
    """A network made ready for one shape."""

    def __call__(self, x: FloatArray) -> FloatArray:
        """Outputs (..., 1) for features (..., n_inputs)."""


class LearnedLaw(Law):
    """A network behind a history of position errors and velocities.

    Args:
        parameters: saturation_effort, velocity_limit, effort_limit, (n_joints,) each.
        history: makes the history for a shape.
        network: makes the network ready for a shape.
        torque_scale: effort per unit of what the network puts out [N·m; N].
    """

    takes = frozenset({"position_target"})
    needs = frozenset({"position_target"})

    def __init__(
        self,
        parameters: Mapping[str, FloatArray],
        history: Callable[[tuple[int, ...]], History],
        network: Callable[[tuple[int, ...]], Forward],
        torque_scale: float,
    ):
        super().__init__(parameters)
        self._make_history, self._make_network = history, network
        self._torque_scale = torque_scale

    def _allocate(self, shape: tuple[int, ...]) -> None:
        self._history = self._make_history(shape)
        self._forward = self._make_network(shape)
        self._scratch = np.empty(shape)

    def _refresh(self) -> None:
        p = self._parameters
        self._clip = DcMotorClip(
            p["saturation_effort"], p["velocity_limit"], p["effort_limit"], self._shape
        )

    def reset(self, rows: NDArray[np.intp] | None) -> None:
        """As in `Law`."""
        self._history.reset(rows)
        reset = getattr(self._forward, "reset", None)
        if reset is not None:
            reset(rows)

    def effort(
        self, position: Target, velocity: Target, effort: Target, q: FloatArray, qd: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """As in `Law`."""
        del velocity, effort
        error = np.subtract(position, q, out=self._scratch)  # type: ignore[arg-type]
        features = self._history.push(error, qd)
        computed = self._forward(features)[..., 0] * self._torque_scale
        return computed, self._clip(computed, qd)
