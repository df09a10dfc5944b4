"""What can be changed of a robot before an experiment, so that it tells more.

    for set_up in set_ups(robot, joints, concerned=("knee",), efforts=True):
        set_up.instruction                 # "Put 0.5 kg on body calf, at its centre of mass."
        set_up.change(trials)              # the same, done to variants of the robot
        set_up.changed(robot)              # the robot as it is given, so changed: a model to write

Each says in words what to do, and does it to any variant: on top of whatever the variant assumes of
the robot, as the real change is on top of whatever is true.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from walkerkit.actuators.drive import Drive, TargetKind
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

Change = Callable[[Trials], None]

RELEASE = "release"
"""In place of an excitation's name: the joints are let go from a pose."""

_GAIN = 0.3  # of the drive's
_MASSES = (0.5, 0.2)  # of what the body carries already
_HANDS = 2  # that hold joints until they are let go
_CLAMPED = 1e9  # kg·m² (kg): nothing moves a joint of this inertia
_STEADY = ("slow_triangle", "steps", "multisine", "shift", "sway", "squat")


@dataclass(frozen=True, kw_only=True)
class SetUp:
    """One change.

    Attributes:
        name: `as_it_is`, `effort_logged`, `reduced_gain`, `known_payload`, `motor_off`,
            `held_link`.
        instruction: what to do, in sentences; empty for nothing.
        excitations: names of what to play under it.
        trouble: how much it asks of who does it, 0 for nothing; equally good ones are chosen by it.
        change: does it to variants of the robot.
        released: joints whose drive is off.
        held: joints that are clamped.
        more_effort: the efforts are logged that were not.
    """

    name: str
    instruction: str
    excitations: tuple[str, ...]
    trouble: int
    change: Change
    released: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    more_effort: bool = False

    @property
    def changes_robot(self) -> bool:
        """Whether its recording needs a model of its own."""
        return self.change is not _nothing

    def changed(self, robot: Robot) -> Robot:
        """The robot with the change in its model."""
        trials = Trials(robot, 1)
        self.change(trials)
        return mend(trials)


def set_ups(
    robot: Robot,
    joints: Sequence[str],
    *,
    concerned: Sequence[str],
    efforts: bool,
    excitations: Sequence[str],
) -> tuple[SetUp, ...]:
    """What can be done with a robot whose joints all take positions, all velocities, or all effort.

    Effort that is played to a joint which is free to go would carry it anywhere, so that joints
    which take effort are let go or clamped.

    Args:
        robot: the robot.
        joints: the joints that were recorded.
        concerned: those of them that the effects in question act on.
        efforts: whether the efforts were logged.
        excitations: names of all excitations, for the robot as it is.

    Returns:
        By how much trouble they are, the robot as it is first; none for a robot that can neither be
        sent targets nor held.
    """
    kind = takes(robot, joints)
    if kind == "effort":
        return _without_targets(robot, joints, excitations)
    first = "first target" if kind == "position" else "first position"
    steady = tuple(name for name in _STEADY if name in excitations)
    found = [
        SetUp(
            name="as_it_is",
            instruction="",
            excitations=tuple(excitations),
            trouble=0,
            change=_nothing,
        ),
        *([] if efforts else [_effort_logged(steady)]),
        _reduced_gain(kind, joints, steady),
        *(_with_payload(robot, body, part, steady) for body, part in _loads(robot, concerned)),
    ]
    if can_be_held(robot, concerned):  # a robot that stands would fall
        others = " The other joints hold theirs." if len(concerned) < len(joints) else ""
        found.append(
            _let_go(
                concerned,
                f"Switch the drive{_plural(concerned)} of {_listed(concerned)} off. Hold the "
                f"joint{_plural(concerned)} at the {first}, start the log, and let go.{others}",
                lambda trials: _switch_off(trials, concerned),
            )
        )
    if robot.base is None:
        told = f"Clamp the link behind joint {concerned[0]} where its {first} is."
        found.append(_held_link(concerned[:1], told, excitations))
    return tuple(found)


def takes(robot: Robot, joints: Sequence[str]) -> TargetKind | None:
    """What all of these joints can be sent, `position` before others; None where they differ."""
    of_each = [robot.joints[name] for name in joints]
    kinds: tuple[TargetKind, ...] = ("position", "velocity")
    for kind in kinds:
        if all(joint.drive(kind) is not None for joint in of_each):
            return kind
    moved = {name for one in robot.movers for name in one.joints}
    moved |= {joint.name for joint in of_each if any(d.law != "affine" for d in joint.inputs)}
    if moved.isdisjoint(joints) and all(
        drive.kind == "effort" for joint in of_each for drive in joint.drives
    ):
        return "effort"
    return None


def can_be_held(robot: Robot, joints: Sequence[str]) -> bool:
    """Whether hands can hold all of these joints until they are let go."""
    return robot.base is None and len(joints) <= _HANDS


def held_amplitude(robot: Robot, joint: str) -> float:
    """How far the targets of a clamped joint may go, for an effort that it has made already."""
    effort, drive = robot.excursion(joint).effort, _servo(robot, joint)
    if drive is None:
        return effort
    gain = drive.stiffness if drive.kind == "position" else drive.damping
    return effort / gain if gain > 0 else 0.0


def _servo(robot: Robot, joint: str) -> Drive | None:
    """What takes targets of the joint's position, or else of its velocity."""
    drives = robot.joints[joint]
    return drives.drive("position") or drives.drive("velocity")


def _without_targets(
    robot: Robot, joints: Sequence[str], excitations: Sequence[str]
) -> tuple[SetUp, ...]:
    """What can be done with joints that take nothing but effort."""
    if not can_be_held(robot, joints):
        return ()
    s = _plural(joints)
    return (
        _let_go(
            joints,
            f"Switch the motor{s} of {_listed(joints)} off. Hold the joint{s} at the first "
            "position, start the log, and let go.",
            _nothing,
        ),
        _held_link(
            joints,
            f"Clamp the link{s} behind joint{s} {_listed(joints)} at the first position.",
            excitations,
        ),
    )


def _reduced_gain(
    kind: TargetKind | None, joints: Sequence[str], excitations: tuple[str, ...]
) -> SetUp:
    """The drives have less gain."""
    return SetUp(
        name="reduced_gain",
        instruction=f"Set the {kind} gain of every drive to {_GAIN:g} of what it is.",
        excitations=excitations,
        trouble=1,
        change=lambda trials: _reduce_gain(trials, joints),
    )


def _effort_logged(excitations: tuple[str, ...]) -> SetUp:
    """The efforts are logged that were not."""
    return SetUp(
        name="effort_logged",
        instruction=(
            "Log the effort of each joint as well: the drive's current times its nominal "
            "torque constant, in N·m."
        ),
        excitations=excitations,
        trouble=1,
        change=_nothing,
        more_effort=True,
    )


def _let_go(joints: Sequence[str], instruction: str, change: Change) -> SetUp:
    """The joints are let go with their drives off."""
    return SetUp(
        name="motor_off",
        instruction=instruction,
        excitations=(RELEASE,),
        trouble=2,
        change=change,
        released=tuple(joints),
    )


def _held_link(joints: Sequence[str], instruction: str, excitations: Sequence[str]) -> SetUp:
    """The links behind the joints are clamped."""
    held = tuple(joints)
    return SetUp(
        name="held_link",
        instruction=instruction,
        excitations=_of_a_held_link(excitations),
        trouble=3,
        change=lambda trials: _clamp(trials, held),
        held=held,
    )


def _of_a_held_link(excitations: Sequence[str]) -> tuple[str, ...]:
    return tuple(name for name in ("steps", "chirp") if name in excitations)


def _nothing(trials: Trials) -> None:
    pass


def _reduce_gain(trials: Trials, joints: Sequence[str]) -> None:
    for name in joints:
        drive = _servo(trials.robot, name)
        if drive is None:
            continue
        bias = trials.field("actuator_biasprm")[:, drive.actuator]
        trials.field("actuator_gainprm")[:, drive.actuator, 0] *= _GAIN
        bias[:, 1 if drive.kind == "position" else 2] *= _GAIN
        if not drive.in_joint_units:  # then it is part of how a control becomes a position
            bias[:, 0] *= _GAIN


def _with_payload(robot: Robot, body: str, part: float, excitations: tuple[str, ...]) -> SetUp:
    mass = _round(part * float(robot.model.body(body).subtreemass[0]))

    def put_on(trials: Trials) -> None:
        trials.field("body_mass")[:, trials.robot.model.body(body).id] += mass

    x, y, z = (f"{1e3 * r:.0f}" for r in robot.model.body(body).ipos)
    return SetUp(
        name="known_payload",
        instruction=(
            f"Put {mass:g} kg on body {body}, at its centre of mass "
            f"({x}, {y}, {z} mm in the body's frame); weigh it first."
        ),
        excitations=excitations,
        trouble=2,
        change=put_on,
    )


def _loads(robot: Robot, concerned: Sequence[str]) -> list[tuple[str, float]]:
    """The last body that the joints in question move, or the trunk, with what to put on it."""
    if robot.base is not None and robot.base.body in robot.bodies:
        return [(robot.base.body, part) for part in _MASSES]
    bodies = CATALOGUE["payload"].sites(robot, concerned)
    model = robot.model
    ids = {model.body(name).id for name in bodies}
    carriers = {int(model.body_parentid[body]) for body in ids}
    last = [name for name in bodies if model.body(name).id not in carriers]
    return [(body, part) for body in last[:1] for part in _MASSES]


def _switch_off(trials: Trials, joints: Sequence[str]) -> None:
    for name in joints:
        for drive in trials.robot.joints[name].drives:
            trials.field("actuator_gainprm")[:, drive.actuator] = 0.0
            trials.field("actuator_biasprm")[:, drive.actuator] = 0.0


def _clamp(trials: Trials, joints: Sequence[str]) -> None:
    for name in joints:
        trials.field("dof_armature")[:, trials.robot.joints[name].dof] += _CLAMPED


def _round(value: float) -> float:
    """The nearest of 1, 2, 5, 10…: what scales and shelves have."""
    steps = np.array([1.0, 2.0, 5.0, 10.0]) * 10.0 ** np.floor(np.log10(value))
    return float(f"{steps[np.argmin(np.abs(np.log(steps / value)))]:.1g}")


def _plural(names: Sequence[str]) -> str:
    return "s" if len(names) > 1 else ""


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
