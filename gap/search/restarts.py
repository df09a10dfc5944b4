"""Restarts: what the noise of the states that replays restart from makes of them.

again = restarted(replays)            # predictions from states with their noise once more
by_chance(count=12, tries=30)         # what a root mean square of so few may be by chance
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from walkerkit.gap.recordings.state import with_more_noise
from walkerkit.gap.simulation.replay import Replay, as_they_are

FloatArray = NDArray[np.float64]

DRAWS = 6  # of the noise of restarts
_RARELY = 0.002  # probability of what is not put down to chance


def restarted(replays: Sequence[Replay], n_threads: int) -> list[list[FloatArray]]:
    """Predictions of robots as they are, from states with the noise that is there once more.

    Args:
        replays: one per robot, that restart.
        n_threads: threads of the simulation, 0 for all cores.

    Returns:
        Of each draw that did not diverge, (rows, channels) of each replay; several, as few windows
        tell little of it.
    """
    every = {id(s.recording): s.recording for r in replays for s in r.segments}
    found = []
    for draw in range(DRAWS):
        noisier = {
            key: with_more_noise(one, (draw, seed)) for seed, (key, one) in enumerate(every.items())
        }
        same = [
            r.of([replace(s, recording=noisier[id(s.recording)]) for s in r.segments])
            for r in replays
        ]
        predicted = as_they_are(same, n_threads)
        if all(np.isfinite(one).all() for one in predicted):
            found.append(predicted)
    return found


def of_restarts(replays: Sequence[Replay], n_threads: int) -> FloatArray:
    """(channels,) root mean square of what the noise of restarts' states changes."""
    own = np.concatenate(as_they_are(replays, n_threads))
    changes = [np.concatenate(one) - own for one in restarted(replays, n_threads)]
    if not changes:
        return np.zeros(own.shape[1])
    found: FloatArray = np.sqrt(np.mean(np.square(changes), axis=(0, 1)))
    return found


def by_chance(count: int, tries: int) -> float:
    """Over its expectation, the most that the root mean square of `count` normal errors is.

    Args:
        count: how many errors.
        tries: how many such numbers are looked at for the largest.
    """
    return float(np.sqrt(chi2.ppf(1 - _RARELY / tries, count) / count)) if count else 1.0
