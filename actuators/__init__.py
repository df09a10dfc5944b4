"""Actuators: how a command becomes joint effort."""

from walkerkit.actuators.actuator import Actuator
from walkerkit.actuators.builtin import (
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
)
from walkerkit.actuators.command import ActuatorCmd
from walkerkit.actuators.config import ActuatorCfg
from walkerkit.actuators.delayed import DelayedActuator, DelayedActuatorCfg
from walkerkit.actuators.explicit import (
    DcMotorActuatorCfg,
    IdealPdActuatorCfg,
    RemotizedPdActuatorCfg,
)
from walkerkit.actuators.group import ActuatorGroup
from walkerkit.actuators.learned import LearnedMlpActuatorCfg, LstmActuatorCfg
from walkerkit.actuators.scaled import add_position_actuator, add_velocity_actuator
from walkerkit.actuators.wrapped import (
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
    XmlVelocityActuatorCfg,
)

__all__ = [
    "Actuator",
    "ActuatorCfg",
    "ActuatorCmd",
    "ActuatorGroup",
    "BuiltinMotorActuatorCfg",
    "BuiltinPdActuatorCfg",
    "BuiltinPositionActuatorCfg",
    "BuiltinVelocityActuatorCfg",
    "DcMotorActuatorCfg",
    "DelayedActuator",
    "DelayedActuatorCfg",
    "IdealPdActuatorCfg",
    "LearnedMlpActuatorCfg",
    "LstmActuatorCfg",
    "RemotizedPdActuatorCfg",
    "XmlMotorActuatorCfg",
    "XmlPositionActuatorCfg",
    "XmlVelocityActuatorCfg",
    "add_position_actuator",
    "add_velocity_actuator",
]
