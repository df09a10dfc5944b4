"""What is hidden in which machine; its size is drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.native.machine import Bristles, Machine
from benchmarks.native.robots import ARM, GANTRY, LEG, WHEEL, Robot

ALL = ("position", "velocity", "effort")


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """A machine, and what of it the workflow is to find.

    Attributes:
        machine: the machine.
        value: what a right estimate says; None where the machine's law has other numbers.
    """

    machine: Machine
    value: float | None = None


_Make = Callable[[np.random.Generator], Hidden]


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A robot, and something that its machine has and its model lacks.

    Attributes:
        name: of the scenario.
        robot: the robot.
        effect: what is hidden by the catalogue's name; empty for nothing.
        place: its joint or body; empty for the whole robot.
        make: the machine, of a size that is drawn.
        signals: what is logged of each joint beside its targets.
        seconds: length of each of the four experiments.
    """

    name: str
    robot: Robot
    effect: str
    place: str
    make: _Make
    signals: tuple[str, ...]
    seconds: float = 8.0


def _changed(field: str, of: str, low: float, high: float) -> _Make:
    """A number of a joint that is larger by what is drawn."""

    def make(rng: np.random.Generator) -> Hidden:
        more = float(rng.uniform(low, high))

        def change(model: mujoco.MjModel) -> None:
            getattr(model, field)[model.joint(of).dofadr[0]] += more

        return Hidden(machine=Machine(change=change), value=more)

    return make


def _loaded(body: str, low: float, high: float) -> _Make:
    """More mass of a body, spread as its own is."""

    def make(rng: np.random.Generator) -> Hidden:
        more = float(rng.uniform(low, high))

        def change(model: mujoco.MjModel) -> None:
            k = model.body(body).id
            model.body_inertia[k] *= (model.body_mass[k] + more) / model.body_mass[k]
            model.body_mass[k] += more

        return Hidden(machine=Machine(change=change), value=more)

    return make


def _weaker(actuator: int, low: float, high: float, *, servo: bool = False) -> _Make:
    """A motor that makes a part less than is asked of it, or a servo whose gain is a part less."""

    def make(rng: np.random.Generator) -> Hidden:
        less = float(rng.uniform(low, high))

        def change(model: mujoco.MjModel) -> None:
            model.actuator_gainprm[actuator, 0] *= 1 - less
            if servo:
                model.actuator_biasprm[actuator, 1] *= 1 - less

        return Hidden(machine=Machine(change=change), value=None if servo else -less)

    return make


def _bristles(joint: str, low: float, high: float, bristles: tuple[float, float]) -> _Make:
    """Friction with bristles, of a stiffness and a damping, that is dry friction in a log."""
    stiffness, damping = bristles

    def make(rng: np.random.Generator) -> Hidden:
        size = float(rng.uniform(low, high))
        forces = {joint: lambda: Bristles(size, stiffness=stiffness, damping=damping)}
        return Hidden(machine=Machine(forces=forces), value=size)

    return make


def _ripple(joint: str, periods: int, low: float, high: float) -> _Make:
    """A torque that goes with the joint's angle, so many times a turn."""

    def make(rng: np.random.Generator) -> Hidden:
        size, phase = float(rng.uniform(low, high)), float(rng.uniform(-np.pi, np.pi))

        def force(position: float, velocity: float) -> float:
            return size * float(np.sin(periods * position + phase))

        return Hidden(machine=Machine(forces={joint: lambda: force}), value=size)

    return make


def _late(low: float, high: float) -> _Make:
    """Targets that are on their way for a while."""

    def make(rng: np.random.Generator) -> Hidden:
        delay = float(rng.uniform(low, high))
        return Hidden(machine=Machine(delay=delay), value=delay)

    return make


def _turned(joint: str, low: float, high: float) -> _Make:
    """An encoder with another zero."""

    def make(rng: np.random.Generator) -> Hidden:
        offset = float(rng.uniform(low, high))
        return Hidden(machine=Machine(offset={joint: offset}), value=offset)

    return make


_Row = tuple[str, str, str, _Make]


def _scenarios(
    of: str, robot: Robot, rows: Sequence[_Row], signals: tuple[str, ...] = ALL
) -> tuple[Scenario, ...]:
    """Those of a robot, by rows of a name, the hidden effect, its place, and its machine."""
    return tuple(
        Scenario(
            name=f"{of}: {name}",
            robot=robot,
            effect=effect,
            place=place,
            make=make,
            signals=signals,
        )
        for name, effect, place, make in rows
    )


def _nothing(rng: np.random.Generator) -> Hidden:
    return Hidden(machine=Machine())


_NOTHING: _Row = ("nothing", "", "", _nothing)
_OF_LEG: tuple[_Row, ...] = (
    _NOTHING,
    ("weak motor", "torque_constant", "knee", _weaker(1, 0.1, 0.2)),
    ("dry friction", "coulomb_friction", "knee", _changed("dof_frictionloss", "knee", 0.3, 0.6)),
    ("damping", "viscous_friction", "hip", _changed("dof_damping", "hip", 0.3, 0.6)),
    ("rotor", "armature", "knee", _changed("dof_armature", "knee", 0.006, 0.02)),
    ("cogging", "cogging", "hip", _ripple("hip", 12, 0.5, 1.2)),
    ("late commands", "command_delay", "", _late(0.003, 0.008)),
    ("encoder", "encoder_offset", "knee", _turned("knee", 0.03, 0.08)),
    ("load", "payload", "shank", _loaded("shank", 0.2, 0.5)),
)
_OF_WHEEL: tuple[_Row, ...] = (
    _NOTHING,
    ("bristles", "coulomb_friction", "axle", _bristles("axle", 0.1, 0.25, (100.0, 0.3))),
    ("rotor", "armature", "axle", _changed("dof_armature", "axle", 0.003, 0.006)),
)
_OF_GANTRY: tuple[_Row, ...] = (
    _NOTHING,
    ("bristles", "coulomb_friction", "z", _bristles("z", 6.0, 12.0, (3e4, 60.0))),
    ("load", "payload", "column", _loaded("column", 0.3, 0.7)),
    ("soft servo", "position_gain", "z", _weaker(1, 0.2, 0.3, servo=True)),
)
_DAMPED: _Row = ("damping", "viscous_friction", "x", _changed("dof_damping", "x", 15.0, 30.0))
_OF_ARM: tuple[_Row, ...] = (
    _NOTHING,
    ("bristles", "coulomb_friction", "j2", _bristles("j2", 2.0, 4.0, (3000.0, 20.0))),
    ("load", "payload", "hand", _loaded("hand", 0.3, 0.7)),
    ("rotor", "armature", "j4", _changed("dof_armature", "j4", 0.004, 0.008)),
)

SCENARIOS = (
    *_scenarios("leg", LEG, _OF_LEG, ("position", "velocity")),
    *_scenarios("wheel", WHEEL, _OF_WHEEL),
    *_scenarios("gantry", GANTRY, _OF_GANTRY),
    *_scenarios("gantry", GANTRY, (_DAMPED,), ("position",)),
    *_scenarios("arm", ARM, _OF_ARM),
)
