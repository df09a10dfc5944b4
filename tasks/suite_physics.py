"""The physics of a dm_control suite task, with actuators whose laws run before every step of it.

`dm_control.suite` steps its physics several times per action in one call, which leaves no room for
a law between two steps. Here the physics itself loops: law, step, law, step. MuJoCo computes the
same, bit for bit, as in one call.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from dm_control import mujoco
from dm_control.rl import control
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from walkerkit.walkers.drivetrain import Drivetrain

FloatArray = NDArray[np.float64]


class ActuatedPhysics:
    """Mixin for `dm_control.mujoco.Physics`, ahead of the class of a domain.

    What a task sends with `set_control` is an action, and what it reads with `control` is the last
    action: its rewards for small controls keep their meaning.
    """

    _drivetrain: Drivetrain | None
    _drawn_from: np.random.RandomState | None
    _random: np.random.RandomState

    def put_on(self, drivetrain: Drivetrain) -> None:
        """Gives it its actuators; to be called once, when it is compiled.

        Args:
            drivetrain: made with the model from which this was compiled.
        """
        drivetrain.initialize(self)
        self._drivetrain = drivetrain
        self._begin()

    @property
    def drivetrain(self) -> Drivetrain:
        """The actuators, and what an action asks of them.

        Raises:
            RuntimeError: this is a copy, or was loaded anew, and has none.
        """
        if self._drivetrain is None:
            raise RuntimeError(
                f"this {type(self).__name__} has no actuators: they stay with the physics that "
                "walkerkit.tasks.suite.load made, and do not come along when it is copied, pickled "
                "or reloaded; load the task once more"
            )
        return self._drivetrain

    def draw_from(self, random_state: np.random.RandomState) -> None:
        """Says where randomizations and random lags are drawn from, at the next reset.

        Args:
            random_state: of the task. It is not advanced, so that the task's own draws are those
                that it would have without actuators.
        """
        if random_state is not self._drawn_from:
            copy = np.random.RandomState()
            copy.set_state(random_state.get_state())
            self._drawn_from = random_state
            self._random = np.random.RandomState(copy.randint(2**31))

    # What dm_control calls.

    def _reload_from_data(self, data: Any) -> None:
        # Every way to make a physics ends here, and this is where its state is declared.
        self._drivetrain = None
        self._drawn_from = None
        self._random = np.random.RandomState(0)
        super()._reload_from_data(data)  # type: ignore[misc]

    def step(self, nstep: int = 1) -> None:
        """Advances the simulation, with the laws run before each step.

        Args:
            nstep: number of steps.
        """
        drivetrain = self.drivetrain
        for _ in range(nstep):
            drivetrain.run()
            super().step()  # type: ignore[misc]

    def set_control(self, control: ArrayLike) -> None:
        """Sets the command of the coming steps.

        Args:
            control: an action, as the environment's `action_spec` says.

        Raises:
            ValueError: it has another shape, or is not finite.
        """
        self.drivetrain.act(control)

    def control(self) -> FloatArray:
        """The last action of this episode, zeros before the first."""
        return self.drivetrain.last_action.copy()

    def reset(self, keyframe_id: int | None = None) -> None:
        """Back to the initial state; actuators forget, and what is random is drawn.

        Args:
            keyframe_id: as in `dm_control.mujoco.Physics`.
        """
        super().reset(keyframe_id)  # type: ignore[misc]
        self._begin()

    def after_reset(self) -> None:
        """The task has set the state of the new episode: actuators start from there."""
        super().after_reset()  # type: ignore[misc]
        self._begin()

    def _begin(self) -> None:
        if self._drivetrain is not None:
            self._drivetrain.reset(self._random)


class ActuatedEnvironment(control.Environment):  # type: ignore[misc]
    """A suite environment whose actions are those of its actuators."""

    def action_spec(self) -> specs.BoundedArray:
        """A number in [-1, 1] for each of the terms' targets, then controls that were kept."""
        return self.physics.drivetrain.action_spec

    def reset(self) -> Any:
        """Starts a new episode and returns its first `TimeStep`."""
        self.physics.draw_from(self.task.random)
        return super().reset()


@functools.cache
def actuated(cls: type[mujoco.Physics]) -> type[Any]:
    """A domain's physics class, with actuators."""
    return type(f"Actuated{cls.__name__}", (ActuatedPhysics, cls), {"__module__": __name__})
