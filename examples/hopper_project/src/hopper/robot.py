"""The robot: two joints, `hip` and `knee`, and a foot, clamped to a stand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from walkerkit.actuators import DrivetrainLaw
from walkerkit.walkers import MjcfWalker

from hopper.drives import CascadeActuatorCfg

HOPPER_XML: Final = Path(__file__).parent / "hopper.xml"
DRIVES: Final = CascadeActuatorCfg(
    joint_names_expr=("hip", "knee"),
    stiffness=60.0,
    damping=1.5,
    velocity_limit=12.0,
    effort_limit=18.0,
)


class Hopper(MjcfWalker):
    """The hopper's leg. Hip 0 and knee 0 stretch it downwards; a bent knee is negative [rad]."""

    @property
    def foot(self) -> Any:
        """The site at the foot's centre, 0.24 m below the knee when the leg is stretched."""
        return self.mjcf_model.find("site", "foot")


def on_stand(laws: Sequence[DrivetrainLaw] = ()) -> Hopper:
    """The leg with its drives.

    Args:
        laws: what its drivetrain does besides.
    """
    return Hopper.from_file(HOPPER_XML, DRIVES, laws=laws)
