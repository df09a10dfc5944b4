"""Between the joint and its log."""

from __future__ import annotations

from walkerkit.gap.effects.base import FloatArray, JointEffect, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials


class EncoderOffset(JointEffect):
    """The encoder's zero is not the model's: the drive and the log see q + q₀."""

    name = "encoder_offset"
    equation = "measured q + q₀, q₀: ref [rad]"
    symptom = "constant; gravity mismatch"
    added_as = "joint ref"
    source = "MuJoCo XML reference, joint/ref"

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The offset of the reading."""
        joint = robot.joints[site]
        size = 0.03 * robot.excursion(site).range if joint.slide else 0.02
        return (
            Parameter(
                name="ref",
                unit="m" if joint.slide else "rad",
                lower=-40 * size,
                upper=40 * size,
                scale=size,
                starts=(-3 * size, -size, size, 3 * size),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Moves `qpos0`; springs and stops stay where they are in the machine."""
        joint = trials.robot.joints[site]
        trials.field("qpos0")[:, joint.qpos] += values[:, 0]
        trials.field("qpos_spring")[:, joint.qpos] += values[:, 0]
        if trials.robot.model.jnt_limited[joint.id]:
            trials.field("jnt_range")[:, joint.id] += values
