"""Explicit actuators of one law, computed in one go.

    lots, apart = joined(group.actuators, columns)     # after they were initialized
    lots[0].apply(cmd)                                 # of all joints; columns[i] are actuator i's

A numpy call costs about the same for four joints as for twelve, so that hips and knees with motors
of their own take twice the time of a robot whose motors are all alike. Where a law treats each
joint by itself, one law with the numbers of all of them does the same, to the last bit. Delays stay
each actuator's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Actuator, Targets
from walkerkit.actuators.command import TARGETS, ActuatorCmd
from walkerkit.actuators.delayed import WORDS, DelayedActuator
from walkerkit.actuators.explicit import ExplicitActuator
from walkerkit.actuators.laws.lag import DelayLine
from walkerkit.actuators.laws.law import Law
from walkerkit.actuators.simulation import viewed

FloatArray = NDArray[np.float64]


def joined(actuators: Sequence[Actuator], columns: Sequence[Any]) -> tuple[list[Joined], list[int]]:
    """Puts together what can be computed together.

    Args:
        actuators: of one robot, initialized.
        columns: what indexes the joints of each in the robot's command.

    Returns:
        The lots, of two actuators or more, and the places of the actuators that are in none.
    """
    alike: dict[type[Law], list[int]] = {}
    for i, actuator in enumerate(actuators):
        base = _base(actuator)
        if (
            isinstance(base, ExplicitActuator)
            and base.law.joinable
            and base.takes.issuperset(TARGETS)
            and base.cfg.transmission == "joint"
        ):
            alike.setdefault(type(base.law), []).append(i)
    chosen = [lot for lot in alike.values() if len(lot) > 1]
    taken = {i for lot in chosen for i in lot}
    apart = [i for i in range(len(actuators)) if i not in taken]
    lots = [Joined([actuators[i] for i in lot], [columns[i] for i in lot]) for lot in chosen]
    return lots, apart


class _Late:
    """A target on its way through a delay to its columns of a row."""

    def __init__(self, line: DelayLine, target: FloatArray, row: FloatArray, columns: Any):
        self._line, self._target, self._row, self._columns = line, target, row, columns

    def move(self) -> bool:
        """Moves it on by a step; whether it has arrived for good."""
        self._row[self._columns] = self._line.push(self._target)
        return self._line.settled


class Joined:
    """Several explicit actuators of one physics or one batch, whose laws are of one class.

    Args:
        actuators: of one robot, initialized.
        asked: what indexes the joints of each in the robot's command.
    """

    def __init__(self, actuators: Sequence[Actuator], asked: Sequence[Any]):
        self._actuators = tuple(actuators)
        bases = (_base(actuator) for actuator in self._actuators)
        self._bases = tuple(base for base in bases if isinstance(base, ExplicitActuator))
        simulation = self._bases[0].simulation
        joints = np.concatenate([base.joint_ids for base in self._bases])
        order = np.argsort(joints)
        batch_shape = simulation.batch_shape
        self._shape = (*batch_shape, len(joints))
        # Where each one's joints are among all of them, in kinematic order.
        places_of_all = np.argsort(order)
        ends = np.cumsum([len(base.joint_ids) for base in self._bases])[:-1]
        # A vector is indexed by them alone, which takes a ninth of the time.
        self._columns: tuple[Any, ...] = tuple(
            (..., columns) if batch_shape else columns for columns in np.split(places_of_all, ends)
        )
        self._asked = tuple(asked)
        model, joints = simulation.model, joints[order]
        self._q, self._q_at = viewed(simulation.state("qpos"), model.jnt_qposadr[joints])
        self._qd, self._qd_at = viewed(simulation.state("qvel"), model.jnt_dofadr[joints])
        controls = np.concatenate([base.ctrl_ids for base in self._bases])[order]
        self._ctrl, self._ctrl_at = viewed(simulation.state("ctrl"), controls)
        if self._ctrl_at is None:
            self._ctrl_at = ...
        self._rows = tuple(np.zeros((3, *self._shape)))
        lines = [
            actuator.lines if isinstance(actuator, DelayedActuator) else {}
            for actuator in actuators
        ]
        self._ways = tuple(
            [
                (own.get(word), (..., at) if batch_shape else at, columns)
                for own, at, columns in zip(lines, asked, self._columns, strict=True)
            ]
            for word in WORDS
        )
        self._lags = tuple(
            actuator.shared_lags
            for actuator in self._actuators
            if isinstance(actuator, DelayedActuator)
            and actuator.shared_lags is not None
            and actuator.shared_lags.wanders
        )
        self._taken: dict[tuple[bool, ...], Targets] = {}
        self._given: Targets = None, None, None
        self._late: list[_Late] = []
        self._efforts: list[FloatArray] = [*np.zeros((2, *self._shape))]
        self._cmd: ActuatorCmd | None = None
        self._outdated = True
        for base in self._bases:
            base.on_change = self._outdate
        self._law: Law = self._bases[0].law
        self._strength: FloatArray | None = None

    def apply(self, cmd: ActuatorCmd) -> None:
        """Computes the controls and writes them.

        Args:
            cmd: targets of all joints of the robot, of its shape.
        """
        if self._outdated:
            self._join()
        if cmd is not self._cmd:
            self._take(cmd)
        for lags in self._lags:
            lags.step()
        if self._late:
            self._late = [late for late in self._late if not late.move()]
        q = self._q if self._q_at is None else self._q[self._q_at]
        qd = self._qd if self._qd_at is None else self._qd[self._qd_at]
        computed, applied = self._law.effort(*self._given, q, qd)
        if self._strength is not None:
            applied *= self._strength
        self._efforts[:] = computed, applied
        self._ctrl[self._ctrl_at] = applied

    def forget(self) -> None:
        """Looks at the next command even if it is the last one."""
        self._cmd = None

    def _take(self, cmd: ActuatorCmd) -> None:
        """Takes a new command; what no delay keeps back holds until the next one."""
        self._cmd = cmd
        targets = cmd.position_target, cmd.velocity_target, cmd.effort_target
        there = tuple([target is not None for target in targets])
        given = self._taken.get(there)
        if given is None:
            # They take every target: whether they have what they need is all there is to check.
            for actuator, at in zip(self._actuators, self._asked, strict=True):
                actuator.checked(cmd.select(at))
            position, velocity, effort = (
                row if has else None for row, has in zip(self._rows, there, strict=True)
            )
            given = self._taken[there] = position, velocity, effort
        self._given = given
        self._late = []
        for target, row, ways in zip(targets, self._rows, self._ways, strict=True):
            if target is None:
                continue
            for line, at, columns in ways:
                part = target[at]
                if line is None:
                    row[columns] = part
                else:
                    part.flags.writeable = False
                    self._late.append(_Late(line, part, row, columns))

    def _outdate(self) -> None:
        self._outdated = True

    def _join(self) -> None:
        """One law with the numbers of all, and the efforts of all in one."""
        self._outdated = False
        self._taken.clear()
        for base, columns in zip(self._bases, self._columns, strict=True):
            base.share(self._efforts, columns)
        names = self._bases[0].law.names
        parameters = {
            name: self._together([base.law.get(name) for base in self._bases]) for name in names
        }
        self._law = type(self._bases[0].law)(parameters)
        self._law.allocate(self._shape)
        strengths = [base.strength for base in self._bases]
        self._strength = None
        if any(strength is not None for strength in strengths):
            self._strength = self._together(
                [np.ones(1) if strength is None else strength for strength in strengths]
            )

    def _together(self, values: Sequence[FloatArray]) -> FloatArray:
        # Of simulations that differ, each has its own.
        each = np.broadcast_shapes(*(value.shape[:-1] for value in values))
        every = np.empty((*each, self._shape[-1]))
        for value, columns in zip(values, self._columns, strict=True):
            every[columns] = value
        return every


def _base(actuator: Actuator) -> Actuator:
    return actuator.base if isinstance(actuator, DelayedActuator) else actuator
