"""What lies between a command and a joint and MuJoCo has no field for.

    from walkerkit.actuators.drivetrain import LAWS
    LAWS["stribeck_friction"](joint_names_expr=(".*",), breakaway=0.3, velocity=0.05)

A law is a class in the file of its family.
"""

from collections.abc import Mapping
from types import MappingProxyType

from walkerkit.actuators.drivetrain.bank import LawBank
from walkerkit.actuators.drivetrain.controller import (
    ControllerDeadband,
    IntegralAction,
    SampleAndHold,
    SetpointFilter,
    SlewLimit,
    VelocityFilter,
)
from walkerkit.actuators.drivetrain.drive import (
    ActuatorLag,
    Cogging,
    QuadraticDrag,
    StrengthDrift,
    SupplySag,
    TorqueRipple,
    TorqueSpeedLimit,
)
from walkerkit.actuators.drivetrain.friction import (
    AsymmetricFriction,
    DirectionalEfficiency,
    LoadDependentFriction,
    PoseDependentFriction,
    PreslidingFriction,
    StribeckFriction,
)
from walkerkit.actuators.drivetrain.law import DrivetrainLaw, Step
from walkerkit.actuators.drivetrain.load_side import LoadSideFeedback
from walkerkit.actuators.drivetrain.loop_delay import LoopDelay
from walkerkit.actuators.drivetrain.runner import LawRunner

# In the order in which those of one stage act.
_LAWS: tuple[type[DrivetrainLaw], ...] = (
    SampleAndHold,
    SetpointFilter,
    SlewLimit,
    ControllerDeadband,
    LoadSideFeedback,
    IntegralAction,
    VelocityFilter,
    LoopDelay,
    SupplySag,
    TorqueSpeedLimit,
    ActuatorLag,
    StrengthDrift,
    TorqueRipple,
    Cogging,
    QuadraticDrag,
    AsymmetricFriction,
    StribeckFriction,
    LoadDependentFriction,
    DirectionalEfficiency,
    PoseDependentFriction,
    PreslidingFriction,
)
LAWS: Mapping[str, type[DrivetrainLaw]] = MappingProxyType({law.name: law for law in _LAWS})
"""Every law, by its name in the catalogue of effects."""

__all__ = [
    "LAWS",
    "ActuatorLag",
    "AsymmetricFriction",
    "Cogging",
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
    "TorqueRipple",
    "TorqueSpeedLimit",
    "VelocityFilter",
]
