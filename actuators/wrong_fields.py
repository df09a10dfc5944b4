"""What to say of arguments that a config does not have, or has to have.

    IdealPdActuatorCfg(joint_names_expr=("knee",), saturation_effort=35.0)
    # TypeError: IdealPdActuatorCfg has no field 'saturation_effort': DcMotorActuatorCfg has it

A field in the wrong config is mostly a wrong config, or one that belongs around or into another.
"""

from __future__ import annotations

import inspect
from collections.abc import Collection, Iterator
from dataclasses import MISSING, fields
from typing import Any

from walkerkit.actuators.messages import closest, listed

_ALSO_CALLED = {
    "kp": "stiffness",
    "kd": "damping",
    "kv": "damping",
    "friction": "frictionloss",
    "max_force": "effort_limit",
    "joint_names": "joint_names_expr",
    "target_names_expr": "joint_names_expr",
    "min_delay": "delay_min_lag",
    "max_delay": "delay_max_lag",
}
"""What others call a field."""
_MOST = 4  # configs that are named


def raise_wrong(cls: type[Any], family: type[Any], given: Collection[str]) -> None:
    """Refuses arguments that a config does not have, and too few of them.

    Args:
        cls: the config's class, a dataclass.
        family: of which other configs are subclasses.
        given: names of the arguments.

    Raises:
        TypeError: one is unknown, or one is missing that has no default.
    """
    own = {item.name: item for item in fields(cls) if item.init}
    for name in given:
        if name not in own:
            raise TypeError(
                f"{cls.__name__} has no field {name!r}{_hint(cls, family, name, given, own)}"
            )
    missing = [
        name
        for name, item in own.items()
        if item.default is MISSING and item.default_factory is MISSING and name not in given
    ]
    if given and missing:
        raise TypeError(
            f"{cls.__name__} needs {listed(missing)} as well: what they are is in its docstring, "
            f"help({cls.__name__})"
        )


def _hint(
    cls: type[Any], family: type[Any], name: str, given: Collection[str], own: Collection[str]
) -> str:
    meant = _ALSO_CALLED.get(name, name)
    if meant in own:
        return f": it is called {meant!r} here"
    configs = [one for one in _concrete(family) if one is not cls and meant in _names(one)]
    called = "it" if meant == name else f"it, as {meant!r}"
    around = [one for one in configs if "base_cfg" in _names(one)]
    if around and "base_cfg" not in own:
        return (
            f": {around[0].__name__} has {called}, and goes around this one: "
            f"{around[0].__name__}(base_cfg={cls.__name__}(...), {meant}=...)"
        )
    if configs and "base_cfg" in own:
        return f": give it to the config that is its base_cfg, which may have {called}"
    others = {_ALSO_CALLED.get(one, one) for one in given}
    of_all = [one for one in configs if others <= _names(one)] or configs
    if of_all:
        return f": {' or '.join([one.__name__ for one in of_all][:_MOST])} has {called}"
    return f"{closest(name, own)}; it has {listed(own)}"


def _names(cls: type[Any]) -> set[str]:
    return {item.name for item in fields(cls) if item.init}


def _concrete(cls: type[Any]) -> Iterator[type[Any]]:
    if not inspect.isabstract(cls):
        yield cls
    for one in cls.__subclasses__():
        yield from _concrete(one)
