"""`<general>` actuators that are what they say, whatever the model's default classes are."""

from __future__ import annotations

from typing import Any


def add_general(target: Any, transmission: str, **attributes: Any) -> Any:
    """Adds a `<general>` actuator with every attribute that a default class could leak set.

    Args:
        target: PyMJCF joint, tendon or site.
        transmission: `joint`, `tendon` or `site`.
        **attributes: of `<general>`, over the plain ones: a fixed gain of one, no bias, no
            activation, no delay, no limit.

    Returns:
        The element, named like its target; or `…_actuator` where another has that name.
    """
    actuators = target.root.actuator
    free = target.root.find("actuator", target.name) is None
    plain = {
        "gear": [1, 0, 0, 0, 0, 0],
        "ctrllimited": False,
        "forcelimited": False,
        "actlimited": False,
        "dyntype": "none",
        "gaintype": "fixed",
        "biastype": "none",
        "dynprm": [1],
        "gainprm": [1],
        "biasprm": [0],
        "actearly": False,
        "nsample": 0,
        "delay": 0.0,
        "damping": [0, 0, 0],
        "armature": 0.0,
        "actdim": -1,
        "inheritrange": 0.0,
        transmission: target,
    }
    return actuators.add(
        "general",
        name=target.name if free else f"{target.name}_actuator",
        **{**plain, **attributes},
    )
