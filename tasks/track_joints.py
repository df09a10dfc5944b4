"""Move the joints along an excitation: an identification experiment, and a test of the drives.

    task = TrackJoints(Leg(), excitation="chirp", seconds=10.0)
    environment = composer.Environment(task, strip_singleton_obs_buffer_dim=True)
    recording = gap.record(environment)            # with actions of zero: the plain experiment

The task itself sends the excitation's targets to the drives, one row for each control step, drawn
anew for each episode. The robot has come to rest under the first target when the episode starts; it
lasts as long as the excitation and ends with discount 1. An action corrects the targets of the
joints that move, by up to `correction` at ±1: zeros leave the experiment as it is. Targets stay
within the joints' ranges.

A robot that floats is hung up by its root body, clear of the ground.

Reward: the weighted mean of

| term | equation | weight |
|---|---|---|
| `tracking` | meanᵢ exp(−((qᵢ − uᵢ)/0.1 rad)²), u the excitation's target, q after the step | 1 |
| `effort` | 1 − meanᵢ min((τᵢ/τᵢ_max)², 1) | 0.1 |

Observations: `joints_pos` (n,) rad, `joints_vel` (n,) rad/s of the walker, and `reference`
(n_moved,) rad, the excitation's targets for the coming step. m and m/s on slide joints.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from dm_control.composer.observation import observable
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.arguments import check_number
from walkerkit.tasks.excitation import Signal
from walkerkit.tasks.hanging import hang_up
from walkerkit.tasks.reference import Reference
from walkerkit.tasks.rewards import closeness, low_effort
from walkerkit.tasks.walker_task import WalkerTask
from walkerkit.walkers.actions import checked_action
from walkerkit.walkers.drivetrain import Randomization

FloatArray = NDArray[np.float64]

_WEIGHTS: Final = {"tracking": 1.0, "effort": 0.1}
_SCALE: Final = 0.1  # rad, or m


class TrackJoints(WalkerTask):
    """A robot on a bench, or hung up, whose joints follow an excitation.

    Args:
        walker: with actuators of ours, some of which follow position targets.
        arena: where it is; by default a flat floor.
        excitation: a signal, or the name of one in `tasks.excitation.BATTERY`.
        seconds: how long an episode lasts [s].
        joint_names_expr: full-match expressions of the joints that move; the others hold the
            default pose. By default all that follow position targets.
        max_velocity: bound of the targets' slope [rad/s; m/s]; by default half the no-load speed of
            the joint's motor, and 6 at most.
        correction: what an action of ±1 adds to the targets [rad; m].
        settle: how long the first target is held before the episode starts [s].
        hang: height at which the root of a robot that floats is held [m].
        physics_timestep: [s]; by default that of the robot's file, else 2 ms.
        control_timestep: [s].
        randomizations: applied to the walker's actuators at the start of each episode, ahead of
            the walker's own.
        weights: {reward term: weight}; terms that are left out have their default.

    Raises:
        TypeError: the walker has no actuators of ours.
        ValueError: as `Reference`, or an argument is out of its bounds.
    """

    def __init__(
        self,
        walker: Any,
        arena: Any = None,
        *,
        excitation: str | Signal = "multisine",
        seconds: float = 10.0,
        joint_names_expr: tuple[str, ...] | None = None,
        max_velocity: float | None = None,
        correction: float = 0.1,
        settle: float = 0.5,
        hang: float = 1.0,
        physics_timestep: float | None = None,
        control_timestep: float = 0.01,
        randomizations: Sequence[Randomization] = (),
        weights: Mapping[str, float] | None = None,
    ):
        super().__init__(
            walker,
            arena,
            physics_timestep=physics_timestep,
            control_timestep=control_timestep,
            randomizations=randomizations,
            weights=weights,
            default_weights=_WEIGHTS,
            observables=("joints_pos", "joints_vel"),
        )
        self._correction = check_number("correction", correction, at_least=0)
        self._settle = check_number("settle", settle, at_least=0)
        hang_up(walker, self._frame, check_number("hang", hang))
        self._held_at = np.zeros(3) if self._frame.pos is None else np.array(self._frame.pos)
        self._reference = Reference(
            walker.drivetrain,
            excitation,
            seconds=seconds,
            timestep=control_timestep,
            joint_names_expr=joint_names_expr,
            max_velocity=max_velocity,
        )
        n = len(self._reference.names)
        joints = walker.drivetrain.joints
        self._low, self._high = joints.ranges[self._reference.columns].T
        self._limits = joints.efforts[self._reference.columns]
        self._targets: FloatArray = np.zeros((len(self._reference), n))
        self._done = 0
        self._positions_at: NDArray[np.intp] = np.zeros(n, dtype=np.intp)
        self._observed = observable.Generic(lambda _: self._row(self._done))
        self._observed.enabled = True

    @property
    def targets(self) -> FloatArray:
        """The excitation's targets of this episode, (steps, n_moved) [rad; m], a copy."""
        return self._targets.copy()

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that move, in the order of the targets."""
        return self._reference.names

    @property
    def task_observables(self) -> OrderedDict[str, Any]:
        """`reference`."""
        return OrderedDict(reference=self._observed)

    def reward_terms(self, physics: Any) -> dict[str, float]:
        """`tracking` and `effort`, as the module says."""
        error = physics.data.qpos[self._positions_at] - self._row(self._done - 1)
        effort = self._walker.actuator_group.applied_effort[self._reference.columns]
        return {"tracking": closeness(error, _SCALE), "effort": low_effort(effort, self._limits)}

    # What composer calls.

    def after_compile(self, physics: Any, random_state: Any) -> None:
        """Finds the joints in the compiled model."""
        del random_state
        found = {
            joint.prefixed_identifier(prefix_root=self._walker.mjcf_model.namescope): joint
            for joint in self._walker.mjcf_model.find_all("joint")
        }
        ids = physics.bind([found[name] for name in self._reference.names]).element_id
        self._positions_at = physics.model.jnt_qposadr[ids].astype(np.intp)

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        """Draws the excitation, and lets the robot come to rest where it starts."""
        self._walker.reinitialize_pose(physics, random_state)
        self._walker.set_pose(physics, position=self._held_at)
        self._targets = self._reference.draw(np.random.default_rng(random_state.randint(2**31)))
        self._done = 0
        physics.data.qpos[self._positions_at] = self._targets[0]
        self._randomize(random_state)
        self._come_to_rest(physics, random_state)

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        """A correction in [-1, 1] for each joint that moves."""
        del physics
        n = len(self._reference.names)
        return specs.BoundedArray(
            (n,), np.float64, -1.0, 1.0, name="\t".join(self._reference.names)
        )

    def before_step(self, physics: Any, action: ArrayLike, random_state: Any) -> None:
        """Sends the next row of targets, corrected by the action.

        Raises:
            ValueError: the action has another shape, or is not finite.
        """
        del physics, random_state
        values = np.clip(checked_action(action, self._reference.names), -1.0, 1.0)
        asked = self._row(self._done) + self._correction * values
        self._walker.command = self._reference.command(np.clip(asked, self._low, self._high))
        self._done += 1

    def should_terminate_episode(self, physics: Any) -> bool:
        """The excitation has ended."""
        del physics
        return self._done >= len(self._targets)

    def _come_to_rest(self, physics: Any, random_state: Any) -> None:
        """Logs of real robots do not begin with a fall into the drives, and neither do these."""
        drivetrain = self._walker.drivetrain
        drivetrain.reset(random_state)
        drivetrain.command = self._reference.command(self._row(0))
        physics.forward()
        for _ in range(round(self._settle / physics.timestep())):
            drivetrain.run()
            physics.step()
        # MuJoCo's drives take the first step after a reset for one from rest, so rest it shall be.
        physics.bind(self._walker.mjcf_model.find_all("joint")).qvel = 0.0
        physics.data.time = 0.0

    def _row(self, row: int) -> FloatArray:
        return np.array(self._targets[min(max(row, 0), len(self._targets) - 1)])
