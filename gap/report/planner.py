"""The next experiment: the safe excitation that would best tell a confusion set apart.

Every member's model is simulated under every excitation of the battery, inside the positions and
speeds that the recordings have already reached; where their predicted logs differ most, in
standard deviations of the noise, is where to measure next.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.report.diagnosis import NextExperiment
from walkerkit.gap.search.fit import Fit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.replay import Replay
from walkerkit.tasks.excitation import BATTERY

FloatArray = NDArray[np.float64]

FILE = "next_experiment.csv"
_SECONDS, _RATE = 10.0, 200.0
_SEED = 20260102
_EFFECTIVE = 0.05  # s; a joint's errors stay alike for about this long


def next_experiment(
    problem: Problem, members: Sequence[Fit]
) -> tuple[NextExperiment, Recording] | None:
    """Chooses the excitation that parts the members best.

    Args:
        problem: what was explained.
        members: fits of the members of a confusion set, the named one first.

    Returns:
        The experiment and its targets; None where the robot takes no position targets, or no
        excitation parts the members at all.
    """
    robot = problem.robots[0]
    joints = [joint for joint in problem.joints if robot.joints[joint].drive("position")]
    if len(joints) < len(problem.joints) or len(members) < 2:
        return None
    at = [robot.excursion(joint) for joint in joints]
    time = np.arange(0.0, _SECONDS, 1 / _RATE)
    best: tuple[float, str, Recording] | None = None
    for name, excitation in BATTERY.items():
        targets = excitation(
            time,
            lower=np.array([a.lower for a in at]),
            upper=np.array([a.upper for a in at]),
            rng=np.random.default_rng(_SEED),
            max_velocity=np.array([a.velocity for a in at]),
        )
        columns = {f"{j}/position_target": targets[:, k] for k, j in enumerate(joints)}
        log = Recording(
            name=name,
            time=time,
            # Only the first sample of the positions is used: the start.
            columns={f"{j}/position": targets[:, k] for k, j in enumerate(joints)} | columns,
        )
        separation = _separation(problem, log, members)
        if np.isfinite(separation) and (best is None or separation > best[0]):
            best = separation, name, log
    if best is None or best[0] == 0:
        return None
    effects = tuple(fit.structure.terms[-1].effect.name for fit in members)
    return NextExperiment(excitation=best[1], between=effects, separation=best[0], file=FILE), best[
        2
    ]


def _separation(problem: Problem, log: Recording, members: Sequence[Fit]) -> float:
    """Difference of the nearest two members, in sigmas; infinity or NaN where one diverges."""
    robot = problem.robots[0]
    replay = Replay(
        robot, whole(log), problem.channels, hold=problem.hold, n_threads=problem.n_threads
    )
    predicted = [
        replay.predict(fit.structure.trials(robot, fit.values[None]))[0] for fit in members
    ]
    independent = _SECONDS / _EFFECTIVE / len(log.time)
    return min(
        float(np.sqrt(independent * np.square((a - b) / problem.noise).sum()))
        for a, b in combinations(predicted, 2)
    )
