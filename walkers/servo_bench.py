"""One motor on a bench, which turns an arm with a weight against gravity.

    environment = composer.Environment(TrackJoints(ServoBench(), excitation="slow_triangle"))
    environment.reset()
    environment.step([0.0])  # no correction of the triangle

The one joint, `shaft`, is level: at zero the arm hangs down, where home is. Its motor is the
`unitree_go1_hip` of `MOTORS`, 23.7 N·m, of which the arm takes 1.8 N·m at most.
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

SERVO_BENCH_XML: Final = Path(__file__).parent / "assets" / "servo_bench.xml"
"""Path of the bench's plain MJCF, which has no actuator."""

SERVO_BENCH_DRIVES: Final = (
    motor_pd(("shaft",), MOTORS["unitree_go1_hip"].actuator(), frequency=15.0, ratio=3.0),
)
"""What drives it by default: PD control through its DC motor."""


class ServoBench(MjcfWalker):
    """A single joint, fixed to the ground."""

    def _build(  # type: ignore[override]
        self,
        name: str = "servo_bench",
        actuators: ActuatorCfg | Iterable[ActuatorCfg] | None = None,
        position_controlled: bool = False,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        randomizations: Sequence[Randomization] = (),
    ) -> None:
        """Builds the bench.

        Args:
            name: its name, its prefix where it is attached.
            actuators: configs of its actuators; by default `SERVO_BENCH_DRIVES`.
            position_controlled: leave the default drives to MuJoCo, as position servos whose
                controls in [-1, 1] span the joints' ranges.
            action: action terms; by default an action in [-1, 1] spans the joint's range.
            randomizations: what changes the actuators at the start of each episode.
        """
        robot = read_robot(SERVO_BENCH_XML)
        super()._build(
            robot,
            actuators=choose(robot.root, SERVO_BENCH_DRIVES, actuators, position_controlled),
            name=name,
            action=action,
            randomizations=randomizations,
        )

    @property
    def tip(self) -> Any:
        """The site at the weight's centre."""
        return self._mjcf_root.find("site", "tip")
