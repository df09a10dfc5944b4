"""Targets that no actuator takes, and actuators whose targets no recording has, in one sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from walkerkit.actuators.drive import TargetKind
from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.robot import Joint, Robot

if TYPE_CHECKING:
    from walkerkit.gap.simulation.commands import Route

KINDS: tuple[TargetKind, ...] = ("position", "velocity", "effort", "voltage")
_GEARED = 3.0  # a gear; a weak servo falls short of its target by less
_ABOUT = 1.25  # times
_CONFIGS: Mapping[TargetKind, tuple[str, str]] = {  # of a walker's actuators that MuJoCo runs
    "position": ("BuiltinPdActuatorCfg", "stiffness=..., damping=..."),
    "velocity": ("BuiltinVelocityActuatorCfg", "damping=..."),
    "voltage": ("BuiltinDcMotorActuatorCfg", "input='voltage', ..."),
}


def check_taken(robot: Robot, recording: Recording, source: str, found: Sequence[Route]) -> None:
    """Refuses a recording whose joints were moved by what it does not say.

    Args:
        robot: the robot.
        recording: the log.
        source: what a user knows it by.
        found: its targets and what takes them.

    Raises:
        InputError: an actuator of a measured joint lacks all of its targets, or takes none.
    """
    sent = {route.drive.actuator for route in found if route.drive is not None}
    controls = {route.drive.ctrl for route in found if route.drive is not None}
    for name in recording.joints:
        joint = robot.joints[name]
        # A law in Python cannot do without its first target.
        drives = joint.drives if joint.in_python else joint.commanded
        known = [d.ctrl in controls if d.in_python else d.actuator in sent for d in drives]
        if drives and not any(known):
            logged = [kind for kind in KINDS if f"{name}/{kind}_target" in recording.columns]
            wanted = " or ".join(dict.fromkeys(f"`{name}/{drive.kind}_target`" for drive in drives))
            raise InputError(
                f"{source}: joint {name!r} has an actuator for {drives[0].kind} "
                f"in {robot.source}, but the recording has no {wanted}. Log that target, or give "
                f"the joint the actuator that its drive really has{_servo(joint, logged)}."
                f"{_native_twin(joint, logged)}"
            )
    for mover in robot.movers:
        moved = [name for name in mover.joints if name in recording.joints]
        if not moved or mover.actuator in sent:
            continue
        listed = ", ".join(map(repr, moved))
        if mover.why_not:
            raise InputError(
                f"{source}: the actuator {mover.called} of {robot.source}, which moves {listed}, "
                f"is {mover.why_not}: no column of a recording can say what it was sent. Give the "
                "joint an actuator that takes a target, or leave its columns out."
            )
        if not mover.name:
            raise InputError(
                f"{source}: an actuator of {robot.source} drives {mover.through}, which moves "
                f"{listed}, and has no name by which the recording could have a column of its "
                f"targets. Name it in the model, and log `<name>/{mover.inputs[0].kind}_target`."
            )
        raise InputError(
            f"{source}: the actuator {mover.called} of {robot.source} drives {mover.through}, "
            f"which moves {listed}, and the recording has no column for it; it would be held as "
            f"the model starts. Log what it was sent as `{mover.columns[0]}`, or leave the columns "
            f"of {listed} out."
        )


def no_actuator(robot: Robot, joint: Joint, kind: TargetKind, source: str) -> str:
    """What to do about a target of a joint that has no actuator of its own."""
    column = f"{joint.name}/{kind}_target"
    mover = next((one for one in robot.movers if joint.name in one.joints), None)
    if mover is not None and mover.inputs and mover.name:
        return (
            f"{source}: column `{column}`: joint {joint.name!r} has no actuator of its own in "
            f"{robot.source}; {mover.called} moves it through {mover.through}. Rename the column "
            f"to `{mover.columns[0]}` if it holds what that was sent, or leave it out."
        )
    if mover is not None:
        why = mover.why_not or "one without a name"
        return (
            f"{source}: column `{column}`: the actuator {mover.called} of joint {joint.name!r} in "
            f"{robot.source} is {why}, and takes no such target. Give the joint one that does."
        )
    return f"{source}: column `{column}` has no actuator in {robot.source}" + _add_actuator(
        robot, joint.name, kind
    )


def unknown_target(
    robot: Robot, recording: Recording, name: str, kind: TargetKind, source: str
) -> str:
    """What to do about a target that goes by the name of no actuator that takes it."""
    column = f"{name}/{kind}_target"
    if name in robot.inputs:
        takes = ", ".join(f"`{name}/{drive.kind}_target`" for drive in robot.inputs[name])
        return (
            f"{source}: column `{column}`: the actuator {name!r} of {robot.source} takes {takes}. "
            "Rename the column, or leave it out."
        )
    mover = next((one for one in robot.movers if one.name == name), None)
    if mover is not None:
        return (
            f"{source}: column `{column}`: the actuator {name!r} of {robot.source} is "
            f"{mover.why_not}, and takes no such target. Leave the column out."
        )
    if name in robot.joints:
        return (
            f"{source}: joint {name!r} has {column!r} but no position. Add '{name}/position' or "
            "leave the column out."
        )
    known = closest(name, [*recording.joints, *robot.inputs])
    return (
        f"{source}: {column!r} is the target of nothing: {name!r} is no joint with a position and "
        f"no actuator of {robot.source}{known}. Rename the column, or leave it out."
    )


def before_gear(robot: Robot, joint: Joint, ratio: float) -> str:
    """What to do about a target that is a motor's and not its joint's; "" where it is none.

    Args:
        robot: the robot.
        joint: one of its joints.
        ratio: how far it moves where its target moves by one.
    """
    drive = joint.taker("position")
    if drive is None or not drive.in_joint_units:
        return ""
    gear = drive.slope
    size = abs(gear)
    if 1 / _GEARED < size < _GEARED or not 1 / _ABOUT < ratio * gear < _ABOUT:
        return ""
    name = robot.model.actuator(drive.actuator).name or "its actuator"
    return (
        f"column `{joint.name}/position_target` looks like the control of {name} in "
        f"{robot.source}, in front of its gear of {gear:g}: {joint.name!r} moves by {ratio:.2g} of "
        f"it. Divide the column by {gear:g}, so that it is the position that the joint is to have."
    )


def check_memory(robot: Robot, recordings: Sequence[Recording]) -> None:
    """Refuses actuators that remember for long, of robots whose replays restart.

    Raises:
        InputError: a measured joint has one whose integral or temperature no log shows.
    """
    measured = {name for recording in recordings for name in recording.joints}
    model = robot.model
    for name, joint in robot.joints.items():
        for drive in joint.inputs if name in measured else ():
            a = drive.actuator
            what = {
                "an integral of its position error": model.actuator_actnum[a]
                and (drive.law == "pid" or model.actuator_gainprm[a, 5] != 0),
                "the temperature of its winding": drive.law == "dcmotor"
                and model.actuator_dynprm[a, 2] != 0,
                "a target whose slope it limits": drive.law == "dcmotor"
                and model.actuator_dynprm[a, 7] != 0,
            }
            remembered = next((words for words, has in what.items() if has), None)
            if remembered is not None:
                raise InputError(
                    f"{robot.source}: the actuator of joint {name!r} is a {drive.law} that "
                    f"remembers {remembered}, which no recording has, and replays of this robot "
                    "restart from the measured state. Leave that out of the actuator, or hold all "
                    "joints by position targets and mount the base."
                )


def _native_twin(joint: Joint, targets: Sequence[TargetKind]) -> str:
    """What else a walker's bare motor may be: the law of an actuator that runs in Python."""
    if joint.in_python or not targets or joint.commanded[0].kind != "effort":
        return ""
    return (
        " An actuator whose law runs in Python, as IdealPdActuatorCfg, leaves a bare motor in the "
        "MJCF: give as the model a `package.module:callable` that returns the walker itself."
    )


def _servo(joint: Joint, logged: Sequence[str]) -> str:
    """The command that makes servos of motors, where targets of positions were logged."""
    if joint.in_python or "position" not in logged or joint.commanded[0].kind != "effort":
        return ""
    return " (`walkerkit servo` makes servos of a model's motors)"


def _add_actuator(robot: Robot, joint: str, kind: TargetKind) -> str:
    """How a model gets the actuator that a joint lacks, the end of a sentence and the next."""
    if robot.path is None or robot.path.suffix.lower() != ".urdf":
        element = "dcmotor" if kind == "voltage" else kind
        return f". Add a <{element}> actuator to joint {joint!r}."
    config, gains = _CONFIGS[kind]
    made = f"MjcfWalker.from_file({robot.path.name!r}, {config}(joint_names_expr=(...), {gains}))"
    return (
        f", and a URDF can have none. Give as the model a `package.module:callable` that returns "
        f"{made}."
    )
