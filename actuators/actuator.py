"""What every actuator can do, from the model's text to the physics step.

    actuator = IdealPdActuatorCfg(joint_names_expr=("knee",), stiffness=40.0, damping=1.0).build()
    actuator.edit_mjcf(root)                       # before compilation: adds its elements
    physics = mjcf.Physics.from_mjcf_model(root)
    actuator.initialize(physics)                   # after every compilation: finds its places
    actuator.reset()                               # at the start of an episode
    for _ in range(1000):
        actuator.update(physics.timestep())
        physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(cmd)
        physics.step()

`compute` belongs before *every* physics step: delays and histories count its calls. The same
actuator serves one physics, with arrays `(n_joints,)`, and a `mujoco.batch.Batch`, with arrays
`(n_sims, n_joints)`: every formula is the same numpy expression over the last axis.
"""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.command import TARGETS, ActuatorCmd
from walkerkit.actuators.messages import closest

if TYPE_CHECKING:
    from dm_control import mjcf

    from walkerkit.actuators.simulation import Simulation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
Random: TypeAlias = "np.random.Generator | np.random.RandomState"  # numpy.random loads late
Targets = tuple[FloatArray | None, FloatArray | None, FloatArray | None]
"""Of position, velocity and effort."""
Rows = IntArray | None
"""Simulations of a batch; None for all of them, or for the only one."""


class Actuator(abc.ABC):
    """Turns targets of its joints into controls of MuJoCo's actuators."""

    def __init__(self) -> None:
        self._checked: ActuatorCmd | None = None

    # Lifecycle.

    @abc.abstractmethod
    def targets(self, root: mjcf.RootElement) -> list[mjcf.Element]:
        """What it would drive: joints, tendons or sites, in kinematic order.

        Args:
            root: the model, not yet compiled; it is left as it is.

        Raises:
            ValueError: as `edit_mjcf`.
        """

    @abc.abstractmethod
    def edit_mjcf(self, root: mjcf.RootElement) -> None:
        """Adds what it needs to the model: its actuators, and armature and friction of the joints.

        Args:
            root: the model, before compilation. A refusal leaves it as it was.

        Raises:
            ValueError: an expression matches nothing, a joint is matched twice or has another
                actuator already, or a number is missing for a joint.
        """

    @abc.abstractmethod
    def initialize(self, physics: Any) -> None:
        """Finds its joints and controls in the compiled model; again after each compilation.

        Args:
            physics: what `Simulation.of` takes.

        Raises:
            RuntimeError: `edit_mjcf` was not called before the compilation.
            ValueError: the model does not have what `edit_mjcf` found.
        """

    def reset(self, env_ids: ArrayLike | None = None, random_state: Random | None = None) -> None:
        """Forgets what happened: delays, histories and hidden states start anew.

        Args:
            env_ids: simulations of the batch, ids or a mask; None for all. The others go on as if
                nothing had happened.
            random_state: where random lags come from, if anywhere; by default from the config's
                seed, once for the actuator's whole life.

        Raises:
            ValueError: ids of one physics, or ids that the batch does not have.
        """
        self._checked = None
        self._reset(rows_of(env_ids, self.simulation.batch_shape), random_state)

    def update(self, dt: float) -> None:
        """Called before each physics step, ahead of `compute`.

        Args:
            dt: the time that the step takes [s].

        Raises:
            ValueError: it is not the timestep of the model, in whose steps lags are counted.
        """
        timestep = self.simulation.model.opt.timestep
        if dt != timestep:
            raise ValueError(
                f"dt is {dt} s, the model's timestep {timestep} s: call update and compute before "
                "every physics step, and initialize after the timestep was changed"
            )

    def compute(self, cmd: ActuatorCmd) -> FloatArray:
        """The controls for the next physics step.

        Args:
            cmd: targets of shape (n_joints,) or (n_sims, n_joints), in the order of `joint_names`.

        Returns:
            Controls of the same shape, in the order of `ctrl_ids`.

        Raises:
            ValueError: a target has another shape, a needed one is missing, or one is given that
                this actuator cannot follow.
        """
        return self.control(*self.checked(cmd))

    def checked(self, cmd: ActuatorCmd) -> Targets:
        """The targets of a command, of which each is looked at once.

        Args:
            cmd: as in `compute`.

        Raises:
            ValueError: as `compute`.
        """
        if cmd is not self._checked:
            self._check(cmd)
            self._checked = cmd
        return cmd.position_target, cmd.velocity_target, cmd.effort_target

    # What it is and does.

    @property
    @abc.abstractmethod
    def takes(self) -> frozenset[str]:
        """The targets that it can follow, of `TARGETS`."""

    @property
    @abc.abstractmethod
    def needs(self) -> frozenset[str]:
        """The targets that it cannot do without."""

    @property
    @abc.abstractmethod
    def simulation(self) -> Simulation:
        """What it was initialized with."""

    @property
    @abc.abstractmethod
    def joint_names(self) -> tuple[str, ...]:
        """Names of its joints (tendons, sites) as in the walker's own model, kinematic order."""

    @property
    @abc.abstractmethod
    def joint_ids(self) -> IntArray:
        """Ids of its joints (tendons, sites) in the compiled model, (n_joints,)."""

    @property
    @abc.abstractmethod
    def ctrl_ids(self) -> IntArray:
        """Places of its controls in `ctrl`, (n_joints,)."""

    @property
    @abc.abstractmethod
    def elements(self) -> tuple[mjcf.Element, ...]:
        """MuJoCo's actuators that it works through, in the order of `joint_names`."""

    @property
    def beside(self) -> tuple[mjcf.Element, ...]:
        """MuJoCo's actuators that it works through besides `elements`, in any order."""
        return ()

    @property
    def apart(self) -> frozenset[str]:
        """The targets that have a control of their own besides that of `ctrl_ids`."""
        return frozenset()

    @property
    @abc.abstractmethod
    def positions(self) -> FloatArray:
        """Where its joints are [rad; m], (..., n_joints), perhaps a live view."""

    @property
    @abc.abstractmethod
    def computed_effort(self) -> FloatArray:
        """What the law asked for in the last `compute`, before any limit [N·m; N]."""

    @property
    @abc.abstractmethod
    def applied_effort(self) -> FloatArray:
        """What was left of it after the limits, those of the joint included [N·m; N]."""

    @abc.abstractmethod
    def reach(self, target: str) -> FloatArray:
        """What it can be asked for, the least of all that config and model state.

        Args:
            target: one of `takes`.

        Returns:
            The least and the greatest target of each joint, (n_joints, 2), infinite where nothing
            is stated.
        """

    @property
    @abc.abstractmethod
    def effort_range(self) -> FloatArray:
        """What acts on the joints at least and at most [N·m; N], (n_joints, 2), as in `reach`."""

    @property
    @abc.abstractmethod
    def holds(self) -> bool:
        """Its control depends on the command alone: it need not be computed at every step."""

    @property
    @abc.abstractmethod
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that `nominal`, `get` and `set` take."""

    @abc.abstractmethod
    def nominal(self, name: str) -> FloatArray:
        """A parameter as configured, or as the XML has it, (n_joints,)."""

    @abc.abstractmethod
    def get(self, name: str) -> FloatArray:
        """A parameter as it is now, (..., n_joints), a copy."""

    @abc.abstractmethod
    def set(self, name: str, values: ArrayLike, env_ids: ArrayLike | None = None) -> None:
        """Changes a parameter, of all simulations or of some.

        Args:
            name: one of `parameters`.
            values: (n_joints,), or (n_ids, n_joints), or a number for all.
            env_ids: as in `reset`.

        Raises:
            KeyError: it has no such parameter.
            ValueError: ids that the batch does not have.
        """

    # For subclasses and for what wraps an actuator.

    @abc.abstractmethod
    def control(
        self,
        position_target: FloatArray | None,
        velocity_target: FloatArray | None,
        effort_target: FloatArray | None,
    ) -> FloatArray:
        """`compute` on targets that were checked before."""

    def look(self) -> None:  # noqa: B027  only what holds has to
        """Stands in for `control` before a step at which its control holds: efforts go on."""

    @abc.abstractmethod
    def _reset(self, rows: Rows, random_state: Random | None) -> None:
        """`reset`, with the ids checked."""

    def _check(self, cmd: ActuatorCmd) -> None:
        expected = (*self.simulation.batch_shape, len(self.joint_names))
        if not isinstance(cmd, ActuatorCmd):
            raise TypeError(f"compute takes an ActuatorCmd, got {cmd!r} of type {type(cmd)}")
        needs, takes = self.needs, self.takes
        for name in TARGETS:
            target = getattr(cmd, name)
            if target is None:
                if name in needs:
                    raise ValueError(
                        f"the actuator of {_few(self.joint_names)} needs a {name}: give it in the "
                        "ActuatorCmd"
                    )
            elif target.shape != expected:
                raise ValueError(
                    f"{name} has shape {target.shape}, the actuator of {_few(self.joint_names)} "
                    f"takes {expected}"
                )
            elif name not in takes and target.any():
                raise ValueError(
                    f"the actuator of {_few(self.joint_names)} cannot follow a {name}, it takes "
                    f"{sorted(self.takes)}: leave it None or zero, or use an actuator that can"
                )


def unknown_parameter(name: str, known: tuple[str, ...]) -> KeyError:
    """The error for a parameter that an actuator does not have."""
    return KeyError(f"no parameter {name!r}{closest(name, known)}; it has {list(known)}")


def _few(names: tuple[str, ...]) -> str:
    shown = ", ".join(repr(name) for name in names[:4])
    return shown + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def rows_of(env_ids: ArrayLike | None, batch_shape: tuple[int, ...]) -> Rows:
    """The ids that a user gave, checked; None for all of them."""
    if env_ids is None:
        return None
    if not batch_shape:
        raise ValueError(f"env_ids={env_ids!r}: there is one physics and no batch; leave it out")
    ids = np.asarray(env_ids)
    if ids.dtype == bool and ids.shape == batch_shape:
        return np.flatnonzero(ids)
    ids = np.atleast_1d(ids)
    if not ids.size:
        return np.zeros(0, dtype=np.intp)
    if ids.dtype.kind not in "iu" or ids.ndim != 1 or ids.min() < 0 or ids.max() >= batch_shape[0]:
        raise ValueError(
            f"env_ids should be ids from 0 to {batch_shape[0] - 1}, or a mask of {batch_shape[0]}, "
            f"got {env_ids!r}"
        )
    return ids.astype(np.intp)
