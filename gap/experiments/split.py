"""Which recordings are fitted and which are held out."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from walkerkit.gap.experiments.experiment import Experiment
from walkerkit.gap.recordings.beginning import from_known
from walkerkit.gap.recordings.recording import Recording

Recordings = tuple[tuple[Recording, ...], ...]

_EVERY = 3  # every third recording, or block of time, is held out
_BLOCKS = 6
_SHORTEST_BLOCK, _LONGEST_BLOCK = 0.5, 120.0  # s; a rollout of an hour would not fit into memory
_FEWEST_ROWS = 1000  # of a longest one
_HOLE_SAMPLES, _HOLE = 20, 0.05  # a step in time longer than both is a hole; the second in s
_LEAST = 0.5  # s between holes, below which a part is left out
_SHOWN = 3


def split(
    experiments: Sequence[Experiment], *, restarts: bool = False
) -> tuple[Recordings, Recordings]:
    """Splits the recordings of each experiment.

    What the user declared is held out; else every third recording where there are three or more;
    else blocks of time.

    Args:
        experiments: the recordings by model.
        restarts: replays of them restart again and again, so that where one begins says little.

    Returns:
        Fitted and held-out recordings, each per experiment, in parts where a log has holes.
    """
    held = held_out_names(experiments)
    if not held:
        return split_in_time(experiments, restarts=restarts)
    return (
        tuple(
            _unbroken((r for r in e.recordings if r.name not in held), restarts)
            for e in experiments
        ),
        tuple(
            _unbroken((r for r in e.recordings if r.name in held), restarts) for e in experiments
        ),
    )


def held_out_names(experiments: Sequence[Experiment]) -> frozenset[str]:
    """Names of the whole recordings that are held out; none where blocks of time are."""
    everything = [r.name for experiment in experiments for r in experiment.recordings]
    declared = frozenset(name for experiment in experiments for name in experiment.held_out)
    if declared or len(everything) < _EVERY:
        return declared
    return frozenset(everything[_EVERY - 1 :: _EVERY])


def split_in_time(
    experiments: Sequence[Experiment], *, restarts: bool = False
) -> tuple[Recordings, Recordings]:
    """Splits every recording into blocks of time, of which every third is held out.

    Both halves then see every recording, so that an effect which shows in one of them alone can
    be found in it and confirmed on it.

    Args:
        experiments: the recordings by model.
        restarts: as for `split`.

    Returns:
        Fitted and held-out blocks, each per experiment.
    """
    cut = [[part for r in e.recordings for part in _blocks(r)] for e in experiments]
    return (
        tuple(_unbroken((part for part, held in parts if not held), restarts) for parts in cut),
        tuple(_unbroken((part for part, held in parts if held), restarts) for parts in cut),
    )


def is_in_time(fitted: Recordings, held_out: Recordings) -> bool:
    """Whether parts of one recording are fitted and others held out."""
    halves = ({id(r.whole) for group in half for r in group} for half in (fitted, held_out))
    return not set.isdisjoint(*halves)


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


def _unbroken(recordings: Iterable[Recording], restarts: bool) -> tuple[Recording, ...]:
    """The recordings without their holes, of which nobody knows what was commanded.

    Nor does anybody know what was before a recording that begins in motion.
    """
    return tuple(part for recording in recordings for part in _parts(recording, restarts))


def _parts(recording: Recording, restarts: bool) -> list[Recording]:
    time = recording.time
    steps = np.diff(time)
    skipped = recording.starts_anew
    unknown = (steps > max(_HOLE, _HOLE_SAMPLES * float(np.median(steps)))) & ~skipped
    holes = np.flatnonzero(unknown | skipped)
    known = restarts or time[0] > recording.whole.time[0]
    if not holes.size:
        return [recording if known else from_known(recording)]
    starts, ends = np.append(0, holes + 1), np.append(holes, len(time) - 1)
    long = time[ends] - time[starts] >= _LEAST
    stops = np.nextafter(time[ends], np.inf)
    parts = [
        recording.between(float(start), float(stop))
        for start, stop in zip(time[starts[long]], stops[long], strict=True)
    ]
    if not parts:
        return [recording]
    if not restarts:
        parts = [p if known and p.time[0] == time[0] else from_known(p) for p in parts]
    holes = np.flatnonzero(unknown)
    if not holes.size:
        return parts
    told = ", ".join(f"from {time[k]:.6g} to {time[k + 1]:.6g} s" for k in holes[:_SHOWN])
    some = "a hole" if len(holes) == 1 else f"{len(holes)} holes"
    note = f"{some}, {told}, of which nobody knows what was commanded: it was cut there"
    first, *others = parts
    return [replace(first, notes=(*first.notes, note)), *(replace(p, notes=()) for p in others)]
