"""Which stretches of the recordings are simulated again and again, instead of all of them.

Evenly spread ones tell as much as all where they are alike. What is rare, as a limit that is met
twice, may be in none of them: where they hold too little of some channel's gap, the stretch that
holds most of it takes the place of one that holds little of any.

    chosen = spread(len(segments), share=0.2, phase=0.5, fewest=3)
    chosen = representative(segments, chosen, Gaps.of(objective, residual))
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.search.objective import Objective

FloatArray = NDArray[np.float64]

_TOO_LITTLE = 0.5  # of the part of a gap that as many rows would hold of an even one


@dataclass(frozen=True, kw_only=True)
class Gaps:
    """Squared gaps over the time of each recording.

    Attributes:
        rows: identity of a recording to its instants (n,) [s] and squares (n, n_scored).
    """

    rows: Mapping[int, tuple[FloatArray, FloatArray]]

    @classmethod
    def of(cls, objective: Objective, residual: FloatArray) -> Gaps:
        """Those of a residual, (rows, n_scored); none at all where it diverged."""
        parts: dict[int, list[tuple[FloatArray, FloatArray]]] = {}
        first = 0
        for replay in objective.replays if np.isfinite(residual).all() else ():
            squares = residual[first : first + len(replay.segment_of_row)] ** 2
            first += len(squares)
            for k, segment in enumerate(replay.segments):
                mine = replay.segment_of_row == k
                time = segment.start + replay.time_of_row[mine]
                parts.setdefault(id(segment.recording), []).append((time, squares[mine]))
        return cls(
            rows={
                key: (np.concatenate([t for t, _ in some]), np.concatenate([s for _, s in some]))
                for key, some in parts.items()
            }
        )

    def within(self, segment: Segment) -> tuple[int, FloatArray]:
        """How many rows of a segment are known, and the sums of their squares, (n_scored,)."""
        time, squares = self.rows[id(segment.recording)]
        inside = (time >= segment.start) & (time <= segment.start + segment.duration)
        return int(inside.sum()), squares[inside].sum(axis=0)


def spread(n: int, *, share: float, phase: float, fewest: int) -> list[int]:
    """A share of n segments, evenly spread.

    Args:
        n: how many there are.
        share: how much of them.
        phase: where between two of its places each lies, 0 to 1.
        fewest: of which there are so many at least.
    """
    count = min(n, max(fewest, round(share * n)))
    return [int(k) for k in (np.arange(count) + phase) * n / count]


def representative(segments: Sequence[Segment], chosen: Sequence[int], gaps: Gaps) -> Sequence[int]:
    """As many of the segments, which hold their part of every channel's gap if they can.

    Args:
        segments: all of them.
        chosen: indices of some, of which half stay at least.
        gaps: over all of them, or most.
    """
    if any(id(segment.recording) not in gaps.rows for segment in segments):
        return chosen
    known = [gaps.within(segment) for segment in segments]
    rows = np.array([n for n, _ in known])
    part = np.array([squares for _, squares in known])
    part /= np.maximum(part.sum(axis=0), np.finfo(float).tiny)
    some = list(chosen)
    held, even = part[some].sum(axis=0), rows[some].sum() / max(rows.sum(), 1)
    missed = [c for c in np.argsort(held) if held[c] < _TOO_LITTLE * even < part[:, c].max()]
    wanted = list(dict.fromkeys(int(part[:, c].argmax()) for c in missed))[: len(some) // 2]
    others = sorted(set(some) - set(wanted), key=lambda k: (-part[k].sum(), k))
    return sorted([*wanted, *others][: len(some)])
