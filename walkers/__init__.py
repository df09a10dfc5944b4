"""Robots as composer entities, and the lock-step engine that steps many of them."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from walkerkit.walkers.leg import LEG_XML as LEG_XML
    from walkerkit.walkers.leg import Leg as Leg

# dm_control looks for a display as soon as it is imported, so it waits for who asks for a walker.
_LAZY = {"LEG_XML": "walkerkit.walkers.leg", "Leg": "walkerkit.walkers.leg"}


def __getattr__(name: str) -> Any:
    """Imports a walker's module when it is first asked for."""
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_LAZY[name]), name)
