"""Proportional-derivative control with feed-forward effort.

τ = kp (q* − q) + kd (q̇* − q̇) + τ*,   |τ| ≤ effort_limit
"""

from __future__ import annotations

import abc
from collections.abc import Mapping

import numpy as np
from numpy import multiply, subtract  # looked up before every physics step
from numpy.typing import NDArray

from walkerkit.actuators.laws.law import Law, Target

FloatArray = NDArray[np.float64]


def pd_effort(
    position: Target,
    velocity: Target,
    effort: Target,
    q: FloatArray,
    qd: FloatArray,
    stiffness: FloatArray,
    damping: FloatArray,
    scratch: FloatArray | None = None,
    against: FloatArray | None = None,
) -> FloatArray:
    """Effort of a PD controller, a new array (..., n_joints) [N·m; N].

    Args:
        position: target [rad; m]; None asks for no position, and kp does nothing.
        velocity: target [rad/s; m/s]; None stands for zero.
        effort: feed-forward [N·m; N]; None stands for zero.
        q: position [rad; m].
        qd: velocity [rad/s; m/s].
        stiffness: kp [N·m/rad; N/m].
        damping: kd [N·m·s/rad; N·s/m].
        scratch: memory of the result's shape to work in, if any.
        against: −kd, where it is at hand.
    """
    if velocity is None:
        total: FloatArray = multiply(-damping if against is None else against, qd)
    else:
        total = subtract(velocity, qd)
        total *= damping
    if position is not None:
        spring = subtract(position, q, scratch)
        spring *= stiffness
        total += spring
    if effort is not None:
        total += effort
    return total


def clipped(effort: FloatArray, limit: FloatArray) -> FloatArray:
    """The effort within ±limit, a new array."""
    out: FloatArray = np.minimum(effort, limit)
    return np.maximum(out, -limit, out=out)


class PdBase(Law):
    """PD control; subclasses say what limits it. Has parameters stiffness and damping at least."""

    def __init__(self, parameters: Mapping[str, FloatArray]):
        super().__init__(parameters)
        if self._parameters["stiffness"].any():
            self.needs = frozenset({"position_target"})

    def _allocate(self, shape: tuple[int, ...]) -> None:
        self._scratch = np.empty(shape)

    def _refresh(self) -> None:
        self._against = -self._parameters["damping"]

    def effort(
        self, position: Target, velocity: Target, effort: Target, q: FloatArray, qd: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """As in `Law`."""
        kp, kd = self._parameters["stiffness"], self._parameters["damping"]
        computed = pd_effort(
            position, velocity, effort, q, qd, kp, kd, self._scratch, self._against
        )
        return computed, self._limited(computed, q, qd)

    @abc.abstractmethod
    def _limited(self, effort: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        """What the limits leave of the effort, a new array."""


class PdLaw(PdBase):
    """PD control within a constant limit; parameters stiffness, damping, effort_limit."""

    joinable = True

    def _limited(self, effort: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        return clipped(effort, self._parameters["effort_limit"])
