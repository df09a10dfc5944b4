"""Like joints share: a structure with one number for all joints of a kind.

    few = tied(fit.structure)
    (found,) = polished(objective, [few.start(fit)], iterations=4)
    fit = few.apart(found)

The hips of a quadruped are made of the same parts. A plain fit with a number for each kind has few
numbers to find, and is the start of one with a number for each joint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.structure import Fit, Slot, Structure
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]

_ALIKE = 0.05  # by which numbers of joints of one kind differ at most


def kinds_of_joints(robot: Robot) -> tuple[tuple[str, ...], ...]:
    """The joints by kind: those with about the same inertia, losses, range and drives."""
    kinds: list[tuple[FloatArray, list[str]]] = []
    for name in robot.joints:
        own = _numbers(robot, name)
        for numbers, members in kinds:
            if len(numbers) == len(own) and np.allclose(numbers, own, rtol=_ALIKE, atol=1e-9):
                members.append(name)
                break
        else:
            kinds.append((own, [name]))
    return tuple(tuple(members) for _, members in kinds)


def _numbers(robot: Robot, name: str) -> FloatArray:
    """What tells its kind: inertia, armature, damping, dry friction, range, gains of its drives."""
    joint, model = robot.joints[name], robot.model
    low, high = model.jnt_range[joint.id]
    drives = [number for d in joint.drives for number in (d.stiffness, d.damping)]
    losses = (model.dof_armature, model.dof_damping, model.dof_frictionloss)
    own = (float(field[joint.dof]) for field in (model.dof_M0, *losses))
    return np.array([float(joint.slide), high - low, *own, *drives])


@dataclass(frozen=True)
class Tied(Structure):
    """A structure of which the joints of a kind share each number.

    Attributes:
        kinds: the joints of each kind.
    """

    kinds: tuple[tuple[str, ...], ...] = ()

    @classmethod
    def of(cls, structure: Structure, kinds: tuple[tuple[str, ...], ...]) -> Tied | None:
        """The structure with fewer numbers; None where no two of its joints are of a kind."""
        tied = cls(structure.terms, structure.robots, kinds)
        return tied if len(tied.slots) < len(structure.slots) else None

    @cached_property
    def whole(self) -> Structure:
        """The structure with a number for each joint."""
        return Structure(self.terms, self.robots)

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """A number for each kind: that of its first joint."""
        return tuple(self.whole.slots[k] for k in self._numbers[0])

    @cached_property
    def _numbers(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(n_parameters,) index of the first of the whole's that each number is, and `of_whole`."""
        kind = {joint: k for k, some in enumerate(self.kinds) for joint in some}
        known: dict[tuple[object, ...], int] = {}
        first = [
            known.setdefault(
                (id(slot.term), slot.parameter.name, kind.get(slot.place, slot.place)), i
            )
            for i, slot in enumerate(self.whole.slots)
        ]
        firsts, of_whole = np.unique(np.array(first, dtype=np.intp), return_inverse=True)
        return firsts, of_whole

    @property
    def of_whole(self) -> NDArray[np.intp]:
        """(n_parameters of the whole,) index of the number that each is."""
        return self._numbers[1]

    @property
    def key(self) -> tuple[tuple[str, tuple[str, ...], bool], ...]:
        """That of the whole, and the kinds."""
        return (*self.whole.key, *(("", kind, True) for kind in self.kinds))

    @cached_property
    def branches(self) -> tuple[int | None, ...]:
        """(n_parameters,) the only branch that each number can change, or None."""
        found = []
        for k in range(len(self.slots)):
            its = {self.whole.branches[i] for i in np.flatnonzero(self.of_whole == k)}
            found.append(its.pop() if len(its) == 1 else None)
        return tuple(found)

    def trials(self, robot: Robot, values: FloatArray) -> Trials:
        """The variants of a robot that these values make, (n, n_parameters)."""
        return self.whole.trials(robot, values[:, self.of_whole])

    def start(self, one: Fit) -> Fit:
        """A fit of the whole with the numbers of the first joint of each kind."""
        return replace(one, structure=self, values=one.values[self._numbers[0]])

    def apart(self, one: Fit) -> Fit:
        """A fit of this as one of the whole."""
        return replace(one, structure=self.whole, values=one.values[self.of_whole])


def tied(structure: Structure) -> Tied | None:
    """A structure with a number for each kind of joint, or where none are alike for all of them.

    None where that has as many numbers.
    """
    robots = structure.robots
    kinds = {kinds_of_joints(robot) for robot in robots}
    alike = Tied.of(structure, kinds.pop()) if len(kinds) == 1 else None
    joints = tuple(dict.fromkeys(name for robot in robots for name in robot.joints))
    return alike or Tied.of(structure, (joints,))
