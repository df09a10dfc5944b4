"""The numbers of hidden effects as the catalogue puts them, to hold its estimates against."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from walkerkit.gap.rehearsal.hidden import HiddenEffect

EVERYWHERE: Final = "*"

# A hidden parameter that the catalogue has by another name.
_OTHER_NAMES: Final = MappingProxyType(
    {
        "delta_kp": "kp",
        "delta_kd": "kd",
        "alpha": "strength",
        "forcerange": "limit",
        "offset": "ref",
    }
)
_OTHERWISE: Final[Mapping[str, Callable[[Mapping[str, float]], dict[str, float]]]] = {
    # The hardware's base is turned, the model's gravity.
    "base_tilt": lambda v: {"roll": -v["roll"], "pitch": -v["pitch"]},
    "mount_compliance": lambda v: {
        "compliance": 1.0 / v["stiffness"],
        "damping_ratio": v["damping_ratio"],
    },
    "series_elasticity": lambda v: {"compliance": 1.0 / v["stiffness"]},
    # A phase is no number to hold against another, 2π apart or not.
    **dict.fromkeys(
        ("cogging", "torque_ripple", "kinematic_error", "pose_dependent_friction"),
        lambda v: {"amplitude": v["amplitude"], "periods": v["periods"]},
    ),
    # All of the effort goes with the voltage, however far that goes.
    "supply_voltage": lambda v: {"share": 1.0},
    # Another law of the ground, and a change of the model's number instead of another number.
    "ground_compliance": lambda v: {},
    "ground_friction": lambda v: {},
}


def truth(hidden: HiddenEffect, place: str) -> dict[str, float]:
    """What a right estimate at a place would say.

    Args:
        hidden: the effect.
        place: a joint or body that has it, or `*` where one value is estimated for all.

    Returns:
        Parameter of the catalogue to value; empty where the places have values of their own and
        `place` is none of them.
    """
    names = [parameter.name for parameter in hidden.kind.parameters]
    shared = all(name in hidden.values for name in names)
    somewhere_else = place not in hidden.places and EVERYWHERE not in hidden.places
    if hidden.places and somewhere_else and not (shared and place == EVERYWHERE):
        return {}
    values = {name: hidden.value(name, place) for name in names}
    if hidden.effect in _OTHERWISE:
        return _OTHERWISE[hidden.effect](values)
    return {_OTHER_NAMES.get(name, name): value for name, value in values.items()}
