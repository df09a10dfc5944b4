"""The catalogue of effects: every concrete `Effect`, by its name.

    from walkerkit.gap.effects import CATALOGUE
    CATALOGUE["coulomb_friction"].equation

A new effect is a class in the file of its family; a new family is a new file. The workflow knows
of none by name. A law that MJCF has no field for is one more class, in `actuators.drivetrain`.
An effect that a user defines in a module of his own follows those of this package, and so do those
of packages that name their modules in the entry points of the group `walkerkit.effects`.
"""

import importlib
import pkgutil
from collections.abc import Iterator, Mapping

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import (
    EVERYWHERE,
    Effect,
    JointEffect,
    Parameter,
    registered,
    users_effects,
)
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

# The order in which effects are listed, and in which ties are broken: the usual suspects first.
_FAMILIES = (
    "friction",
    "inertia",
    "transmission",
    "play",
    "actuation",
    "timing",
    "measurement",
    "environment",
    "law_friction",
    "laws_drive",
    "laws_controller",
    "periodic",
)
_others = sorted({module.name for module in pkgutil.iter_modules(__path__)} - {*_FAMILIES})
for _family in (*_FAMILIES, *_others):
    importlib.import_module(f"{__name__}.{_family}")

from walkerkit.gap.effects.law_effect import LawEffect  # noqa: E402  its family comes in its order


class Catalogue(Mapping[str, Effect]):
    """Effects by name: those of this package, and then those that users have defined by now."""

    def __init__(self) -> None:
        self._ours = registered()

    def __getitem__(self, name: str) -> Effect:
        own = self._ours.get(name)
        return users_effects()[name] if own is None else own

    def __iter__(self) -> Iterator[str]:
        return iter((*self._ours, *users_effects()))

    def __len__(self) -> int:
        return len(self._ours) + len(users_effects())


CATALOGUE = Catalogue()

__all__ = [
    "CATALOGUE",
    "EVERYWHERE",
    "Effect",
    "JointEffect",
    "LawEffect",
    "Parameter",
    "Robot",
    "Trials",
    "fields",
]
