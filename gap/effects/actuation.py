"""The drive: its gains, its torque and its limits."""

from __future__ import annotations

from types import MappingProxyType

import mujoco
import numpy as np

from walkerkit.actuators.drive import Drive
from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import FloatArray, JointEffect, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_LIMIT = "effort_limit"  # of laws in Python that have one


def _has(robot: Robot, joint: str, number: str) -> bool:
    """Whether the drive has a gain: a law in Python may be a network, or have none of the name."""
    return not robot.joints[joint].in_python or robot.number(joint, number) is not None


def _servo(robot: Robot, joint: str) -> Drive | None:
    """The position servo of a joint; none that drives it away from its target."""
    drive = robot.joints[joint].drive("position")
    return drive if drive is not None and drive.stiffness > 0 else None


# Files are shipped with the gains of nobody's servo: 1, or what looked calm.
_TIMES_WEAKER, _TIMES_STRONGER = 0.999, 1e3


def _kp(robot: Robot, site: str, given: Robot) -> float | None:
    drive = fields.drive_of(robot, site, "position")
    return None if drive is None else drive.stiffness


def _kd(robot: Robot, site: str, given: Robot) -> float | None:
    drive = fields.drive_of(robot, site, "velocity", "position")
    return None if drive is None else drive.damping


def _strength(robot: Robot, site: str, given: Robot) -> float:
    return 1 / robot.measured(site).effort_scale - 1


def _bias(robot: Robot, site: str, given: Robot) -> float | None:
    drive = fields.drive_of(robot, site)
    if drive is None:
        return None
    return fields.gear(robot, drive) * float(robot.model.actuator_biasprm[drive.actuator, 0])


def _limit(robot: Robot, site: str, given: Robot) -> float | None:
    drive = fields.drive_of(robot, site)
    if drive is None or not robot.model.actuator_forcelimited[drive.actuator]:
        return None
    largest = float(np.abs(robot.model.actuator_forcerange[drive.actuator]).max())
    return abs(fields.gear(robot, drive)) * largest


class PositionGain(JointEffect):
    """The drive's proportional gain is not the model's."""

    name = "position_gain"
    part = "gain"
    ordinary = True
    equation = "τ = Δkp (u − q), Δkp: kp [N·m/rad]"
    symptom = "proportional to position error"
    added_as = "actuator gainprm, biasprm"
    source = "MuJoCo XML reference, actuator/position/kp"
    fields = MappingProxyType({"kp": fields.Field(path="actuator/kp", read=_kp)})

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints with a position actuator."""
        return _servo(robot, joint) is not None and _has(robot, joint, "stiffness")

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The gain to add."""
        drive = _servo(robot, site)
        kp = drive.stiffness if drive else 1.0
        return (
            Parameter(
                name="kp",
                unit="N/m" if robot.joints[site].slide else "N·m/rad",
                lower=-_TIMES_WEAKER * kp,
                upper=_TIMES_STRONGER * kp,
                scale=0.1 * kp,
                starts=(-0.3 * kp, -0.1 * kp, 0.1 * kp, 0.4 * kp),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Scales the gain and the stiffness, so that targets keep their meaning."""
        joint = trials.robot.joints[site]
        drive = joint.drive("position")
        if drive is None:
            return
        if joint.in_python:
            trials.number(site, "stiffness")[:] += values[:, 0]
            return
        factor = 1 + values[:, 0] / drive.stiffness
        trials.field("actuator_gainprm")[:, drive.actuator, 0] *= factor
        bias = trials.field("actuator_biasprm")
        bias[:, drive.actuator, 1] *= factor
        # With a control in joint units a constant bias is effort of its own; otherwise it is
        # part of the law that maps the control to a position, and goes with the gain.
        if not drive.in_joint_units:
            bias[:, drive.actuator, 0] *= factor


class VelocityGain(JointEffect):
    """The drive's derivative gain is not the model's."""

    name = "velocity_gain"
    part = "gain"
    ordinary = True
    equation = "τ = −Δkd q̇, made by the drive, Δkd: kd [N·m·s/rad]"
    symptom = "proportional to speed"
    added_as = "actuator biasprm"
    source = "MuJoCo XML reference, actuator/position/kv"
    fields = MappingProxyType({"kd": fields.Field(path="actuator/kv", read=_kd)})

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints with a position or velocity actuator."""
        return self._drive(robot, joint) is not None and _has(robot, joint, "damping")

    @staticmethod
    def _drive(robot: Robot, joint: str) -> Drive | None:
        drive = robot.joints[joint].drive("velocity")
        if drive is not None and drive.damping > 0:
            return drive
        return robot.joints[joint].drive("position")

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The gain to add."""
        drive, excursion = self._drive(robot, site), robot.excursion(site)
        own = drive.damping if drive else 0.0
        kd = max(own, 0.0)  # what pushes along as it moves is none to be taken away
        size = max(0.1 * abs(own), 0.02 * excursion.effort / excursion.velocity)
        less = (-min(3 * size, 0.5 * kd),) if kd > 0 else ()
        return (
            Parameter(
                name="kd",
                unit="N·s/m" if robot.joints[site].slide else "N·m·s/rad",
                lower=-kd,
                upper=max(200 * size, _TIMES_STRONGER * kd),
                scale=size,
                starts=(*less, size, 5 * size),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Lowers the velocity bias; a velocity target's gain goes with it."""
        drive = self._drive(trials.robot, site)
        if drive is None:
            return
        if drive.in_python:
            trials.number(site, "damping")[:] += values[:, 0]
            return
        gear = float(trials.robot.model.actuator_gear[drive.actuator, 0])
        bias = trials.field("actuator_biasprm")[:, drive.actuator]
        if drive.kind == "velocity":
            factor = 1 + values[:, 0] / drive.damping
            trials.field("actuator_gainprm")[:, drive.actuator, 0] *= factor
            if not drive.in_joint_units:
                bias[:, 0] *= factor
        bias[:, 2] -= values[:, 0] / gear**2


class TorqueConstant(JointEffect):
    """The motor makes more or less torque than the drive believes."""

    name = "torque_constant"
    part = "gain"
    equation = "τ (1 + α), α: strength [1]; the log shows τ"
    symptom = "proportional to effort"
    added_as = "actuator gainprm, biasprm and forcerange together"
    source = (
        "Kt of a permanent-magnet motor; effort as the drive reports it is current × nominal Kt"
    )
    resembles = ("payload", "com_offset", "encoder_gain")
    fields = MappingProxyType(
        {"strength": fields.Field(path="actuator/gainprm × (1 + strength)", read=_strength)}
    )

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints with an actuator."""
        return bool(robot.joints[joint].drives)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The relative change."""
        return (
            Parameter(
                name="strength",
                unit="1",
                lower=-0.95,
                upper=4.0,
                scale=0.05,
                starts=(-0.3, -0.1, 0.1, 0.3),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Scales all that the joint's actuators make, and what the log shows of it back."""
        factor = 1 + values[:, :1]
        for drive in trials.robot.joints[site].drives:
            trials.field("actuator_gainprm")[:, drive.actuator, :1] *= factor
            trials.field("actuator_biasprm")[:, drive.actuator, :3] *= factor
            trials.field("actuator_forcerange")[:, drive.actuator] *= factor
        trials.effort_scale[site] /= factor[:, 0]


class TorqueBias(JointEffect):
    """A constant torque that the drive does not know of."""

    name = "torque_bias"
    part = "pose"
    equation = "τ + c, c: bias [N·m]; the log shows τ"
    symptom = "constant"
    added_as = "actuator biasprm"
    source = (
        "offset of a current sensor; also the constant term of Janot, Gautier, Brunot, EMPS, 2019"
    )
    fields = MappingProxyType({"bias": fields.Field(path="actuator/biasprm", read=_bias)})

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints with an actuator."""
        return bool(robot.joints[joint].drives)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The constant torque."""
        size = 0.03 * robot.excursion(site).effort
        return (
            Parameter(
                name="bias",
                unit="N" if robot.joints[site].slide else "N·m",
                lower=-100 * size,
                upper=100 * size,
                scale=size,
                starts=(-5 * size, -size, size, 5 * size),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the bias of the joint's first actuator, and takes it off what the log shows."""
        drive = trials.robot.joints[site].drives[0]
        gear = float(trials.robot.model.actuator_gear[drive.actuator, 0])
        trials.field("actuator_biastype")[:, drive.actuator] = mujoco.mjtBias.mjBIAS_AFFINE.value
        trials.field("actuator_biasprm")[:, drive.actuator, 0] += values[:, 0] / gear
        trials.effort_offset[site] -= trials.effort_scale[site] * values[:, 0]


class EffortLimit(JointEffect):
    """The drive saturates at a lower effort than the model's."""

    name = "effort_limit"
    part = "strength"
    equation = "clip(τ, ±F), F: limit [N·m]"
    symptom = "peaks only"
    added_as = "actuator forcerange"
    source = "MuJoCo XML reference, actuator/general/forcerange"
    fields = MappingProxyType({"limit": fields.Field(path="actuator/forcerange", read=_limit)})

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints with an actuator."""
        return bool(robot.joints[joint].drives)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The limit itself; unchanged is the model's, or above all that was seen."""
        peak = robot.excursion(site).effort
        known = self._known(robot, site)
        zero = min(known, 4 * peak)
        # The peak leaves out single samples, in which a step of the targets shows a limit.
        starts = tuple(f * peak for f in (2.4, 1.7, 1.2) if f * peak < zero)
        least = min(peak, zero)
        starts += tuple(f * least for f in (1.0, 0.85, 0.7, 0.5, 0.3) if f * least < zero)
        return (
            Parameter(
                name="limit",
                unit="N" if robot.joints[site].slide else "N·m",
                zero=zero,
                lower=0.02 * least,
                upper=zero if np.isinf(known) or known > 4 * peak else 3 * known,
                scale=0.05 * least,
                starts=starts,
            ),
        )

    @staticmethod
    def _known(robot: Robot, joint: str) -> float:
        own = robot.number(joint, _LIMIT)
        if own is not None:
            return own
        drive = robot.joints[joint].drives[0]
        if not robot.model.actuator_forcelimited[drive.actuator]:
            return float("inf")
        gear = float(robot.model.actuator_gear[drive.actuator, 0])
        return abs(gear) * float(np.abs(robot.model.actuator_forcerange[drive.actuator]).max())

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Sets a symmetric `actuator_forcerange`, except where the limit is the unchanged one."""
        robot = trials.robot
        drive = robot.joints[site].drives[0]
        gear = abs(float(robot.model.actuator_gear[drive.actuator, 0]))
        limit = values[:, 0]
        changed = limit != self.parameters(robot, site)[0].zero
        if robot.number(site, _LIMIT) is not None:
            trials.number(site, _LIMIT)[changed] = limit[changed]
            return
        # What a torque constant did to the range before stays a factor of it.
        strength = 1 / trials.effort_scale[site][changed]
        bound = strength * limit[changed] / gear
        trials.field("actuator_forcelimited")[changed, drive.actuator] = 1
        trials.field("actuator_forcerange")[changed, drive.actuator] = np.stack(
            [-bound, bound], axis=1
        )
