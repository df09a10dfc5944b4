"""Every drivetrain law, in the order in which those of one stage act."""

from collections.abc import Mapping
from types import MappingProxyType

from walkerkit.actuators.drivetrain.controller import (
    ControllerDeadband,
    IntegralAction,
    SampleAndHold,
    SetpointFilter,
    SlewLimit,
    VelocityFilter,
)
from walkerkit.actuators.drivetrain.delays import CommandDelay, LoopDelay
from walkerkit.actuators.drivetrain.drive import (
    ActuatorLag,
    Cogging,
    QuadraticDrag,
    StrengthDrift,
    SupplySag,
    SupplyVoltage,
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
from walkerkit.actuators.drivetrain.law import DrivetrainLaw
from walkerkit.actuators.drivetrain.load_side import LoadSideFeedback

_LAWS: tuple[type[DrivetrainLaw], ...] = (
    CommandDelay,
    SampleAndHold,
    SetpointFilter,
    SlewLimit,
    ControllerDeadband,
    LoadSideFeedback,
    IntegralAction,
    VelocityFilter,
    LoopDelay,
    SupplyVoltage,
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
