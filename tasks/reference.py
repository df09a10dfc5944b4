"""An excitation laid out for the joints of a robot: what its drives are asked to follow.

reference = Reference(walker.drivetrain, "chirp", seconds=10.0, timestep=0.01)
targets = reference.draw(np.random.default_rng(0))       # (steps, n_joints) rad
walker.command = reference.command(targets[0])
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators import ActuatorCmd
from walkerkit.actuators.messages import closest, listed
from walkerkit.actuators.selection import select
from walkerkit.tasks.excitation import BATTERY, Signal
from walkerkit.tasks.room import room_about
from walkerkit.walkers.drivetrain import Drivetrain

FloatArray = NDArray[np.float64]

_FASTEST: Final = 6.0  # rad/s or m/s, as `max_velocity` where nothing less is known
_SPEED_SHARE: Final = 0.5  # of a motor's no-load speed


class Reference:
    """Targets of an excitation around the default pose of a robot.

    Args:
        drivetrain: of the robot.
        excitation: a signal, or the name of one in `tasks.excitation.BATTERY`.
        joint_names_expr: full-match expressions of the joints that move; the others hold the
            default pose. By default all that follow position targets.
        seconds: how long it lasts [s].
        timestep: from one target to the next [s].
        max_velocity: bound of the targets' slope, scalar or (n_joints,) [rad/s; m/s]; by default
            half the no-load speed of the joint's motor, and 6 at most.

    Attributes:
        names: the joints that move, in kinematic order.
        columns: their places in a command.
        lower: lowest target, (n_joints,) [rad; m].
        upper: highest target, (n_joints,) [rad; m].

    Raises:
        ValueError: there is no such excitation, it has no steps, or a joint does not follow
            position targets.
    """

    def __init__(
        self,
        drivetrain: Drivetrain,
        excitation: str | Signal,
        *,
        seconds: float,
        timestep: float,
        joint_names_expr: tuple[str, ...] | None = None,
        max_velocity: float | FloatArray | None = None,
    ):
        if isinstance(excitation, str) and excitation not in BATTERY:
            raise ValueError(
                f"there is no excitation {excitation!r}{closest(excitation, BATTERY)}; there are "
                f"{listed(BATTERY)}"
            )
        self._signal = BATTERY[excitation] if isinstance(excitation, str) else excitation
        steps = round(seconds / timestep) if np.isfinite(seconds) else 0
        if steps < 2:
            raise ValueError(
                f"seconds is {seconds}; an excitation takes two steps of {timestep} s or more"
            )
        self._time = timestep * np.arange(steps)
        self._drivetrain = drivetrain
        joints = drivetrain.joints
        able = ["position_target" in takes for takes in joints.takes]
        if joint_names_expr is None:
            chosen = tuple(i for i, one in enumerate(able) if one)
        else:
            chosen = select(joint_names_expr, joints.names)
        unable = [joints.names[i] for i in chosen if not able[i]]
        if unable or not chosen:
            raise ValueError(
                f"no position target goes to {listed(unable or joints.names)}: an excitation is "
                "made of position targets; use actuators that follow them, or choose other joints "
                "with joint_names_expr"
            )
        self.columns = np.array(chosen, dtype=np.intp)
        self.names = tuple(joints.names[i] for i in chosen)
        self.lower, self.upper = room_about(
            joints.default[self.columns], joints.ranges[self.columns]
        )
        if max_velocity is None:
            max_velocity = np.minimum(_SPEED_SHARE * joints.speeds[self.columns], _FASTEST)
        self._max_velocity = max_velocity

    def __len__(self) -> int:
        """How many steps it has."""
        return len(self._time)

    def draw(self, rng: np.random.Generator) -> FloatArray:
        """Targets of the joints that move, (steps, n_joints) [rad; m].

        Args:
            rng: source of phases and levels.
        """
        return self._signal(
            self._time,
            lower=self.lower,
            upper=self.upper,
            rng=rng,
            max_velocity=self._max_velocity,
        )

    def command(self, targets: FloatArray) -> ActuatorCmd:
        """The command that asks for these targets, and for the default pose of other joints.

        Args:
            targets: (n_joints,) [rad; m].
        """
        rest = self._drivetrain.rest
        positions = np.array(rest.position_target)
        positions[self.columns] = targets
        return ActuatorCmd(
            position_target=positions,
            velocity_target=rest.velocity_target,
            effort_target=rest.effort_target,
        )
