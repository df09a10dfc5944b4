"""Which recordings are fitted and which are held out."""

from __future__ import annotations

from collections.abc import Sequence

from walkerkit.gap.manifest import Experiment
from walkerkit.gap.recording import Recording

Recordings = tuple[tuple[Recording, ...], ...]

_EVERY = 3  # every third recording is held out
_FITTED_TIME = 2 / 3


def split(experiments: Sequence[Experiment]) -> tuple[Recordings, Recordings]:
    """Splits the recordings of each experiment.

    What the user declared is held out; else every third recording where there are three or more;
    else the last third of each recording's time.

    Args:
        experiments: the recordings by model.

    Returns:
        Fitted and held-out recordings, each per experiment.
    """
    everything = [r for experiment in experiments for r in experiment.recordings]
    declared = {name for experiment in experiments for name in experiment.held_out}
    if not declared and len(everything) < _EVERY:
        cut = [[_in_time(r) for r in experiment.recordings] for experiment in experiments]
        return (
            tuple(tuple(early for early, _ in parts) for parts in cut),
            tuple(tuple(late for _, late in parts) for parts in cut),
        )
    held = declared or {r.name for r in everything[_EVERY - 1 :: _EVERY]}
    return (
        tuple(tuple(r for r in e.recordings if r.name not in held) for e in experiments),
        tuple(tuple(r for r in e.recordings if r.name in held) for e in experiments),
    )


def _in_time(recording: Recording) -> tuple[Recording, Recording]:
    start = float(recording.time[0])
    middle = start + _FITTED_TIME * recording.duration
    return (
        recording.between(start, middle),
        recording.between(middle, float(recording.time[-1]) + recording.duration),
    )
