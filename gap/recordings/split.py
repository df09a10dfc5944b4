"""Which recordings are fitted and which are held out."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from walkerkit.gap.recordings.manifest import Experiment
from walkerkit.gap.recordings.recording import Recording

Recordings = tuple[tuple[Recording, ...], ...]

_EVERY = 3  # every third recording, or block of time, is held out
_BLOCKS = 6
_SHORTEST_BLOCK, _LONGEST_BLOCK = 0.5, 120.0  # s; a rollout of an hour would not fit into memory
_FEWEST_ROWS = 1000  # of a longest one


def split(experiments: Sequence[Experiment]) -> tuple[Recordings, Recordings]:
    """Splits the recordings of each experiment.

    What the user declared is held out; else every third recording where there are three or more;
    else blocks of time.

    Args:
        experiments: the recordings by model.

    Returns:
        Fitted and held-out recordings, each per experiment.
    """
    everything = [r for experiment in experiments for r in experiment.recordings]
    declared = {name for experiment in experiments for name in experiment.held_out}
    if not declared and len(everything) < _EVERY:
        return split_in_time(experiments)
    held = declared or {r.name for r in everything[_EVERY - 1 :: _EVERY]}
    return (
        tuple(tuple(r for r in e.recordings if r.name not in held) for e in experiments),
        tuple(tuple(r for r in e.recordings if r.name in held) for e in experiments),
    )


def split_in_time(experiments: Sequence[Experiment]) -> tuple[Recordings, Recordings]:
    """Splits every recording into blocks of time, of which every third is held out.

    Both halves then see every recording, so that an effect which shows in one of them alone can
    be found in it and confirmed on it.

    Args:
        experiments: the recordings by model.

    Returns:
        Fitted and held-out blocks, each per experiment.
    """
    cut = [[part for r in e.recordings for part in _blocks(r)] for e in experiments]
    return (
        tuple(tuple(part for part, held in parts if not held) for parts in cut),
        tuple(tuple(part for part, held in parts if held) for parts in cut),
    )


def _blocks(recording: Recording) -> list[tuple[Recording, bool]]:
    """Blocks of a recording, and whether each is held out."""
    count = int(min(_BLOCKS, max(_EVERY, recording.duration // _SHORTEST_BLOCK)))
    long = int(np.ceil(recording.duration / _LONGEST_BLOCK))
    count = max(count, min(long, len(recording.time) // _FEWEST_ROWS))
    # Of as many samples each, so that a gap in the log leaves no block empty.
    first = np.linspace(0, len(recording.time), count, endpoint=False).astype(int)
    edges = np.append(recording.time[first], np.nextafter(recording.time[-1], np.inf))
    return [
        (recording.between(float(low), float(high)), number % _EVERY == _EVERY - 1)
        for number, (low, high) in enumerate(itertools.pairwise(edges))
    ]
