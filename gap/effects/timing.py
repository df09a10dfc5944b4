"""Delays."""

from __future__ import annotations

from types import MappingProxyType

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import FloatArray, JointEffect, Parameter
from walkerkit.gap.recordings.beginning import LONGEST_DELAY
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials


class CommandDelay(JointEffect):
    """Targets reach the drive late: bus, driver, planner; the drive's own feedback is prompt."""

    name = "command_delay"
    part = "timing"
    ordinary = True
    equation = "u(t − d), d: delay [s]"
    symptom = "phase grows with frequency"
    added_as = "actuator delay, nsample"
    source = "MuJoCo XML reference, actuator/general/delay"
    fields = MappingProxyType(
        {"delay": fields.Field(path="actuator/delay", read=fields.command_delay)}
    )
    shared = True

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints with an actuator."""
        return bool(robot.joints[joint].drives)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The delay to add; what the model has can be taken away."""
        known = min(
            float(robot.model.actuator_delay[drive.actuator])
            + (drive.late if drive.in_python else 0)
            for drive in robot.joints[site].drives
        )
        return (
            Parameter(
                name="delay",
                unit="s",
                lower=0.0 if known == 0 else -known,
                upper=LONGEST_DELAY,
                scale=0.005,
                starts=(0.003, 0.01, 0.025),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the age of the targets."""
        trials.command_delay[site] += values[:, 0]


class SensorDelay(JointEffect):
    """Positions and velocities are logged late; the drive's own feedback is prompt."""

    name = "sensor_delay"
    part = "timing"
    equation = "y(t − d), d: delay [s]"
    symptom = "a pure time shift of position and velocity"
    added_as = "measurement in actuators.json, sensor delay"
    source = "MuJoCo XML reference, sensor/delay"
    fields = MappingProxyType({"delay": fields.measurement("position_delay")})
    shared = True

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The delay to add; what is known already can be taken away."""
        return (
            Parameter(
                name="delay",
                unit="s",
                lower=-robot.measured(site).position_delay,
                upper=LONGEST_DELAY,
                scale=0.005,
                starts=(0.003, 0.01, 0.025),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the age of the logged position and velocity."""
        trials.position_delay[site] += values[:, 0]
