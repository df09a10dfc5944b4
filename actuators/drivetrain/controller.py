"""The controller in the drive: what becomes of targets and of feedback."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from walkerkit.actuators.config_fields import number
from walkerkit.actuators.drivetrain.drivetrain_law import (
    SOON,
    DrivetrainLaw,
    Lag,
    Parameters,
    Stage,
    State,
    Step,
    clipped,
    first,
)
from walkerkit.actuators.selection import Numbers

_SAME_INSTANT = (
    1e-9  # s; a sample that is due at a step's own instant is taken, whatever the rounding
)
_STANDSTILL = 1e-12  # rad; less than that is no way to go


@dataclass(frozen=True, kw_only=True)
class SetpointFilter(Lag):
    """Targets that pass a first-order filter.

    Attributes:
        time_constant: T [s].
    """

    name: ClassVar[str] = "setpoint_filter"
    stage: ClassVar[Stage] = "controller"
    state: ClassVar[tuple[str, ...]] = ("target",)
    neutral: ClassVar[Mapping[str, float]] = {"time_constant": 0.0}
    targets_only: ClassVar[bool] = True
    time_constant: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.target, step.target_ahead, state["target"] = SetpointFilter.lagged(
            state["target"], step.target, step.target_ahead, p
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
    targets_only: ClassVar[bool] = True
    rate: Numbers = number(above=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        before = first(state["target"], step.target)
        most = p["rate"] * step.dt
        way = step.target - before
        # Exactly where it is wanted, where that is near enough.
        reached = before + clipped(way, -most, most)
        step.target = np.where(np.abs(way) <= most, step.target, reached)
        step.target_ahead = np.where(np.abs(way) < most, step.target_ahead, 0.0)
        state["target"] = step.target


@dataclass(frozen=True, kw_only=True)
class SampleAndHold(DrivetrainLaw):
    """Targets that the drive takes up every T only, at multiples of it.

    Where that is within a step, the step has the mean of the target before and the one after.

    Attributes:
        period: T [s]; 0 takes up every one.
    """

    name: ClassVar[str] = "sample_and_hold"
    stage: ClassVar[Stage] = "controller"
    state: ClassVar[tuple[str, ...]] = ("target",)
    neutral: ClassVar[Mapping[str, float]] = {"period": 0.0}
    targets_only: ClassVar[bool] = True
    period: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        period = np.maximum(p["period"], _SAME_INSTANT)
        held = first(state["target"], step.target)
        instant = np.ceil((step.time - _SAME_INSTANT) / period) * period
        # The part of the step before it; all of it where there is none in this step.
        before = (instant - step.time) / step.dt
        same = _SAME_INSTANT / step.dt
        before = np.where(before < same, 0.0, np.where(before > 1.0 - same, 1.0, before))
        state["target"] = np.where(before < 1.0, step.target, held)
        mean = (1.0 - before) * step.target + before * held
        prompt = (step.target - mean) + step.target_ahead
        step.target_ahead = np.where(before > SOON, held - mean, prompt)
        step.target = mean


@dataclass(frozen=True, kw_only=True)
class ControllerDeadband(DrivetrainLaw):
    """A controller that leaves position errors below δ alone.

    A joint that passes the edge of the band within a step is left alone for that part of it.

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
        error = step.target - step.q
        later = error - step.qd * step.dt
        low, high = np.minimum(error, later), np.maximum(error, later)
        within = np.minimum(high, p["width"]) - np.maximum(low, -p["width"])
        # A joint that stands still goes no way, all of it within or none.
        part = (within + _STANDSTILL) / (high - low + _STANDSTILL)
        lost = clipped(part, 0.0, 1.0) * error
        start = error + step.target_ahead
        step.target_ahead = step.target_ahead + (
            lost - np.where(np.abs(start) < p["width"], start, 0.0)
        )
        step.target = step.target - lost


@dataclass(frozen=True, kw_only=True)
class IntegralAction(DrivetrainLaw):
    """An integrator beside the PD control: ki ∫(u − q) dt, held within its clamp.

    Beyond the drive's own limit it does not wind up either.

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
        most = np.minimum(p["clamp"], step.limit)
        added = clipped(before + p["gain"] * error * step.dt, -most, most)
        state["effort"] = added
        step.effort = clipped(step.effort + added, -step.limit, step.limit)


@dataclass(frozen=True, kw_only=True)
class VelocityFilter(Lag):
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
        filtered, _, state["qd"] = VelocityFilter.lagged(state["qd"], step.qd, 0.0, p)
        step.effort = clipped(
            step.effort + step.damping * (step.qd - filtered), -step.limit, step.limit
        )
