"""The drive: what becomes of the effort that its control law asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from walkerkit.actuators.config_fields import number
from walkerkit.actuators.drivetrain.drivetrain_law import (
    DrivetrainLaw,
    FloatArray,
    Lag,
    Parameters,
    Stage,
    State,
    Step,
    clipped,
)
from walkerkit.actuators.selection import Numbers


@dataclass(frozen=True, kw_only=True)
class SupplyVoltage(DrivetrainLaw):
    """What the drive makes goes with the supply's voltage: τ (1 + w (V/V₀ − 1)).

    With a share w of 1 that is τ V/V₀, of a drive that does not correct for its supply. Its limits
    are lower by as much. Where no voltage is known it is V₀.

    Attributes:
        share: w [1].
        nominal: V₀, at which the drive makes what it is asked for [V].
    """

    name: ClassVar[str] = "supply_voltage"
    stage: ClassVar[Stage] = "drive"
    neutral: ClassVar[Mapping[str, float]] = {"share": 0.0, "nominal": 1.0}
    share: Numbers = number()
    nominal: Numbers = number(above=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        known = np.isfinite(step.voltage)
        off = np.where(known, np.where(known, step.voltage, 0.0) / p["nominal"] - 1.0, 0.0)
        step.supply = 1.0 + p["share"] * off
        _scale(step, step.supply)


@dataclass(frozen=True, kw_only=True)
class TorqueSpeedLimit(DrivetrainLaw):
    """The torque–speed line of a DC motor: τ between S (−1 − q̇/V) and S (1 − q̇/V).

    Both S and V go with the voltage of the supply, where a law says so.

    Attributes:
        saturation_effort: S, at standstill [N·m; N].
        velocity_limit: V, without load [rad/s; m/s].
    """

    name: ClassVar[str] = "torque_speed_limit"
    stage: ClassVar[Stage] = "drive"
    neutral: ClassVar[Mapping[str, float]] = {"saturation_effort": 1e9, "velocity_limit": 1e9}
    sizes: ClassVar[int] = 2
    saturation_effort: Numbers = number(above=0)
    velocity_limit: Numbers = number(above=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        lost = p["saturation_effort"] * (step.qd / p["velocity_limit"])
        stall = p["saturation_effort"] * step.supply
        # Faster than V it can only brake, by no more than its stall torque.
        high = clipped(stall - lost, -stall, stall)
        low = clipped(-stall - lost, -stall, stall)
        _limit(step, low, high)


@dataclass(frozen=True, kw_only=True)
class ActuatorLag(Lag):
    """Effort that follows what is asked for with a first-order lag, as through an inductance.

    Attributes:
        time_constant: T [s].
    """

    name: ClassVar[str] = "actuator_lag"
    stage: ClassVar[Stage] = "drive"
    state: ClassVar[tuple[str, ...]] = ("effort",)
    neutral: ClassVar[Mapping[str, float]] = {"time_constant": 0.0}
    time_constant: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.effort, step.effort_ahead, state["effort"] = ActuatorLag.lagged(
            state["effort"], step.effort, step.effort_ahead, p
        )


@dataclass(frozen=True, kw_only=True)
class TorqueRipple(DrivetrainLaw):
    """Effort that pulses with the pose, in proportion to itself: τ (1 + A sin(N q + φ)).

    The drive reports τ.

    Attributes:
        amplitude: A [1].
        periods: N, per radian or metre of the joint.
        phase: φ [rad].
    """

    name: ClassVar[str] = "torque_ripple"
    stage: ClassVar[Stage] = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"amplitude": 0.0, "periods": 1.0, "phase": 0.0}
    amplitude: Numbers = number(at_least=0)
    periods: Numbers = number(above=0)
    phase: Numbers = number(default=0.0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        wave = np.sin(p["periods"] * step.q + p["phase"])
        step.extra += p["amplitude"] * wave * step.effort


@dataclass(frozen=True, kw_only=True)
class Cogging(DrivetrainLaw):
    """Effort of the magnets that comes back with the pose: A sin(N q + φ).

    Attributes:
        amplitude: A [N·m; N].
        periods: N, per radian or metre of the joint.
        phase: φ [rad].
    """

    name: ClassVar[str] = "cogging"
    stage: ClassVar[Stage] = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"amplitude": 0.0, "periods": 1.0, "phase": 0.0}
    amplitude: Numbers = number(at_least=0)
    periods: Numbers = number(above=0)
    phase: Numbers = number(default=0.0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.extra += p["amplitude"] * np.sin(p["periods"] * step.q + p["phase"])


@dataclass(frozen=True, kw_only=True)
class StrengthDrift(DrivetrainLaw):
    """A drive that weakens as it warms up: τ (1 − γ t). It goes on reporting τ.

    Attributes:
        rate: γ [1/s].
    """

    name: ClassVar[str] = "strength_drift"
    stage: ClassVar[Stage] = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"rate": 0.0}
    rate: Numbers = number()

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.extra -= np.minimum(p["rate"] * step.time, 1.0) * step.effort


@dataclass(frozen=True, kw_only=True)
class SupplySag(DrivetrainLaw):
    """Limits that fall with the power that all joints draw: F (1 − c Σ|τ q̇|).

    Attributes:
        sag: c, part of the limit lost per watt [1/W].
    """

    name: ClassVar[str] = "supply_sag"
    stage: ClassVar[Stage] = "drive"
    neutral: ClassVar[Mapping[str, float]] = {"sag": 0.0}
    sag: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        power = np.abs(step.effort * step.qd).sum(axis=-1, keepdims=True)
        left = np.maximum(1.0 - p["sag"] * power, 0.0)
        # Where there is no limit there is none to fall; 0 · ∞ would say otherwise.
        falls = np.isfinite(step.limit) & (p["sag"] > 0)
        limit = np.where(falls, np.where(falls, step.limit, 0.0) * left, np.inf)
        _limit(step, -limit, limit)


@dataclass(frozen=True, kw_only=True)
class QuadraticDrag(DrivetrainLaw):
    """Drag that grows with the square of speed: −b₂ q̇|q̇|.

    Attributes:
        drag: b₂ [N·m·s²/rad²; N·s²/m²].
    """

    name: ClassVar[str] = "quadratic_drag"
    stage: ClassVar[Stage] = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"drag": 0.0}
    drag: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.extra -= p["drag"] * step.qd * np.abs(step.qd)


def _scale(step: Step, factor: FloatArray) -> None:
    step.effort = step.effort * factor
    if step.effort_ahead.any():
        step.effort_ahead = step.effort_ahead * factor


def _limit(step: Step, low: FloatArray, high: FloatArray) -> None:
    effort = clipped(step.effort, low, high)
    if step.effort_ahead.any():
        start = step.effort + step.effort_ahead
        limited = clipped(start, low, high)
        same = (limited == start) & (effort == step.effort)
        step.effort_ahead = np.where(same, step.effort_ahead, limited - effort)
    step.effort = effort
