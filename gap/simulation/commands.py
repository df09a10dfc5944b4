"""The recorded commands as the controls of a simulation.

Between samples a target is held, as a drive holds its last command, or interpolated but for its
steps, which comes closer to a loop that runs at the rate of the log, or faster; before the first
sample it is the first. Or it is the next sample, where a row is written after the step that its
target was for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drive import Drive, TargetKind
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.interpolate import NEAREST
from walkerkit.gap.simulation.robot import Joint, Robot

FloatArray = NDArray[np.float64]

Hold = Literal["zero_order", "linear", "next"]

_STEP = 4.0  # times what a target moves just before and after, which no motion does

_KINDS: tuple[TargetKind, ...] = ("position", "velocity", "effort")
_CONFIGS: Mapping[TargetKind, tuple[str, str]] = {  # of a walker's actuators that MuJoCo runs
    "position": ("BuiltinPdActuatorCfg", "stiffness=..., damping=..."),
    "velocity": ("BuiltinVelocityActuatorCfg", "damping=..."),
}


@dataclass(frozen=True, kw_only=True)
class Route:
    """One target column and where it enters the simulation.

    Attributes:
        joint: the joint.
        column: the column of the recording.
        drive: the actuator that takes it, or None for effort applied to the joint beside it.
    """

    joint: Joint
    column: str
    drive: Drive | None


def routes(robot: Robot, recording: Recording) -> tuple[Route, ...]:
    """Finds for every target of the recording the actuator that takes it.

    Raises:
        InputError: a joint's actuator lacks its target, or a target has no actuator to go to.
    """
    source = str(recording.source or recording.name)
    robot.check_joints(recording.joints, source)
    found: list[Route] = []
    for name in recording.joints:
        joint = robot.joints[name]
        targets = [kind for kind in _KINDS if f"{name}/{kind}_target" in recording.columns]
        taken = {kind for kind in targets if joint.drive(kind) is not None}
        for kind in targets:
            if kind in taken or kind == "effort":
                found.append(
                    Route(joint=joint, column=f"{name}/{kind}_target", drive=joint.drive(kind))
                )
        first = joint.drives[0].kind if joint.in_python else None
        if joint.drives and (not taken or (first and first not in taken)):
            wanted = " or ".join(f"`{name}/{drive.kind}_target`" for drive in joint.drives)
            raise InputError(
                f"{source}: joint {name!r} has an actuator for {joint.drives[0].kind} "
                f"in {robot.source}, but the recording has no {wanted}. Log that target, or give "
                "the joint the actuator that its drive really has."
                f"{_native_twin(robot, joint, targets)}"
            )
        if not joint.drives and targets and "effort" not in targets:
            raise InputError(
                f"{source}: column `{name}/{targets[0]}_target` has no actuator in "
                f"{robot.source}{_add_actuator(robot, name, targets[0])}"
            )
    return tuple(found)


def _native_twin(robot: Robot, joint: Joint, targets: Sequence[TargetKind]) -> str:
    """What else a walker's bare motor may be: the law of an actuator that runs in Python."""
    if joint.in_python or not targets or joint.drives[0].kind != "effort":
        return ""
    return (
        " An actuator whose law runs in Python, as IdealPdActuatorCfg, leaves a bare motor in the "
        "MJCF: give as the model a `package.module:callable` that returns the walker itself."
    )


def _add_actuator(robot: Robot, joint: str, kind: TargetKind) -> str:
    """How a model gets the actuator that a joint lacks, the end of a sentence and the next."""
    if robot.path is None or robot.path.suffix.lower() != ".urdf":
        return f". Add a <{kind}> actuator to joint {joint!r}."
    config, gains = _CONFIGS[kind]
    made = f"MjcfWalker.from_file({robot.path.name!r}, {config}(joint_names_expr=(...), {gains}))"
    return (
        f", and a URDF can have none. Give as the model a `package.module:callable` that returns "
        f"{made}."
    )


def by_effort_alone(robot: Robot, recording: Recording) -> tuple[str, ...]:
    """The recording's joints that have nothing but effort to hold them."""
    servoed = {
        route.joint.name
        for route in routes(robot, recording)
        if route.drive is not None and route.drive.kind != "effort"
    }
    return tuple(name for name in recording.joints if name not in servoed)


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
