"""Many copies of a composer task's robot, stepped in lock-step by `mujoco.batch`.

    copies = Copies(lambda: Stand(Quadruped()), n_sims=64)
    for row in range(64):
        copies.reset(row, np.random.RandomState(row))
    copies.step(np.zeros((64, 12)))              # one control step of all of them
    copies.field("qpos")                         # (64, nq), up to date

An episode begins as composer begins it: the task itself, on a physics of its own, draws and settles
the start, which is copied into the simulation. Between resets nothing of composer runs. What the
task changes in the model at a reset is followed where the walker's actuators own it; the model is
compiled once, so that MJCF variations have no effect.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from dm_control import composer
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators import ActuatorGroup
from walkerkit.walkers.actuated import Actuated
from walkerkit.walkers.batch import LockStep
from walkerkit.walkers.drivetrain import Drivetrain

FloatArray = NDArray[np.float64]
MakeTask = Callable[[], Any]
Edit = Callable[[mujoco.MjSpec, Any], None]

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_LIVE = frozenset({"qpos", "qvel", "act", "ctrl", "time"})


class Copies:
    """N robots of one task, each in a world of its own.

    Args:
        make_task: makes the composer task, with one walker that has actuators of ours; it is called
            twice and has to make the same thing.
        n_sims: how many copies.
        n_threads: threads of the simulation, 0 for all cores. Results do not depend on it.
        edit: adds to the batch's model what does not change its motion, such as sensors. Called
            with the model as a spec and the task's physics.

    Attributes:
        task: the task that begins the episodes.
        n_sims: how many copies.
        previous_action: the action before the last one, (n_sims, n), zeros where there was none.

    Raises:
        TypeError: the task has no walker with actuators of ours.
        ValueError: it has several, or `make_task` does not make the same thing twice.
    """

    def __init__(
        self,
        make_task: MakeTask,
        n_sims: int,
        *,
        n_threads: int = 0,
        edit: Edit | None = None,
    ):
        if n_sims < 1:
            raise ValueError(f"n_sims is {n_sims}; it should be at least 1")
        self.task, self.n_sims = make_task(), n_sims
        twin = _twin(self.task, make_task)
        self._random = np.random.RandomState(0)
        self._composer = composer.Environment(
            self.task, random_state=self._random, recompile_mjcf_every_episode=False
        )
        self._composer.reset()
        self._single = walker_of(self.task).drivetrain
        model = _compiled(self.task, self._composer.physics, edit)
        self._lockstep = LockStep(model, n_sims, n_threads=n_threads)
        # The first one's actuators draw what an episode begins with; these run it.
        self._drivetrain: Drivetrain = walker_of(twin).drivetrain
        self._drivetrain.initialize(self._lockstep)
        self._live = {name: self._lockstep.live(name) for name in _LIVE}
        self._bound: dict[str, NDArray[Any]] = {}
        self._fields: dict[str, NDArray[Any]] = {}
        self._substeps = int(self.task.physics_steps_per_control_step)
        self._holds = all(actuator.holds for actuator in self._drivetrain.group.actuators)
        self.previous_action = np.zeros_like(self._drivetrain.last_action)

    # Running.

    def reset(self, row: int, random_state: np.random.RandomState) -> None:
        """Begins an episode in one simulation, as `composer.Environment.reset` does.

        Args:
            row: the simulation.
            random_state: where the task draws from; it moves on.
        """
        self._random.set_state(random_state.get_state())
        self._composer.reset()
        random_state.set_state(self._random.get_state())
        model, data = self.physics.model.ptr, self.physics.data.ptr
        mujoco.mj_getState(model, data, self._lockstep.batch.state[row], _STATE)
        for name, values in self._fields.items():
            self._copy(name, values[row])
        self._drivetrain.adopt(row, self._single)
        self.previous_action[row] = 0.0

    def step(self, actions: ArrayLike, ids: NDArray[np.intp] | None = None) -> NDArray[np.bool_]:
        """One control step.

        Args:
            actions: (n_sims, n), as the action terms take them.
            ids: simulations to step, rising; None for all. The others are to be reset next.

        Returns:
            (n_sims,) the simulations that diverged.

        Raises:
            ValueError: an action has another shape, or is not finite.
        """
        drivetrain = self._drivetrain
        previous = drivetrain.last_action
        drivetrain.act(actions)
        self.previous_action = np.array(previous)
        drivetrain.group.renew()
        diverged = self._lockstep.advance(self._substeps, self._before, steady=self._holds, ids=ids)
        for name, values in self._fields.items():
            values[...] = self._bound[name]
        return diverged

    def _before(self, substep: int) -> None:
        del substep
        self._drivetrain.run()

    # What functions of the copies read.

    def field(self, name: str) -> Any:
        """A field of MjData, (n_sims, *shape), as composer's tasks see it after a step or a reset.

        Positions, velocities and what follows from them are those of the present state, forces and
        accelerations those of the last physics step.

        Args:
            name: for instance `qpos`, `xmat` or `sensordata`.

        Raises:
            ValueError: MuJoCo's batch has no such field.
        """
        if name in self._live:
            return self._live[name]
        if name not in self._fields:
            # As of now, and up to date from now on.
            lockstep = self._lockstep
            state = lockstep.batch.state.copy()
            bound = lockstep.live(name)
            lockstep.batch.forward()
            self._bound[name], self._fields[name] = bound, np.array(bound)
            lockstep.batch.state[...] = state
        return self._fields[name]

    def _copy(self, name: str, row: NDArray[Any]) -> None:
        values = getattr(self.physics.data, name)
        if name == "sensordata":
            row[: len(values)] = values  # those of the batch's own come last
        else:
            row[...] = values

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model."""
        return self._lockstep.model

    @property
    def physics(self) -> Any:
        """The physics in which episodes begin; what is fixed can be looked up in it."""
        return self._composer.physics

    @property
    def walker(self) -> Any:
        """The walker of `task`, for the places of its parts in the model."""
        return walker_of(self.task)

    @property
    def drivetrain(self) -> Drivetrain:
        """The actuators of all copies, their command and the last actions, (n_sims, n)."""
        return self._drivetrain

    @property
    def actuators(self) -> ActuatorGroup:
        """The actuators of all copies: `applied_effort` is (n_sims, n_joints), and so on."""
        return self._drivetrain.group

    @property
    def action(self) -> FloatArray:
        """The last actions, (n_sims, n), zeros before the first."""
        return self._drivetrain.last_action

    @property
    def time(self) -> FloatArray:
        """Time since the start of the episodes [s], (n_sims,)."""
        return self._live["time"]

    def close(self) -> None:
        """Frees the physics."""
        self._composer.close()


def walker_of(task: Any) -> Any:
    """The one walker of a task that has actuators of ours.

    Raises:
        TypeError: there is none.
        ValueError: there are several.
    """
    walkers = [one for one in task.root_entity.iter_entities() if isinstance(one, Actuated)]
    if not walkers:
        raise TypeError(
            f"{type(task).__name__} has no walker with actuators of ours: use MjcfWalker, one of "
            "our robots, or with_actuators(walker, actuators)"
        )
    if len(walkers) > 1:
        raise ValueError(f"{type(task).__name__} has {len(walkers)} walkers; only one is stepped")
    return walkers[0]


def _twin(task: Any, make_task: MakeTask) -> Any:
    other = make_task()
    one, two = (t.root_entity.mjcf_model.to_xml_string() for t in (task, other))
    if other is task or one != two:
        raise ValueError(
            "make_task should make the same task each time that it is called, and a new one: build "
            "the walker in it, as lambda: Stand(Quadruped()) does"
        )
    return other


def _compiled(task: Any, physics: Any, edit: Edit | None) -> mujoco.MjModel:
    root = task.root_entity.mjcf_model
    spec = mujoco.MjSpec.from_string(root.to_xml_string(), assets=root.get_assets())
    if edit is not None:
        edit(spec, physics)
    return spec.compile()
