"""An effect of the motors: their iron saturates, so that much current makes less than its share.

The drives reckon the effort that they report from the current, and so do not see it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from walkerkit.actuators import DrivetrainLaw, Numbers, Step, number
from walkerkit.gap.effects import LawEffect, Parameter, Robot

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class IronSaturation(DrivetrainLaw):
    """Of the effort τ that the drive reports, τ / √(1 + (b τ)²) reaches the joint.

    Attributes:
        bend: b, one over the effort of which 71 % are left [1/(N·m)].
    """

    name = "iron_saturation"
    stage = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"bend": 0.0}
    bend: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Mapping[str, FloatArray], state: dict[str, FloatArray]) -> None:
        """Takes away what the iron loses; all arrays are (..., n_joints) [N·m]."""
        step.extra += step.effort / np.sqrt(1.0 + (p["bend"] * step.effort) ** 2) - step.effort


class IronSaturationEffect(LawEffect):
    """Iron that saturates: the motor's torque constant falls with the current."""

    law = IronSaturation
    driven = True
    name = "iron_saturation"
    part = "strength"
    equation = "τ / √(1 + (b τ)²), b: bend [1/(N·m)]; the log shows τ"
    symptom = "grows with the cube of the effort"
    source = "a curve of our own, of slope 1 at rest, that levels off as the iron fills"

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The bend, of a size that shows at the efforts of the log."""
        size = 0.3 / robot.excursion(site).effort
        return (
            Parameter(
                name="bend",
                unit="1/(N·m)",
                zero=self.known(robot, site)["bend"],
                lower=0.0,
                upper=20 * size,
                scale=size,
                starts=(size, 3 * size),
                inverse=("saturation_effort", "N·m"),
            ),
        )
