"""Spans of the recordings that misfit far more than the rest, and the option that leaves them out.

    notes = list(misfits(problem, after.values()))

A hand on the robot, a fall or drives that were off are no effect of any catalogue, and a few such
seconds outweigh all others in a root mean square.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.report.replayed import Replayed
from walkerkit.gap.search.problem import Problem, channel_noise

FloatArray = NDArray[np.float64]

_BLOCK = 0.2  # s
_FEWEST = 20  # blocks, of which some can stand out
_USUAL = 0.8  # of the blocks have less error than a usual large one
_FAR = 6.0  # times that
_MOST = 0.15  # of all blocks; more is no exception
_LISTED = 4  # spans


@dataclass(frozen=True, kw_only=True)
class _Block:
    """A fraction of a second of a recording.

    Attributes:
        recording: its file, or its name where it has none.
        number: since the recording's time zero, in blocks.
        error: root-mean-square error of each joint's position [rad; m].
    """

    recording: str
    number: int
    error: FloatArray


def misfits(problem: Problem, halves: Iterable[Replayed]) -> Iterator[str]:
    """A note of the spans that stand out, none where there are none.

    Args:
        problem: what the recordings are of.
        halves: what is fitted and what is held out, replayed by the mended robots.
    """
    halves = list(halves)
    blocks = [block for half in halves for block in _blocks(half)]
    if len(blocks) < _FEWEST:
        return
    errors = np.stack([block.error for block in blocks])
    every = (c for half in halves for replay in half.replays for c in replay.channels)
    channels = [c for c in dict.fromkeys(every) if c.signal == "position"]
    noise = np.array([channel_noise(problem.recordings, c).std for c in channels])
    # Fast motion misfits more than slow, and is no exception.
    usual = np.maximum(np.nanquantile(errors, _USUAL, axis=0), noise)
    far = np.nanmax(errors / usual, axis=1)
    out = np.flatnonzero(far > _FAR)
    if not 0 < out.size <= _MOST * len(blocks):
        return
    found: list[tuple[str, int, int, float]] = []
    for k in sorted(out, key=lambda k: (blocks[k].recording, blocks[k].number)):
        one = blocks[k]
        name, first, last, most = found[-1] if found else ("", 0, 0, 0.0)
        if name == one.recording and one.number - last <= 2:
            found[-1] = name, first, one.number, max(most, float(far[k]))
        else:
            found.append((one.recording, one.number, one.number, float(far[k])))
    worst = sorted(found, key=lambda span: -span[3])[:_LISTED]
    options = " ".join(
        f"--skip {name}={first * _BLOCK:.10g}:{(last + 1) * _BLOCK:.10g}"
        for name, first, last, _ in worst
    )
    yield (
        f"{len(found)} span{'s' if len(found) > 1 else ''} of time misfit"
        f"{'' if len(found) > 1 else 's'} up to {worst[0][3]:.2g} times as much as the rest. See "
        "whether a hand, a fall or drives that were off are the cause; if so, leave "
        f"{'the worst of them' if len(found) > _LISTED else 'them' if len(found) > 1 else 'it'} "
        f"out: {options}"
    )


def _blocks(half: Replayed) -> Iterator[_Block]:
    """A half in blocks of time."""
    for replay, residual in zip(half.replays, half.residuals(), strict=True):
        columns = [k for k, c in enumerate(replay.channels) if c.signal == "position"]
        start = np.array([segment.start for segment in replay.segments])
        number = np.floor((replay.time_of_row + start[replay.segment_of_row]) / _BLOCK).astype(int)
        wholes = [segment.recording.whole for segment in replay.segments]
        names = np.array([str(whole.source or whole.name) for whole in wholes])
        of_row = names[replay.segment_of_row]
        squares = residual[:, columns] ** 2
        for name in dict.fromkeys(names):
            mine = np.flatnonzero(of_row == name)
            for one in np.unique(number[mine]):
                rows = squares[mine[number[mine] == one]]
                there = ~np.isnan(rows).all(axis=0)
                error = np.full(len(columns), np.nan)
                error[there] = np.sqrt(np.nanmean(rows[:, there], axis=0))
                if there.any():
                    yield _Block(recording=str(name), number=int(one), error=error)
