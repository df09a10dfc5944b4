"""The controller in the drive: what becomes of targets and of feedback."""

from __future__ import annotations

from walkerkit.actuators import drivetrain as laws
from walkerkit.gap.effects.effect import Parameter
from walkerkit.gap.effects.law_effect import LawEffect, is_servo
from walkerkit.gap.simulation.robot import Robot

_LONGEST = 0.5  # s, of a filter of the targets; slower ones are no part of a drive
_PERIODS = (0.002, 0.004, 0.005, 0.008, *(0.001 * k for k in range(10, 31)), 0.04, 0.05, 0.1)


class SetpointFilter(LawEffect):
    """Targets pass a first-order filter in the drive."""

    law = laws.SetpointFilter
    name = "setpoint_filter"
    part = "timing"
    equation = "first-order filter on u, T: time_constant [s]"
    symptom = "rounds the steps of the targets"
    source = "MuJoCo XML reference, actuator/position/timeconst"
    shared = True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The filter's time constant."""
        return (_time_constant(self, robot, site, (0.004, 0.012, 0.04, 0.12), _LONGEST),)


class SlewLimit(LawEffect):
    """Targets move no faster than a limit in the drive."""

    law = laws.SlewLimit
    name = "slew_limit"
    part = "timing"
    equation = "|u̇| ≤ r, r: rate [rad/s]"
    symptom = "fast moves only"
    source = "profile velocity of a servo drive, CiA 402 object 6081h"

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The limit itself; unchanged is the robot's, or above all that a step of targets asks."""
        excursion = robot.excursion(site)
        zero = min(
            self.known(robot, site)["rate"],
            max(2 * excursion.range / robot.model.opt.timestep, 20 * excursion.velocity),
        )
        fastest = min(excursion.velocity, zero)
        return (
            Parameter(
                name="rate",
                unit="m/s" if robot.joints[site].slide else "rad/s",
                zero=zero,
                lower=0.02 * fastest,
                upper=zero,
                scale=0.05 * fastest,
                # A limit shows from a little below the true one to where nothing is as fast.
                starts=tuple(p * fastest for p in (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.35, 0.2)),
            ),
        )


class SampleAndHold(LawEffect):
    """The drive takes up a new target every T only, counted from the log's beginning."""

    law = laws.SampleAndHold
    name = "sample_and_hold"
    part = "timing"
    equation = "u taken up at multiples of T and held between them, T: period [s]"
    symptom = "stairs in effort and motion"
    source = "zero-order hold: Åström, Wittenmark, Computer-Controlled Systems, 3rd ed., ch. 2"
    shared = True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The period; many of those that drives have, since between them lies nothing to follow."""
        return (
            Parameter(
                name="period",
                unit="s",
                zero=self.known(robot, site)["period"],
                lower=0.0,
                upper=0.2,
                scale=0.001,
                starts=_PERIODS,
            ),
        )


class ControllerDeadband(LawEffect):
    """The controller does nothing about small position errors."""

    law = laws.ControllerDeadband
    name = "controller_deadband"
    part = "gain"
    equation = "|u − q| < δ → 0, δ: width [rad]"
    symptom = "small errors"
    source = "dead zone: Slotine, Li, Applied Nonlinear Control, 1991, ch. 5"

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Half the width of the band, tried in parts of the largest error that a joint had."""
        drive = robot.joints[site].drive("position")
        kp = drive.stiffness if drive else 0.0
        largest = robot.excursion(site).effort / kp if kp > 0 else robot.excursion(site).range
        known = self.known(robot, site)["width"]
        return (
            Parameter(
                name="width",
                unit="m" if robot.joints[site].slide else "rad",
                zero=known,
                lower=0.0,
                upper=max(2 * largest, 2 * known),
                scale=0.05 * largest,
                starts=tuple(part * largest for part in (0.8, 0.4, 0.2, 0.1, 0.05, 0.02)),
            ),
        )


class IntegralAction(LawEffect):
    """The controller also adds up position errors."""

    law = laws.IntegralAction
    name = "integral_action"
    part = "gain"
    equation = "τ + ki ∫(u − q) dt, at most ±clamp; ki: gain [N·m/(rad·s)], clamp [N·m]"
    symptom = "slow decay of an offset"
    source = "PID control: Åström, Hägglund, Advanced PID Control, 2006, ch. 3"

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints with a position servo; others have no error to add up."""
        return is_servo(robot, joint)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Gain and clamp; unchanged is a clamp beyond all effort that was seen."""
        drive = robot.joints[site].drive("position")
        kp = drive.stiffness if drive and drive.stiffness > 0 else 1.0
        peak, slide = robot.excursion(site).effort, robot.joints[site].slide
        known = self.known(robot, site)
        wide = min(known["clamp"], 4 * peak)
        pairs = [(k, c) for k in (0.3, 1.0, 3.0) for c in (wide, 0.2 * peak, 0.05 * peak)]
        return (
            Parameter(
                name="gain",
                unit="N/(m·s)" if slide else "N·m/(rad·s)",
                zero=known["gain"],
                lower=0.0,
                upper=max(50 * kp, 2 * known["gain"]),
                scale=0.2 * kp,
                starts=tuple(part * kp for part, _ in pairs),
            ),
            Parameter(
                name="clamp",
                unit="N" if slide else "N·m",
                zero=wide,
                lower=0.005 * min(peak, wide),
                upper=wide,
                scale=0.05 * min(peak, wide),
                starts=tuple(min(clamp, wide) for _, clamp in pairs),
                shape=not known["gain"],
            ),
        )


class VelocityFilter(LawEffect):
    """The velocity that is fed back is filtered."""

    law = laws.VelocityFilter
    name = "velocity_filter"
    part = "timing"
    equation = "τ = −kd q̇ of a first-order filter on q̇, T: time_constant [s]"
    symptom = "lost damping at high frequency"
    source = "filtered derivative: Åström, Hägglund, Advanced PID Control, 2006, ch. 3"
    shared = True

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints whose drive damps."""
        drives = robot.joints[joint].drives
        return bool(drives) and drives[0].damping > 0

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The filter's time constant."""
        return (_time_constant(self, robot, site, (0.003, 0.01, 0.03), 0.2),)


def _time_constant(
    effect: LawEffect, robot: Robot, joint: str, starts: tuple[float, ...], longest: float
) -> Parameter:
    known = effect.known(robot, joint)["time_constant"]
    return Parameter(
        name="time_constant",
        unit="s",
        zero=known,
        lower=0.0,
        upper=max(longest, 2 * known),
        scale=0.003,
        starts=starts,
    )
