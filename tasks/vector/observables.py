"""Composer's observables, read from all copies at once.

    functions = walker_functions(task.observables, copies)     # {"quadruped/joints_pos": function}

What an observable reads of MuJoCo's data is found out by looking at data that hold their own
addresses: everything that picks numbers out of them is followed, whoever wrote it. Beside those,
what our walkers observe of their actuators is known by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.messages import listed
from walkerkit.tasks.vector.copies import Copies
from walkerkit.tasks.vector.vector_task import Function

FloatArray = NDArray[np.float64]

_FIELDS: Final = (
    "qpos",
    "qvel",
    "act",
    "ctrl",
    "qacc",
    "xpos",
    "xquat",
    "xmat",
    "xipos",
    "ximat",
    "geom_xpos",
    "geom_xmat",
    "site_xpos",
    "site_xmat",
    "subtree_com",
    "cvel",
    "ten_length",
    "ten_velocity",
    "actuator_length",
    "actuator_velocity",
    "actuator_force",
    "qfrc_actuator",
    "qfrc_constraint",
    "sensordata",
)
_TARGETS: Final = ("position_target", "velocity_target", "effort_target")
_EFFORTS: Final = ("computed_effort", "applied_effort")


def observable_functions(copies: Copies, known: Mapping[str, Function]) -> dict[str, Function]:
    """A function for each enabled observable of the task, by its name.

    Args:
        copies: of the task.
        known: those of the task that read more than MuJoCo's data, by name.

    Raises:
        ValueError: an observable reads something else, or is delayed, buffered or corrupted.
    """
    own = _of_walker(copies)
    found: dict[str, Function] = {}
    unknown = []
    for name, observable in copies.task.observables.items():
        if not observable.enabled:
            continue
        function = known.get(name) or own.get(name)
        if function is None and not _is_plain(observable):
            unknown.append(name)
            continue
        function = function or _picked(copies, observable)
        if function is None:
            unknown.append(name)
        else:
            found[name] = function
    if unknown:
        raise ValueError(
            f"the observables {listed(unknown)} do more than read numbers of MuJoCo's data as they "
            "are: disable them, or give observations={name: function} for them"
        )
    return found


def _is_plain(observable: Any) -> bool:
    """It shows the present and nothing else."""
    return (
        observable.corruptor is None
        and observable.aggregator is None
        and observable.update_interval in (None, 1)
        and observable.buffer_size in (None, 1)
        and observable.delay in (None, 0)
    )


def _of_walker(copies: Copies) -> dict[str, Function]:
    """What our walkers observe of themselves."""
    n = len(copies.drivetrain.joints.names)

    def target(name: str) -> Function:
        def read(copies: Copies) -> FloatArray:
            values = getattr(copies.drivetrain.command, name)
            return np.zeros((copies.n_sims, n)) if values is None else values

        return read

    def effort(name: str) -> Function:
        return lambda copies: getattr(copies.actuators, name)

    functions: dict[str, Function] = {"prev_action": lambda copies: copies.action}
    functions |= {name: target(name) for name in _TARGETS}
    functions |= {name: effort(name) for name in _EFFORTS}
    full = copies.walker.observables.as_dict(fully_qualified=True)
    short = copies.walker.observables.as_dict(fully_qualified=False)
    return {name: functions[key] for name, key in zip(full, short, strict=True) if key in functions}


def _picked(copies: Copies, observable: Any) -> Function | None:
    """A function that reads what an observable picks out of one field of the data, if it does."""
    physics = copies.physics.copy(share_model=True)
    seen = []
    for shift in (0.0, 0.25):
        for name, start in _starts(physics).items():
            field = getattr(physics.data, name)
            field[...] = start + shift + np.arange(field.size).reshape(field.shape)
        seen.append(np.array(observable.observation_callable(physics)(), dtype=np.float64))
    # What is computed may happen to be an address, but does not move by as much as the data do.
    at, moved = seen[0], seen[1] - seen[0]
    if not (at.size and np.isfinite(at).all() and (moved == 0.25).all()):
        return None
    for name, start in _starts(physics).items():
        field = getattr(physics.data, name)
        if (at >= start).all() and (at < start + field.size).all() and (at == np.floor(at)).all():
            places = (at - start).astype(np.intp)
            return lambda copies: copies.field(name).reshape(copies.n_sims, -1)[:, places]
    return None


def _starts(physics: Any) -> dict[str, int]:
    """The first address of each field."""
    sizes = [int(getattr(physics.data, name).size) for name in _FIELDS]
    return dict(zip(_FIELDS, np.cumsum([1, *sizes[:-1]]).tolist(), strict=True))
