"""The actuators of one robot, side by side.

    actuators = ActuatorGroup((hip_cfg, knee_cfg))
    actuators.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    actuators.initialize(physics)
    actuators.apply(ActuatorCmd(position_target=targets))     # before every physics step

Its arrays have one column per joint, of all its actuators together, in kinematic order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.actuator import Actuator, Random
from walkerkit.actuators.command import TARGETS, ActuatorCmd
from walkerkit.actuators.config import TRANSMISSIONS, ActuatorCfg
from walkerkit.actuators.joined import Joined, joined
from walkerkit.actuators.messages import listed
from walkerkit.actuators.selection import narrowed
from walkerkit.actuators.simulation import Simulation, indexer, last_axis
from walkerkit.actuators.targeted import in_kinematic_order

if TYPE_CHECKING:
    from dm_control import mjcf

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


_NO_JOINTS = (
    "the actuators have no joints yet: call edit_mjcf(root) before the model is compiled, then "
    "initialize(physics)"
)


class ActuatorGroup:
    """Several actuators that share out the joints of a robot.

    Args:
        cfgs: their configs.
        may_be_none: there need not be any.

    Attributes:
        actuators: the actuators, in the order of the configs.

    Raises:
        TypeError: something is not a config.
        ValueError: there is none.
    """

    def __init__(self, cfgs: ActuatorCfg | Iterable[ActuatorCfg], *, may_be_none: bool = False):
        configs = (cfgs,) if isinstance(cfgs, ActuatorCfg) else tuple(cfgs)
        for cfg in configs:
            if not isinstance(cfg, ActuatorCfg):
                raise TypeError(f"actuators should be actuator configs, got {cfg!r}")
        if not configs and not may_be_none:
            raise ValueError("actuators is empty: give at least one actuator config")
        self.cfgs = configs
        self.actuators: tuple[Actuator, ...] = tuple(cfg.build() for cfg in configs)
        self._joint_names: tuple[str, ...] = ()
        self._driven: tuple[Any, ...] = ()
        self._columns: tuple[Any, ...] = ()
        self._single = len(configs) == 1
        self._last: ActuatorCmd | None = None
        self._parts: dict[int, ActuatorCmd] = {}
        self._simulation: Simulation | None = None
        self._ctrl: FloatArray = np.zeros(0)
        self._ctrl_at: tuple[Any, ...] = ()
        self._order: tuple[IntArray, ...] = ()
        self._for_others: tuple[frozenset[str], ...] = ()
        self._joined: list[Joined] = []
        self._apart: list[int] = []

    def edit_mjcf(self, root: mjcf.RootElement) -> None:
        """Adds all of them to the model.

        Args:
            root: the model, before compilation. A refusal leaves it as it was.

        Raises:
            ValueError: as `Actuator.edit_mjcf`, or two configs claim one joint.
        """
        targets = [actuator.targets(root) for actuator in self.actuators]
        for i, mine in enumerate(targets):
            for other in range(i):
                twice = [one for one in mine if any(one is its for its in targets[other])]
                if twice:
                    raise _claimed_twice(
                        root, twice, *((self.cfgs[k], targets[k]) for k in (other, i))
                    )
        for actuator in self.actuators:
            actuator.edit_mjcf(root)
        # By the element and not by its name: a tendon may have the name of a joint.
        rank = {
            id(element): i
            for i, element in enumerate(
                element for kind in TRANSMISSIONS for element in in_kinematic_order(root, kind)
            )
        }
        ranks = [[rank[id(target)] for target in mine] for mine in targets]
        named = {
            place: name
            for mine, actuator in zip(ranks, self.actuators, strict=True)
            for place, name in zip(mine, actuator.joint_names, strict=True)
        }
        at = {place: i for i, place in enumerate(sorted(named))}
        self._joint_names = tuple(named[place] for place in at)
        driven = {
            place: one
            for m, r in zip(targets, ranks, strict=True)
            for one, place in zip(m, r, strict=True)
        }
        self._driven = tuple(driven[place] for place in at)
        self._order = tuple(
            np.array([at[place] for place in mine], dtype=np.intp) for mine in ranks
        )
        self._columns = tuple(indexer(order) for order in self._order)

    def initialize(self, physics: Any) -> None:
        """Finds their places in the compiled model; again after each compilation.

        Args:
            physics: what `Simulation.of` takes.

        Raises:
            RuntimeError: `edit_mjcf` was not called before the compilation.
        """
        for actuator in self.actuators:
            actuator.initialize(physics)
        self._simulation = Simulation.of(physics)
        self._ctrl = self._simulation.state("ctrl")
        self._ctrl_at = tuple(
            last_axis(self._ctrl, actuator.ctrl_ids) for actuator in self.actuators
        )
        # A target that none of them takes is left in, to be refused; so is an effort, always.
        some = self.takes - {"effort_target"}
        self._for_others = tuple(some - actuator.takes for actuator in self.actuators)
        self._joined, self._apart = joined(self.actuators, self._columns)
        self._last = None

    def reset(self, env_ids: ArrayLike | None = None, random_state: Random | None = None) -> None:
        """Forgets what happened, as `Actuator.reset`."""
        for actuator in self.actuators:
            actuator.reset(env_ids, random_state)
        for lot in self._joined:
            lot.forget()
        self._last = None

    def update(self, dt: float) -> None:
        """As `Actuator.update`."""
        for actuator in self.actuators:
            actuator.update(dt)

    def compute(self, cmd: ActuatorCmd) -> FloatArray:
        """The controls for the next physics step.

        Args:
            cmd: targets of all joints, in the order of `joint_names`.

        Returns:
            Controls of the same shape and order; they belong at `ctrl_ids`.
        """
        if self._single:
            return self.actuators[0].compute(cmd)
        controls = np.empty((*self.simulation.batch_shape, len(self._joint_names)))
        parts = self._split(cmd, range(len(self.actuators)))
        for i, (actuator, columns) in enumerate(zip(self.actuators, self._columns, strict=True)):
            controls[..., columns] = actuator.compute(parts[i])
        return controls

    def apply(self, cmd: ActuatorCmd) -> None:
        """Computes the controls and writes them; what holds from the step before is left alone.

        Args:
            cmd: as in `compute`.
        """
        again = cmd is self._last
        parts = self._parts if again else self._split(cmd, self._apart)
        for lot in self._joined:
            lot.apply(cmd)
        for i in self._apart:
            actuator = self.actuators[i]
            if again and actuator.holds:
                actuator.look()
            else:
                self._ctrl[self._ctrl_at[i]] = actuator.compute(parts[i])

    def renew(self) -> None:
        """Lets the next `apply` write every control, also those that hold."""
        self._last = None

    def _split(self, cmd: ActuatorCmd, places: Iterable[int]) -> Mapping[int, ActuatorCmd]:
        """The parts of a command that these actuators get, at least."""
        if cmd is not self._last:
            expected = (*self.simulation.batch_shape, len(self._joint_names))
            if cmd.shape is not None and cmd.shape != expected:
                raise ValueError(
                    f"the targets have shape {cmd.shape}, the robot takes {expected}: one number "
                    f"for each of {list(self._joint_names)}"
                )
            self._last, self._parts = cmd, {}
        for i in places:
            if i not in self._parts:
                self._parts[i] = (
                    cmd
                    if self._single
                    else _without(cmd.select(self._columns[i]), self._for_others[i])
                )
        return self._parts

    @property
    def simulation(self) -> Simulation:
        """What they were initialized with."""
        if self._simulation is None:
            raise self._unknown()
        return self._simulation

    def _unknown(self) -> RuntimeError:
        """The error for who asks before they know their physics."""
        return RuntimeError(
            "call initialize(physics) after the model was compiled"
            if self._joint_names or not self.actuators
            else _NO_JOINTS
        )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of all joints, in kinematic order.

        Raises:
            RuntimeError: `edit_mjcf` was not called yet, here and in what follows.
        """
        if self.actuators and not self._joint_names:
            raise RuntimeError(_NO_JOINTS)
        return self._joint_names

    @property
    def driven(self) -> tuple[Any, ...]:
        """The joints (tendons, sites) themselves, in the order of `joint_names`."""
        if self.actuators and not self._joint_names:
            raise RuntimeError(_NO_JOINTS)
        return self._driven

    @property
    def positions(self) -> FloatArray:
        """Where the joints are [rad; m], (..., n_joints), a copy."""
        return self._gather([actuator.positions for actuator in self.actuators])

    @property
    def joint_ids(self) -> IntArray:
        """Ids of all joints in the compiled model, (n_joints,).

        Raises:
            RuntimeError: they do not know their physics yet, here and in what follows.
        """
        return self._gather([actuator.joint_ids for actuator in self.actuators]).astype(np.intp)

    @property
    def ctrl_ids(self) -> IntArray:
        """Places of the controls in `ctrl`, (n_joints,)."""
        return self._gather([actuator.ctrl_ids for actuator in self.actuators]).astype(np.intp)

    @property
    def takes(self) -> frozenset[str]:
        """The targets that at least one of them can follow, of `TARGETS`."""
        every = {name for actuator in self.actuators for name in actuator.takes}
        return frozenset(name for name in TARGETS if name in every)

    @property
    def elements(self) -> tuple[Any, ...]:
        """MuJoCo's actuators, in the order of `joint_names`."""
        every: list[Any] = [None] * len(self.joint_names)
        for actuator, order in zip(self.actuators, self._order, strict=True):
            for place, element in zip(order, actuator.elements, strict=True):
                every[int(place)] = element
        return tuple(every)

    @property
    def beside(self) -> tuple[Any, ...]:
        """MuJoCo's actuators that they work through besides these."""
        return tuple(element for actuator in self.actuators for element in actuator.beside)

    @property
    def computed_effort(self) -> FloatArray:
        """What the laws asked for in the last step, before any limit [N·m; N]."""
        return self._gather([actuator.computed_effort for actuator in self.actuators])

    @property
    def applied_effort(self) -> FloatArray:
        """What was left of it after the limits [N·m; N]."""
        return self._gather([actuator.applied_effort for actuator in self.actuators])

    def reach(self, target: str) -> FloatArray:
        """What each joint can be asked for, as `Actuator.reach`, (n_joints, 2).

        Args:
            target: of `TARGETS`.
        """
        return self._ranges([actuator.reach(target) for actuator in self.actuators])

    @property
    def effort_range(self) -> FloatArray:
        """What acts on each joint at least and at most [N·m; N], as `Actuator`, (n_joints, 2)."""
        return self._ranges([actuator.effort_range for actuator in self.actuators])

    def _ranges(self, parts: list[FloatArray]) -> FloatArray:
        """Ranges of each actuator's joints, in the order of `joint_names`."""
        every = np.empty((len(self._joint_names), 2))
        for part, order in zip(parts, self._order, strict=True):
            every[order] = part
        return every

    def _gather(self, parts: list[NDArray[Any]]) -> NDArray[Any]:
        if self._simulation is None:
            raise self._unknown()
        if not parts:
            return np.zeros((*self._simulation.batch_shape, 0))
        every = np.empty((*parts[0].shape[:-1], len(self._joint_names)), dtype=parts[0].dtype)
        for part, columns in zip(parts, self._columns, strict=True):
            every[..., columns] = part
        return every


def _without(cmd: ActuatorCmd, names: frozenset[str]) -> ActuatorCmd:
    """A part of a command without the targets that only other joints' actuators take."""
    for name in names:
        object.__setattr__(cmd, name, None)
    return cmd


def _claimed_twice(
    root: mjcf.RootElement, twice: Sequence[Any], *claims: tuple[ActuatorCfg, Sequence[Any]]
) -> ValueError:
    """The error for joints that two configs claim, with the expressions that mend it."""

    def names(elements: Sequence[Any]) -> list[str]:
        return [one.prefixed_identifier(prefix_root=root.namescope) for one in elements]

    one, other = (cfg for cfg, _ in claims)
    wider, its = max(claims, key=lambda claim: len(claim[1]))  # the first of two alike
    rest = narrowed(getattr(wider, "joint_names_expr", ()), names(its), names(twice))
    remedy = (
        f"make the {'first' if wider is one else 'second'} narrower, joint_names_expr={rest}"
        if rest
        else "leave one of the two out"
    )
    kind = twice[0].spec.namespace
    what = f"{kind}s {{}} are" if len(twice) > 1 else f"{kind} {{}} is"
    return ValueError(
        f"{what.format(listed(names(twice)))} claimed by {_named(one)} and by {_named(other)}: "
        f"{remedy}"
    )


def _named(cfg: ActuatorCfg) -> str:
    expressions = getattr(cfg, "joint_names_expr", ())
    return f"{type(cfg).__name__}(joint_names_expr={expressions})"
