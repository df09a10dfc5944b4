"""The recorded commands as the controls of a simulation.

Between samples a target is held, as a drive holds its last command, or interpolated but for its
steps, which comes closer to a loop that runs at the rate of the log, or faster; before the first
sample it is the first. Or it is the next sample, where a row is written after the step that its
target was for.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drive import Drive
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.interpolate import NEAREST
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.gap.simulation.untaken import KINDS, check_taken, no_actuator, unknown_target

FloatArray = NDArray[np.float64]

Hold = Literal["zero_order", "linear", "next"]

_STEP = 4.0  # times what a target moves just before and after, which no motion does


@dataclass(frozen=True, kw_only=True)
class Route:
    """One target column and where it enters the simulation.

    Attributes:
        joint: the joint, or None for an actuator that is no joint's own.
        column: the column of the recording.
        drive: the actuator that takes it, or None for effort applied to the joint beside it.
    """

    joint: Joint | None
    column: str
    drive: Drive | None


def routes(robot: Robot, recording: Recording) -> tuple[Route, ...]:
    """Finds for every target of the recording the actuator that takes it.

    A joint's targets are `<joint>/position_target` and the like; those of an actuator that drives
    something else, or is the second one of its kind on a joint, `<actuator>/position_target`.

    Raises:
        InputError: a joint's actuator lacks its target, or a target has no actuator to go to.
    """
    source = str(recording.source or recording.name)
    robot.check_joints(recording.joints, source)
    found = [
        Route(joint=robot.joints[name], column=column, drive=drive)
        for name in recording.joints
        for column, drive in _targets_of_joint(robot, recording, name, source)
    ]
    by_name = _by_name(robot, recording, source, {route.column for route in found})
    taken = {route.drive.ctrl for route in found if route.drive is not None}
    for route in by_name:
        if route.drive is not None and route.drive.ctrl in taken:
            raise InputError(
                f"{source}: column `{route.column}` is what a column of its joint says, too. Leave "
                "one of the two out."
            )
    found += by_name
    check_taken(robot, recording, source, found)
    return tuple(found)


def _targets_of_joint(
    robot: Robot, recording: Recording, name: str, source: str
) -> Iterator[tuple[str, Drive | None]]:
    """Columns of a joint's targets, each with what takes it: None where it is effort beside it."""
    joint = robot.joints[name]
    logged = [kind for kind in KINDS if f"{name}/{kind}_target" in recording.columns]
    # A tendon's actuator may have the name of a joint.
    own = {drive.kind: drive for one in robot.movers if one.name == name for drive in one.inputs}
    for kind in logged:
        drive = joint.taker(kind) or own.get(kind)
        if drive is None and kind == "effort":
            # What a motor is sent is volts, as `BuiltinDcMotorActuatorCfg` takes them.
            drive = joint.taker("voltage")
            if drive is not None and "voltage" in logged:
                raise InputError(
                    f"{source}: joint {name!r} has both `{name}/voltage_target` and "
                    f"`{name}/effort_target`, and its motor takes one command. Leave out the one "
                    "that it was not sent."
                )
        if drive is not None or kind == "effort":
            yield f"{name}/{kind}_target", drive
        elif not joint.commanded and "effort" not in logged:
            raise InputError(no_actuator(robot, joint, kind, source))


def _by_name(robot: Robot, recording: Recording, source: str, known: Container[str]) -> list[Route]:
    """Targets that go by the name of their actuator."""
    of_joint = {drive.ctrl: joint for joint in robot.joints.values() for drive in joint.commanded}
    found = []
    for name in recording.commanded:
        inputs = {drive.kind: drive for drive in robot.inputs.get(name, ())}
        for kind in KINDS:
            column = f"{name}/{kind}_target"
            if column not in recording.columns or column in known:
                continue
            drive = inputs.get(kind)
            if drive is None and name in robot.joints and name in robot.loops.joints:
                drive = robot.joints[name].taker(kind)
            if drive is None:
                raise InputError(unknown_target(robot, recording, name, kind, source))
            joint = of_joint.get(drive.ctrl)
            # One that follows others needs no encoder.
            if joint is not None and joint.name not in {*recording.joints, *robot.loops.joints}:
                raise InputError(
                    f"{source}: column `{column}` is for joint {joint.name!r} of {robot.source}, "
                    f"which has no position here. Add `{joint.name}/position`, or leave it out."
                )
            if joint is not None:  # whose drives know what a target was before they were mended
                drive = next(one for one in joint.commanded if one.ctrl == drive.ctrl)
            found.append(Route(joint=joint, column=column, drive=drive))
    return found


def by_effort_alone(robot: Robot, recording: Recording) -> tuple[str, ...]:
    """The recording's joints that nothing holds: no servo, and no loop or tendon with one."""
    found = routes(robot, recording)
    servos = {
        route.drive.actuator
        for route in found
        if route.drive is not None and route.drive.kind in ("position", "velocity")
    }
    held = {
        route.joint.name
        for route in found
        if route.joint is not None and route.drive is not None and route.drive.actuator in servos
    }
    held.update(name for one in robot.movers if one.actuator in servos for name in one.joints)
    if set(recording.joints) <= held:
        return ()
    every = robot.made.get(("held", frozenset(held)), lambda: robot.loops.holds(held))
    return tuple(name for name in recording.joints if name not in every)


def driven_by_effort(robot: Robot, recording: Recording) -> bool:
    """Whether some joint has nothing but effort to hold it, so that whole rollouts run away."""
    return bool(by_effort_alone(robot, recording))


def between_samples(
    recording: Recording, column: str, time: FloatArray, hold: Hold, step: float
) -> FloatArray:
    """A target at some instants.

    A held target changes at the step nearest to its stamp: a stamp that jitters around a step's own
    instant must not move it by a whole step, nor a clock of another rate make it late on average.

    Args:
        recording: the log.
        column: name of a column.
        time: (n,) instants of steps [s].
        hold: `zero_order` for the last sample before each, `linear` for a line to the sample after
            each unless the target steps there, or `next` for that sample, of logs that show at the
            end of a period what was commanded in it.
        step: the steps' length [s].

    Returns:
        (n,) values.
    """
    # A part starts in the middle of a motion: what was commanded before is on its way.
    recording = recording.whole
    values = recording.columns[column]
    index = np.searchsorted(recording.time, time + NEAREST * step, side="right") - 1
    if hold == "next":
        index += 1
    index = np.clip(index, 0, len(values) - 1)
    if hold == "linear":
        return np.where(
            _steps(values)[index], values[index], np.interp(time, recording.time, values)
        )
    return values[index]


def _steps(values: FloatArray) -> NDArray[np.bool_]:
    """(n,) where a target steps between a sample and the next."""
    moved = np.abs(np.diff(values, append=values[-1:]))
    beside = np.maximum(np.roll(moved, 1), np.roll(moved, -1))
    return moved > _STEP * beside
