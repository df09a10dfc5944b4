"""A mended robot as what its user goes on with: a compiled model, actuators, a walker.

    mended = Mended(robot)
    mended.model                  # mujoco.MjModel
    mended.actuators              # what MJCF cannot say: actuator configs and drivetrain laws
    walker = mended.walker()      # for any composer task

What lies between a joint and its log (a delay of the sensor, a scale of the effort) is in none of
the three, since none of them is logged: `robot.measurement` has it.
"""

from __future__ import annotations

import copy
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import mujoco
from numpy.typing import ArrayLike

from walkerkit.gap.simulation.mend import write_model
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import FILE, sidecar

if TYPE_CHECKING:
    from walkerkit.actuators import ActuatorCfg
    from walkerkit.walkers import MjcfWalker
    from walkerkit.walkers.actions import ActionTerm
    from walkerkit.walkers.drivetrain import Randomization
    from walkerkit.walkers.saved import SavedActuators

WalkerT = TypeVar("WalkerT", bound="MjcfWalker")


@dataclass(frozen=True)
class Mended:
    """A robot with what was found written into it.

    Attributes:
        robot: the robot, as replays take it.
    """

    robot: Robot

    @property
    def model(self) -> mujoco.MjModel:
        """Its compiled model, a copy."""
        return copy.copy(self.robot.model)

    @property
    def actuators(self) -> SavedActuators:
        """What MJCF cannot say: how a target enters each drive, and the laws around it."""
        from walkerkit.walkers.saved import saved_actuators

        with tempfile.TemporaryDirectory() as folder:
            return saved_actuators(self._written(Path(folder)), in_python=self._in_python)

    def walker(
        self,
        *,
        name: str | None = None,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        home: str | Mapping[str, float] | ArrayLike | None = None,
        floating: bool | None = None,
        randomizations: Sequence[Randomization] = (),
    ) -> MjcfWalker:
        """A composer walker of it, whose actuators, delays and laws are those that were found.

        The physics timestep, gravity and the integrator are a task's and an arena's: they are right
        where they are those of `model`. The other options are those of `MjcfWalker.from_file`,
        which reads the saved folder.

        Args:
            name: the walker's name, its prefix in an arena; by default the model's.
            action: action terms; by default an action in [-1, 1] spans what each joint can do.
            home: the pose in which it starts; by default that of the model's first keyframe.
            floating: whether it gets a free joint in an arena; by default as in the model.
            randomizations: what changes its actuators at the start of each episode.

        Raises:
            ValueError: PyMJCF cannot say what the model has, or a joint has several actuators.
        """
        # dm_control looks for a display as soon as it is imported, which only walkers need.
        from walkerkit.walkers import MjcfWalker

        return self.made(
            MjcfWalker,
            name=name,
            action=action,
            home=home,
            floating=floating,
            randomizations=randomizations,
        )

    def made(self, kind: type[WalkerT], **options: Any) -> WalkerT:
        """The same as a walker of a class of one's own.

        Args:
            kind: the class.
            **options: of `MjcfWalker.from_file`.
        """
        from walkerkit.walkers.saved import saved_actuators

        with tempfile.TemporaryDirectory() as folder:
            path = self._written(Path(folder))
            saved = saved_actuators(path, in_python=self._in_python)
            return kind.from_file(path, saved.actuators, laws=saved.laws, **options)

    @property
    def _in_python(self) -> list[ActuatorCfg]:
        return [program.cfg for program in self.robot.programs]

    def _written(self, folder: Path) -> Path:
        path = folder / f"{Path(self.robot.stem).name}.xml"
        write_model(self.robot, path)
        content = json.dumps(sidecar({path.name: self.robot}, []))
        (folder / FILE).write_text(content, encoding="utf-8")
        return path


def mended_by_name(robots: Sequence[Robot]) -> Mapping[str, Mended]:
    """Mended robots by the names of their models; names that repeat get a number."""
    found: dict[str, Mended] = {}
    for robot in robots:
        name, number = robot.stem, 1
        while name in found:
            number += 1
            name = f"{robot.stem}_{number}"
        found[name] = Mended(robot)
    return found


def only(mended: Mapping[str, Mended]) -> Mended:
    """The one robot that there is.

    Raises:
        ValueError: there are several.
    """
    if len(mended) > 1:
        raise ValueError(
            f"there are several models, {', '.join(map(repr, mended))}: take one of them, as in "
            f"mended[{next(iter(mended))!r}].model"
        )
    return next(iter(mended.values()))
