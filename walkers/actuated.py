"""What makes a composer walker own its actuators.

`apply_action` sets the command, `before_substep` runs the laws, `after_compile` finds everything
again in the recompiled model and `initialize_episode` forgets the last episode: the walker works in
tasks and arenas that know nothing of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators import ActuatorCfg, ActuatorCmd, ActuatorGroup
from walkerkit.actuators.drivetrain import DrivetrainLaw
from walkerkit.walkers.actions import ActionTerm
from walkerkit.walkers.drivetrain import Drivetrain, Existing, Randomization

FloatArray = NDArray[np.float64]


class Actuated:
    """Mixin for `dm_control.locomotion.walkers.base.Walker`; see `MjcfWalker`, `with_actuators`."""

    def put_on(
        self,
        root: mjcf.RootElement,
        cfgs: ActuatorCfg | Iterable[ActuatorCfg],
        *,
        action: ActionTerm | Sequence[ActionTerm] | None,
        default: Mapping[str, float],
        existing: Existing,
        laws: Sequence[DrivetrainLaw] = (),
        randomizations: Sequence[Randomization] = (),
        keep_integrator: bool = False,
    ) -> None:
        """Adds the actuators to the walker's model; to be called once, while it is built.

        Args:
            root: the walker's model.
            cfgs: configs of the actuators.
            action: action terms; by default an action spans all that the joints can do.
            default: {joint: position} of the default pose [rad; m]; others are at their reference.
            existing: whether actuators that the joints have already are replaced, or kept, which
                makes a second one for the same joint an error.
            laws: drivetrain laws of its joints.
            randomizations: applied at the start of each episode.
            keep_integrator: as in `Drivetrain`.
        """
        self._drivetrain = Drivetrain(
            root,
            cfgs,
            action=action,
            default=default,
            existing=existing,
            laws=laws,
            randomizations=randomizations,
            keep_integrator=keep_integrator,
        )
        # dm_control's tasks describe an action by the model's actuators, in the model's order.
        place = {id(element): i for i, element in enumerate(self.actuators)}
        root.actuator._children.sort(key=lambda element: place[id(element)])

    # What composer calls.

    def after_compile(self, physics: Any, random_state: Any) -> None:
        """Finds joints and controls in the compiled model."""
        super().after_compile(physics, random_state)  # type: ignore[misc]
        self._drivetrain.initialize(physics)

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        """Forgets the last episode: delays, histories, the command; draws what is random."""
        super().initialize_episode(physics, random_state)  # type: ignore[misc]
        self._drivetrain.reset(random_state)

    def apply_action(self, physics: Any, action: ArrayLike, random_state: Any) -> None:
        """Sets the command for the coming physics steps.

        Args:
            physics: the compiled model.
            action: (n,), as the action terms take it. Controls of actuators that were
                kept come last, in their own units.
            random_state: unused.

        Raises:
            ValueError: the action has another shape, or is not finite.
        """
        del physics, random_state
        self._drivetrain.act(action)

    def before_step(self, physics: Any, random_state: Any) -> None:
        """Takes the controls back from tasks that write to them, as `composer.NullTask` does."""
        super().before_step(physics, random_state)  # type: ignore[misc]
        self._drivetrain.group.renew()

    def before_substep(self, physics: Any, random_state: Any) -> None:
        """Runs the actuators' laws."""
        super().before_substep(physics, random_state)  # type: ignore[misc]
        self._drivetrain.run()

    # What it offers.

    @property
    def drivetrain(self) -> Drivetrain:
        """The actuators, and what an action asks of them."""
        return self._drivetrain

    @property
    def actuator_group(self) -> ActuatorGroup:
        """The actuators, whose laws run before each physics step."""
        return self._drivetrain.group

    @property
    def command(self) -> ActuatorCmd:
        """What the actuators are asked for at present."""
        return self._drivetrain.command

    @command.setter
    def command(self, cmd: ActuatorCmd) -> None:
        if not isinstance(cmd, ActuatorCmd):
            raise TypeError(f"command should be an ActuatorCmd, got {cmd!r} of type {type(cmd)}")
        self._drivetrain.command = cmd

    @property
    def actuators(self) -> tuple[Any, ...]:
        """MuJoCo's actuators: ours in the order of `actuator_group.joint_names`, then the kept."""
        group = self._drivetrain.group
        return (*group.elements, *group.beside, *self._drivetrain.kept)

    @property
    def action_spec(self) -> specs.BoundedArray:
        """A number in [-1, 1] for each of the terms' targets, then controls that were kept."""
        return self._drivetrain.action_spec

    def action_for(self, cmd: ActuatorCmd | None = None) -> FloatArray:
        """The action that asks for a command, as a policy in physical units needs it.

        Args:
            cmd: targets of `actuator_group.joint_names`; None to hold the default pose.

        Returns:
            (n,), not clipped: what is beyond ±1 is more than a `FullRangeAction` can ask for.
            Controls of actuators that were kept are zero.
        """
        return self._drivetrain.action_for(cmd)

    @property
    def prev_action(self) -> FloatArray:
        """The last action of this episode, zeros before the first."""
        return self._drivetrain.last_action
