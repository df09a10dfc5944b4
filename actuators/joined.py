"""Explicit actuators of one law, computed in one go.

    lots, apart = joined(group.actuators)     # after they were initialized
    lots[0].apply(parts)                      # parts[i] is the command of actuator i

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
from walkerkit.actuators.command import ActuatorCmd
from walkerkit.actuators.delayed import WORDS, DelayedActuator
from walkerkit.actuators.explicit import ExplicitActuator
from walkerkit.actuators.laws.lag import DelayLine
from walkerkit.actuators.laws.law import Law
from walkerkit.actuators.simulation import viewed

FloatArray = NDArray[np.float64]


def joined(actuators: Sequence[Actuator]) -> tuple[list[Joined], list[int]]:
    """Puts together what can be computed together.

    Args:
        actuators: of one robot, initialized.

    Returns:
        The lots, of two actuators or more, and the places of the actuators that are in none.
    """
    lots: dict[type[Law], list[int]] = {}
    for i, actuator in enumerate(actuators):
        base = _base(actuator)
        if (
            isinstance(base, ExplicitActuator)
            and base.law.joinable
            and base.cfg.transmission == "joint"
        ):
            lots.setdefault(type(base.law), []).append(i)
    chosen = [lot for lot in lots.values() if len(lot) > 1]
    taken = {i for lot in chosen for i in lot}
    apart = [i for i in range(len(actuators)) if i not in taken]
    return [Joined(actuators, lot) for lot in chosen], apart


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
        places: of those that are joined.
    """

    def __init__(self, actuators: Sequence[Actuator], places: Sequence[int]):
        self._places = tuple(places)
        self._actuators = tuple(actuators[i] for i in places)
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
        model, joints = simulation.model, joints[order]
        self._q, self._q_at = viewed(simulation.state("qpos"), model.jnt_qposadr[joints])
        self._qd, self._qd_at = viewed(simulation.state("qvel"), model.jnt_dofadr[joints])
        controls = np.concatenate([base.ctrl_ids for base in self._bases])[order]
        self._ctrl, self._ctrl_at = viewed(simulation.state("ctrl"), controls)
        if self._ctrl_at is None:
            self._ctrl_at = ...
        self._rows = tuple(np.zeros((3, *self._shape)))
        self._given: Targets = None, None, None
        self._late: list[_Late] = []
        self._efforts: list[FloatArray] = [*np.zeros((2, *self._shape))]
        self._parts: Sequence[ActuatorCmd] | None = None
        self._outdated = True
        for base in self._bases:
            base.on_change = self._outdate
        self._law: Law = self._bases[0].law
        self._strength: FloatArray | None = None

    def apply(self, parts: Sequence[ActuatorCmd]) -> None:
        """Computes the controls and writes them.

        Args:
            parts: the commands of all actuators of the robot; the same object as long as they hold.
        """
        if self._outdated:
            self._join()
        if parts is not self._parts:
            self._take(parts)
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
        self._parts = None

    def _take(self, parts: Sequence[ActuatorCmd]) -> None:
        """Checks new commands; what no delay keeps back holds until the next ones."""
        self._parts = parts
        self._late = []
        for i, actuator, columns in zip(self._places, self._actuators, self._columns, strict=True):
            targets = actuator.checked(parts[i])
            lines = actuator.lines if isinstance(actuator, DelayedActuator) else {}
            for word, row, target in zip(WORDS, self._rows, targets, strict=True):
                if target is None:
                    continue
                if word in lines:
                    self._late.append(_Late(lines[word], target, row, columns))
                else:
                    row[columns] = target
        # Which targets there are is the same for all of them.
        position, velocity, effort = (
            None if target is None else row for row, target in zip(self._rows, targets, strict=True)
        )
        self._given = position, velocity, effort

    def _outdate(self) -> None:
        self._outdated = True

    def _join(self) -> None:
        """One law with the numbers of all, and the efforts of all in one."""
        self._outdated = False
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
