"""Which number of the model or of actuators.json a parameter of an effect changes.

    COULOMB = joint("frictionloss", "dof_frictionloss")
    COULOMB.path                              # "joint/frictionloss"
    COULOMB.read(robot, "knee", robot)        # what the model has, in the parameter's unit

Every effect says it once, in `fields`. What a model had before and has after it was mended is read
by the same function, so that a report never states a number that is not in the files.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from walkerkit.actuators.drive import Drive, read_drive
from walkerkit.actuators.drivetrain import CommandDelay, DrivetrainLaw
from walkerkit.gap.simulation.interpolate import made_delay
from walkerkit.gap.simulation.robot import Robot

FILE = "actuators.json"
Read = Callable[[Robot, str, Robot], float | None]
"""Of a robot, at a site, beside the robot as it was given; None where it has no such number."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """One number of a robot's files.

    Attributes:
        path: element and attribute in MJCF, e.g. `joint/frictionloss`, or keys of actuators.json,
            e.g. `actuators.json/laws/slew_limit/rate`. Where the number follows from several, they
            stand with the sign that joins them.
        read: the number that a robot has at a site [the parameter's unit].
    """

    path: str
    read: Read


def joint(
    attribute: str,
    array: str,
    address: Literal["dof", "id", "qpos"] = "dof",
    column: int | None = None,
) -> Field:
    """An attribute of a joint.

    Args:
        attribute: its name in MJCF.
        array: the field of mjModel that has it.
        address: what the array is indexed by.
        column: which of its columns it is; None where there is one number.
    """
    return Field(path=f"joint/{attribute}", read=partial(_of_joint, array, address, column))


def law(of: type[DrivetrainLaw], parameter: str) -> Field:
    """A parameter of a drivetrain law."""
    return Field(
        path=f"{FILE}/laws/{of.name}/{parameter}", read=partial(_of_law, of.name, parameter)
    )


def measurement(attribute: str, *, of_a_factor: bool = False) -> Field:
    """What lies between a joint and its log.

    Args:
        attribute: the attribute of `Measurement`.
        of_a_factor: the number is what the factor has beyond 1.
    """
    return Field(
        path=f"{FILE}/measurement/{attribute}{' − 1' if of_a_factor else ''}",
        read=partial(_of_measurement, attribute, 1.0 if of_a_factor else 0.0),
    )


def drive_of(robot: Robot, site: str, *kinds: str) -> Drive | None:
    """The first actuator of a joint that takes one of some kinds of target, as its model has it.

    Args:
        robot: the robot; its joints know the meaning of targets, its model what the drive makes.
        site: the joint.
        kinds: kinds of targets, in the order of preference; none for any.
    """
    drives = robot.joints[site].drives
    chosen = next((one for kind in kinds for one in drives if one.kind == kind), None)
    if chosen is None and not kinds and drives:
        chosen = drives[0]
    return None if chosen is None else read_drive(robot.model, chosen.actuator)


def gear(robot: Robot, drive: Drive) -> float:
    """The gear of an actuator."""
    return float(robot.model.actuator_gear[drive.actuator, 0])


def command_delay(robot: Robot, site: str, given: Robot) -> float | None:
    """How late targets reach the drive [s], by its own delay and by that of the law."""
    drives = robot.joints[site].drives
    if not drives:
        return None
    own = float(made_delay(robot.model.actuator_delay[drives[0].actuator], _step(robot)))
    return own + robot.laws.get(site, {}).get(CommandDelay.name, {}).get("delay", 0.0)


def _step(robot: Robot) -> float:
    return float(robot.model.opt.timestep)


def _of_joint(
    array: str, address: str, column: int | None, robot: Robot, site: str, given: Robot
) -> float:
    values = getattr(robot.model, array)[getattr(robot.joints[site], address)]
    return float(values if column is None else values[column])


def _of_law(name: str, parameter: str, robot: Robot, site: str, given: Robot) -> float | None:
    sites = [site] if site in robot.joints else [*robot.laws]
    known = (robot.laws.get(one, {}).get(name) for one in sites)
    found = next((one for one in known if one is not None), None)
    return None if found is None else float(found[parameter])


def _of_measurement(
    attribute: str, less: float, robot: Robot, site: str, given: Robot
) -> float | None:
    one = site if site in robot.joints else next(iter(robot.joints))
    measured = robot.measured(one)
    if attribute in ("error_periods", "error_phase") and not measured.error_amplitude:
        return None
    return float(getattr(measured, attribute)) - less
