"""Actuators whose law runs in Python, as a replay knows them.

    robot = with_programs(robot, walker.drivetrain)
    robot.programs[0].law()          # an `actuators.laws.law.Law`, at rest

In the compiled model such an actuator is a bare motor. What its joint is sent goes to the law, in
columns of the controls that come after those of MuJoCo: `Drive.ctrl` of a drive that is `in_python`
is one of these, `Drive.actuator` is the motor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.delayed import DelayedActuator
from walkerkit.actuators.drive import Drive, TargetKind
from walkerkit.actuators.drivetrain import DrivetrainLaw
from walkerkit.actuators.explicit import ExplicitActuator, ExplicitActuatorCfg
from walkerkit.actuators.inputs import XmlInputsActuator
from walkerkit.actuators.laws.law import Law
from walkerkit.actuators.messages import listed
from walkerkit.actuators.native import NativeActuator
from walkerkit.actuators.selection import select
from walkerkit.gap.errors import InputError
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]

_KINDS: tuple[TargetKind, ...] = ("position", "velocity", "effort")
_LITTLE, _SETTLED = 0.01, 50  # rad and rad/s (or m); steps after which a network has answered


@dataclass(frozen=True, kw_only=True, eq=False)
class Program:
    """The law of some joints.

    Attributes:
        cfg: the config that makes it.
        joints: names of the joints, in its order.
        numbers: the config's numbers, (n_joints,) each.
        inputs: by kind of target, the columns of the joints' targets among the controls.
        memory: it remembers, so that it is to run once in each of the walker's own steps.
    """

    cfg: ExplicitActuatorCfg
    joints: tuple[str, ...]
    numbers: Mapping[str, FloatArray]
    inputs: Mapping[TargetKind, tuple[int, ...]]
    memory: bool

    def law(self) -> Law:
        """The law, new."""
        return self.cfg.law(self.numbers)

    def with_numbers(self, changed: Mapping[tuple[str, str], float]) -> Program:
        """The same with other numbers, by joint and name; those of other joints are left out."""
        numbers = {name: values.copy() for name, values in self.numbers.items()}
        for (joint, name), value in changed.items():
            if joint in self.joints:
                numbers.setdefault(name, np.full(len(self.joints), np.inf))
                numbers[name][self.joints.index(joint)] = value
        return replace(self, numbers=numbers)


def rest_controls(robot: Robot) -> FloatArray:
    """Controls of MuJoCo and targets of laws in Python with which the robot rests, (width,)."""
    data = rest(robot.model)
    controls = np.concatenate([data.ctrl, np.zeros(robot.width - robot.model.nu)])
    for program in robot.programs:
        for name, column in zip(program.joints, program.inputs.get("position", ()), strict=False):
            controls[column] = data.qpos[robot.joints[name].qpos]
    return controls


def with_programs(robot: Robot, drivetrain: Any) -> Robot:
    """The robot with what of a walker's drivetrain is not in its model.

    Args:
        robot: compiled from the walker's model.
        drivetrain: the walker's (`walkers.drivetrain.Drivetrain`).

    Returns:
        The robot with laws and delays that run in Python, and with its drivetrain laws.

    Raises:
        InputError: one of its actuators computes something in Python that no replay can.
    """
    notes = list(robot.notes)
    group = drivetrain.group
    for actuator in group.actuators:
        late: dict[TargetKind, float] = {}
        names = actuator.joint_names
        if isinstance(actuator, DelayedActuator):
            if not actuator.native:
                late = _late(actuator, float(robot.model.opt.timestep))
                notes += _of_lags(actuator, names)
            actuator = actuator.base
        in_python = _runs_in_python(actuator, robot)
        if not in_python and not late:
            continue
        if actuator.cfg.transmission != "joint":
            raise InputError(
                f"{robot.source}: the {'law' if in_python else 'delay'} of {listed(names)} runs in "
                f"Python and works on a {actuator.cfg.transmission}; replays run those of joints. "
                "Give actuators of joints, or one that MuJoCo runs, without delay."
            )
        joints = {name: robot.joints[name] for name in names if name in robot.joints}
        if in_python:
            robot = _with_program(robot, actuator, joints, late)
        else:
            own = {
                name: replace(
                    joint,
                    drives=tuple(_later(d, late) for d in joint.drives),
                    inputs=tuple(_later(d, late) for d in joint.inputs),
                )
                for name, joint in joints.items()
            }
            robot = replace(robot, joints={**robot.joints, **own})
    laws = _drivetrain_laws(drivetrain.laws, group.joint_names)
    return replace(robot, notes=tuple(notes), laws=laws or robot.laws)


def _runs_in_python(actuator: Any, robot: Robot) -> bool:
    if isinstance(actuator, NativeActuator | XmlInputsActuator):
        return False
    if (
        isinstance(actuator, ExplicitActuator)
        and type(actuator).control is ExplicitActuator.control
    ):
        return True
    raise InputError(
        f"{robot.source}: {type(actuator).__name__} of {listed(actuator.joint_names)} makes its "
        "controls itself, which no replay can do for it. Write what it does as a Law, which an "
        "ExplicitActuatorCfg returns from its `law` (docs/own_actuator.md)."
    )


def _late(actuator: DelayedActuator, step: float) -> dict[TargetKind, float]:
    """How old its targets are on average [s]."""
    lag = 0.5 * (actuator.cfg.delay_min_lag + actuator.cfg.delay_max_lag)
    words = actuator.cfg.words(actuator.base.takes)
    return {kind: lag * step for kind in _KINDS if kind in words}


def _of_lags(actuator: DelayedActuator, names: Sequence[str]) -> list[str]:
    low, high = actuator.cfg.delay_min_lag, actuator.cfg.delay_max_lag
    if low == high:
        return []
    return [
        f"The lag of {listed(names)} is drawn at random from {low} to {high} steps, and no log "
        f"says what was drawn: it is replayed with {0.5 * (low + high):g}."
    ]


def _later(drive: Drive, late: Mapping[TargetKind, float]) -> Drive:
    # Volts are asked for by effort targets.
    kind = "effort" if drive.kind == "voltage" else drive.kind
    return replace(drive, late=drive.late + late.get(kind, 0.0))


def _with_program(
    robot: Robot,
    actuator: ExplicitActuator,
    joints: Mapping[str, Joint],
    late: Mapping[TargetKind, float],
) -> Robot:
    names = actuator.joint_names
    for name in names:
        if name not in joints or len(joints[name].commanded) != 1:
            raise InputError(
                f"{robot.source}: joint {name!r} has an actuator whose law runs in Python, and "
                f"{len(joints[name].commanded) if name in joints else 'no'} of MuJoCo's, where it "
                "should have a motor. Leave one of them out."
            )
    law = actuator.cfg.law(actuator.numbers)
    kinds = [kind for kind in _KINDS if f"{kind}_target" in law.takes]
    columns = robot.width + np.arange(len(kinds) * len(names)).reshape(len(kinds), -1)
    program = Program(
        cfg=actuator.cfg,
        joints=names,
        numbers={name: np.array(values) for name, values in actuator.numbers.items()},
        inputs={kind: tuple(map(int, row)) for kind, row in zip(kinds, columns, strict=True)},
        memory=not law.joinable,
    )
    stiffness, damping = linearised(program)
    made = {}
    for k, name in enumerate(names):
        inputs = {
            kind: Drive(
                actuator=joints[name].drives[0].actuator,
                ctrl=program.inputs[kind][k],
                kind=kind,
                slope=1.0,
                offset=0.0,
                stiffness=float(stiffness[k]) if kind == "position" else 0.0,
                damping=float(damping[k]) if kind != "effort" else 0.0,
                in_joint_units=True,
                late=late.get(kind, 0.0),
                in_python=True,
            )
            for kind in kinds
        }
        first = _first(inputs, law)
        others = tuple(drive for kind, drive in inputs.items() if kind != first)
        made[name] = replace(joints[name], drives=(inputs[first],), inputs=others)
    return replace(robot, joints={**robot.joints, **made}, programs=(*robot.programs, program))


def _first(inputs: Mapping[TargetKind, Drive], law: Law) -> TargetKind:
    """The target that a joint cannot do without, or that which moves it most."""
    position, velocity = inputs.get("position"), inputs.get("velocity")
    if position is not None and ("position_target" in law.needs or position.stiffness > 0):
        return "position"
    if velocity is not None and ("velocity_target" in law.needs or velocity.damping > 0):
        return "velocity"
    return "effort" if "effort" in inputs else next(iter(inputs))


def linearised(program: Program) -> tuple[FloatArray, FloatArray]:
    """Stiffness and damping of a law about rest, (n_joints,) each [N·m/rad, N·m·s/rad; N/m, …].

    They are its numbers of that name, where it has such; else what it answers to a small error.
    """
    law = program.law()
    found = []
    for name, error, speed in (("stiffness", _LITTLE, 0.0), ("damping", 0.0, -_LITTLE)):
        if name in law.names:
            found.append(np.array(law.get(name), dtype=np.float64))
            continue
        made = [_answer(program.law(), len(program.joints), s * error, s * speed) for s in (1, -1)]
        found.append(np.maximum(0.5 * (made[0] - made[1]) / _LITTLE, 0.0))
    return found[0], found[1]


def _answer(law: Law, n: int, error: float, speed: float) -> FloatArray:
    law.allocate((n,))
    law.reset(None)
    zeros = np.zeros(n)
    targets = {kind: zeros if f"{kind}_target" in law.takes else None for kind in _KINDS}
    position = None if targets["position"] is None else zeros + error
    effort = zeros
    for _ in range(_SETTLED):
        _, effort = law.effort(
            position, targets["velocity"], targets["effort"], zeros, zeros + speed
        )
    return np.array(effort)


def _drivetrain_laws(
    laws: Sequence[DrivetrainLaw], joints: Sequence[str]
) -> dict[str, dict[str, dict[str, float]]]:
    """Drivetrain laws of a walker by joint and name, each with its numbers."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for law in laws:
        chosen = [joints[i] for i in select(law.joint_names_expr, list(joints))]
        numbers = law.numbers(tuple(chosen))
        for k, joint in enumerate(chosen):
            found.setdefault(joint, {})[law.name] = {
                name: float(values[k]) for name, values in numbers.items()
            }
    return found
