"""What the reading of a log has to know of the model.

model = Model.of(load_robot("go2.xml"))
model.joints["FL_hip_joint"].upper, model.order       # rad, and the actuators' joints
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from walkerkit.actuators.drive import TargetKind
from walkerkit.gap.simulation.robot import Robot


@dataclass(frozen=True, kw_only=True)
class ModelJoint:
    """A hinge or slide joint.

    Attributes:
        lower, upper: its range [rad; m], infinite where it has none.
        slide: whether it is a slide joint.
        takes: kinds of targets that its actuators take.
    """

    lower: float
    upper: float
    slide: bool
    takes: tuple[TargetKind, ...]


@dataclass(frozen=True, kw_only=True)
class Model:
    """A model's joints.

    Attributes:
        source: names it in messages.
        joints: name to joint, in kinematic order.
        order: joints that are driven, in the order of the actuators; all where none is.
        floats: whether it has a base that floats.
    """

    source: str
    joints: Mapping[str, ModelJoint]
    order: tuple[str, ...]
    floats: bool

    @classmethod
    def of(cls, robot: Robot) -> Model:
        """Of a robot that is loaded."""
        found = {}
        for name, joint in robot.joints.items():
            limited = bool(robot.model.jnt_limited[joint.id])
            lower, upper = robot.model.jnt_range[joint.id] if limited else (-np.inf, np.inf)
            found[name] = ModelJoint(
                lower=float(lower),
                upper=float(upper),
                slide=joint.slide,
                takes=tuple(drive.kind for drive in joint.drives),
            )
        actuators = {
            drive.actuator: name for name, joint in robot.joints.items() for drive in joint.drives
        }
        order = dict.fromkeys(actuators[actuator] for actuator in sorted(actuators))
        return cls(
            source=robot.source,
            joints=found,
            order=tuple(order or found),
            floats=robot.base is not None,
        )
