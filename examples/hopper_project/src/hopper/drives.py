"""The drives: a position loop around a velocity loop, as ODrive and others have it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from walkerkit.actuators import IdealPdActuatorCfg, Law, Numbers, PdLaw, number, pd_parameters

FloatArray = NDArray[np.float64]


class CascadeLaw(PdLaw):
    """PD control whose position loop asks for no more speed than `velocity_limit`.

    τ = kd (clip(kp/kd (q* − q) + q̇*, ±velocity_limit) − q̇) + τ*,   |τ| ≤ effort_limit
    """

    def effort(
        self,
        position: FloatArray | None,
        velocity: FloatArray | None,
        effort: FloatArray | None,
        q: FloatArray,
        qd: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """The effort [N·m] that it asks for, and what its limits leave of it.

        Args:
            position: position targets (..., n_joints) [rad], or None.
            velocity: velocity targets (..., n_joints) [rad/s], or None for zero.
            effort: effort targets (..., n_joints) [N·m], or None for zero.
            q: positions (..., n_joints) [rad].
            qd: velocities (..., n_joints) [rad/s].
        """
        kp, kd, fastest = (self.get(name) for name in ("stiffness", "damping", "velocity_limit"))
        speed = np.zeros_like(q) if velocity is None else velocity
        if position is not None:
            speed = speed + kp / kd * (position - q)
        asked = kd * (np.clip(speed, -fastest, fastest) - qd)
        if effort is not None:
            asked = asked + effort
        most = self.get("effort_limit")
        return asked, np.clip(asked, -most, most)


@dataclass(frozen=True, kw_only=True)
class CascadeActuatorCfg(IdealPdActuatorCfg):
    """Config of a cascade: what `IdealPdActuatorCfg` has, and the limit between the loops.

    Attributes:
        damping: kd, the gain of the velocity loop, above 0 [N·m·s/rad].
        velocity_limit: the most speed that the position loop asks for [rad/s].
    """

    damping: Numbers = number(above=0)
    velocity_limit: Numbers = number(above=0)

    def law(self, numbers: Mapping[str, FloatArray]) -> Law:
        """The law of its joints, of the config's numbers, (n_joints,) each."""
        return CascadeLaw({**pd_parameters(numbers), "velocity_limit": numbers["velocity_limit"]})
