"""Timing several things against each other on a machine that has other work, too."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray


def in_turns(
    calls: Sequence[Callable[[], object]],
    *,
    rounds: int,
    repeat: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> NDArray[np.float64]:
    """Seconds that each call took, (rounds, n), one after the other in every round.

    What disturbs a round disturbs all of them, so that the ratio of the fastest of each, and the
    median of the rounds' ratios, tell more than any time alone.

    Args:
        calls: what to time.
        rounds: how often each has its turn.
        repeat: calls in a turn; their mean counts.
        clock: what tells the time [s].
    """
    seconds = np.empty((rounds, len(calls)))
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        for row in seconds:
            for i, call in enumerate(calls):
                start = clock()
                for _ in range(repeat):
                    call()
                row[i] = (clock() - start) / repeat
    finally:
        if was_enabled:
            gc.enable()
    return seconds


def ratio(seconds: NDArray[np.float64], of: int = 0, to: int = 1) -> tuple[float, float]:
    """What one takes of another's time: by the fastest turn of each, and in the median round."""
    least = seconds.min(axis=0)
    return float(least[of] / least[to]), float(np.median(seconds[:, of] / seconds[:, to]))


def told(ratios: tuple[float, float]) -> str:
    """Both ratios as text."""
    fastest, median = ratios
    return f"{fastest:.2f}x (median of rounds {median:.2f}x)"
