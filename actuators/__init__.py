"""Actuators: how a command becomes joint effort.

For an actuator of your own (docs/own_actuator.md): a config, `ExplicitActuatorCfg` or one of its
subclasses, with fields from `number` and `choice`, and a law, `Law` or `PdLaw`. For a drivetrain
law of your own: `DrivetrainLaw` and `Step`.
"""

from walkerkit.actuators.actuator import Actuator
from walkerkit.actuators.builtin import (
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
)
from walkerkit.actuators.builtin_dc_motor import BuiltinDcMotorActuatorCfg
from walkerkit.actuators.builtin_muscle import BuiltinMuscleActuatorCfg
from walkerkit.actuators.command import ActuatorCmd
from walkerkit.actuators.config import ActuatorCfg
from walkerkit.actuators.config_fields import choice, number
from walkerkit.actuators.delayed import DelayedActuator, DelayedActuatorCfg
from walkerkit.actuators.drivetrain import DrivetrainLaw, Step
from walkerkit.actuators.explicit import (
    DcMotorActuatorCfg,
    ExplicitActuatorCfg,
    IdealPdActuatorCfg,
    RemotizedPdActuatorCfg,
    pd_parameters,
)
from walkerkit.actuators.group import ActuatorGroup
from walkerkit.actuators.inputs import XmlInputsActuatorCfg
from walkerkit.actuators.laws.dc_motor import DcMotorLaw
from walkerkit.actuators.laws.law import Law
from walkerkit.actuators.laws.pd import PdLaw
from walkerkit.actuators.learned import LearnedMlpActuatorCfg, LstmActuatorCfg
from walkerkit.actuators.motors import (
    MOTORS,
    ElectricActuator,
    Gains,
    Motor,
    gains_from_bandwidth,
    linkage_matrix,
    parallel_linkage,
    reflected_inertia,
    reflected_inertia_from_two_stage_planetary,
    rotary_to_linear,
    rpm_to_rad,
)
from walkerkit.actuators.randomization import Randomization
from walkerkit.actuators.randomize import (
    randomize,
    randomize_armature,
    randomize_delay,
    randomize_effort_limits,
    randomize_friction,
    randomize_pd_gains,
    randomize_strength,
    randomize_viscous_damping,
)
from walkerkit.actuators.scaled import (
    add_effort_actuator,
    add_position_actuator,
    add_velocity_actuator,
)
from walkerkit.actuators.selection import Numbers
from walkerkit.actuators.wrapped import (
    XmlActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
    XmlVelocityActuatorCfg,
)

__all__ = [
    "MOTORS",
    "Actuator",
    "ActuatorCfg",
    "ActuatorCmd",
    "ActuatorGroup",
    "BuiltinDcMotorActuatorCfg",
    "BuiltinMotorActuatorCfg",
    "BuiltinMuscleActuatorCfg",
    "BuiltinPdActuatorCfg",
    "BuiltinPositionActuatorCfg",
    "BuiltinVelocityActuatorCfg",
    "DcMotorActuatorCfg",
    "DcMotorLaw",
    "DelayedActuator",
    "DelayedActuatorCfg",
    "DrivetrainLaw",
    "ElectricActuator",
    "ExplicitActuatorCfg",
    "Gains",
    "IdealPdActuatorCfg",
    "Law",
    "LearnedMlpActuatorCfg",
    "LstmActuatorCfg",
    "Motor",
    "Numbers",
    "PdLaw",
    "Randomization",
    "RemotizedPdActuatorCfg",
    "Step",
    "XmlActuatorCfg",
    "XmlInputsActuatorCfg",
    "XmlMotorActuatorCfg",
    "XmlPositionActuatorCfg",
    "XmlVelocityActuatorCfg",
    "add_effort_actuator",
    "add_position_actuator",
    "add_velocity_actuator",
    "choice",
    "gains_from_bandwidth",
    "linkage_matrix",
    "number",
    "parallel_linkage",
    "pd_parameters",
    "randomize",
    "randomize_armature",
    "randomize_delay",
    "randomize_effort_limits",
    "randomize_friction",
    "randomize_pd_gains",
    "randomize_strength",
    "randomize_viscous_damping",
    "reflected_inertia",
    "reflected_inertia_from_two_stage_planetary",
    "rotary_to_linear",
    "rpm_to_rad",
]
