"""Targets through the simulation of a robot on its feet, under variants of it.

    log = hold(robot, base, qpos, time, targets)       # what is sent, from where
    ran = simulated(log, robot, trials)
    ran.qpos, ran.pressure, ran.effort                 # (n, steps, ...)

The replay of a log does it, so that delays, laws in Python and the height of the start are what a
diagnosis makes of them. The force of the ground is read from the six degrees of freedom of the base
that nothing else constrains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from walkerkit.gap.recordings.base_state import POSITION
from walkerkit.gap.recordings.recording import QUATERNION, Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.together import Asked, controlled, together
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]

_AVERAGED = 0.02  # s, over which the force of the ground is averaged
_RECORDS = ("qpos", "qfrc_actuator", "qfrc_constraint")


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """What variants of a robot did.

    Attributes:
        step: of the simulation [s]; the rows are at its first, second, … end.
        qpos: (n, steps, nq); NaN where a simulation diverged.
        effort: (n, steps, nv) of the drives, on the joints [N·m; N].
        force: (n, steps, 3) of the ground, in the world's frame, averaged over 20 ms [N].
        moment: (n, steps, 3) of it about the base's origin, in the world's frame [N·m].
        place: (n, steps, 3) of the base's origin [m].
    """

    step: float
    qpos: FloatArray
    effort: FloatArray
    force: FloatArray
    moment: FloatArray
    place: FloatArray

    def pressure(self, level: float) -> FloatArray:
        """(n, steps, 2) the centre of pressure on a level ground at some height [m]."""
        down = level - self.place[..., 2]
        load = np.where(self.force[..., 2] > 0, self.force[..., 2], np.nan)
        x = (down * self.force[..., 0] - self.moment[..., 1]) / load
        y = (down * self.force[..., 1] + self.moment[..., 0]) / load
        return np.stack([x, y], axis=-1) + self.place[..., :2]


def sent(
    robot: Robot, base: Base, qpos: FloatArray, time: FloatArray, targets: dict[str, FloatArray]
) -> Recording:
    """What is sent to a robot, as a log that begins where the robot stands.

    Args:
        robot: the robot.
        base: its base.
        qpos: (nq,) the pose in which it begins.
        time: (T,) [s].
        targets: joint to its (T,) position targets [rad; m].
    """
    rows = len(time)
    columns = {
        name: np.full(rows, value)
        for name, value in zip(
            (*POSITION, *QUATERNION), qpos[base.qpos : base.qpos + 7], strict=True
        )
    }
    # Only the first sample of the positions is used: the start.
    columns |= {f"{name}/position": np.full(rows, qpos[j.qpos]) for name, j in robot.joints.items()}
    columns |= {f"{name}/position_target": values for name, values in targets.items()}
    return Recording(name="standing", time=time, columns=columns)


def simulated(
    logs: Sequence[Recording], robot: Robot, base: Base, trials: Trials, *, n_threads: int = 0
) -> list[Simulated]:
    """Runs what is sent.

    Args:
        logs: of `sent`.
        robot: the robot.
        base: its base.
        trials: n variants of it.
        n_threads: of the simulation, 0 for all cores.

    Returns:
        What the variants did, of each log.
    """
    channels = [Channel(joint=name, signal="position") for name in robot.joints]
    ready: list[tuple[int, int, Asked]] = []
    for k, log in enumerate(logs):
        replay = Replay(robot, whole(log), channels, n_threads=n_threads)
        for row in range(trials.n):  # of one alone a replay asks in one piece, however long it is
            ((_, part),) = replay.predicting(trials.rows(np.array([row])))
            asked = next(part)
            while not isinstance(asked, Asked):
                asked = part.send(controlled([asked])[0])
            part.close()
            ready.append((k, row, replace(asked, record=_RECORDS)))
    rollouts = together([asked for _, _, asked in ready], n_threads)
    found: list[dict[str, FloatArray]] = [{} for _ in logs]
    for (k, row, _), (rollout, _) in zip(ready, rollouts, strict=True):
        for name, values in rollout.records.items():
            if name not in found[k]:
                found[k][name] = np.full((trials.n, *values.shape[1:]), np.nan)
            found[k][name][row] = values[0]
    return [_read(robot.model, base, one) for one in found]


def _read(model: mujoco.MjModel, base: Base, records: dict[str, FloatArray]) -> Simulated:
    step = float(model.opt.timestep)
    qpos, pushed = records["qpos"], records["qfrc_constraint"]
    # Into the world's frame. Of what diverged scipy's rotations would raise.
    w, axis = np.split(qpos[..., base.qpos + 3 : base.qpos + 7], [1], axis=-1)
    own = pushed[..., base.dof + 3 : base.dof + 6]
    about = own + 2 * np.cross(axis, np.cross(axis, own) + w * own)
    rows = max(1, round(_AVERAGED / step))
    force, moment = (
        uniform_filter1d(values, rows, axis=1)
        for values in (pushed[..., base.dof : base.dof + 3], about)
    )
    return Simulated(
        step=step,
        qpos=qpos,
        effort=records["qfrc_actuator"],
        force=force,
        moment=moment,
        place=qpos[..., base.qpos : base.qpos + 3],
    )
