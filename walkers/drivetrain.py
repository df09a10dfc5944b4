"""A robot's drivetrain: its actuators, and what a policy's action asks of them.

    drivetrain = Drivetrain(root, cfgs, action=JointPositionAction(joint_names_expr=(".*",)))
    physics = mjcf.Physics.from_mjcf_model(root)
    drivetrain.initialize(physics)             # after each compilation
    drivetrain.reset(random_state)             # at the start of an episode
    drivetrain.act(action)                     # at each control step
    drivetrain.run()                           # before each physics step

It knows neither walkers nor tasks: composer walkers and the physics of suite tasks have one each.
Initialized with a `LockStep` batch, it drives all its simulations, with one row of an action each;
`adopt` then stands for `reset`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, Protocol, get_args

import mujoco
import numpy as np
from dm_control import mjcf
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators import (
    ActuatorCfg,
    ActuatorCmd,
    ActuatorGroup,
    BuiltinDcMotorActuatorCfg,
    BuiltinMotorActuatorCfg,
    BuiltinVelocityActuatorCfg,
)
from walkerkit.actuators.adoption import Adoption
from walkerkit.actuators.command import TARGETS
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.drivetrain import DrivetrainLaw, LawRunner
from walkerkit.actuators.inputs import XmlInputsActuatorCfg
from walkerkit.actuators.limits import stated_reach
from walkerkit.actuators.selection import Numbers, select
from walkerkit.actuators.simulation import Simulation
from walkerkit.actuators.targeted import actuators_of, candidates, element_ids
from walkerkit.actuators.wrapped import XmlActuatorCfg
from walkerkit.walkers.actions import Commander, FullRangeAction, checked_action
from walkerkit.walkers.terms import ActionTerm, Joints

FloatArray = NDArray[np.float64]
Existing = Literal["replace", "keep"]
Reaches = dict[int, dict[str, FloatArray]]
"""By the id of a joint's element: {target: least and greatest}."""

_FROM_XML = (XmlActuatorCfg, XmlInputsActuatorCfg)
_DRIVEN = ("joint", "jointinparent", "tendon", "site", "cranksite", "body")


class Randomization(Protocol):
    """Changes actuators at the start of an episode."""

    def apply(self, actuators: ActuatorGroup, random_state: Any) -> Any:
        """Draws anew, from the nominal values."""


class Drivetrain:
    """Actuators added to a model, with the controls of those that the model keeps.

    Args:
        root: the robot's model, before compilation; it is changed.
        cfgs: configs of the actuators.
        action: action terms; by default an action spans all that the joints can do.
        default: {joint: position} of the default pose [rad; m]; others are at their reference.
        existing: `replace` the actuators that the joints have already, or `keep` them, which makes
            a second one for the same joint an error.
        laws: drivetrain laws of its joints (`walkerkit.actuators.drivetrain`).
        randomizations: applied at the start of each episode.
        keep_integrator: leave the model's integrator alone. By default a model that states none
            gets `implicitfast` where an actuator brings damping.

    Attributes:
        group: the actuators, whose laws run before each physics step.
        kept: MuJoCo's actuators that are not of this drivetrain; they take the last numbers of an
            action, as their controls, one with several inputs as many.
        joints: what is known of the joints that the group drives.
        command: what the actuators are asked for at present.
        last_action: the last action of this episode, zeros before the first.

    Raises:
        TypeError: something is not a config.
        ValueError: as `ActuatorGroup.edit_mjcf` and `Commander`.
    """

    def __init__(
        self,
        root: mjcf.RootElement,
        cfgs: ActuatorCfg | Iterable[ActuatorCfg],
        *,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        default: Mapping[str, float] | None = None,
        existing: Existing = "replace",
        laws: Sequence[DrivetrainLaw] = (),
        randomizations: Sequence[Randomization] = (),
        keep_integrator: bool = False,
    ):
        if existing not in get_args(Existing):
            raise ValueError(f"existing should be one of {get_args(Existing)}, got {existing!r}")
        self.group = ActuatorGroup(cfgs, may_be_none=existing == "keep")
        replaced = _remove_claimed(root, self.group) if existing == "replace" else {}
        self.group.edit_mjcf(root)
        if not keep_integrator and root.option.integrator is None and _bring_damping(self.group):
            root.option.integrator = "implicitfast"
        self.kept: tuple[Any, ...] = tuple(
            element
            for element in root.find_all("actuator")
            if not any(element is ours for ours in (*self.group.elements, *self.group.beside))
        )
        self._root = root
        self._randomizations = tuple(randomizations)
        self._laws = LawRunner(laws) if laws else None
        self.joints, self._kept_ranges, kept_names = _survey(
            root, self.group, self.kept, default or {}, replaced
        )
        terms = (FullRangeAction(),) if action is None else action
        self._commander = Commander(terms if isinstance(terms, Sequence) else (terms,), self.joints)
        self._names = (*self._commander.names, *kept_names)
        self._ctrl: FloatArray = np.zeros(0)
        self._kept_at: NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        self._batch_shape: tuple[int, ...] = ()
        self._adoption: Adoption | None = None
        self.command: ActuatorCmd = self._commander.rest()
        self.last_action: FloatArray = np.zeros(len(self._names))
        self._asked: tuple[ActuatorCmd, FloatArray] | None = None

    def initialize(self, physics: Any) -> None:
        """Finds joints and controls in the compiled model; again after each compilation.

        Args:
            physics: what `Simulation.of` takes.
        """
        self.group.initialize(physics)
        if self._laws is not None:
            self._laws.initialize(self.group)
        self._ctrl = self.group.simulation.state("ctrl")
        model = Simulation.of(physics).model
        self._batch_shape = self.group.simulation.batch_shape
        if self._batch_shape:
            self._adoption = Adoption(self.group)
            self.command = self._commander.rest(self._batch_shape)
            self.last_action = np.zeros((*self._batch_shape, len(self._names)))
        ids = element_ids(model, self.kept, mujoco.mjtObj.mjOBJ_ACTUATOR, self._root)
        self._kept_at = _controls_of(model, ids)

    def reset(self, random_state: Any) -> None:
        """Forgets the last episode: delays, histories, the command; draws what is random.

        Args:
            random_state: where draws come from.
        """
        if self._laws is not None:
            self._laws.restore()
        for randomization in self._randomizations:
            randomization.apply(self.group, random_state)
        self.command = self._commander.rest()
        self.last_action = np.zeros(len(self._names))
        self._asked = None
        self.group.reset(random_state=random_state)
        # Observations of the first step see forces that belong to the pose.
        self.group.apply(self.command)
        if self._laws is not None:
            self._laws.reset()
        self.group.reset(random_state=random_state)

    def adopt(self, row: int, drivetrain: Drivetrain) -> None:
        """Lets a simulation of the batch begin as one physics that has just been reset.

        Args:
            row: the simulation, whose state is that of the physics.
            drivetrain: of the physics, and made as this one was.

        Raises:
            RuntimeError: this drivetrain drives one physics.
            ValueError: it has drivetrain laws, which keep a past that nothing carries over.
        """
        if self._adoption is None:
            raise RuntimeError("call initialize(batch) with a batch of simulations, then adopt")
        if self._laws is not None:
            raise ValueError(
                "the walker has drivetrain laws, and those run in one physics at a time: leave "
                "`laws` out, or take as many environments"
            )
        self._adoption.adopt(row, drivetrain.group)
        targets = {}
        for name in TARGETS:
            values, rest = getattr(self.command, name), getattr(drivetrain.command, name)
            if values is not None:
                targets[name] = values.copy()
                targets[name][row] = rest
        self.command = ActuatorCmd(**targets)
        self.last_action = self.last_action.copy()
        self.last_action[row] = 0.0

    def act(self, action: ArrayLike) -> None:
        """Sets the command, and the controls that were kept, for the coming physics steps.

        Args:
            action: (n,), or (n_sims, n), as the action terms take it. Controls of actuators that
                were kept come last, in their own units.

        Raises:
            RuntimeError: the model has actuators that were kept and is not compiled yet.
            ValueError: the action has another shape, is not finite, or asks for what is not.
        """
        if len(self._kept_at) != len(self._kept_ranges):
            raise RuntimeError("call initialize(physics) after the model was compiled, then act")
        values = checked_action(action, self._names, self._batch_shape)
        n = self._commander.size
        if self._commander.relative:
            self._follow(values[..., :n])
        else:
            self.command = self._commander.asked(values[..., :n], self._batch_shape)
        if self.kept:
            low, high = self._kept_ranges.T
            self._ctrl[..., self._kept_at] = np.clip(values[..., n:], low, high)
        values.flags.writeable = False
        self.last_action = values

    def run(self) -> None:
        """Runs the actuators' laws for the next physics step."""
        # A command that someone else has set stays as it is.
        if self._asked is not None and self._asked[0] is self.command:
            self._follow(self._asked[1])
        if self._laws is not None:
            self._laws.apply(self.command)
        else:
            self.group.apply(self.command)

    def _follow(self, values: FloatArray) -> None:
        """Counts the targets of relative terms from where the joints are now."""
        self.command = self._commander.asked(values, self._batch_shape, self.group.positions)
        self._asked = self.command, values

    def action_for(self, cmd: ActuatorCmd | None = None) -> FloatArray:
        """The action that asks for a command, as a policy in physical units needs it.

        Args:
            cmd: targets of `joints.names`; None to hold the default pose.

        Returns:
            (n,), not clipped: what is beyond ±1 is more than a `FullRangeAction` can ask for.
            Controls of actuators that were kept are zero.
        """
        positions = self.group.positions if self._commander.relative else None
        wanted = self._commander.action(self._commander.rest() if cmd is None else cmd, positions)
        return np.concatenate([wanted, np.zeros(len(self._kept_ranges))])

    @property
    def laws(self) -> tuple[DrivetrainLaw, ...]:
        """The drivetrain laws of its joints."""
        return () if self._laws is None else self._laws.laws

    @property
    def changed_effort(self) -> FloatArray:
        """What laws changed of the effort that the drives report [N·m; N], (n_joints,)."""
        if self._laws is None:
            return np.zeros(len(self.joints.names))
        return self._laws.changed_effort

    @property
    def rest(self) -> ActuatorCmd:
        """The command to hold the default pose."""
        return self._commander.rest()

    @property
    def action_spec(self) -> specs.BoundedArray:
        """A number in [-1, 1] for each of the terms' targets, then controls that were kept.

        Terms without a clip of their own also take what lies outside.
        """
        n = self._commander.size
        return specs.BoundedArray(
            shape=(len(self._names),),
            dtype=np.float64,
            minimum=np.concatenate([np.full(n, -1.0), self._kept_ranges[:, 0]]),
            maximum=np.concatenate([np.full(n, 1.0), self._kept_ranges[:, 1]]),
            name="\t".join(self._names),
        )


def _kept_names(element: Any, inputs: int) -> list[str]:
    """An actuator's name, or that of what it drives; one with several inputs has one for each."""
    driven = (getattr(element, reference, None) for reference in _DRIVEN)
    named = (one.name for one in (element, *driven) if one is not None and one.name)
    name = str(next(named, element.tag))
    return [name] if inputs == 1 else [f"{name}[{k}]" for k in range(inputs)]


def _controls_of(model: mujoco.MjModel, actuators: NDArray[np.intp]) -> NDArray[np.intp]:
    """Where all controls of some actuators are in `ctrl`."""
    first, count = model.actuator_ctrladr[actuators], model.actuator_ctrlnum[actuators]
    places = [np.arange(f, f + n) for f, n in zip(first, count, strict=True)]
    return np.concatenate([np.zeros(0), *places]).astype(np.intp)


def _remove_claimed(root: mjcf.RootElement, group: ActuatorGroup) -> Reaches:
    """Removes the actuators of joints that get a new one, and the sensors that read them.

    Returns:
        What those could be asked for, by what they drove.
    """
    removed: dict[int, list[Any]] = {}
    unlimited: dict[int, list[Any]] = {}
    for cfg in group.cfgs:
        base = getattr(cfg, "base_cfg", cfg)
        if isinstance(base, TargetedActuatorCfg) and not isinstance(base, _FROM_XML):
            named = candidates(root, base.transmission)
            targets = list(named.values())
            for i in select(base.joint_names_expr, list(named)):
                removed[id(targets[i])] = actuators_of(targets[i])
                # Positions are limited by the joint, and laws that run in Python take them.
                if isinstance(base, BuiltinVelocityActuatorCfg | BuiltinMotorActuatorCfg):
                    unlimited[id(targets[i])] = removed[id(targets[i])]
    reaches = _reaches(root, unlimited)
    elements = [element for those in removed.values() for element in those]
    for sensor in root.find_all("sensor"):
        if any(getattr(sensor, "actuator", None) is element for element in elements):
            sensor.remove()
    for element in elements:
        element.remove()
    return reaches


def _bring_damping(group: ActuatorGroup) -> bool:
    """Whether actuators that are added to the model damp, which Euler would integrate explicitly.

    The file's own actuators do as they did.
    """
    added = [getattr(cfg, "base_cfg", cfg) for cfg in group.cfgs]
    return any(
        isinstance(cfg, BuiltinDcMotorActuatorCfg) or _any(cfg.numbers().get("damping", 0.0))
        for cfg in added
        if isinstance(cfg, TargetedActuatorCfg) and not isinstance(cfg, _FROM_XML)
    )


def _any(numbers: Numbers) -> bool:
    """Whether one of the numbers is not zero."""
    return any(numbers.values()) if isinstance(numbers, Mapping) else numbers != 0


def _reaches(root: mjcf.RootElement, actuators: Mapping[int, Sequence[Any]]) -> Reaches:
    """What joints could be asked for that have just one actuator, while it is still there."""
    alone = {target: those[0] for target, those in actuators.items() if len(those) == 1}
    if not alone:
        return {}
    model = _compiled(root)
    ids = element_ids(model, alone.values(), mujoco.mjtObj.mjOBJ_ACTUATOR, root)
    return {target: stated_reach(model, int(one)) for target, one in zip(alone, ids, strict=True)}


def _survey(
    root: mjcf.RootElement,
    group: ActuatorGroup,
    kept: Sequence[Any],
    default: Any,
    replaced: Reaches,
) -> tuple[Joints, FloatArray, list[str]]:
    """What there is to know of the joints and of the controls that were kept, compiled once."""
    model = _compiled(root)
    data = mujoco.MjData(model)
    group.initialize((model, data))
    on_joint = {
        name: int(joint)
        for actuator, cfg in zip(group.actuators, group.cfgs, strict=True)
        if getattr(getattr(cfg, "base_cfg", cfg), "transmission", "joint") == "joint"
        for name, joint in zip(actuator.joint_names, actuator.joint_ids, strict=True)
    }
    positions = [
        float(default.get(name, model.qpos0[model.jnt_qposadr[on_joint[name]]]))
        if name in on_joint
        else 0.0
        for name in group.joint_names
    ]
    takes = {name: actuator.takes for actuator in group.actuators for name in actuator.joint_names}
    apart = {name: actuator.apart for actuator in group.actuators for name in actuator.joint_names}
    reach = {target: group.reach(target) for target in TARGETS}
    for i, target in enumerate(group.driven):
        # Where nothing limits an actuator now, an action spans what the one before it could do.
        for name, ends in replaced.get(id(target), {}).items():
            if name in takes[group.joint_names[i]] and not np.isfinite(reach[name][i]).all():
                reach[name][i] = ends
    joints = Joints(
        names=group.joint_names,
        default=np.array(positions),
        ranges=reach["position_target"],
        takes=tuple(takes[name] for name in group.joint_names),
        speeds=np.abs(reach["velocity_target"]).max(axis=1),
        efforts=np.abs(group.effort_range).max(axis=1),
        apart=tuple(apart[name] for name in group.joint_names),
        reach=reach,
    )
    ids = element_ids(model, kept, mujoco.mjtObj.mjOBJ_ACTUATOR, root)
    controls = _controls_of(model, ids)
    limited = (model.actuator_ctrllimited[controls] != 0)[:, None]
    kept_ranges = np.where(limited, model.actuator_ctrlrange[controls], [[-1.0, 1.0]])
    inputs = model.actuator_ctrlnum[ids]
    named = [
        name
        for element, n in zip(kept, inputs, strict=True)
        for name in _kept_names(element, int(n))
    ]
    return joints, kept_ranges.reshape(-1, 2), named


def _compiled(root: mjcf.RootElement) -> mujoco.MjModel:
    """The walker's own model, as MuJoCo compiles it."""
    return mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
