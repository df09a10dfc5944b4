"""The world around the robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from walkerkit.gap.effects.base import EVERYWHERE, Effect, FloatArray, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_MOST = 0.35  # rad; nobody overlooks twenty degrees


class BaseTilt(Effect):
    """The base is not mounted level, so that gravity points elsewhere in its frame."""

    name = "base_tilt"
    equation = "g rotated by roll about x and pitch about y of the world frame [rad]"
    symptom = "sin(q + δ), all joints"
    added_as = "option/gravity"
    source = "MuJoCo XML reference, option/gravity"
    kind = "robot"

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """The robot as a whole, where there is gravity."""
        return (EVERYWHERE,) if np.any(robot.model.opt.gravity) else ()

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Roll and pitch."""
        return tuple(
            Parameter(
                name=name,
                unit="rad",
                lower=-_MOST,
                upper=_MOST,
                scale=0.03,
                starts=tuple(0.06 * np.asarray(signs, dtype=float)),
            )
            for name, signs in (("roll", (1, -1, 0, 0)), ("pitch", (0, 0, 1, -1)))
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Rotates `opt.gravity` by roll, then pitch."""
        gravity = trials.field("opt.gravity")
        x, y, z = gravity.T.copy()
        (sr, sp), (cr, cp) = np.sin(values.T), np.cos(values.T)
        y, z = cr * y - sr * z, sr * y + cr * z
        x, z = cp * x + sp * z, cp * z - sp * x
        gravity[...] = np.stack([x, y, z], axis=1)
