"""Between the joint and its log."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import EVERYWHERE, Effect, FloatArray, JointEffect, Parameter
from walkerkit.gap.recordings.beginning import LONGEST_DELAY
from walkerkit.gap.simulation.robot import Excursion, Robot
from walkerkit.gap.simulation.trials import Trials


class EncoderOffset(JointEffect):
    """The encoder's zero is not the model's: the drive and the log see q + q₀."""

    name = "encoder_offset"
    part = "encoder"
    equation = "measured q + q₀, q₀: ref [rad]"
    symptom = "constant; gravity mismatch"
    added_as = "joint ref"
    source = "MuJoCo XML reference, joint/ref"
    fields = MappingProxyType({"ref": fields.joint("ref", "qpos0", "qpos")})

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


class EncoderGain(JointEffect):
    """The encoder reads too steeply: drive and log both see a q, a q̇.

    Without gravity and dry friction this is exactly a torque constant that is as much too large:
    in a q, inertia, damping and springs are 1/a of what they are, and so is effort a times as much.
    """

    name = "encoder_gain"
    part = "encoder"
    equation = "measured a q, a = 1 + excess, excess: excess [1]; the drive feeds a q, a q̇ back"
    symptom = "proportional to q"
    added_as = "actuator biasprm; measurement in actuators.json"
    source = "gear ratio or counts per turn of an incremental encoder, misread"
    resembles = ("torque_constant", "payload", "com_offset")
    fields = MappingProxyType({"excess": fields.measurement("encoder_gain", of_a_factor=True)})

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The gain beyond what is known."""
        return (
            Parameter(
                name="excess",
                unit="1",
                lower=-0.5,
                upper=1.0,
                scale=0.02,
                starts=(-0.1, -0.02, 0.02, 0.1),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Scales what the drives feed back, and what the log shows."""
        factor = 1 + values[:, :1]
        # Laws in Python are given what the encoder reads.
        for drive in (d for d in trials.robot.joints[site].drives if not d.in_python):
            trials.field("actuator_biasprm")[:, drive.actuator, 1:3] *= factor
        trials.encoder_gain[site] *= factor[:, 0]


class KinematicError(JointEffect):
    """The log reads the joint through a gear that is not round: an eccentric wheel, a bent shaft.

    The drive has an encoder of its own, on the motor, which reads true: what the log shows beside
    that makes no effort. Logged velocities have the slope of the reading.
    """

    name = "kinematic_error"
    part = "encoder"
    equation = (
        "logged q + A sin(N q + φ), A: amplitude [rad], N: periods [1/rad], φ: phase [rad]; the "
        "drive feeds q back"
    )
    symptom = "periodic in q, no force"
    added_as = "measurement in actuators.json"
    source = "eccentric gears; Michalec, Precision Gearing: Theory and Practice, 1966"
    fields = MappingProxyType(
        {
            "amplitude": fields.measurement("error_amplitude"),
            "periods": fields.measurement("error_periods"),
            "phase": fields.measurement("error_phase"),
        }
    )
    extends = ("encoder_offset", "encoder_gain")

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Its start are waves that the log shows, and one that comes once a turn."""
        joint, excursion = robot.joints[site], robot.excursion(site)
        width, known = excursion.range, robot.measured(site)
        least, most = 0.003 * width, 0.2 * width
        once = 2 * np.pi / width if joint.slide else 1.0
        seen = [
            (float(np.clip(wave.amplitude, least, most)), wave.periods, wave.phase)
            for wave in excursion.waves("position")
        ]
        starts = [*seen, (least, once, 0.0), (least, once, 0.5 * np.pi)]
        amplitudes, periods, phases = zip(*starts, strict=True)
        return (
            Parameter(
                name="amplitude",
                unit="m" if joint.slide else "rad",
                zero=known.error_amplitude,
                lower=0.0,
                upper=max(most, 2 * known.error_amplitude),
                scale=least,
                starts=amplitudes,
            ),
            Parameter(
                name="periods",
                unit="1/m" if joint.slide else "1/rad",
                zero=known.error_periods,
                lower=min(0.5 * once, 0.5 / width, known.error_periods),
                upper=2 * max(*periods, 100 / width, known.error_periods),
                scale=0.5 / width,
                starts=periods,
                shape=not known.error_amplitude,
            ),
            Parameter(
                name="phase",
                unit="rad",
                zero=known.error_phase,
                lower=-2 * np.pi,
                upper=2 * np.pi,
                scale=0.3,
                starts=phases,
                shape=not known.error_amplitude,
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Takes the place of the error that is known."""
        trials.position_error[site][:] = values


class ClockSkew(Effect):
    """The clock of the measured signals runs faster than that of the targets, or more slowly.

    Clocks agree at the log's first sample; what happens t after it is logged, beside the targets of
    that time, as of t (1 + ε). It holds for positions, velocities and efforts of all joints.
    """

    name = "clock_skew"
    part = "timing"
    equation = "y at t (1 + ε), ε: skew [1]"
    symptom = "a lag that grows with time"
    added_as = "measurement in actuators.json"
    source = "clock of the drives against that of the computer; Mills et al., RFC 5905, 2010"
    fields = MappingProxyType({"skew": fields.measurement("clock_skew")})
    kind = "robot"

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """The robot as a whole."""
        return (EVERYWHERE,)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The skew beyond what is known, up to a tenth of a second at the end of the log."""
        lengths = [excursion.duration for excursion in robot.excursions.values()]
        duration = max(lengths, default=Excursion().duration)
        return (
            Parameter(
                name="skew",
                unit="1",
                lower=-LONGEST_DELAY / duration,
                upper=LONGEST_DELAY / duration,
                scale=0.002 / duration,
                starts=tuple(late / duration for late in (-0.02, -0.005, 0.005, 0.02)),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the skew of all joints' logs."""
        for skew in trials.clock_skew.values():
            skew += values[:, 0]
