"""An action spec with bounds, for tasks that others wrote.

    task = with_bounds(go_to_target.GoToTarget(walker, floors.Floor()), walker)
    spec = composer.Environment(task).action_spec()
    action = np.random.default_rng(0).uniform(spec.minimum, spec.maximum)

composer describes an action by MuJoCo's actuators, whose controls are mostly unbounded where laws
run in Python. What the walker takes is `walker.action_spec`; this says so in the task's place.
"""

from __future__ import annotations

import functools
from typing import Any, TypeVar

from dm_control import composer
from dm_env import specs

from walkerkit.walkers.actuated import Actuated

TaskT = TypeVar("TaskT", bound=composer.Task)


def with_bounds(task: TaskT, walker: Any) -> TaskT:
    """Gives a task the action spec of its walker.

    Args:
        task: any composer task that hands its whole action to the walker, as dm_control's with one
            walker do; it is changed, and belongs to a subclass of its class then.
        walker: the walker, with actuators of ours.

    Returns:
        The same task.

    Raises:
        TypeError: it is no task, or the walker has no actuators of ours.
        ValueError: the walker is not in the task.
    """
    if not isinstance(task, composer.Task):
        raise TypeError(f"task should be a composer task, got {task!r}")
    if not isinstance(walker, Actuated):
        raise TypeError(
            f"walker is a {type(walker).__name__}, which has no actuators of ours: its task has "
            "bounds already, or put some on with with_actuators(walker, actuators)"
        )
    if not any(entity is walker for entity in task.root_entity.iter_entities()):
        raise ValueError(
            f"walker is a {type(walker).__name__} that is not in the {type(task).__name__}: give "
            "the one that the task was made with"
        )
    if not isinstance(task, _Bounded):
        task.__class__ = _bounded(type(task))  # type: ignore[arg-type]
    task._bounds_of = walker
    return task


class _Bounded:
    """A task that others wrote, whose actions are those of a walker."""

    _bounds_of: Actuated

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        """As `walker.action_spec`."""
        del physics
        return self._bounds_of.action_spec


@functools.cache
def _bounded(cls: type[composer.Task]) -> type[Any]:
    return type(f"{cls.__name__}WithBounds", (_Bounded, cls), {"__module__": __name__})
