"""The time that a control loop takes from its measurements to its effort."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from walkerkit.actuators.drivetrain.law import DrivetrainLaw, Parameters, Stage, State, Step
from walkerkit.actuators.fields import number
from walkerkit.actuators.selection import Numbers


@dataclass(frozen=True, kw_only=True)
class LoopDelay(DrivetrainLaw):
    """Effort that comes late, what is fed back included: τ(t − d).

    Between steps it is interpolated linearly; before the first it was as in the first. Of each
    joint it remembers the efforts of as many steps as the longest delay spans, the latest first.

    Attributes:
        delay: d [s].
    """

    name: ClassVar[str] = "loop_delay"
    stage: ClassVar[Stage] = "drive"
    state: ClassVar[tuple[str, ...]] = ("effort",)
    neutral: ClassVar[Mapping[str, float]] = {"delay": 0.0}
    delay: Numbers = number(at_least=0)

    @classmethod
    def depth(cls, p: Parameters, dt: float) -> int | None:
        """As in `DrivetrainLaw`."""
        return int(np.ceil(p["delay"].max() / dt)) + 2

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        history = state["effort"]
        history[..., 1:] = history[..., :-1]
        history[..., 0] = step.effort
        if np.isnan(history[..., -1]).any():
            history[...] = np.where(np.isnan(history), step.effort[..., None], history)
        age = np.broadcast_to(p["delay"] / step.dt, step.effort.shape)
        whole = age.astype(np.intp)
        part = age - whole
        newer = np.take_along_axis(history, whole[..., None], axis=-1)[..., 0]
        older = np.take_along_axis(history, whole[..., None] + 1, axis=-1)[..., 0]
        step.effort = newer + part * (older - newer)
