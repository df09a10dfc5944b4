"""The controller in the drive: what becomes of targets and of feedback."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from walkerkit.actuators.drivetrain.law import (
    DrivetrainLaw,
    Parameters,
    Stage,
    State,
    Step,
    first,
    lagged,
)
from walkerkit.actuators.fields import number
from walkerkit.actuators.selection import Numbers

_SAME_INSTANT = (
    1e-9  # s; a sample that is due at a step's own instant is taken, whatever the rounding
)


@dataclass(frozen=True, kw_only=True)
class SetpointFilter(DrivetrainLaw):
    """Targets that pass a first-order filter.

    Attributes:
        time_constant: T [s].
    """

    name: ClassVar[str] = "setpoint_filter"
    stage: ClassVar[Stage] = "controller"
    state: ClassVar[tuple[str, ...]] = ("target",)
    neutral: ClassVar[Mapping[str, float]] = {"time_constant": 0.0}
    time_constant: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.target, state["target"] = lagged(
            state["target"], step.target, step.dt, p["time_constant"]
        )


@dataclass(frozen=True, kw_only=True)
class SlewLimit(DrivetrainLaw):
    """Targets that move no faster than r.

    Attributes:
        rate: r [rad/s; m/s].
    """

    name: ClassVar[str] = "slew_limit"
    stage: ClassVar[Stage] = "controller"
    state: ClassVar[tuple[str, ...]] = ("target",)
    neutral: ClassVar[Mapping[str, float]] = {"rate": 1e9}
    rate: Numbers = number(above=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        before = first(state["target"], step.target)
        most = p["rate"] * step.dt
        step.target = before + np.clip(step.target - before, -most, most)
        state["target"] = step.target


@dataclass(frozen=True, kw_only=True)
class SampleAndHold(DrivetrainLaw):
    """Targets that the drive takes up every T only.

    Attributes:
        period: T [s]; 0 takes up every one.
    """

    name: ClassVar[str] = "sample_and_hold"
    stage: ClassVar[Stage] = "controller"
    state: ClassVar[tuple[str, ...]] = ("target", "next")
    neutral: ClassVar[Mapping[str, float]] = {"period": 0.0}
    period: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        due = first(state["next"], step.time) <= step.time + _SAME_INSTANT
        step.target = np.where(due, step.target, state["target"])
        state["target"] = step.target
        late = first(state["next"], step.time)
        state["next"] = np.where(due, np.maximum(late, step.time - p["period"]) + p["period"], late)


@dataclass(frozen=True, kw_only=True)
class ControllerDeadband(DrivetrainLaw):
    """A controller that leaves position errors below δ alone.

    Attributes:
        width: δ [rad; m].
    """

    name: ClassVar[str] = "controller_deadband"
    stage: ClassVar[Stage] = "controller"
    neutral: ClassVar[Mapping[str, float]] = {"width": 0.0}
    width: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.target = np.where(np.abs(step.target - step.q) < p["width"], step.q, step.target)


@dataclass(frozen=True, kw_only=True)
class IntegralAction(DrivetrainLaw):
    """An integrator beside the PD control: ki ∫(u − q) dt, held within its clamp.

    Attributes:
        gain: ki [N·m/(rad·s); N/(m·s)].
        clamp: the most that it adds [N·m; N].
    """

    name: ClassVar[str] = "integral_action"
    stage: ClassVar[Stage] = "drive"
    state: ClassVar[tuple[str, ...]] = ("effort",)
    neutral: ClassVar[Mapping[str, float]] = {"gain": 0.0, "clamp": 1e9}
    gain: Numbers = number(at_least=0)
    clamp: Numbers = number(default=1e9, above=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        before = np.where(np.isnan(state["effort"]), 0.0, state["effort"])
        error = np.where(step.stiffness > 0, step.target - step.q, 0.0)
        added = np.clip(before + p["gain"] * error * step.dt, -p["clamp"], p["clamp"])
        state["effort"] = added
        step.effort = np.clip(step.effort + added, -step.limit, step.limit)


@dataclass(frozen=True, kw_only=True)
class VelocityFilter(DrivetrainLaw):
    """Damping that acts on a filtered velocity: kd (q̇ − q̇ filtered) is missing from it.

    Attributes:
        time_constant: T of the first-order filter [s].
    """

    name: ClassVar[str] = "velocity_filter"
    stage: ClassVar[Stage] = "drive"
    state: ClassVar[tuple[str, ...]] = ("qd",)
    neutral: ClassVar[Mapping[str, float]] = {"time_constant": 0.0}
    time_constant: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        filtered, state["qd"] = lagged(state["qd"], step.qd, step.dt, p["time_constant"])
        step.effort = np.clip(
            step.effort + step.damping * (step.qd - filtered), -step.limit, step.limit
        )
