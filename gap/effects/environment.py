"""What the robot is mounted on and runs into."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from walkerkit.gap.effects.base import EVERYWHERE, Effect, FloatArray, JointEffect, Parameter
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


_HARDEST = 2.0  # timesteps; MuJoCo's constraints are no faster


class EndStop(JointEffect):
    """The joint runs into a stop where its model moves freely, or not yet."""

    name = "end_stop"
    equation = "lower ≤ q ≤ upper [rad], held by a damped spring that gives way with timeconst [s]"
    symptom = "at the limits"
    added_as = "joint range, solreflimit"
    source = "MuJoCo XML reference, joint/range; computation chapter, solver parameters"

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Both stops, unchanged far outside or where the model has them, and how hard they are."""
        joint, excursion = robot.joints[site], robot.excursion(site)
        low, high, width = excursion.lower, excursion.upper, excursion.range
        known = (low - width, high + width)
        if robot.model.jnt_limited[joint.id]:
            known = tuple(map(float, robot.model.jnt_range[joint.id]))
        unit = "m" if joint.slide else "rad"
        hardest = _HARDEST * float(robot.model.opt.timestep)
        softness = max(float(robot.model.jnt_solref[joint.id, 0]), hardest)
        near, nearer = 0.02 * width, 0.1 * width
        return (
            Parameter(
                name="lower",
                unit=unit,
                zero=known[0],
                lower=min(known[0], low - width),
                upper=max(known[0], low + 0.45 * width),
                scale=near,
                starts=(low + near, low + near, known[0], low + nearer),
            ),
            Parameter(
                name="upper",
                unit=unit,
                zero=known[1],
                lower=min(known[1], high - 0.45 * width),
                upper=max(known[1], high + width),
                scale=near,
                starts=(high - near, known[1], high - near, high - nearer),
            ),
            Parameter(
                name="timeconst",
                unit="s",
                zero=softness,
                lower=hardest,
                upper=max(0.1, 2 * softness),
                scale=0.25 * softness,
                starts=(softness,) * 4,
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Sets `jnt_range` and `jnt_solref`, and switches the limit on where it was moved."""
        robot, joint = trials.robot, trials.robot.joints[site]
        lower, upper, softness = self.parameters(robot, site)
        moved = values[:, :2] != [lower.zero, upper.zero]
        some = moved.any(axis=1)
        limited, span = trials.field("jnt_limited"), trials.field("jnt_range")[:, joint.id]
        # A stop that was not moved stays where it is, be it that other effects have moved it.
        own = np.where(limited[:, [joint.id]], span, values[:, :2])
        span[some] = np.where(moved, values[:, :2], own)[some]
        limited[some, joint.id] = True
        solref = trials.field("jnt_solref")[:, joint.id]
        changed = values[:, 2] != softness.zero
        solref[changed] = np.stack([values[:, 2], np.ones(trials.n)], axis=1)[changed]
