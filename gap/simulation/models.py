"""What makes one compiled model of another.

differing(model, other)    # ("actuator_gainprm", "body_mass"), or None
"""

from __future__ import annotations

import weakref
from typing import Any

import mujoco
import numpy as np

from walkerkit.gap.simulation.trials import model_field
from walkerkit.walkers.batch import LockStep

# Models are never written to, so that what was found of a pair holds for as long as they live.
_DIFFERING: weakref.WeakKeyDictionary[
    mujoco.MjModel, weakref.WeakKeyDictionary[mujoco.MjModel, tuple[str, ...] | None]
] = weakref.WeakKeyDictionary()


def differing(one: mujoco.MjModel, other: mujoco.MjModel) -> tuple[str, ...] | None:
    """Fields in which two models differ and that make one the other; None if it takes more."""
    known = _DIFFERING.setdefault(one, weakref.WeakKeyDictionary())
    if other not in known:
        known[other] = _found_differing(one, other)
    return known[other]


def _found_differing(one: mujoco.MjModel, other: mujoco.MjModel) -> tuple[str, ...] | None:
    first = one.nq, one.nu, one.opt.timestep, one.opt.integrator
    if first != (other.nq, other.nu, other.opt.timestep, other.opt.integrator):
        return None  # as most of all that are not alike
    differing = _differences(one, other)
    fields = {}
    for name in differing:
        values = model_field(other, name)
        if values.dtype != np.float64 or values.shape != model_field(one, name).shape:
            return None
        fields[name] = values[None]
    made = LockStep(one, 1, fields=fields, n_threads=1).batch.get_model(0)
    # These are the same in both, but those of a batch are its own.
    same = set(_differences(made, other)) <= {"opt.disableflags"}
    return tuple(fields) if same else None


def _differences(one: mujoco.MjModel, other: mujoco.MjModel) -> list[str]:
    """Sizes, options and fields that are not the same in two models."""
    return [
        prefix + name
        for prefix, mine, theirs in (("", one, other), ("opt.", one.opt, other.opt))
        for name in _names_of_numbers(mine)
        if not _same(getattr(mine, name), getattr(theirs, name))
    ]


def _same(mine: Any, theirs: Any) -> bool:
    """As `np.array_equal`, which takes longer than the comparison of arrays as small as these."""
    if isinstance(mine, np.ndarray):
        return mine.shape == theirs.shape and bool((mine == theirs).all())
    return bool(mine == theirs)


_NAMES: dict[type, tuple[str, ...]] = {}


def _names_of_numbers(one: object) -> tuple[str, ...]:
    """Names of what holds numbers in a struct of MuJoCo's."""
    if type(one) not in _NAMES:
        _NAMES[type(one)] = tuple(
            name
            for name in dir(one)
            if not name.startswith("_") and isinstance(getattr(one, name), (np.ndarray, int, float))
        )
    return _NAMES[type(one)]
