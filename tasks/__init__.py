"""Tasks, action terms and excitation experiments.

    from walkerkit.tasks import JointPositionAction, Stand, TrackJoints, TrackVelocity, suite

Rewards are in [0, 1], tasks end on falls, and `suite.load` makes dm_control's suite tasks, and ours
beside them, with actuators whose laws run before every physics step.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from walkerkit.tasks import suite
    from walkerkit.tasks.bounds import with_bounds
    from walkerkit.tasks.falls import FallLimits
    from walkerkit.tasks.stand import Stand
    from walkerkit.tasks.track_joints import TrackJoints
    from walkerkit.tasks.track_velocity import TrackVelocity
    from walkerkit.walkers.actions import (
        FullRangeAction,
        JointEffortAction,
        JointPositionAction,
        JointVelocityAction,
        RelativeJointPositionAction,
    )

# dm_control looks for a display as soon as it is imported, so it waits for who asks for a task.
_HOMES = {
    "FallLimits": "tasks.falls",
    "FullRangeAction": "walkers.actions",
    "JointEffortAction": "walkers.actions",
    "JointPositionAction": "walkers.actions",
    "JointVelocityAction": "walkers.actions",
    "RelativeJointPositionAction": "walkers.actions",
    "Stand": "tasks.stand",
    "TrackJoints": "tasks.track_joints",
    "TrackVelocity": "tasks.track_velocity",
    "with_bounds": "tasks.bounds",
}

__all__ = [
    "FallLimits",
    "FullRangeAction",
    "JointEffortAction",
    "JointPositionAction",
    "JointVelocityAction",
    "RelativeJointPositionAction",
    "Stand",
    "TrackJoints",
    "TrackVelocity",
    "suite",
    "with_bounds",
]


def __getattr__(name: str) -> Any:
    """Imports what is asked for when it is first asked for."""
    if name == "suite":
        return importlib.import_module("walkerkit.tasks.suite")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"walkerkit.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """What the module has by now, and what it has for who asks."""
    return sorted({*globals(), *__all__})
