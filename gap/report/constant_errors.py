"""A log with a constant of its own: effort in another unit, positions from another zero.

    effort_scales(after.values(), gap)     # {"knee": 1.25}: logged over simulated
    position_offsets(after.values(), gap)  # {"knee": 0.03}: logged less simulated, rad

Motion says what effort there was. Where the simulation moves as the robot does, and what it makes
is the logged effort but for one factor, neither robot nor model has anything to do with that.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from walkerkit.gap.report.gaps import Gap
from walkerkit.gap.report.replayed import Replayed

_LEAST = 0.05  # from 1
_LEFT = 0.5  # of the gap of effort, once the factor is known
_PART = 0.3  # of the effort itself


def effort_scales(halves: Iterable[Replayed], gap: Gap) -> dict[str, float]:
    """By what factor logged efforts are other than simulated ones, of joints where that is all.

    Args:
        halves: the recordings, replayed as far as they are explained.
        gap: what is left of them.

    Returns:
        Joint to factor; empty where positions are not explained, or efforts are.
    """
    effort = gap.signals.get("effort")
    moves = gap.position_at_floor or gap.position.mostly_closed
    if effort is None or effort.at_floor or not moves:
        return {}
    sums: dict[str, np.ndarray] = {}
    for half in halves:
        for replay, predicted in zip(half.replays, half.predicted, strict=True):
            for c, channel in enumerate(replay.channels):
                if channel.signal != "effort":
                    continue
                both = np.stack([predicted[:, c], replay.measured[:, c]])
                both = both[:, np.isfinite(both).all(axis=0)]
                sums[channel.joint] = sums.get(channel.joint, np.zeros((2, 2))) + both @ both.T
    found = {}
    for joint, ((made, shared), (_, logged)) in sums.items():
        scale = shared / made if made > 0 else 1.0
        gap_as_logged = made + logged - 2 * shared
        left = logged - scale * shared
        if (
            scale > 0
            and abs(np.log(scale)) > np.log1p(_LEAST)
            and left < min(_LEFT**2 * gap_as_logged, _PART**2 * logged)
        ):
            found[joint] = float(scale)
    return found


def position_offsets(halves: Iterable[Replayed], gap: Gap) -> dict[str, float]:
    """By how much logged positions are more than simulated ones, of joints where that is all.

    Args:
        halves: the recordings, replayed as far as they are explained.
        gap: what is left of them.

    Returns:
        Joint to offset, in its unit; without those whose positions are explained.
    """
    wrong: dict[str, list[np.ndarray]] = {}
    for half in halves:
        for replay, predicted in zip(half.replays, half.predicted, strict=True):
            for c, channel in enumerate(replay.channels):
                if channel.signal == "position" and channel.joint in gap.joints:
                    error = replay.measured[:, c] - predicted[:, c]
                    wrong.setdefault(channel.joint, []).append(error[np.isfinite(error)])
    found = {}
    for joint, errors in wrong.items():
        error = np.concatenate(errors)
        if not gap.joints[joint].at_floor and error.std() < _LEFT * np.sqrt(np.mean(error**2)):
            found[joint] = float(error.mean())
    return found
