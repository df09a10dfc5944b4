"""Torque motors turned into the servo that the robot's controller is.

    made = with_servos("go2.xml", kp=60, kd=1.5)
    made.text.write(Path("go2_servo.xml"))
    made.snippet              # what was written, to be read

A robot's drives close a loop around position, τ = kp (target − q) − kd q̇, within their limits. Many
models have the bare motors instead, as a policy's own loop is outside of them; a log of targets
then cannot be replayed. Here each motor becomes `<position kp kv forcerange>`: the effort that its
control could ask for is the servo's limit, its gear is taken away so that the gains are those of
the joint, and nothing clips the target. All other bytes of the file stay.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from walkerkit.actuators.drive import Drive
from walkerkit.gap.errors import closest, refusal
from walkerkit.gap.own_robot.mjcf_text import Element, MjcfText
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Joint, Robot

_LAW = (
    *("gaintype", "biastype", "dyntype", "gainprm", "biasprm", "dynprm", "actdim", "actearly"),
    *("actlimited", "actrange", "inheritrange", "dampratio", "timeconst"),
)
_SERVO_TAGS = ("position",)


@dataclass(frozen=True, kw_only=True)
class Servoed:
    """A model with servos.

    Attributes:
        text: the changed text, to be written.
        joints: those that have a new servo.
        snippet: the new elements, one a line.
        notes: what a user should know.
    """

    text: MjcfText
    joints: tuple[str, ...]
    snippet: str
    notes: tuple[str, ...]


def with_servos(
    model: str | Path,
    *,
    kp: float,
    kd: float,
    joints: Sequence[str] = (),
    effort: float | None = None,
    allow_outside: bool = False,
) -> Servoed:
    """Turns a model's torque motors into servos.

    Args:
        model: an MJCF file.
        kp: stiffness [N·m/rad; N/m].
        kd: damping [N·m·s/rad; N·s/m].
        joints: regular expressions of whole names. A joint that has a servo gets these gains, and
            one without an actuator a servo. By default all that have a torque motor; where the
            model has no actuator at all, every joint.
        effort: the drives' limit, instead of that of the motors [N·m; N].
        allow_outside: the model's files may lie outside of its folder.

    Raises:
        InputError: a number makes no sense, no joint is meant, or one has another kind of actuator.
    """
    for name, value in (("kp", kp), ("kd", kd), ("effort", effort)):
        if value is not None and not (math.isfinite(value) and value >= 0):
            raise refusal(f"{name} is {value:g}. Give a number of at least 0.")
    robot = load_robot(model, allow_outside=allow_outside)
    if robot.path is None:
        raise refusal(f"{model}: a callable has no text to change. Give an MJCF file.")
    text = MjcfText.read(robot.path)
    return _Change(robot, text, kp, kd, effort).of(_chosen(robot, joints))


def _chosen(robot: Robot, expressions: Sequence[str]) -> list[Joint]:
    found: dict[str, Joint] = {}
    for expression in expressions:
        try:
            some = {n: j for n, j in robot.joints.items() if re.fullmatch(expression, n)}
        except re.error as error:
            raise refusal(f"--joint {expression!r} is no regular expression: {error}.") from None
        if not some:
            raise refusal(
                f"{robot.source}: no joint is called {expression!r}"
                f"{closest(expression, robot.joints)}. It has {', '.join(robot.joints)}."
            )
        found |= some
    if expressions:
        return list(found.values())
    if not robot.model.nactuator:
        return list(robot.joints.values())
    driven = [joint for joint in robot.joints.values() if joint.drive("effort") is not None]
    if not driven:
        raise refusal(
            f"{robot.source}: no joint has a torque motor. Name those that get these gains with "
            "--joint, such as --joint '.*'."
        )
    return driven


class _Change:
    def __init__(self, robot: Robot, text: MjcfText, kp: float, kd: float, effort: float | None):
        self._robot, self._text = robot, text
        self._gains = {"kp": _number(kp), "kv": _number(kd)}
        self._effort = effort
        self._lines: list[str] = []
        self._notes: list[str] = []

    def of(self, joints: Sequence[Joint]) -> Servoed:
        """The model with servos at these joints."""
        elements = [e for e in self._text.elements if e.parents and e.parents[-1].tag == "actuator"]
        if len(elements) != self._robot.model.nactuator:
            raise refusal(
                f"{self._robot.source}: it has {self._robot.model.nactuator} actuators and "
                f"{len(elements)} elements that make them. Write the servos by hand: "
                f'<position joint="..." kp="{self._gains["kp"]}" kv="{self._gains["kv"]}"/>.'
            )
        added = []
        for joint in joints:
            drive = joint.drive("effort")
            servo = joint.drive("position")
            if drive is not None:
                self._turn(joint, drive, elements[drive.actuator])
            elif servo is not None and elements[servo.actuator].tag in _SERVO_TAGS:
                self._regain(servo, elements[servo.actuator])
            elif joint.drives or self._is_driven(joint):
                raise refusal(
                    f"{self._robot.source}: joint {joint.name!r} has an actuator that is neither a "
                    "torque motor nor a <position>. Leave the joint out with --joint, or replace "
                    "its actuator by hand."
                )
            else:
                added.append(self._new(joint))
        if added:
            self._text.add("actuator", added)
            self._lines += added
        self._tell_keyframes(joints)
        return Servoed(
            text=self._text,
            joints=tuple(joint.name for joint in joints),
            snippet="\n".join(self._lines),
            notes=tuple(self._notes),
        )

    def _turn(self, joint: Joint, drive: Drive, element: Element) -> None:
        """Makes a servo of a motor."""
        model = self._robot.model
        lower, upper = self._limits(drive)
        attributes: dict[str, str | None] = dict.fromkeys((*_LAW, "ctrlrange"))
        attributes |= self._gains
        if np.isfinite(upper):
            attributes["forcerange"] = f"{_number(lower)} {_number(upper)}"
            attributes["forcelimited"] = "true" if "forcelimited" in element.attributes else None
        else:
            self._notes.append(f"joint {joint.name!r} has no effort limit; give one with --effort")
        if model.actuator_ctrllimited[drive.actuator]:
            # What limited efforts would now limit positions.
            attributes["ctrllimited"] = "false"
        if model.actuator_gear[model.actuator_outadr[drive.actuator], 0] != 1:
            attributes["gear"] = "1"
        text = self._text.change(element, attributes=attributes, tag="position")
        self._lines.append(text)

    def _limits(self, drive: Drive) -> tuple[float, float]:
        """The efforts at the joint that a motor can make, infinite where nothing limits them."""
        if self._effort is not None:
            return -self._effort, self._effort
        model, k = self._robot.model, drive.actuator
        gear = float(model.actuator_gear[model.actuator_outadr[k], 0])
        gain = float(model.actuator_gainprm[k, 0])
        lower, upper = -np.inf, np.inf
        ranges = []
        if model.actuator_ctrllimited[k]:
            ranges.append(gain * gear * model.actuator_ctrlrange[k])
        if model.actuator_forcelimited[k]:
            ranges.append(gear * model.actuator_forcerange[k])
        for ends in ranges:
            lower, upper = max(lower, float(ends.min())), min(upper, float(ends.max()))
        return lower, upper

    def _regain(self, servo: Drive, element: Element) -> None:
        """Gives a servo these gains."""
        attributes: dict[str, str | None] = {"dampratio": None, **self._gains}
        if self._effort is not None:
            attributes["forcerange"] = f"{_number(-self._effort)} {_number(self._effort)}"
        gear = self._robot.model.actuator_gear[self._robot.model.actuator_outadr[servo.actuator], 0]
        if gear != 1:
            attributes["gear"] = "1"
        self._lines.append(self._text.change(element, attributes=attributes))

    def _new(self, joint: Joint) -> str:
        limit = ""
        if self._effort is not None:
            limit = f' forcerange="{_number(-self._effort)} {_number(self._effort)}"'
        elif not self._robot.model.jnt_actfrclimited[joint.id]:
            self._notes.append(f"joint {joint.name!r} has no effort limit; give one with --effort")
        gains = " ".join(f'{name}="{value}"' for name, value in self._gains.items())
        return f'<position name="{joint.name}" joint="{joint.name}" {gains}{limit}/>'

    def _is_driven(self, joint: Joint) -> bool:
        model = self._robot.model
        kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
        own = model.actuator_trnid[:, 0] == joint.id
        return bool(np.any(np.isin(model.actuator_trntype, kinds) & own))

    def _tell_keyframes(self, joints: Sequence[Joint]) -> None:
        """Says where a keyframe's controls, which were efforts, are no targets of its pose."""
        model = self._robot.model
        for key in range(model.nkey):
            for joint in joints:
                drive = joint.drive("effort")
                if drive is None:
                    continue
                control = float(model.key_ctrl[key, drive.ctrl])
                if abs(control - float(model.key_qpos[key, joint.qpos])) > 1e-6:
                    self._notes.append(
                        f"keyframe {model.key(key).name!r} has the control {control:g} for joint "
                        f"{joint.name!r}, which is a target now: set its ctrl to its pose"
                    )
                    return


def _number(value: float) -> str:
    return f"{value:.10g}"
