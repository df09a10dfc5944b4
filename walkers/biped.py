"""A biped of twelve joints and 29 kg, with legs in the size of Unitree's G1 and with its motors.

    walker = Biped(action=JointPositionAction(joint_names_expr=(".*",), scale=0.5))
    task = go_to_target.GoToTarget(walker=walker, arena=floors.Floor())  # unmodified
    environment = composer.Environment(task)

Joints are `left_hip_pitch`, `left_hip_roll`, `left_hip_yaw`, `left_knee`, `left_ankle_pitch`,
`left_ankle_roll`, then those of the right leg. Pitch and knee turn about y (left), roll about x
(forward), yaw about z (up), all with the same sign on both sides. At home it stands on flat feet,
without a policy.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from walkerkit.actuators import MOTORS, ActuatorCfg, parallel_linkage
from walkerkit.walkers.actions import ActionTerm
from walkerkit.walkers.drivetrain import Randomization
from walkerkit.walkers.mjcf_walker import MjcfWalker
from walkerkit.walkers.robot_file import read_robot
from walkerkit.walkers.servos import choose, motor_pd

BIPED_XML: Final = Path(__file__).parent / "assets" / "biped.xml"
"""Path of its plain MJCF, which has no actuators."""

# Two motors share an ankle; each of its joints has both, as long as the other is at rest.
_ANKLE = parallel_linkage([MOTORS["unitree_5020"].actuator()] * 2, [[1, 1], [1, -1]])[0]

# Upright, gravity pulls at both ankles together with 160 N·m/rad. With 30 Hz they hold against
# three times that, and it stands by itself; where a policy balances it, less will do. More damping
# would be too much for the 5 ms at which some of dm_control's tasks step.
BIPED_DRIVES: Final = (
    motor_pd(
        (".*_hip_pitch", ".*_hip_yaw"),
        MOTORS["unitree_7520_14"].actuator(),
        frequency=25.0,
        ratio=1.0,
    ),
    motor_pd(
        (".*_hip_roll", ".*_knee"), MOTORS["unitree_7520_22"].actuator(), frequency=25.0, ratio=1.0
    ),
    motor_pd((".*_ankle_.*",), _ANKLE, frequency=30.0, ratio=1.0),
)
"""What drives it by default: PD control through its DC motors."""

SIDES: Final = ("left", "right")
"""Its legs, in the order of the joints."""


class Biped(MjcfWalker):
    """A two-legged robot with flat feet."""

    def _build(  # type: ignore[override]
        self,
        name: str = "biped",
        actuators: ActuatorCfg | Iterable[ActuatorCfg] | None = None,
        position_controlled: bool = False,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        randomizations: Sequence[Randomization] = (),
    ) -> None:
        """Builds the robot.

        Args:
            name: its name, its prefix where it is attached.
            actuators: configs of its actuators; by default `BIPED_DRIVES`.
            position_controlled: leave the default drives to MuJoCo, as position servos whose
                controls in [-1, 1] span the joints' ranges.
            action: action terms; by default an action in [-1, 1] spans the joints' ranges.
            randomizations: what changes the actuators at the start of each episode.
        """
        robot = read_robot(BIPED_XML)
        super()._build(
            robot,
            actuators=choose(robot.root, BIPED_DRIVES, actuators, position_controlled),
            name=name,
            action=action,
            randomizations=randomizations,
        )

    @property
    def feet(self) -> Sequence[Any]:
        """The sites at the centres of the soles, left and right."""
        return tuple(self._mjcf_root.find("site", f"{side}_foot") for side in SIDES)
