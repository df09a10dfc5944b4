"""The catalogue of what a rehearsal robot can have and its model lacks.

    HIDEABLE["coulomb_friction"].on              # "joints"
    HIDEABLE["coulomb_friction"].parameters      # frictionloss [N·m], at least 0

Names are those of the workflow's catalogue, equations those of its documentation; what MuJoCo or
the workflow make of them is not used. `NAMELESS` are troubles of which no catalogue knows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

Place = Literal["joints", "bodies", "world"]


@dataclass(frozen=True, kw_only=True)
class HiddenParameter:
    """One number of an effect.

    Attributes:
        name: its key in `HiddenEffect.values`.
        unit: its unit on a hinge; on a slide joint read m for rad and N for N·m.
        least: smallest value that makes sense.
        exclusive: whether `least` itself does not.
        grows: 1 where more of it is more of the effect, -1 where less of it is, 0 where neither.
    """

    name: str
    unit: str
    least: float = -math.inf
    exclusive: bool = False
    grows: Literal[-1, 0, 1] = 1


@dataclass(frozen=True, kw_only=True)
class Hideable:
    """An effect that the rehearsal robot can have.

    Attributes:
        on: what has it: joints, bodies, or the whole world.
        parameters: its numbers.
        shared: all joints have it, with one value.
    """

    on: Place
    parameters: tuple[HiddenParameter, ...]
    shared: bool = False


def _some(name: str, unit: str, *, grows: Literal[-1, 0, 1] = 1) -> HiddenParameter:
    """A number of at least 0."""
    return HiddenParameter(name=name, unit=unit, least=0.0, grows=grows)


def _above(name: str, unit: str, *, grows: Literal[-1, 0, 1] = 1) -> HiddenParameter:
    """A number above 0."""
    return HiddenParameter(name=name, unit=unit, least=0.0, exclusive=True, grows=grows)


def _any(name: str, unit: str, *, grows: Literal[-1, 0, 1] = 1) -> HiddenParameter:
    """A number of either sign."""
    return HiddenParameter(name=name, unit=unit, grows=grows)


def _on_joints(*parameters: HiddenParameter) -> Hideable:
    return Hideable(on="joints", parameters=parameters)


def _on_all_joints(*parameters: HiddenParameter) -> Hideable:
    return Hideable(on="joints", parameters=parameters, shared=True)


def _wave(unit: str) -> tuple[HiddenParameter, ...]:
    """A sine over the pose: amplitude, periods in 2π of pose, phase."""
    return (
        _some("amplitude", unit),
        _above("periods", "1/rad", grows=0),
        _any("phase", "rad", grows=0),
    )


_FORCE, _DRAG, _TURN = "N·m", "N·m·s/rad", "N·m/rad"

HIDEABLE: Final[Mapping[str, Hideable]] = MappingProxyType(
    {
        "viscous_friction": _on_joints(_some("damping", _DRAG)),
        "coulomb_friction": _on_joints(_some("frictionloss", _FORCE)),
        "asymmetric_friction": _on_joints(_some("forward", _FORCE), _some("backward", _FORCE)),
        "stribeck_friction": _on_joints(
            _some("breakaway", _FORCE), _above("velocity", "rad/s", grows=0)
        ),
        "presliding_friction": _on_joints(
            _some("frictionloss", _FORCE), _above("bend", "rad", grows=0)
        ),
        "load_dependent_friction": _on_joints(_some("coefficient", "")),
        "directional_efficiency": _on_joints(
            _above("driving", "", grows=-1), _above("backdriving", "", grows=1)
        ),
        "pose_dependent_friction": _on_joints(*_wave(_FORCE)),
        "quadratic_drag": _on_joints(_some("drag", "N·m·s²/rad²")),
        "cogging": _on_joints(*_wave(_FORCE)),
        "torque_ripple": _on_joints(*_wave("")),
        "armature": _on_joints(_some("armature", "kg·m²")),
        "payload": Hideable(on="bodies", parameters=(_some("mass", "kg"),)),
        "com_offset": Hideable(on="bodies", parameters=tuple(_any(axis, "m") for axis in "xyz")),
        "backlash": _on_joints(_some("width", "rad")),
        "series_elasticity": _on_joints(_above("stiffness", _TURN, grows=-1)),
        "parallel_spring": _on_joints(_some("stiffness", _TURN), _any("springref", "rad", grows=0)),
        "end_stop": _on_joints(_any("lower", "rad", grows=0), _any("upper", "rad", grows=0)),
        "position_gain": _on_joints(_any("delta_kp", _TURN)),
        "velocity_gain": _on_joints(_any("delta_kd", _DRAG)),
        "torque_constant": _on_joints(
            HiddenParameter(name="alpha", unit="", least=-1.0, exclusive=True)
        ),
        "torque_bias": _on_joints(_any("bias", _FORCE)),
        "effort_limit": _on_joints(_above("forcerange", _FORCE, grows=-1)),
        "torque_speed_limit": _on_joints(
            _above("saturation_effort", _FORCE, grows=-1),
            _above("velocity_limit", "rad/s", grows=-1),
        ),
        "supply_sag": _on_all_joints(_some("sag", "1/W")),
        "supply_voltage": _on_all_joints(_some("swing", "")),
        "strength_drift": _on_joints(_any("rate", "1/s")),
        "actuator_lag": _on_joints(_some("time_constant", "s")),
        "loop_delay": _on_all_joints(_some("delay", "s")),
        "command_delay": _on_all_joints(_some("delay", "s")),
        "sample_and_hold": _on_all_joints(_some("period", "s")),
        "setpoint_filter": _on_joints(_some("time_constant", "s")),
        "slew_limit": _on_joints(_above("rate", "rad/s", grows=-1)),
        "controller_deadband": _on_joints(_some("width", "rad")),
        "integral_action": _on_joints(_some("gain", "N·m/(rad·s)")),
        "velocity_filter": _on_joints(_some("time_constant", "s")),
        "sensor_delay": _on_all_joints(_some("delay", "s")),
        "clock_skew": Hideable(on="world", parameters=(_any("skew", ""),)),
        "encoder_offset": _on_joints(_any("offset", "rad")),
        "encoder_gain": _on_joints(_any("excess", "")),
        "kinematic_error": _on_joints(*_wave("rad")),
        "mount_compliance": Hideable(
            on="world",
            parameters=(
                _above("stiffness", _TURN, grows=-1),
                _some("damping_ratio", "", grows=0),
            ),
        ),
        "base_tilt": Hideable(on="world", parameters=(_any("roll", "rad"), _any("pitch", "rad"))),
    }
)
"""The effects that can be hidden, by their names in the catalogue.

What their numbers are where the name does not say: `delta_kp` and `delta_kd` are added to the
drive's gains, `alpha` is the torque constant's relative error, `forcerange` the drive's limit to
both sides, `offset` and `excess` what the encoder reads too much and too steeply, `roll` and
`pitch` the base's rotation about the world's x, then y; `bend` is how far bristles bend before they
slide, `swing` by which part of itself the supply's voltage goes up and down, `width` of the
backlash how far the rotor turns from one flank of the teeth to the other and of the controller's
deadband the largest error that is left alone, `lower` and `upper` are the poses where stops begin;
a wave is A sin(N q + φ).
"""

GROUND: Final[Mapping[str, Hideable]] = MappingProxyType(
    {
        "ground_friction": Hideable(on="world", parameters=(_some("friction", "", grows=0),)),
        "ground_compliance": Hideable(
            on="world", parameters=(_above("stiffness", "N/m", grows=-1),)
        ),
        "foot_offset": Hideable(on="bodies", parameters=tuple(_any(axis, "m") for axis in "xyz")),
    }
)
"""What can be hidden under a robot that stands on its feet: the coefficient of friction that they
have in the place of the model's, the stiffness of the ground under each foot, and how far a foot is
from where the model has it, in the frame of the body that carries it."""

NOT_THE_ROBOTS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "timestep": (
            "it is the simulation's, not the robot's, whose time has no steps; give the model a "
            "longer timestep once the recordings are made, and diagnose with that"
        )
    }
)
"""Effects of the workflow's catalogue that no robot can have, with the reason and what to do."""

NAMELESS: Final[Mapping[str, Hideable]] = MappingProxyType(
    {
        "random_pushes": _on_joints(_some("effort", _FORCE)),
        "pose_bump": _on_joints(
            _any("effort", _FORCE),
            _any("pose", "rad", grows=0),
            _above("reach", "rad", grows=0),
        ),
    }
)
"""Troubles that no catalogue names: somebody pushes now and then, by up to `effort`; a cable
catches around a pose, A exp(−((q − pose)/reach)²)."""
