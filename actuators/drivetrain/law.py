"""A drivetrain law: a pure change of target, effort or friction before each physics step.

    law = StribeckFriction(joint_names_expr=(".*_knee",), breakaway=0.3, velocity=0.05)

Laws run in three stages, each over arrays `(..., n_joints)`: those of the controller change the
target, those of the drive its effort, those of the joint its friction. What a law adds shows in the
effort that a drive reports only where it says so.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.fields import names
from walkerkit.actuators.selection import Numbers, per_joint

FloatArray = NDArray[np.float64]
Stage = Literal["controller", "drive", "joint"]


@dataclass(kw_only=True, eq=False)
class Step:
    """One physics step at n joints, as the laws find and leave it; arrays (..., n_joints).

    Attributes:
        dt: length of the step [s].
        time: since the start, () or (n_sims, 1) [s].
        q: positions [rad; m].
        qd: velocities [rad/s; m/s].
        stiffness: kp of the drive, 0 where it follows no position [N·m/rad; N/m].
        damping: kd of the drive [N·m·s/rad; N·s/m].
        limit: the drive's effort limit [N·m; N], infinite where it has none.
        target: position target [rad; m]; laws of the controller replace it.
        effort: effort of the drive, as it would report it [N·m; N]; laws of the drive replace it.
        extra: effort at the joint besides, which no drive reports [N·m; N].
        friction: dry friction besides what the model has [N·m; N].
    """

    dt: float
    time: FloatArray
    q: FloatArray
    qd: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    limit: FloatArray
    target: FloatArray
    effort: FloatArray
    extra: FloatArray
    friction: FloatArray


Parameters = Mapping[str, FloatArray]
State = dict[str, FloatArray]


@dataclass(frozen=True, kw_only=True)
class DrivetrainLaw(abc.ABC):
    """A law of some joints; its other fields are its parameters, one number per joint each.

    Attributes:
        joint_names_expr: full-match regular expressions of the joints that have it.
    """

    name: ClassVar[str]
    stage: ClassVar[Stage]
    state: ClassVar[tuple[str, ...]] = ()
    """Names of what it remembers from step to step; NaN where nothing has happened yet."""
    neutral: ClassVar[Mapping[str, float]]
    """Parameters at which it does nothing; those after the first `sizes` are idle there."""
    sizes: ClassVar[int] = 1

    joint_names_expr: tuple[str, ...] = names()

    def __post_init__(self) -> None:
        for item in fields(self):
            if "check" in item.metadata:
                value = item.metadata["check"](item.name, getattr(self, item.name))
                object.__setattr__(self, item.name, value)

    @staticmethod
    @abc.abstractmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """Changes the step.

        Args:
            step: written to.
            p: parameters, (n_joints,) or (n_sims, n_joints) each.
            state: what it remembers, (..., n_joints) each, written to.
        """

    @classmethod
    def parameter_names(cls) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(item.name for item in fields(cls) if item.name != "joint_names_expr")

    def numbers(self, joints: tuple[str, ...]) -> dict[str, FloatArray]:
        """Its parameters, one number for each of these joints."""
        values: dict[str, Numbers] = {name: getattr(self, name) for name in self.parameter_names()}
        return {name: per_joint(value, joints, field=name) for name, value in values.items()}


def first(remembered: FloatArray, now: FloatArray) -> FloatArray:
    """What is remembered, or the present value where nothing is yet."""
    return np.where(np.isnan(remembered), now, remembered)


def lagged(
    remembered: FloatArray, now: FloatArray, dt: float, time_constant: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What a first-order filter makes of an input that is held for a step.

    Args:
        remembered: where it stands, NaN where it has not begun.
        now: the input, in any unit.
        dt: the step [s].
        time_constant: T [s]; without one the input passes.

    Returns:
        Its mean over the step, which joins the unfiltered input smoothly as T goes to 0, and where
        it stands at the end.
    """
    ratio = np.maximum(time_constant, 1e-9) / dt
    behind = first(remembered, now) - now
    left = np.exp(-1.0 / ratio)
    return now + behind * (ratio * (1.0 - left)), now + behind * left
