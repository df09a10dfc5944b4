"""A quadruped of twelve joints and 12 kg, in the size of Unitree's Go1 and with its motors.

    walker = Quadruped(action=JointPositionAction(joint_names_expr=(".*",), scale=0.5))
    task = go_to_target.GoToTarget(walker=walker, arena=floors.Floor())  # unmodified
    environment = composer.Environment(task)

Joints are `FL_hip`, `FL_thigh`, `FL_calf`, then those of `FR`, `RL` and `RR`: front or rear, left
or right. A hip turns about x (forward), thigh and calf about y (left). At home it stands.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from walkerkit.actuators import MOTORS, ActuatorCfg
from walkerkit.walkers.actions import ActionTerm
from walkerkit.walkers.drivetrain import Randomization
from walkerkit.walkers.mjcf_walker import MjcfWalker
from walkerkit.walkers.robot_file import read_robot
from walkerkit.walkers.servos import choose, motor_pd

QUADRUPED_XML: Final = Path(__file__).parent / "assets" / "quadruped.xml"
"""Path of its plain MJCF, which has no actuators."""

QUADRUPED_DRIVES: Final = (
    motor_pd(
        (".*_hip", ".*_thigh"), MOTORS["unitree_go1_hip"].actuator(), frequency=20.0, ratio=1.0
    ),
    motor_pd((".*_calf",), MOTORS["unitree_go1_knee"].actuator(), frequency=20.0, ratio=1.0),
)
"""What drives it by default: PD control through its DC motors."""

LEGS: Final = ("FL", "FR", "RL", "RR")
"""Its legs, in the order of the joints: front left, front right, rear left, rear right."""


class Quadruped(MjcfWalker):
    """A four-legged robot with point feet."""

    def _build(  # type: ignore[override]
        self,
        name: str = "quadruped",
        actuators: ActuatorCfg | Iterable[ActuatorCfg] | None = None,
        position_controlled: bool = False,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        randomizations: Sequence[Randomization] = (),
    ) -> None:
        """Builds the robot.

        Args:
            name: its name, its prefix where it is attached.
            actuators: configs of its actuators; by default `QUADRUPED_DRIVES`.
            position_controlled: leave the default drives to MuJoCo, as position servos whose
                controls in [-1, 1] span the joints' ranges.
            action: action terms; by default an action in [-1, 1] spans the joints' ranges.
            randomizations: what changes the actuators at the start of each episode.
        """
        robot = read_robot(QUADRUPED_XML)
        super()._build(
            robot,
            actuators=choose(robot.root, QUADRUPED_DRIVES, actuators, position_controlled),
            name=name,
            action=action,
            randomizations=randomizations,
        )

    @property
    def feet(self) -> Sequence[Any]:
        """The sites at the feet's centres, in the order of `LEGS`."""
        return tuple(self._mjcf_root.find("site", f"{leg}_foot") for leg in LEGS)
