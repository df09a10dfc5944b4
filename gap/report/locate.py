"""Where the gap lives: which joint, and in which regime.

Each regime is a part of the samples of one joint (see `regimes`). One that holds more of the
squared gap than its part of the samples is where to look.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.report.gaps import Location
from walkerkit.gap.report.regimes import EVERYWHERE, regimes
from walkerkit.gap.simulation.replay import Channel, Replay

FloatArray = NDArray[np.float64]
Masks = Sequence[Mapping[str, Mapping[str, NDArray[np.bool_]]]]

_SHOWN = 8
_LEAST_LIFT = 1.15
_ONE_SIDED = 1.25  # times the lift of the opposite
_OPPOSITE = {
    **{"forward": "backward", "backward": "forward"},
    **{"pose_low": "pose_high", "pose_high": "pose_low"},
}


def locate(
    replays: Sequence[Replay], residuals: Sequence[FloatArray], joints: Sequence[str]
) -> tuple[Location, ...]:
    """Ranks joints and regimes by how much more of the squared position gap they hold than samples.

    Args:
        replays: the replayed recordings, one replay per robot.
        residuals: of each replay, (rows, n_channels) simulated minus measured.
        joints: names of the joints.

    Returns:
        The locations that hold more than their part, largest excess first, and every joint's
        `everywhere`.
    """
    masks = [regimes(replay, joints) for replay in replays]
    return standing_out(gap_map(masks, replays, residuals, joints))


def gap_map(
    masks: Masks,
    replays: Sequence[Replay],
    residuals: Sequence[FloatArray],
    joints: Sequence[str],
    signal: str = "position",
    per: Mapping[str, float] | None = None,
) -> tuple[Location, ...]:
    """The gap of one signal in every regime of every joint.

    Args:
        masks: `regimes` of each replay.
        replays: the replayed recordings, one replay per robot.
        residuals: of each replay, (rows, n_channels) simulated minus measured.
        joints: names of the joints.
        signal: whose gap; joints that never logged it are left out.
        per: joint to what its gap is counted in for shares and lifts, where they have several
            units; their own by default.

    Returns:
        Joint by joint, regimes that occur; empty where there is no gap at all.
    """
    squares: dict[tuple[str, str], float] = {}
    samples: dict[tuple[str, str], int] = {}
    for mask, replay, residual in zip(masks, replays, residuals, strict=True):
        for joint in joints:
            channel = Channel(joint=joint, signal=signal)
            if channel not in replay.channels:
                continue
            column = replay.channels.index(channel)
            measured = np.isfinite(replay.measured[:, column])
            error = np.where(measured, np.nan_to_num(residual[:, column]), 0.0)
            for name, rows in mask[joint].items():
                key = joint, name
                squares[key] = squares.get(key, 0.0) + float(error[rows] @ error[rows])
                samples[key] = samples.get(key, 0) + int((measured & rows).sum())
    of = {joint: (per or {}).get(joint, 1.0) ** -2 for joint in joints}
    total_square = sum(of[j] * size for (j, name), size in squares.items() if name == EVERYWHERE)
    total_samples = sum(count for (_, name), count in samples.items() if name == EVERYWHERE)
    if total_square == 0:
        return ()
    return tuple(
        Location(
            joint=joint,
            regime=regime,
            share=of[joint] * square / total_square,
            lift=of[joint] * square / total_square / (samples[joint, regime] / total_samples),
            signal=signal,
            rms=float(np.sqrt(square / samples[joint, regime])),
        )
        for (joint, regime), square in squares.items()
        if samples[joint, regime]
    )


def standing_out(cells: Sequence[Location]) -> tuple[Location, ...]:
    """Of a map the places that hold more than their part, largest excess first, and the joints.

    A direction, or an end of the range, says something only where its opposite is another.
    """
    ranked = sorted(cells, key=lambda at: (at.lift * at.share - at.share, at.share), reverse=True)
    lift = {(at.joint, at.regime): at.lift for at in cells}
    places = [
        at
        for at in ranked
        if at.regime != EVERYWHERE
        and at.lift >= _LEAST_LIFT
        and at.lift > _ONE_SIDED * lift.get((at.joint, _OPPOSITE.get(at.regime, "")), 0.0)
    ]
    whole = sorted((at for at in ranked if at.regime == EVERYWHERE), key=lambda at: -at.share)
    return (*places[:_SHOWN], *whole)
