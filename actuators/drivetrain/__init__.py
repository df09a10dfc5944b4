"""What lies between a command and a joint and MuJoCo has no field for.

    from walkerkit.actuators.drivetrain import LAWS
    LAWS["stribeck_friction"](joint_names_expr=(".*",), breakaway=0.3, velocity=0.05)

A law is a class in the file of its family, or a class of a user's own: `docs/own_actuator.md`.
"""

from walkerkit.actuators.drivetrain.bank import LawBank
from walkerkit.actuators.drivetrain.controller import (
    ControllerDeadband,
    IntegralAction,
    SampleAndHold,
    SetpointFilter,
    SlewLimit,
    VelocityFilter,
)
from walkerkit.actuators.drivetrain.delays import CommandDelay, LoopDelay
from walkerkit.actuators.drivetrain.drive_stage import (
    ActuatorLag,
    Cogging,
    QuadraticDrag,
    StrengthDrift,
    SupplySag,
    SupplyVoltage,
    TorqueRipple,
    TorqueSpeedLimit,
)
from walkerkit.actuators.drivetrain.drivetrain_law import DrivetrainLaw, Step
from walkerkit.actuators.drivetrain.joint_friction import (
    AsymmetricFriction,
    DirectionalEfficiency,
    LoadDependentFriction,
    PoseDependentFriction,
    PreslidingFriction,
    StribeckFriction,
)
from walkerkit.actuators.drivetrain.load_side import LoadSideFeedback
from walkerkit.actuators.drivetrain.registry import LAWS, UnknownLawError, in_order, law_named
from walkerkit.actuators.drivetrain.runner import LawRunner

__all__ = [
    "LAWS",
    "ActuatorLag",
    "AsymmetricFriction",
    "Cogging",
    "CommandDelay",
    "ControllerDeadband",
    "DirectionalEfficiency",
    "DrivetrainLaw",
    "IntegralAction",
    "LawBank",
    "LawRunner",
    "LoadDependentFriction",
    "LoadSideFeedback",
    "LoopDelay",
    "PoseDependentFriction",
    "PreslidingFriction",
    "QuadraticDrag",
    "SampleAndHold",
    "SetpointFilter",
    "SlewLimit",
    "Step",
    "StrengthDrift",
    "StribeckFriction",
    "SupplySag",
    "SupplyVoltage",
    "TorqueRipple",
    "TorqueSpeedLimit",
    "UnknownLawError",
    "VelocityFilter",
    "in_order",
    "law_named",
]
