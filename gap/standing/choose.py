"""The motions that a robot on its feet comes through, each as large as that allows.

    chosen = safe_motions(stand, seconds=10.0, rate=500.0)
    for one in chosen:
        one.targets, one.size, one.fault       # None, 0 and why, of what was left out

Each motion is drawn at its full size, turned into joint targets, and simulated under all variants
of the robot; what is at fault is made smaller (`SIZES`), and left out when the smallest is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from walkerkit.gap.bar import Progress
from walkerkit.gap.standing.loads import held
from walkerkit.gap.standing.motions import MOTIONS, STILL, Motion, OutOfReachError, Path
from walkerkit.gap.standing.reach import Reach
from walkerkit.gap.standing.safety import fault_of
from walkerkit.gap.standing.simulated import sent, simulated
from walkerkit.gap.standing.standing_pose import Stand

FloatArray = NDArray[np.float64]

SIZES: Final = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12)
"""Parts of a motion's full size that are tried, the largest first."""

_KNOT = 0.01  # s between poses that are solved for
_MISSED = 1e-3  # m, by which a foot may miss its place


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """A motion, as it was found to be safe or not.

    Attributes:
        motion: which.
        size: part of its full size; 0 where it is left out.
        time: (T,) of its targets [s].
        targets: joint to its (T,) targets [rad; m]; empty where it is left out.
        path: what it does; None where it is left out.
        fault: what speaks against it at the next larger size, "" where nothing does.
    """

    motion: Motion
    size: float
    time: FloatArray
    targets: dict[str, FloatArray]
    path: Path | None
    fault: str


def safe_motions(
    stand: Stand,
    motions: Sequence[Motion] = MOTIONS,
    *,
    seconds: float,
    rate: float,
    speed: float = np.inf,
    share: float = 1.0,
    seed: int = 0,
    n_threads: int = 0,
    progress: Progress | None = None,
) -> tuple[Chosen, ...]:
    """Finds the largest size at which each motion is safe.

    Args:
        stand: the robot as it stands.
        motions: which to try.
        seconds: length of those that have none of their own [s].
        rate: targets a second.
        speed: of the fastest target [rad/s; m/s].
        share: of the motions' full sizes that is tried first.
        seed: of phases.
        n_threads: of the simulation, 0 for all cores.
        progress: called with what is tried and how much of it all is done, in [0, 1].
    """
    found = []
    for number, motion in enumerate(motions):
        if progress is not None:
            progress(f"trying to {motion.name}", number / len(motions))
        length = seconds if motion.seconds is None else motion.seconds(stand)
        time = np.arange(0.0, length, 1 / rate)
        found.append(_largest(stand, motion, time, share, speed, seed, n_threads))
    return tuple(found)


def _largest(
    stand: Stand,
    motion: Motion,
    time: FloatArray,
    share: float,
    speed: float,
    seed: int,
    n_threads: int,
) -> Chosen:
    """One motion at the largest size at which it is safe."""
    fault, worst = "", 0
    every = range(len(stand.variants.names))
    for size in SIZES:
        try:
            path, targets = drawn(stand, motion, time, share * size, speed, seed)
        except OutOfReachError as reason:
            fault = str(reason)
            continue
        log = sent(stand.robot, stand.base, stand.qpos, time, targets)
        # What was at fault at the last size is at this one, as a rule: it is tried alone first.
        for some in ([worst], every):
            trials = stand.variants.trials.rows(np.array(some))
            (ran,) = simulated([log], stand.robot, stand.base, trials, n_threads=n_threads)
            found = fault_of(stand, path, time, ran, some)
            if found is not None:
                worst, fault = found
                break
        else:
            return Chosen(
                motion=motion,
                size=share * size,
                time=time,
                targets=targets,
                path=path,
                fault=fault,
            )
    return Chosen(motion=motion, size=0.0, time=time, targets={}, path=None, fault=fault)


def drawn(
    stand: Stand, motion: Motion, time: FloatArray, size: float, speed: float, seed: int
) -> tuple[Path, dict[str, FloatArray]]:
    """A motion's path at some times, and the targets that make it.

    Raises:
        OutOfReachError: the legs do not reach, or the targets leave their limits.
    """
    knots = np.arange(0.0, time[-1] + 2 * _KNOT, _KNOT)
    rough = motion.draw(stand, knots, size, seed)
    reach = Reach(stand)
    poses = reach.poses(rough.shift, rough.turn, rough.lifted)
    if reach.worst > _MISSED:
        raise OutOfReachError(f"its legs do not reach, by {1e3 * reach.worst:.0f} mm")
    targets = CubicSpline(knots, held(stand, poses, _KNOT, rough.carries))(time)
    targets[time < STILL] = stand.targets
    fastest = np.abs(np.diff(targets, axis=0)).max(axis=0) / (time[1] - time[0])
    for joint, series, fast in zip(stand.joints, targets.T, fastest, strict=True):
        if fast > speed:
            raise OutOfReachError(
                f"{joint.name} would be sent at {fast:.1f} rad/s, and the speed is {speed:g}"
            )
        low, high = stand.robot.target_range(joint)
        if series.min() < low or series.max() > high:
            raise OutOfReachError(f"the targets of {joint.name} leave its range")
    return (
        rough.at(knots, time),
        {joint.name: series for joint, series in zip(stand.joints, targets.T, strict=True)},
    )
