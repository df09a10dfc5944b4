"""A motor with its gearbox, as the joint feels it.

hip = ElectricActuator(reflected_inertia=0.0102, velocity_limit=32.0, effort_limit=88.0)
stiffness, damping = gains_from_bandwidth(hip.reflected_inertia, 2 * math.pi * 10, 2.0)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from walkerkit.actuators.arguments import check_number


@dataclass(frozen=True, kw_only=True)
class ElectricActuator:
    """What a joint needs to know of its motor; for a slide joint read kg, m/s and N.

    Attributes:
        reflected_inertia: inertia of the rotor and gears at the joint, its `armature` [kg·m²].
        velocity_limit: no-load speed at the joint [rad/s].
        effort_limit: largest torque that is asked for, at the joint [N·m].
        saturation_effort: stall torque at the joint, at least `effort_limit` [N·m]; None where
            nobody states it.

    Raises:
        TypeError: one of them is not a number.
        ValueError: the inertia is negative, a limit not above zero, one of them not finite, or the
            stall torque below the effort limit.
    """

    reflected_inertia: float
    velocity_limit: float
    effort_limit: float
    saturation_effort: float | None = None

    def __post_init__(self) -> None:
        check_number("reflected_inertia", self.reflected_inertia, at_least=0)
        check_number("velocity_limit", self.velocity_limit, above=0)
        check_number("effort_limit", self.effort_limit, above=0)
        if self.saturation_effort is None:
            return
        check_number("saturation_effort", self.saturation_effort, above=0)
        if self.saturation_effort < self.effort_limit:
            raise ValueError(
                f"`saturation_effort` should be at least the effort_limit of {self.effort_limit}, "
                f"got {self.saturation_effort}: a motor gives its largest torque at stall; are the "
                "two swapped?"
            )


class Gains(NamedTuple):
    """Gains of a PD controller.

    Attributes:
        stiffness: effort per position error [N·m/rad, or N/m].
        damping: effort per velocity error [N·m·s/rad, or N·s/m].
    """

    stiffness: float
    damping: float


def gains_from_bandwidth(inertia: float, natural_frequency: float, damping_ratio: float) -> Gains:
    """The PD gains with which an inertia swings as asked: I·q̈ + 2ζωI·q̇ + ω²I·q = 0.

    With the motor's reflected inertia alone, the links that it carries are left out; a damping
    ratio well above 1 makes room for them, since both frequency and ratio fall with 1/√(inertia).

    Args:
        inertia: moving inertia at the joint, I [kg·m², or kg].
        natural_frequency: undamped natural frequency ω in rad/s, not in Hz: 10 Hz is 2π·10.
        damping_ratio: ζ [1]; 1 is critically damped.

    Returns:
        Stiffness ω²I and damping 2ζωI.

    Raises:
        TypeError: an argument is not a number.
        ValueError: the inertia or frequency is not above zero, or the ratio negative.
    """
    inertia = check_number("inertia", inertia, above=0)
    natural_frequency = check_number("natural_frequency", natural_frequency, above=0)
    damping_ratio = check_number("damping_ratio", damping_ratio, at_least=0)
    return Gains(
        stiffness=inertia * natural_frequency**2,
        damping=2 * damping_ratio * inertia * natural_frequency,
    )
