"""Through a gearbox, a screw or a rack: inertia, effort and speed on the other side.

    reflected_inertia(1.1e-4, gear_ratio=6)  # 0.00396 kg·m² at the joint
    rpm_to_rad(103)  # 10.8 rad/s
    rotary_to_linear(motor, lead=0.005, efficiency=0.8)  # a screw of 5 mm a turn

Speed falls and torque rises by the ratio g, so the same kinetic energy ½ J ω² belongs to g² times
the inertia. Gear ratios are input speed over output speed, 6 for "6 : 1".
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from walkerkit.actuators.arguments import check_number, plain
from walkerkit.actuators.motors.electric import ElectricActuator


def reflected_inertia(rotor_inertia: float, gear_ratio: float) -> float:
    """The inertia of a rotor at the output of its gearbox, J·g².

    Args:
        rotor_inertia: about the motor's axis [kg·m²].
        gear_ratio: of the whole gearbox [1].

    Returns:
        Inertia at the joint [kg·m²], its `armature`.

    Raises:
        TypeError: an argument is not a number.
        ValueError: the inertia is negative, or the ratio not above zero.
    """
    inertia = check_number("rotor_inertia", rotor_inertia, at_least=0)
    return float(inertia * check_number("gear_ratio", gear_ratio, above=0) ** 2)


def reflected_inertia_from_two_stage_planetary(
    rotor_inertia: Sequence[float] | NDArray[Any], gear_ratio: Sequence[float] | NDArray[Any]
) -> float:
    """The inertia of a two-stage planetary gearbox at its output, J₀(g₁g₂)² + J₁g₂² + J₂.

    Args:
        rotor_inertia: Three inertias, each about its own shaft: the rotor with the first sun, the
            first carrier with the second sun, the second carrier [kg·m²].
        gear_ratio: Three ratios, each from the shaft before [1]. The first is that of the motor to
            itself, 1.

    Returns:
        Inertia at the joint [kg·m²], its `armature`.

    Raises:
        TypeError: an argument is not three numbers.
        ValueError: not three of them, an inertia is negative, a ratio not above zero, or the first
            ratio is not 1.
    """
    first, second, third = _three("rotor_inertia", rotor_inertia, at_least=0)
    motor, stage_1, stage_2 = _three("gear_ratio", gear_ratio, above=0)
    if motor != 1:
        raise ValueError(
            f"`gear_ratio[0]` should be 1, got {motor:g}: the first of the three shafts is the "
            f"motor's own; use (1, {stage_1:g}, {stage_2:g}), or (1, {motor:g}, {stage_1:g}) if "
            "the list began with the first stage"
        )
    return float(first * (stage_1 * stage_2) ** 2 + second * stage_2**2 + third)


def rpm_to_rad(rpm: float) -> float:
    """Revolutions per minute in rad/s.

    Args:
        rpm: speed [rev/min].

    Raises:
        TypeError: `rpm` is not a number.
        ValueError: it is not finite.
    """
    return check_number("rpm", rpm) * math.pi / 30


def rotary_to_linear(
    actuator: ElectricActuator,
    *,
    lead: float | None = None,
    pinion_radius: float | None = None,
    efficiency: float = 1.0,
) -> ElectricActuator:
    """The actuator of a slide joint that a rotary one drives by a screw, or by rack and pinion.

    With r metres of travel per radian: mass J/r², force η·τ/r, velocity ω·r.

    Args:
        actuator: what turns the screw or pinion, gearbox included.
        lead: travel per revolution of the screw [m], 2π·r.
        pinion_radius: pitch radius of the pinion [m], r. Either this or `lead`.
        efficiency: η, share of the motor's work that reaches the load when it drives [1]; a sliding
            screw loses half or more. Driven back by the load it loses, too, which this leaves out.

    Returns:
        The same in kg, m/s and N.

    Raises:
        TypeError: a number is none, or not exactly one of `lead` and `pinion_radius` is given.
        ValueError: one of them is not above zero, or the efficiency not within (0, 1].
    """
    if lead is not None and pinion_radius is None:
        travel = check_number("lead", lead, above=0) / (2 * math.pi)
    elif pinion_radius is not None and lead is None:
        travel = check_number("pinion_radius", pinion_radius, above=0)
    else:
        raise TypeError(
            f"give one of `lead` [m/rev] and `pinion_radius` [m], got lead={lead!r} and "
            f"pinion_radius={pinion_radius!r}"
        )
    share = check_number("efficiency", efficiency, above=0, at_most=1)
    stall = actuator.saturation_effort
    return dataclasses.replace(
        actuator,
        reflected_inertia=actuator.reflected_inertia / travel**2,
        velocity_limit=actuator.velocity_limit * travel,
        effort_limit=actuator.effort_limit / travel * share,
        saturation_effort=None if stall is None else stall / travel * share,
    )


def _three(
    name: str,
    values: Sequence[float] | NDArray[Any],
    *,
    above: float | None = None,
    at_least: float | None = None,
) -> tuple[float, ...]:
    numbers = plain(values)
    if isinstance(numbers, str) or not isinstance(numbers, Sequence):
        raise TypeError(f"`{name}` should be three numbers, got {values!r}")
    if len(numbers) != 3:
        raise ValueError(
            f"`{name}` should be three numbers, got {len(numbers)}: {values!r}; "
            "reflected_inertia takes a rotor and the ratio of its whole gearbox"
        )
    return tuple(
        check_number(f"{name}[{i}]", number, above=above, at_least=at_least)
        for i, number in enumerate(numbers)
    )
