"""Episodes of a policy in an environment, from seeds that are the same for every robot.

    episodes = roll_out(environment, policy, seeds=range(10), seconds=None)

The environment's random state is seeded anew before each reset, so that an episode of one robot
and that of another with the same seed begin alike, as far as the task draws alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, one_line
from walkerkit.gap.policy.loading import Policy

FloatArray = NDArray[np.float64]

LONGEST = 600.0
"""An episode that nobody limits is run this long, and then refused [s]."""


@dataclass(frozen=True, kw_only=True)
class Episode:
    """How an episode went.

    Attributes:
        seed: of the environment's draws.
        total: the sum of its rewards.
        seconds: how long it was [s].
        fell: the task ended it with a discount of 0, or the simulation diverged.
        tracking: root-mean-square of what the policy should make none, in `Tracking.unit`; None
            where nothing can be tracked.
    """

    seed: int
    total: float
    seconds: float
    fell: bool
    tracking: float | None


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """What a policy tracks.

    Attributes:
        what: in words.
        unit: of the error.
        error: the error now, (n,).
    """

    what: str
    unit: str
    error: Callable[[Any], FloatArray]


def tracking_of(environment: Any) -> Tracking | None:
    """What is tracked: the task's `tracking_error`, else the joints' position targets, or nothing.

    Args:
        environment: the environment, after a reset.
    """
    task = environment.task
    own = getattr(task, "tracking_error", None)
    if own is not None:
        unit = str(getattr(task, "tracking_unit", ""))
        return Tracking(what="the task's own error", unit=unit, error=own)
    drivetrain = getattr(getattr(task, "walker", None), "drivetrain", None)
    if drivetrain is None or drivetrain.rest.position_target is None:
        return None

    def error(physics: Any) -> FloatArray:
        del physics
        target = drivetrain.command.position_target
        return np.asarray(target - drivetrain.group.positions)

    return Tracking(what="position targets of the joints", unit="rad", error=error)


def roll_out(
    environment: Any, policy: Policy, *, seeds: Iterable[int], seconds: float | None
) -> tuple[Episode, ...]:
    """Rolls a policy out, an episode for each seed.

    Args:
        environment: of dm_control.
        policy: the policy.
        seeds: of the episodes.
        seconds: how long an episode is at most [s]; None until the environment ends it.

    Raises:
        InputError: the environment has no random state, an episode does not end, or the policy
            raises, or returns what is no action.
    """
    random = random_state(environment)
    return tuple(_episode(environment, policy, random, seed, seconds) for seed in seeds)


def draws_a_start(environment: Any, seeds: Iterable[int]) -> bool:
    """Whether the state in which an episode begins depends on its seed."""
    random = random_state(environment)
    starts = set()
    for seed in seeds:
        random.seed(seed)
        environment.reset()
        data = environment.physics.data
        starts.add((data.qpos.tobytes(), data.qvel.tobytes()))
    return len(starts) > 1


def random_state(environment: Any) -> np.random.RandomState:
    """Where an environment draws from.

    Raises:
        InputError: it does not say.
    """
    task = getattr(environment, "task", None)
    for found in (getattr(environment, "random_state", None), getattr(task, "random", None)):
        if isinstance(found, np.random.RandomState):
            return found
    raise InputError(
        f"make_environment returned an object of type {type(environment).__name__}, which has "
        "neither a random_state nor a task with one. Return a dm_control environment: "
        "composer.Environment(task), or control.Environment(physics, task)."
    )


def _episode(
    environment: Any, policy: Policy, random: Any, seed: int, seconds: float | None
) -> Episode:
    from dm_control.rl.control import PhysicsError

    random.seed(seed)
    timestep = environment.reset()
    tracking = tracking_of(environment)
    spec = environment.action_spec()
    step = float(environment.control_timestep())
    most = round((LONGEST if seconds is None else seconds) / step)
    total, squares, done, diverged = 0.0, list[float](), 0, False
    while not timestep.last() and done < most:
        action = _asked(policy, timestep, spec)
        try:
            timestep = environment.step(action)
        except PhysicsError:
            diverged = True
            break
        done += 1
        total += float(timestep.reward or 0.0)
        if tracking is not None:
            squares.append(float(np.mean(np.square(tracking.error(environment.physics)))))
    if seconds is None and done == most and not timestep.last():
        raise InputError(
            f"an episode has not ended after {LONGEST:g} s. Give seconds, or a time limit to the "
            "environment."
        )
    if not np.isfinite(total):
        raise InputError(
            f"the rewards of seed {seed} add up to {total}. Let the task's reward be finite."
        )
    return Episode(
        seed=seed,
        total=total,
        seconds=done * step,
        fell=diverged or bool(timestep.last() and timestep.discount == 0),
        tracking=float(np.sqrt(np.mean(squares))) if squares else None,
    )


def _asked(policy: Policy, timestep: Any, spec: Any) -> FloatArray:
    """What a policy asks for.

    Raises:
        InputError: it raises, or returns no action.
    """
    with _of_the_policy(policy):
        action = np.asarray(policy(timestep), dtype=np.float64)
    if action.shape != tuple(spec.shape):
        raise InputError(
            f"the policy returned {action.size} numbers of shape {action.shape}, and an action has "
            f"{tuple(spec.shape)}. Give the policy that belongs to the environment's action terms."
        )
    if not np.isfinite(action).all():
        raise InputError(
            f"the policy returned {action[~np.isfinite(action)][0]} in an action. Mend the policy, "
            "or what it observes."
        )
    return action


@contextmanager
def _of_the_policy(policy: Policy) -> Iterator[None]:
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # it is the user's function
        name = getattr(policy, "__name__", type(policy).__name__)
        raise InputError(
            f"the policy {name!r} raised {type(error).__name__}: {one_line(error)}. It is called "
            "with dm_control's TimeStep and returns an action."
        ) from error
