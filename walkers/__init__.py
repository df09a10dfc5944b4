"""Robots as composer entities, and the lock-step engine that steps many of them."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from walkerkit.walkers.leg import LEG_XML as LEG_XML
    from walkerkit.walkers.leg import Leg as Leg
    from walkerkit.walkers.mjcf_walker import MjcfWalker as MjcfWalker
    from walkerkit.walkers.with_actuators import with_actuators as with_actuators

# dm_control looks for a display as soon as it is imported, so it waits for who asks for a walker.
_LAZY = {
    "LEG_XML": "leg",
    "Leg": "leg",
    "MjcfWalker": "mjcf_walker",
    "with_actuators": "with_actuators",
}


def __getattr__(name: str) -> Any:
    """Imports a walker's module when it is first asked for."""
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
