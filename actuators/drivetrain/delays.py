"""The time that commands take to the drive, and that its control loop takes to an effort.

Between steps both are interpolated linearly, as MuJoCo's own delay is; before the first step all
was as in the first. Of each joint as many steps are remembered as the longest delay spans, the
latest first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.config_fields import number
from walkerkit.actuators.drivetrain.drivetrain_law import (
    SOON,
    DrivetrainLaw,
    FloatArray,
    Parameters,
    Stage,
    State,
    Step,
)
from walkerkit.actuators.selection import Numbers


class _Delay(DrivetrainLaw):
    """A law of one `delay` [s]."""

    @classmethod
    def depth(cls, p: Parameters, dt: float) -> int | None:
        """As in `DrivetrainLaw`."""
        return int(np.ceil(p["delay"].max() / dt)) + 2


@dataclass(frozen=True, kw_only=True)
class CommandDelay(_Delay):
    """Targets that come late: u(t − d).

    An actuator's own `delay` in MJCF does the same to what these laws have made of a target
    already; this one comes before all others, as on its way to the drive.

    Attributes:
        delay: d [s].
    """

    name: ClassVar[str] = "command_delay"
    stage: ClassVar[Stage] = "controller"
    state: ClassVar[tuple[str, ...]] = ("target",)
    neutral: ClassVar[Mapping[str, float]] = {"delay": 0.0}
    targets_only: ClassVar[bool] = True
    delay: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        targets = state["target"] = _remembered(state["target"], step.target)
        whole, part = _age(p, step)
        newer, older = _then(targets, whole), _then(targets, whole + 1)
        step.target = newer + part * (older - newer)
        step.target_ahead = np.where(p["delay"] > 0, 0.0, step.target_ahead)


@dataclass(frozen=True, kw_only=True)
class LoopDelay(_Delay):
    """Effort that comes late, what is fed back included: τ(t − d).

    Attributes:
        delay: d [s].
    """

    name: ClassVar[str] = "loop_delay"
    stage: ClassVar[Stage] = "drive"
    state: ClassVar[tuple[str, ...]] = ("effort", "asked")
    neutral: ClassVar[Mapping[str, float]] = {"delay": 0.0}
    delay: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        efforts = state["effort"] = _remembered(state["effort"], step.effort)
        asked = state["asked"] = _remembered(state["asked"], step.stiffness * step.target)
        whole, part = _age(p, step)
        newer, older = _then(efforts, whole), _then(efforts, whole + 1)
        step.effort = newer + part * (older - newer)
        # At its beginning a step still has the target of a whole step before.
        still = (1.0 - part) * (_then(asked, whole + 1) - _then(asked, whole))
        prompt = np.where(whole[..., 0] + part < SOON, step.effort_ahead, 0.0)
        step.effort_ahead = np.where(part > SOON, still, prompt)


def _remembered(history: FloatArray, latest: FloatArray) -> FloatArray:
    later = np.concatenate([latest[..., None], history[..., :-1]], axis=-1)
    if np.isnan(later[..., -1]).any():
        later = np.where(np.isnan(later), latest[..., None], later)
    return later


def _age(p: Parameters, step: Step) -> tuple[NDArray[np.intp], FloatArray]:
    """Whole steps of the delay, (..., n_joints, 1), and the part that is left, (..., n_joints)."""
    age = np.broadcast_to(p["delay"] / step.dt, step.target.shape)
    whole = age.astype(np.intp)
    return whole[..., None], age - whole


def _then(history: FloatArray, age: NDArray[np.intp]) -> FloatArray:
    return np.take_along_axis(history, age, axis=-1)[..., 0]
