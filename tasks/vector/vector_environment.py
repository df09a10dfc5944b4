"""A vectorised Gymnasium environment of a composer task, stepped in lock-step.

    environments = WalkerVectorEnv(lambda: Stand(Quadruped()), num_envs=64, time_limit=10.0)
    observations, _ = environments.reset(seed=0)
    for _ in range(100):
        actions = environments.action_space.sample()
        observations, rewards, terminated, truncated, infos = environments.step(actions)

Each copy goes the way that a `composer.Environment` of its own with that seed would go, bit for
bit, actuators, delays and all that is drawn at a reset included; rewards agree to rounding. Of
`Stand` and `TrackVelocity` everything is known. For other tasks, or other rewards, give functions
over arrays:

    WalkerVectorEnv(
        make_task,
        num_envs=64,
        time_limit=10.0,
        observations={"pose": lambda copies: copies.field("qpos")[:, 7:]},
        reward=lambda copies: copies.field("qvel")[:, 0],
        terminated=lambda copies: copies.field("qpos")[:, 2] < 0.15,
    )

An episode is `terminated` when the task ends it with discount 0, or when its simulation diverges,
and `truncated` at the time limit. Limits: one walker; no MJCF variations, drivetrain laws, cameras;
of dm_control's hooks only those of a reset run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from walkerkit.tasks.vector.copies import Copies, MakeTask
from walkerkit.tasks.vector.observables import observable_functions
from walkerkit.tasks.vector.upright import vector_task
from walkerkit.tasks.vector.vector_task import Function, VectorTask

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Observations = dict[str, FloatArray]
Step = tuple[Observations, FloatArray, BoolArray, BoolArray, dict[str, Any]]


class WalkerVectorEnv(gymnasium.vector.VectorEnv[Observations, FloatArray, NDArray[Any]]):
    """Many copies of a task's walker.

    Args:
        make_task: makes the composer task; called twice, it has to make the same thing anew.
        num_envs: how many copies.
        time_limit: of an episode [s].
        observations: {name: function}, instead of the task's enabled observables; a function takes
            the `Copies` and returns (num_envs, ...).
        reward: instead of the task's, a function that returns (num_envs,).
        terminated: instead of the task's, a function that returns (num_envs,) of bool.
        task: what is known of the task, where this package does not know it.
        autoreset_mode: what follows the end of an episode, as in Gymnasium's own vector
            environments.
        n_threads: threads of the simulation, 0 for all cores. Results do not depend on it.

    Attributes:
        copies: the simulations and what can be read of them.

    Raises:
        TypeError: the task has no walker with actuators of ours.
        ValueError: the reward or the end of episodes is not known and not given, a function returns
            another shape, or as `Copies`.
    """

    def __init__(
        self,
        make_task: MakeTask,
        num_envs: int,
        *,
        time_limit: float = float("inf"),
        observations: Mapping[str, Function] | None = None,
        reward: Function | None = None,
        terminated: Function | None = None,
        task: VectorTask | None = None,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        n_threads: int = 0,
    ):
        first = make_task()
        self._task = vector_task(first) if task is None else task
        made = [first]
        self.copies = Copies(
            lambda: made.pop() if made else make_task(),
            num_envs,
            n_threads=n_threads,
            edit=None if self._task is None else self._task.edit,
        )
        if self._task is not None:
            self._task.attach(self.copies)
        of_task = None if self._task is None else (self._task.reward, self._task.terminated)
        self._reward = _chosen("reward", reward, of_task and of_task[0], first)
        self._terminated = _chosen("terminated", terminated, of_task and of_task[1], first)
        self._time_limit = time_limit
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        self.render_mode = None
        self._randoms = [np.random.RandomState(i) for i in range(num_envs)]
        self._ended = np.zeros(num_envs, dtype=bool)
        known = {} if self._task is None else self._task.observations()
        self._functions = (
            observable_functions(self.copies, known) if observations is None else dict(observations)
        )
        self._begin(range(num_envs))
        self._check()
        spec = self.copies.drivetrain.action_spec
        self.single_action_space = Box(spec.minimum, spec.maximum, dtype=np.float64)
        self.single_observation_space = Dict(
            {
                name: Box(-np.inf, np.inf, values.shape[1:], np.float64)
                for name, values in self._observe().items()
            }
        )
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        # The first reset starts afresh.
        self._randoms = [np.random.RandomState() for _ in range(num_envs)]

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, dict[str, Any]]:
        """Begins episodes, as Gymnasium's `SyncVectorEnv` does.

        Args:
            seed: one for each copy, or one number, to which the copy's own is added; None goes on
                drawing where the copy is.
            options: `reset_mask`, (num_envs,) of bool, of the copies to reset; by default all.

        Raises:
            ValueError: there are too few seeds or too many, or the mask has another shape.
        """
        seeds: Sequence[int | None]
        if isinstance(seed, int | np.integer):
            seeds = [int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = [None] * self.num_envs if seed is None else seed
        if len(seeds) != self.num_envs:
            raise ValueError(f"{len(seeds)} seeds were given for {self.num_envs} copies")
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool:
            raise ValueError(
                f"reset_mask should be {self.num_envs} of bool, got {mask.dtype} of {mask.shape}"
            )
        for row, chosen in enumerate(seeds):
            if mask[row] and chosen is not None:
                self._randoms[row] = np.random.RandomState(chosen)
        self._begin(np.flatnonzero(mask))
        return self._observe(), {}

    def step(self, actions: ArrayLike) -> Step:
        """One control step of every copy.

        Args:
            actions: (num_envs, n), as the action terms take them.

        Returns:
            Observations, rewards (num_envs,), terminated (num_envs,), truncated (num_envs,) and
            infos, as Gymnasium's autoreset mode has them.

        Raises:
            RuntimeError: an episode has ended and, without autoreset, was not reset.
            ValueError: an action has another shape, or is not finite.
        """
        ended = self._ended
        if self.autoreset_mode == AutoresetMode.DISABLED and ended.any():
            raise RuntimeError(
                f"the episodes of copies {np.flatnonzero(ended).tolist()} have ended: call "
                "reset(options={'reset_mask': mask}) for them"
            )
        diverged = self.copies.step(actions, np.flatnonzero(~ended) if ended.any() else None)
        rewards = np.array(self._reward(self.copies), dtype=np.float64)
        terminated = np.array(self._terminated(self.copies), dtype=bool) | diverged
        truncated = (self.copies.time >= self._time_limit) & ~terminated
        rewards[diverged | ended] = 0.0
        terminated[ended] = truncated[ended] = False
        now = terminated | truncated
        infos: dict[str, Any] = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            if now.any():
                final = self._observe()
                for row in np.flatnonzero(now):
                    last = {"final_obs": {name: one[row] for name, one in final.items()}}
                    infos = self._add_info(infos, {**last, "final_info": {}}, int(row))
                self._begin(np.flatnonzero(now))
        else:
            # A copy whose episode ended in the step before begins the next one in this one.
            self._begin(np.flatnonzero(ended))
            self._ended = now
        return self._observe(), rewards, terminated, truncated, infos

    def close_extras(self, **kwargs: Any) -> None:
        """Frees the physics."""
        del kwargs
        self.copies.close()

    def _begin(self, chosen: Sequence[int] | range | NDArray[np.intp]) -> None:
        for row in chosen:
            self.copies.reset(int(row), self._randoms[row])
            if self._task is not None:
                self._task.begin(int(row))
            self._ended[row] = False

    def _observe(self) -> Observations:
        return {
            name: np.array(function(self.copies), dtype=np.float64)
            for name, function in self._functions.items()
        }

    def _check(self) -> None:
        """Refuses functions that do not return a row for each copy."""
        n = self.num_envs
        for name, function in self._functions.items():
            shape = np.shape(function(self.copies))
            if shape[:1] != (n,):
                raise ValueError(
                    f"observations[{name!r}] returned shape {shape}; it should start with {n}"
                )
        for name, function in (("reward", self._reward), ("terminated", self._terminated)):
            shape = np.shape(function(self.copies))
            if shape != (n,):
                raise ValueError(f"{name} returned shape {shape}; it should be ({n},)")


def _chosen(name: str, given: Function | None, known: Function | None, task: Any) -> Function:
    function = known if given is None else given
    if function is None:
        raise ValueError(
            f"the {name} of {type(task).__name__} is not known for many copies at once: give "
            f"{name}=function, of the copies, that returns an array (num_envs,)"
        )
    return function
