"""Variants that are another compilation: what of a robot no field of its model can say.

    for rebuild, rows in rebuilds(trials):
        rebuilt = rebuilt_as(rebuild, robot)
        moved = rebuilt.trials(trials.rows(rows))       # variants of rebuilt.robot

Trials are always variants of the robot as it is given, whatever they change. `Replay` and `mend`
take them onto the robots that they need: fields follow their joints to the places that these have
there. Variants that need none stay on the robot itself, so that nothing of them changes.

To add to it: a column of `Trials`, an attribute of `Rebuild` that says what of it asks for another
compilation, and what `Rebuilt` makes of both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import LoadSideFeedback
from walkerkit.gap.simulation.gear_play import set_play, with_play
from walkerkit.gap.simulation.mount import mounts, set_mount, with_mount
from walkerkit.gap.simulation.robot import Joint, Play, Robot
from walkerkit.gap.simulation.trials import Trials, model_field

_TIMESTEP, _INTEGRATOR = "opt.timestep", "opt.integrator"


@dataclass(frozen=True, kw_only=True)
class Rebuild:
    """How the robot of a variant differs from the one that is given.

    Attributes:
        play: joints that get play, in order.
        mount: whether what carries the robot gives way.
        parts: steps that it makes in place of one.
        other_integrator: explicit integration exchanged for implicit, or the other way round.
    """

    play: tuple[str, ...] = ()
    mount: bool = False
    parts: int = 1
    other_integrator: bool = False

    @property
    def needed(self) -> bool:
        """There is a difference."""
        return self != Rebuild()


def rebuilds(trials: Trials) -> list[tuple[Rebuild, NDArray[np.intp]]]:
    """The robots that the variants need, each with its rows."""
    rows: dict[Rebuild, list[int]] = {}
    given = {joint: trials.play(joint) for joint in sorted({joint for joint, _ in trials.plays})}
    plays = {joint: (play["width"] > 0) | (play["compliance"] > 0) for joint, play in given.items()}
    soft = trials.mounts.get("compliance", np.zeros(trials.n)) > 0
    option = trials.robot.model.opt
    steps = trials.fields.get(_TIMESTEP, trials.own(_TIMESTEP))
    others = trials.fields.get(_INTEGRATOR, trials.own(_INTEGRATOR)) != option.integrator
    # Step by step, few simulations cost as much as many: those that part anywhere go together.
    slow = trials.stepwise | np.any(
        [some & (trials.load_side[joint] > 0) for joint, some in plays.items()], axis=0
    )
    anywhere = tuple(joint for joint, some in plays.items() if some[slow].any())
    for row in range(trials.n):
        own = tuple(joint for joint, some in plays.items() if some[row])
        rebuild = Rebuild(
            play=anywhere if own and slow[row] else own,
            mount=bool(soft[row]),
            parts=round(option.timestep / float(steps[row])),
            other_integrator=bool(others[row]),
        )
        rows.setdefault(rebuild, []).append(row)
    return [(rebuild, np.array(some, dtype=np.intp)) for rebuild, some in rows.items()]


def rebuilt_as(rebuild: Rebuild, robot: Robot) -> Rebuilt:
    """The robot as some variants need it, made once for all who ask."""
    return robot.made.get(rebuild, lambda: Rebuilt(rebuild, robot))


class Rebuilt:
    """A robot as some variants need it.

    Args:
        rebuild: how it differs.
        robot: the robot as it is given.

    Attributes:
        robot: the rebuilt one.
    """

    def __init__(self, rebuild: Rebuild, robot: Robot):
        if rebuild.parts > 1 or rebuild.other_integrator:
            robot = robot.refined(rebuild.parts, other_integrator=rebuild.other_integrator)
        if rebuild.mount:
            robot = with_mount(robot)
        self.robot = with_play(robot, rebuild.play) if rebuild.play else robot
        self._played = rebuild.play
        self._mounted = mounts(self.robot) if rebuild.mount else ()

    def trials(self, trials: Trials) -> Trials:
        """The variants on the rebuilt robot.

        Args:
            trials: variants of the robot as it is given that need this one.
        """
        moved = trials.on(self.robot, self._carried)
        for name in (_TIMESTEP, _INTEGRATOR):
            moved.fields.pop(name, None)
        if self._mounted:
            set_mount(moved, trials.mount())
        armature = trials.fields.get("dof_armature", trials.own("dof_armature"))
        for joint in self._played:
            play = trials.play(joint)
            motor = trials.robot.joints[joint]
            set_play(moved, joint, play, armature[:, motor.dof] + play["armature"])
            share = trials.load_side[joint]
            if motor.drives and motor.drives[0].kind != "effort" and share.any():
                moved.law(LoadSideFeedback, joint)["share"][:] = share
        return moved

    def _carried(self, name: str, values: NDArray[Any]) -> NDArray[Any]:
        """A model field of the given robot as that of the rebuilt one."""
        own = model_field(self.robot.model, name)
        if own.shape == values.shape[1:]:
            return values.copy()
        carried = np.repeat(own[None], len(values), axis=0)
        carried[:, np.delete(np.arange(len(own)), self._added(name))] = values
        return carried

    def _added(self, name: str) -> list[int]:
        """Rows of a field that the given robot does not have."""
        plays = [self.robot.joints[joint].play for joint in self._played]
        added: list[Joint | Play] = [*self._mounted, *(play for play in plays if play)]
        if name.startswith("dof_"):
            return [one.dof for one in added]
        if name.startswith("jnt_"):
            return [one.id for one in added]
        return [one.qpos for one in added]
