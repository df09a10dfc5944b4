"""Friction of the joint, as dry friction that MuJoCo's own constraint solves for, step by step.

A joint that sticks therefore sticks, at any timestep; see MuJoCo's computation chapter on friction
loss for how softly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from walkerkit.actuators.config_fields import number
from walkerkit.actuators.drivetrain.drivetrain_law import (
    DrivetrainLaw,
    Parameters,
    Stage,
    State,
    Step,
)
from walkerkit.actuators.selection import Numbers

_RIGID_STEPS = 4  # MuJoCo's stiffest friction stops a joint within two
_SMALLEST = 1e-12  # rad; bristles without friction do not bend


@dataclass(frozen=True, kw_only=True)
class AsymmetricFriction(DrivetrainLaw):
    """Dry friction Fc⁺ forwards and Fc⁻ backwards.

    It is the mean of both as symmetric friction, and half the difference as a constant effort:
    at rest the joint holds anything between −Fc⁻ and Fc⁺ either way.

    Attributes:
        forward: Fc⁺ [N·m; N].
        backward: Fc⁻ [N·m; N].
    """

    name: ClassVar[str] = "asymmetric_friction"
    stage: ClassVar[Stage] = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"forward": 0.0, "backward": 0.0}
    sizes: ClassVar[int] = 2
    constant: ClassVar[bool] = True
    forward: Numbers = number(at_least=0)
    backward: Numbers = number(at_least=0)

    @classmethod
    def prepared(cls, p: Parameters, dt: float) -> Parameters:
        """As in `DrivetrainLaw`; the mean of both, and half of their difference."""
        mean = 0.5 * (p["forward"] + p["backward"])
        return {**p, "mean": mean, "half": 0.5 * (p["forward"] - p["backward"])}

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.friction += p["mean"]
        step.extra -= p["half"]


@dataclass(frozen=True, kw_only=True)
class StribeckFriction(DrivetrainLaw):
    """More dry friction at low speed: (Fs − Fc) exp(−|q̇/vs|^α), beside the model's Fc.

    Attributes:
        breakaway: Fs − Fc [N·m; N].
        velocity: vs, where it has fallen to 37 % [rad/s; m/s].
        exponent: α; 1 is Tustin's, 2 Gaussian (Armstrong-Hélouvry et al., Automatica 30, 1994).
    """

    name: ClassVar[str] = "stribeck_friction"
    stage: ClassVar[Stage] = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"breakaway": 0.0, "velocity": 1.0, "exponent": 1.0}
    breakaway: Numbers = number(at_least=0)
    velocity: Numbers = number(above=0)
    exponent: Numbers = number(default=1.0, above=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        slowness = (np.abs(step.qd) / p["velocity"]) ** p["exponent"]
        step.friction += p["breakaway"] * np.exp(-slowness)


@dataclass(frozen=True, kw_only=True)
class LoadDependentFriction(DrivetrainLaw):
    """Dry friction in proportion to the load of the gear: μ |τ|.

    Attributes:
        coefficient: μ [1].
    """

    name: ClassVar[str] = "load_dependent_friction"
    stage: ClassVar[Stage] = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"coefficient": 0.0}
    coefficient: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.friction += p["coefficient"] * np.abs(step.effort)


@dataclass(frozen=True, kw_only=True)
class DirectionalEfficiency(DrivetrainLaw):
    """A gear that passes on η₁ τ when it drives, and lets η₂ τ brake when it is driven.

    It is their mean as a factor on the effort, and half their difference as friction in proportion
    to the load: between the two the gear locks.

    Attributes:
        driving: η₁ [1].
        backdriving: η₂ [1], at least η₁.
    """

    name: ClassVar[str] = "directional_efficiency"
    stage: ClassVar[Stage] = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"driving": 1.0, "backdriving": 1.0}
    sizes: ClassVar[int] = 2
    driving: Numbers = number(at_least=0)
    backdriving: Numbers = number(at_least=0)

    @classmethod
    def prepared(cls, p: Parameters, dt: float) -> Parameters:
        """As in `DrivetrainLaw`; the factor on the effort, and that of the friction."""
        gained = 0.5 * (p["driving"] + p["backdriving"]) - 1.0
        lost = np.maximum(0.5 * (p["backdriving"] - p["driving"]), 0.0)
        return {**p, "gained": gained, "lost": lost}

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        step.extra += p["gained"] * step.effort
        step.friction += p["lost"] * np.abs(step.effort)


@dataclass(frozen=True, kw_only=True)
class PoseDependentFriction(DrivetrainLaw):
    """Dry friction that comes back with the pose: A (1 + sin(N q + φ))/2.

    Attributes:
        amplitude: A [N·m; N].
        periods: N, per radian or metre of the joint.
        phase: φ [rad].
    """

    name: ClassVar[str] = "pose_dependent_friction"
    stage: ClassVar[Stage] = "joint"
    neutral: ClassVar[Mapping[str, float]] = {"amplitude": 0.0, "periods": 1.0, "phase": 0.0}
    amplitude: Numbers = number(at_least=0)
    periods: Numbers = number(above=0)
    phase: Numbers = number(default=0.0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        wave = np.sin(p["periods"] * step.q + p["phase"])
        step.friction += 0.5 * p["amplitude"] * (1.0 + wave)


@dataclass(frozen=True, kw_only=True)
class PreslidingFriction(DrivetrainLaw):
    """Bristles that bend before the joint slides: the LuGre model without its viscous terms.

    ż = q̇ − σ₀ |q̇| z/g, τ = −σ₀ z (Canudas de Wit et al., IEEE TAC 40, 1995), where g is all the dry
    friction that the joint has, of the model and of other laws; so Stribeck's makes it LuGre's own.
    Each step is solved exactly for a constant velocity. As a spring that explicit steps integrate,
    it wants σ₀ below I/h², where I is the joint's inertia and h the timestep.

    A joint is rigid in its first steps, until it is at rest where it sticks: what holds it then
    tells how far its bristles are bent.

    Attributes:
        bristle_stiffness: σ₀ [N·m/rad; N/m].
    """

    name: ClassVar[str] = "presliding_friction"
    stage: ClassVar[Stage] = "joint"
    state: ClassVar[tuple[str, ...]] = ("z", "level", "steps")
    reads_held: ClassVar[bool] = True
    neutral: ClassVar[Mapping[str, float]] = {"bristle_stiffness": 1e9}
    bristle_stiffness: Numbers = number(above=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        stiffness = p["bristle_stiffness"]
        level = np.maximum(step.dry + step.friction, 0.0)
        furthest = level / stiffness
        settled = np.sign(step.qd) * furthest
        stuck = np.abs(step.held) <= state["level"]
        start = np.where(stuck, -step.held / stiffness, settled)
        slid = step.dt * np.abs(step.qd) / np.maximum(furthest, _SMALLEST)
        z = state["z"]
        bent = np.where(np.isnan(z), start, settled + (z - settled) * np.exp(-slid))
        steps = np.where(np.isnan(state["steps"]), 0.0, state["steps"])
        rigid = steps < _RIGID_STEPS
        state["z"] = np.where(rigid, np.nan, bent)
        state["level"] = level * (1 + 1e-9)  # the solver's rounding
        state["steps"] = steps + 1.0
        soft = ~rigid & (stiffness < PreslidingFriction.neutral["bristle_stiffness"])
        step.extra -= np.where(soft, stiffness * bent, 0.0)
        step.friction = np.where(soft, -step.dry, step.friction)
