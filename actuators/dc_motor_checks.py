"""Which numbers of a DC motor belong together.

The fields of `BuiltinDcMotorActuatorCfg` are optional one by one; these are the rules that leave a
motor which MuJoCo can run, with every number in it meaning something.
"""

from __future__ import annotations

from collections.abc import Mapping

from walkerkit.actuators.dc_motor_parameters import Input
from walkerkit.actuators.selection import Numbers

_SERVO: dict[Input, frozenset[str]] = {
    "voltage": frozenset(),
    "position": frozenset({"stiffness", "damping", "integral_gain", "integral_limit", "slew_rate"}),
    "velocity": frozenset({"damping", "slew_rate"}),
    "effort": frozenset({"damping", "slew_rate"}),
}
"""Fields that mean something with an input, of those that belong to the drive's controller."""
_NEEDED: dict[Input, tuple[str, ...]] = {
    "voltage": (),
    "position": ("stiffness",),
    "velocity": ("damping",),
    "effort": (),
}
_NEEDS = (
    ("stall_torque", ("nominal_voltage",)),
    ("no_load_speed", ("nominal_voltage",)),
    ("nominal_voltage", ("stall_torque", "no_load_speed")),
    ("current_rate_limit", ("inductance", "electrical_time_constant")),
    ("integral_limit", ("integral_gain",)),
    ("cogging_amplitude", ("cogging_periodicity",)),
    ("cogging_periodicity", ("cogging_amplitude",)),
    ("cogging_phase", ("cogging_amplitude",)),
    ("bristle_stiffness", ("coulomb_friction",)),
    ("bristle_damping", ("bristle_stiffness",)),
    ("coulomb_friction", ("bristle_stiffness",)),
    ("static_friction", ("stribeck_velocity",)),
    ("static_friction", ("bristle_stiffness",)),
    ("stribeck_velocity", ("static_friction",)),
    ("thermal_resistance", ("thermal_capacitance", "thermal_time_constant")),
    ("thermal_capacitance", ("thermal_resistance",)),
    ("thermal_time_constant", ("thermal_resistance",)),
    ("temperature_coefficient", ("thermal_resistance",)),
    ("ambient_temperature", ("thermal_resistance",)),
    ("reference_temperature", ("thermal_resistance",)),
)
"""A field, and those of which it needs one."""
_EXCLUSIVE = (
    ("torque_constant", "no_load_speed"),
    ("back_emf_constant", "no_load_speed"),
    ("resistance", "stall_torque"),
    ("effort_limit", "current_limit"),
    ("inductance", "electrical_time_constant"),
    ("thermal_capacitance", "thermal_time_constant"),
)
"""Two ways of saying one thing."""


def check_dc_motor(input_: Input, given: Mapping[str, Numbers], *, on_site: bool) -> None:
    """Refuses numbers that are right one by one and wrong together.

    Args:
        input_: what the command is.
        given: the numbers, without those that are None.
        on_site: the motor drives a site.

    Raises:
        ValueError: such numbers, named with the remedy.
    """
    if not given.keys() & {"torque_constant", "back_emf_constant", "no_load_speed"}:
        raise ValueError(
            "the motor constant is missing: give torque_constant or back_emf_constant, or "
            "nominal_voltage and no_load_speed"
        )
    if not given.keys() & {"resistance", "stall_torque"}:
        raise ValueError(
            "the resistance is missing: give resistance, or nominal_voltage and stall_torque"
        )
    for one, other in _EXCLUSIVE:
        if one in given and other in given:
            raise ValueError(
                f"{one}={given[one]!r} and {other}={given[other]!r} say the same thing, perhaps "
                "not the same: leave one of them out"
            )
    for name, any_of in _NEEDS:
        if name in given and not given.keys() & {*any_of}:
            raise ValueError(
                f"{name}={given[name]!r} means nothing without {' or '.join(any_of)}: give that, "
                f"or leave {name} out"
            )
    for name in sorted(given.keys() & _SERVO["position"] - _SERVO[input_]):
        takers = [repr(other) for other, servo in _SERVO.items() if name in servo]
        raise ValueError(
            f"{name}={given[name]!r} with input={input_!r}: only a drive with input "
            f"{' or '.join(takers)} has one; leave it out, or change the input"
        )
    for name in _NEEDED[input_]:
        if name not in given:
            raise ValueError(f"input={input_!r} needs {name}: a drive without it does nothing")
    if on_site and (input_ == "position" or given["gear_ratio"] != 1.0):
        raise ValueError(
            f"input={input_!r} and gear_ratio={given['gear_ratio']!r} with transmission='site': a "
            "site has no position, and its gear is `gear`; use another input and leave "
            "gear_ratio out"
        )
    _check_friction(given.get("static_friction"), given.get("coulomb_friction"))


def _check_friction(static: Numbers | None, coulomb: Numbers | None) -> None:
    if static is None or coulomb is None:
        return
    names = [*(static if isinstance(static, Mapping) else ())] or [
        *(coulomb if isinstance(coulomb, Mapping) else ("",))
    ]
    for name in names:
        holds = static.get(name) if isinstance(static, Mapping) else static
        brakes = coulomb.get(name) if isinstance(coulomb, Mapping) else coulomb
        if holds is not None and brakes is not None and holds < brakes:
            of = f"[{name!r}]" if name else ""
            raise ValueError(
                f"static_friction{of}={holds} is below coulomb_friction{of}={brakes}: what holds a "
                "joint at rest is at least what brakes it; exchange them"
            )
