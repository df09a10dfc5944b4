"""Drives whose encoder is on the link, behind what gives way between it and the motor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from walkerkit.actuators.config_fields import number
from walkerkit.actuators.drivetrain.drivetrain_law import (
    DrivetrainLaw,
    Parameters,
    Stage,
    State,
    Step,
    clipped,
)
from walkerkit.actuators.selection import Numbers


@dataclass(frozen=True, kw_only=True)
class LoadSideFeedback(DrivetrainLaw):
    """A drive that is fed back what its link does, in place of its motor.

    It acts on joints whose model has play between motor and link
    (`walkerkit.actuators.play_joint`): −kp δ − kd δ̇ is added to the drive's effort, δ: position of
    the play. What saturates the drive is taken to saturate it with and without; other laws still
    see the motor.

    Attributes:
        share: of the play that lies before the encoder; 1 for an encoder on the link.
    """

    name: ClassVar[str] = "load_side_feedback"
    stage: ClassVar[Stage] = "drive"
    neutral: ClassVar[Mapping[str, float]] = {"share": 0.0}
    reads_play: ClassVar[bool] = True
    share: Numbers = number(at_least=0)

    @staticmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """As in `DrivetrainLaw`."""
        missed = step.stiffness * step.play + step.damping * step.play_speed
        step.effort = clipped(step.effort - p["share"] * missed, -step.limit, step.limit)
