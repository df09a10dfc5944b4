"""The drive: what becomes of the effort that its control law asks for."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from walkerkit.actuators import drivetrain as laws
from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import EVERYWHERE, Effect, FloatArray, Parameter
from walkerkit.gap.effects.law_effect import LawEffect
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_LONGEST_LOOP = 0.06  # s
_USUAL, _FASTEST, _SLOWEST = 0.02, 0.002, 0.1  # s, of a control loop
_FAR = 4.0  # times what was seen; a limit there is none
_STEADY = 0.02  # of itself, by which a supply varies that says nothing


class TorqueSpeedLimit(LawEffect):
    """The torque–speed line of a DC motor: less torque is left the faster it turns."""

    law = laws.TorqueSpeedLimit
    name = "torque_speed_limit"
    part = "strength"
    equation = (
        "τ between S (−1 − q̇/V) and S (1 − q̇/V), S: saturation_effort [N·m], "
        "V: velocity_limit [rad/s]"
    )
    symptom = "high speed, when driving"
    source = "speed–torque line of a DC motor at constant voltage; NVIDIA Isaac Lab's DCMotor"
    extends = ("effort_limit",)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Stall torque and no-load speed; unchanged are the robot's, or far above what was seen."""
        excursion, slide = robot.excursion(site), robot.joints[site].slide
        known = self.known(robot, site)
        stall = min(known["saturation_effort"], _FAR * excursion.effort)
        speed = min(known["velocity_limit"], _FAR * excursion.velocity)
        effort, velocity = min(excursion.effort, stall), min(excursion.velocity, speed)
        pairs = [(s, v) for v in (1.8, 1.2, 0.9) for s in (1.4, 1.0, 0.7)]
        return (
            Parameter(
                name="saturation_effort",
                unit="N" if slide else "N·m",
                zero=stall,
                lower=0.02 * effort,
                upper=max(stall, 2 * effort),
                scale=0.05 * effort,
                starts=tuple(min(s * effort, stall) for s, _ in pairs),
            ),
            Parameter(
                name="velocity_limit",
                unit="m/s" if slide else "rad/s",
                zero=speed,
                lower=0.02 * velocity,
                upper=max(speed, 2 * velocity),
                scale=0.05 * velocity,
                starts=tuple(min(v * velocity, speed) for _, v in pairs),
            ),
        )


class ActuatorLag(LawEffect):
    """Effort follows what is asked for with a first-order lag, as through an inductance."""

    law = laws.ActuatorLag
    name = "actuator_lag"
    part = "timing"
    equation = "first-order lag of τ, T: time_constant [s]"
    symptom = "high frequency"
    source = "electrical time constant L/R; MuJoCo XML reference, actuator/general/dyntype"

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The lag's time constant."""
        known = self.known(robot, site)["time_constant"]
        return (
            Parameter(
                name="time_constant",
                unit="s",
                zero=known,
                lower=0.0,
                upper=max(0.2, 2 * known),
                scale=0.001,
                starts=tuple(part * _damping_time(robot, site) for part in (0.05, 0.15, 0.4)),
            ),
        )


class StrengthDrift(LawEffect):
    """The drive weakens as it warms up, from the log's beginning on; it goes on reporting τ."""

    law = laws.StrengthDrift
    name = "strength_drift"
    part = "strength"
    equation = "τ (1 − γ t), γ: rate [1/s]; the log shows τ"
    symptom = "grows over minutes"
    source = "falling Kt and rising R(T) of a motor that warms up; MuJoCo XML reference, dcmotor"
    resembles = ("torque_constant", "payload")
    driven = True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The part of its strength that is lost in a second."""
        known = self.known(robot, site)["rate"]
        return (
            Parameter(
                name="rate",
                unit="1/s",
                zero=known,
                lower=min(0.0, known),
                upper=max(0.2, 2 * known),
                scale=0.002,
                starts=(0.002, 0.006, 0.02),
            ),
        )


class LoopDelay(LawEffect):
    """The control loop takes its time: what it makes of targets and feedback comes late."""

    law = laws.LoopDelay
    name = "loop_delay"
    part = "timing"
    equation = "τ(t − d), feedback included, d: delay [s]"
    symptom = "phase and lost damping"
    source = "computing and bus delay in the loop: Åström, Wittenmark, ch. 3"
    shared = True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The delay from measurement to effort."""
        known = self.known(robot, site)["delay"]
        longest = max(_LONGEST_LOOP, 2 * known)
        # As all have it, no more than the most nervous of them bears.
        time = min(
            min(_damping_time(robot, name), _inertia_time(robot, name))
            for name in robot.excursions or robot.joints
        )
        return (
            Parameter(
                name="delay",
                unit="s",
                zero=known,
                lower=0.0,
                upper=longest,
                scale=0.001,
                starts=tuple(min(part * time, longest) for part in (1.2, 0.8, 0.5, 0.25, 0.1)),
            ),
        )


class SupplyVoltage(LawEffect):
    """The drive does not correct for its supply, whose voltage is in the log.

    The voltage at which it makes what it is asked for is the median of what was logged: a drive
    that is made for another one has a wrong torque constant besides.
    """

    law = laws.SupplyVoltage
    name = "supply_voltage"
    part = "strength"
    equation = (
        "τ (1 + w (V/V₀ − 1)) and its limits, w: share [1], V: the log's voltage [V], "
        "V₀: its median"
    )
    symptom = "follows the voltage column"
    source = "a bridge that is driven by duty cycle: its mean voltage goes with that of the supply"
    shared = True

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints with a drive, where the voltage was logged and varied."""
        seen = robot.excursion(joint).voltage
        return (
            super().acts_on(robot, joint)
            and seen is not None
            and seen[0] > 0
            and seen[2] - seen[1] > _STEADY * seen[0]
        )

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The share of the effort that goes with the voltage."""
        known = self.known(robot, site)["share"]
        return (
            Parameter(
                name="share",
                unit="1",
                zero=known,
                lower=min(-0.5, known),
                upper=max(2.5, known),
                scale=0.1,
                starts=(0.5, 1.0),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Writes the law's share, and the voltage that was usual where it has none yet."""
        super().apply(trials, site, values)
        robot = trials.robot
        seen, own = robot.excursion(site).voltage, trials.law(self.law, site)
        if seen is not None and self.law.name not in robot.laws.get(site, {}):
            own["nominal"][own["share"] != 0] = seen[0]


class SupplySag(Effect):
    """The supply sags under load, so that all drives' limits fall with the power drawn."""

    name = "supply_sag"
    part = "strength"
    equation = "clip(τ, ±F (1 − c Σ|τ q̇|)), F the drive's limit, c: sag [1/W]"
    symptom = "many joints loaded at once"
    added_as = "drivetrain law in actuators.json"
    source = "internal resistance of a battery; τ and q̇ of all joints as their drives ask for them"
    fields = MappingProxyType({"sag": fields.law(laws.SupplySag, "sag")})
    kind = "robot"

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """The robot as a whole, where some measured joint's drive has a limit."""
        return (EVERYWHERE,) if any(np.isfinite(_limit(robot, name)) for name in joints) else ()

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The part of the limits that is lost with every watt."""
        known = max((self._known(robot, name) for name in robot.joints), default=0.0)
        moved = [robot.excursion(name) for name in robot.excursions or robot.joints]
        power = sum(excursion.effort * excursion.velocity for excursion in moved)
        return (
            Parameter(
                name="sag",
                unit="1/W",
                zero=known,
                lower=0.0,
                upper=max(20 / power, 2 * known),
                scale=0.3 / power,
                starts=tuple(part / power for part in (0.3, 0.6, 1.0, 1.7, 3.0, 5.0, 8.0)),
            ),
        )

    @staticmethod
    def _known(robot: Robot, joint: str) -> float:
        return robot.laws.get(joint, {}).get(laws.SupplySag.name, {}).get("sag", 0.0)

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Writes the law of all joints whose drives have a limit."""
        robot = trials.robot
        changed = values[:, 0] != self.parameters(robot, site)[0].zero
        for joint in robot.joints:
            if np.isfinite(_limit(robot, joint)):
                trials.law(laws.SupplySag, joint)["sag"][changed] = values[changed, 0]


def _damping_time(robot: Robot, joint: str) -> float:
    """kd/kp of a servo with the joint's own damping; one that lags by more swings up [s]."""
    drives = robot.joints[joint].drives
    if not drives or drives[0].stiffness <= 0:
        return _USUAL
    damping = drives[0].damping + float(robot.model.dof_damping[robot.joints[joint].dof])
    return min(max(damping / drives[0].stiffness, _FASTEST), _SLOWEST)


def _inertia_time(robot: Robot, joint: str) -> float:
    """Inertia over the damping of the drive, in which that stops a joint [s]."""
    drives = robot.joints[joint].drives
    if not drives or drives[0].damping <= 0:
        return _USUAL
    inertia = float(robot.model.dof_M0[robot.joints[joint].dof])
    return min(max(inertia / drives[0].damping, _FASTEST), _SLOWEST)


def _limit(robot: Robot, joint: str) -> float:
    drives = robot.joints[joint].drives
    own = robot.number(joint, "effort_limit")
    if own is not None:
        return own
    if not drives or not robot.model.actuator_forcelimited[drives[0].actuator]:
        return float("inf")
    gear = float(robot.model.actuator_gear[drives[0].actuator, 0])
    return float(np.max(gear * robot.model.actuator_forcerange[drives[0].actuator]))
