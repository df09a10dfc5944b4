"""What makes a composer walker own its actuators.

`apply_action` sets the command, `before_substep` runs the laws, `after_compile` finds everything
again in the recompiled model and `initialize_episode` forgets the last episode: the walker works in
tasks and arenas that know nothing of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal, Protocol

import mujoco
import numpy as np
from dm_control import mjcf
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators import ActuatorCfg, ActuatorCmd, ActuatorGroup
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.selection import select
from walkerkit.actuators.targeted import actuators_of, candidates
from walkerkit.actuators.wrapped import XmlActuatorCfg
from walkerkit.walkers.actions import (
    ActionTerm,
    Commander,
    FullRangeAction,
    Joints,
    checked_action,
)

FloatArray = NDArray[np.float64]
Existing = Literal["replace", "keep"]


class Randomization(Protocol):
    """Changes actuators at the start of an episode."""

    def apply(self, actuators: ActuatorGroup, random_state: Any) -> Any:
        """Draws anew, from the nominal values."""


class Actuated:
    """Mixin for `dm_control.locomotion.walkers.base.Walker`; see `MjcfWalker`, `with_actuators`."""

    def put_on(
        self,
        root: mjcf.RootElement,
        cfgs: ActuatorCfg | Iterable[ActuatorCfg],
        *,
        action: ActionTerm | Sequence[ActionTerm] | None,
        default: Any,
        existing: Existing,
        randomizations: Sequence[Randomization] = (),
    ) -> None:
        """Adds the actuators to the walker's model; to be called once, while it is built.

        Args:
            root: the walker's model.
            cfgs: configs of the actuators.
            action: action terms; by default an action spans all that the joints can do.
            default: {joint: position} of the default pose [rad; m]; others are at their reference.
            existing: whether actuators that the joints have already are replaced, or kept, which
                makes a second one for the same joint an error.
            randomizations: applied at the start of each episode.
        """
        group = ActuatorGroup(cfgs)
        if existing == "replace":
            _remove_claimed(root, group)
        group.edit_mjcf(root)
        self._group = group
        self._kept = tuple(
            element
            for element in root.find_all("actuator")
            if not any(element is ours for ours in group.elements)
        )
        self._kept_ctrl: Any = slice(0, 0)
        self._live_ctrl: FloatArray = np.zeros(0)
        self._randomizations = tuple(randomizations)
        terms = (FullRangeAction(),) if action is None else action
        joints, ranges = _survey(root, group, self._kept, default)
        self._commander = Commander(terms if isinstance(terms, Sequence) else (terms,), joints)
        self._kept_ranges = ranges
        self._command: ActuatorCmd = self._commander.rest()
        self._last_action: FloatArray = np.zeros(self.action_spec.shape)

    # What composer calls.

    def after_compile(self, physics: Any, random_state: Any) -> None:
        """Finds joints and controls in the compiled model."""
        super().after_compile(physics, random_state)  # type: ignore[misc]
        self._group.initialize(physics)
        self._live_ctrl = self._group.simulation.state("ctrl")
        if self._kept:
            ids = np.atleast_1d(physics.bind(self._kept).element_id)
            self._kept_ctrl = physics.model.ptr.actuator_ctrladr[ids]

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        """Forgets the last episode: delays, histories, the command; draws what is random."""
        super().initialize_episode(physics, random_state)  # type: ignore[misc]
        for randomization in self._randomizations:
            randomization.apply(self._group, random_state)
        self._command = self._commander.rest()
        self._last_action = np.zeros(self.action_spec.shape)
        self._group.reset(random_state=random_state)
        # Observations of the first step see forces that belong to the pose.
        self._group.apply(self._command)
        self._group.reset(random_state=random_state)

    def apply_action(self, physics: Any, action: ArrayLike, random_state: Any) -> None:
        """Sets the command for the coming physics steps.

        Args:
            physics: the compiled model.
            action: (n,), in [-1, 1]; what is outside is clipped. Controls of actuators that were
                kept come last, in their own units.
            random_state: unused.

        Raises:
            ValueError: the action has another shape, or is not finite.
        """
        del physics, random_state
        values = checked_action(action, [*self._commander.names, *self._kept_names])
        n = self._commander.size
        self._command = self._commander.command(values[:n])
        if self._kept:
            low, high = self._kept_ranges.T
            self._live_ctrl[self._kept_ctrl] = np.clip(values[n:], low, high)
        self._last_action = values

    def before_substep(self, physics: Any, random_state: Any) -> None:
        """Runs the actuators' laws."""
        super().before_substep(physics, random_state)  # type: ignore[misc]
        self._group.apply(self._command)

    # What it offers.

    @property
    def actuator_group(self) -> ActuatorGroup:
        """The actuators, whose laws run before each physics step."""
        return self._group

    @property
    def command(self) -> ActuatorCmd:
        """What the actuators are asked for at present."""
        return self._command

    @command.setter
    def command(self, cmd: ActuatorCmd) -> None:
        self._command = cmd

    @property
    def action_spec(self) -> specs.BoundedArray:
        """A number in [-1, 1] for each of the terms' targets, then controls that were kept."""
        n = self._commander.size
        return specs.BoundedArray(
            shape=(n + len(self._kept),),
            dtype=np.float64,
            minimum=np.concatenate([np.full(n, -1.0), self._kept_ranges[:, 0]]),
            maximum=np.concatenate([np.full(n, 1.0), self._kept_ranges[:, 1]]),
            name="\t".join([*self._commander.names, *self._kept_names]),
        )

    def action_for(self, cmd: ActuatorCmd | None = None) -> FloatArray:
        """The action that asks for a command, as a policy in physical units needs it.

        Args:
            cmd: targets of `actuator_group.joint_names`; None to hold the default pose.

        Returns:
            (n,), not clipped: what is beyond ±1 is more than the action terms can ask for. Controls
            of actuators that were kept are zero.
        """
        wanted = self._commander.action(self._commander.rest() if cmd is None else cmd)
        return np.concatenate([wanted, np.zeros(len(self._kept))])

    @property
    def prev_action(self) -> FloatArray:
        """The last action of this episode, zeros before the first."""
        return self._last_action

    @property
    def _kept_names(self) -> tuple[str, ...]:
        return tuple(str(element.name) for element in self._kept)


def _remove_claimed(root: mjcf.RootElement, group: ActuatorGroup) -> None:
    """Removes the actuators of joints that get a new one, and the sensors that read them."""
    removed = []
    for cfg in group.cfgs:
        base = getattr(cfg, "base_cfg", cfg)
        if isinstance(base, TargetedActuatorCfg) and not isinstance(base, XmlActuatorCfg):
            named = candidates(root, base.transmission)
            targets = list(named.values())
            for i in select(base.joint_names_expr, list(named)):
                removed += actuators_of(targets[i])
    for sensor in root.find_all("sensor"):
        if any(getattr(sensor, "actuator", None) is element for element in removed):
            sensor.remove()
    for element in removed:
        element.remove()


def _survey(
    root: mjcf.RootElement, group: ActuatorGroup, kept: Sequence[Any], default: Any
) -> tuple[Joints, FloatArray]:
    """What there is to know of the joints and of the controls that were kept, compiled once."""
    model = compiled(root)
    data = mujoco.MjData(model)
    group.initialize((model, data))
    positions, ranges = [], []
    on_joint = {
        name: int(joint)
        for actuator, cfg in zip(group.actuators, group.cfgs, strict=True)
        if getattr(getattr(cfg, "base_cfg", cfg), "transmission", "joint") == "joint"
        for name, joint in zip(actuator.joint_names, actuator.joint_ids, strict=True)
    }
    for name in group.joint_names:
        joint = on_joint.get(name)
        if joint is None:
            positions.append(0.0)
            ranges.append([-np.inf, np.inf])
            continue
        address = model.jnt_qposadr[joint]
        positions.append(float(default.get(name, model.qpos0[address])))
        limited = model.jnt_limited[joint]
        ranges.append(list(model.jnt_range[joint]) if limited else [-np.inf, np.inf])
    takes = {name: actuator.takes for actuator in group.actuators for name in actuator.joint_names}
    joints = Joints(
        names=group.joint_names,
        default=np.array(positions),
        ranges=np.array(ranges).reshape(-1, 2),
        takes=tuple(takes[name] for name in group.joint_names),
        speeds=_limits(group, "velocity_limit"),
        efforts=_limits(group, "effort_limit"),
    )
    names = [element.prefixed_identifier(prefix_root=root.namescope) for element in kept]
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name) for name in names]
    controls = model.actuator_ctrladr[ids]
    limited = (model.actuator_ctrllimited[controls] != 0)[:, None]
    kept_ranges = np.where(limited, model.actuator_ctrlrange[controls], [[-1.0, 1.0]])
    return joints, kept_ranges.reshape(-1, 2)


def compiled(root: mjcf.RootElement) -> mujoco.MjModel:
    """The walker's own model, as MuJoCo compiles it."""
    return mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())


def _limits(group: ActuatorGroup, name: str) -> FloatArray:
    limits: dict[str, float] = {}
    for actuator in group.actuators:
        if name in actuator.parameters:
            limits.update(zip(actuator.joint_names, actuator.nominal(name), strict=True))
    return np.array([limits.get(joint, np.inf) for joint in group.joint_names])
