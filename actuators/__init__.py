"""Actuators: how a command becomes joint effort."""

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
from walkerkit.actuators.delayed import DelayedActuator, DelayedActuatorCfg
from walkerkit.actuators.explicit import (
    DcMotorActuatorCfg,
    IdealPdActuatorCfg,
    RemotizedPdActuatorCfg,
)
from walkerkit.actuators.group import ActuatorGroup
from walkerkit.actuators.inputs import XmlInputsActuatorCfg
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
from walkerkit.actuators.wrapped import (
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
    "DelayedActuator",
    "DelayedActuatorCfg",
    "ElectricActuator",
    "Gains",
    "IdealPdActuatorCfg",
    "LearnedMlpActuatorCfg",
    "LstmActuatorCfg",
    "Motor",
    "Randomization",
    "RemotizedPdActuatorCfg",
    "XmlInputsActuatorCfg",
    "XmlMotorActuatorCfg",
    "XmlPositionActuatorCfg",
    "XmlVelocityActuatorCfg",
    "add_effort_actuator",
    "add_position_actuator",
    "add_velocity_actuator",
    "gains_from_bandwidth",
    "linkage_matrix",
    "parallel_linkage",
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
