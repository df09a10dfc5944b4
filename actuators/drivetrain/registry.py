"""Every drivetrain law, in the order in which those of one stage act.

    law_named("stribeck_friction")     # walkerkit's, or one that a user has defined
    in_order([MyLaw, StribeckFriction])

A user's law is a subclass of `DrivetrainLaw` in a module of the user's own. It is known by its name
as soon as that module is imported; a package that has laws names their module in its entry points
of the group `walkerkit.laws`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.metadata import entry_points
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
from walkerkit.actuators.drivetrain.drivetrain_law import DrivetrainLaw, defined_laws
from walkerkit.actuators.drivetrain.joint_friction import (
    AsymmetricFriction,
    DirectionalEfficiency,
    LoadDependentFriction,
    PoseDependentFriction,
    PreslidingFriction,
    StribeckFriction,
)
from walkerkit.actuators.drivetrain.load_side import LoadSideFeedback
from walkerkit.actuators.messages import closest, listed

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
"""Every law of walkerkit, by its name in the catalogue of effects."""


class UnknownLawError(ValueError):
    """No law has a name that a file or a user gives."""


ENTRY_POINTS = "walkerkit.laws"
"""Group of the entry points that name modules with laws."""


def law_named(name: str) -> type[DrivetrainLaw]:
    """The law of a name, of walkerkit or of a user.

    Raises:
        UnknownLawError: no law has that name.
    """
    found = LAWS.get(name) or defined_laws().get(name)
    if found is None:
        for entry in entry_points(group=ENTRY_POINTS):
            entry.load()
        found = defined_laws().get(name)
    if found is None:
        known = [*LAWS, *(other for other in defined_laws() if other not in LAWS)]
        raise UnknownLawError(
            f"there is no drivetrain law {name!r}{closest(name, known)}; there are "
            f"{listed(known)}. Import the module that defines it before"
        )
    return found


def in_order(laws: Iterable[type[DrivetrainLaw]]) -> list[type[DrivetrainLaw]]:
    """Laws, each once, in the order in which those of a stage act: those of users come last.

    Among themselves the laws of users are in the order of their names.
    """
    ours = {law: k for k, law in enumerate(LAWS.values())}
    return sorted(dict.fromkeys(laws), key=lambda law: (ours.get(law, len(ours)), law.name))
