"""Robots as composer entities, and the lock-step engine that steps many of them."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from walkerkit.walkers.biped import BIPED_XML as BIPED_XML
    from walkerkit.walkers.biped import Biped as Biped
    from walkerkit.walkers.gait import Trot as Trot
    from walkerkit.walkers.leg import LEG_XML as LEG_XML
    from walkerkit.walkers.leg import Leg as Leg
    from walkerkit.walkers.mjcf_walker import MjcfWalker as MjcfWalker
    from walkerkit.walkers.quadruped import QUADRUPED_XML as QUADRUPED_XML
    from walkerkit.walkers.quadruped import Quadruped as Quadruped
    from walkerkit.walkers.refit import with_actuators as with_actuators
    from walkerkit.walkers.servo_bench import SERVO_BENCH_XML as SERVO_BENCH_XML
    from walkerkit.walkers.servo_bench import ServoBench as ServoBench

# dm_control looks for a display as soon as it is imported, so it waits for who asks for a walker.
_LAZY = {
    "BIPED_XML": "biped",
    "Biped": "biped",
    "LEG_XML": "leg",
    "Leg": "leg",
    "MjcfWalker": "mjcf_walker",
    "QUADRUPED_XML": "quadruped",
    "Quadruped": "quadruped",
    "SERVO_BENCH_XML": "servo_bench",
    "ServoBench": "servo_bench",
    "Trot": "gait",
    "with_actuators": "refit",
}

__all__ = [
    "BIPED_XML",
    "LEG_XML",
    "QUADRUPED_XML",
    "SERVO_BENCH_XML",
    "Biped",
    "Leg",
    "MjcfWalker",
    "Quadruped",
    "ServoBench",
    "Trot",
    "with_actuators",
]


def __getattr__(name: str) -> Any:
    """Imports a walker's module when it is first asked for."""
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)


def __dir__() -> list[str]:
    """What the module has by now, and what it has for who asks."""
    return sorted({*globals(), *__all__})
