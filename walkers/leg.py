"""One quadruped-class leg hung from a fixed base: the smallest robot worth diagnosing.

    from dm_control import composer
    from walkerkit.tasks import TrackJoints
    from walkerkit.walkers import LEG_XML, Leg

    environment = composer.Environment(TrackJoints(Leg(), excitation="chirp"))
    environment.reset()
    environment.step([0.0, 0.0, 0.0])  # no correction of the chirp

Three hinges, `hip` (abduction), `thigh` and `calf`, each under a position servo of the same name.
The leg touches nothing, so that joint logs speak of the drives alone. `LEG_XML` is the same robot
as a plain MJCF file.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from walkerkit.actuators import ActuatorCfg, IdealPdActuatorCfg, XmlPositionActuatorCfg
from walkerkit.walkers.actions import ActionTerm
from walkerkit.walkers.drivetrain import Randomization
from walkerkit.walkers.mjcf_walker import MjcfWalker
from walkerkit.walkers.robot_file import read_robot
from walkerkit.walkers.servos import choose

LEG_XML: Final = Path(__file__).parent / "assets" / "leg.xml"
"""Path of the leg's plain MJCF."""

# The servos of the file, whose controls are targets in radians.
_SERVOS: Final = XmlPositionActuatorCfg(joint_names_expr=("hip", "thigh", "calf"))
_DRIVES: Final = (
    IdealPdActuatorCfg(
        joint_names_expr=_SERVOS.joint_names_expr, stiffness=60.0, damping=3.0, effort_limit=30.0
    ),
)


class Leg(MjcfWalker):
    """A three-joint leg on a fixed base."""

    def _build(  # type: ignore[override]
        self,
        name: str = "leg",
        actuators: ActuatorCfg | Iterable[ActuatorCfg] | None = None,
        position_controlled: bool = False,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        randomizations: Sequence[Randomization] = (),
    ) -> None:
        """Builds the leg.

        Args:
            name: its name, its prefix where it is attached.
            actuators: configs of its actuators; by default the file's position servos.
            position_controlled: replace the file's servos, whose controls are in radians, by ones
                with the same gains whose controls in [-1, 1] span the joints' ranges.
            action: action terms; by default an action in [-1, 1] spans the joints' ranges.
            randomizations: what changes the actuators at the start of each episode.
        """
        robot = read_robot(LEG_XML)
        if position_controlled:
            for servo in robot.root.find_all("actuator"):
                servo.remove()
        elif actuators is None:
            actuators = _SERVOS
        super()._build(
            robot,
            actuators=choose(robot.root, _DRIVES, actuators, position_controlled),
            name=name,
            action=action,
            randomizations=randomizations,
        )

    @property
    def foot(self) -> Any:
        """The site at the foot's centre."""
        return self._mjcf_root.find("site", "foot")
