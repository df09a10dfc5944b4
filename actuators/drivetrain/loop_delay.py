"""The time that a control loop takes from its measurements to its effort."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain.law import (
    SOON,
    DrivetrainLaw,
    FloatArray,
    Parameters,
    Stage,
    State,
    Step,
)
from walkerkit.actuators.fields import number
from walkerkit.actuators.selection import Numbers


@dataclass(frozen=True, kw_only=True)
class LoopDelay(DrivetrainLaw):
    """Effort that comes late, what is fed back included: τ(t − d).

    Between steps it is interpolated linearly; before the first it was as in the first. Of each
    joint it remembers the efforts of as many steps as the longest delay spans, the latest first,
    and what of them the targets asked for.

    Attributes:
        delay: d [s].
    """

    name: ClassVar[str] = "loop_delay"
    stage: ClassVar[Stage] = "drive"
    state: ClassVar[tuple[str, ...]] = ("effort", "asked")
    neutral: ClassVar[Mapping[str, float]] = {"delay": 0.0}
    delay: Numbers = number(at_least=0)

    @classmethod
    def depth(cls, p: Parameters, dt: float) -> int | None:
        """As in `DrivetrainLaw`."""
        return int(np.ceil(p["delay"].max() / dt)) + 2

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        efforts, asked = state["effort"], state["asked"]
        for history, latest in ((efforts, step.effort), (asked, step.stiffness * step.target)):
            history[..., 1:] = history[..., :-1]
            history[..., 0] = latest
            if np.isnan(history[..., -1]).any():
                history[...] = np.where(np.isnan(history), latest[..., None], history)
        age = np.broadcast_to(p["delay"] / step.dt, step.effort.shape)
        whole = age.astype(np.intp)[..., None]
        part = age - whole[..., 0]
        newer, older = _then(efforts, whole), _then(efforts, whole + 1)
        step.effort = newer + part * (older - newer)
        # At its beginning a step still has the target of a whole step before.
        still = (1.0 - part) * (_then(asked, whole + 1) - _then(asked, whole))
        prompt = np.where(age < SOON, step.effort_ahead, 0.0)
        step.effort_ahead = np.where(part > SOON, still, prompt)


def _then(history: FloatArray, age: NDArray[np.intp]) -> FloatArray:
    return np.take_along_axis(history, age, axis=-1)[..., 0]
