"""What the composer tasks of this package have in common."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from typing import Any

from dm_control import composer
from dm_control.locomotion.arenas import floors

from walkerkit.tasks.rewards import checked_weights, weighted_mean
from walkerkit.walkers.actuated import Actuated
from walkerkit.walkers.drivetrain import Randomization

DEFAULT_TIMESTEP = 0.002
"""MuJoCo's, in seconds."""


class WalkerTask(composer.Task):  # type: ignore[misc]
    """One walker in one arena, with a reward that is the weighted mean of terms in [0, 1].

    Args:
        walker: with actuators of ours: `MjcfWalker`, our robots, or what `with_actuators` returns.
        arena: where it is; by default a flat floor.
        physics_timestep: [s]; by default that of the robot's file, else 2 ms.
        control_timestep: [s], a whole number of physics timesteps.
        randomizations: applied to the walker's actuators at the start of each episode, ahead of
            the walker's own.
        weights: {reward term: weight}; terms that are left out have their default.
        default_weights: all terms of the task.
        observables: names of the walker's observables to enable, where it has them.

    Raises:
        TypeError: the walker has no actuators of ours.
        ValueError: the timesteps do not fit each other, or as `rewards.checked_weights`.
    """

    def __init__(
        self,
        walker: Any,
        arena: Any,
        *,
        physics_timestep: float | None,
        control_timestep: float,
        randomizations: Sequence[Randomization],
        weights: Mapping[str, float] | None,
        default_weights: Mapping[str, float],
        observables: Sequence[str],
    ):
        self._weights = checked_weights(weights, default_weights)
        self._randomizations = tuple(randomizations)
        self._walker = _actuated(walker)
        self._arena = floors.Floor() if arena is None else arena
        if physics_timestep is None:
            physics_timestep = self._walker.mjcf_model.option.timestep or DEFAULT_TIMESTEP
        self._frame = self._arena.attach(walker)
        self._walker.create_root_joints(self._frame)
        self.set_timesteps(control_timestep=control_timestep, physics_timestep=physics_timestep)
        available = self._walker.observables.as_dict(fully_qualified=False)
        for name in observables:
            if name in available:
                available[name].enabled = True

    @abc.abstractmethod
    def reward_terms(self, physics: Any) -> dict[str, float]:
        """The terms of the reward, each in [0, 1].

        Args:
            physics: the compiled model, after a control step.
        """

    def get_reward(self, physics: Any) -> float:
        """The weighted mean of `reward_terms`, in [0, 1]."""
        return weighted_mean(self.reward_terms(physics), self._weights)

    @property
    def weights(self) -> dict[str, float]:
        """The weight of each reward term."""
        return dict(self._weights)

    @property
    def root_entity(self) -> Any:
        """The arena."""
        return self._arena

    @property
    def walker(self) -> Any:
        """The walker."""
        return self._walker

    def _randomize(self, random_state: Any) -> None:
        for randomization in self._randomizations:
            randomization.apply(self._walker.actuator_group, random_state)


def _actuated(walker: Any) -> Any:
    if isinstance(walker, Actuated):
        return walker
    raise TypeError(
        f"walker is a {type(walker).__name__}, which has no actuators of ours: use "
        "MjcfWalker.from_file(path, actuators), one of our robots, or "
        "with_actuators(walker, actuators)"
    )
