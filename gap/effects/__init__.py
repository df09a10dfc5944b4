"""The catalogue of effects: every concrete `Effect` in this package, by its name.

    from walkerkit.gap.effects import CATALOGUE
    CATALOGUE["coulomb_friction"].equation

A new effect is a class in the file of its family; a new family is a new file. Nothing else changes.
"""

import importlib
import pkgutil
from types import MappingProxyType

from walkerkit.gap.effects.base import EVERYWHERE, Effect, JointEffect, Parameter, registered

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

CATALOGUE = MappingProxyType(registered())

__all__ = ["CATALOGUE", "EVERYWHERE", "Effect", "JointEffect", "Parameter"]
