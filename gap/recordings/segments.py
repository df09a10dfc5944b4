"""Stretches of a recording that are simulated in one go."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from walkerkit.gap.recordings.recording import Recording

_FEWEST_ROWS = 4


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Consecutive samples of a recording, simulated from the measured state of the first.

    Attributes:
        recording: the log.
        first, last: index of its first sample and one past its last.
    """

    recording: Recording
    first: int
    last: int

    @property
    def start(self) -> float:
        """Time of the first sample [s]."""
        return float(self.recording.time[self.first])

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return float(self.recording.time[self.last - 1]) - self.start


def whole(recording: Recording) -> tuple[Segment, ...]:
    """The whole recording as one segment."""
    return (Segment(recording=recording, first=0, last=len(recording.time)),)


def windows(recording: Recording, length: float) -> tuple[Segment, ...]:
    """Adjoining segments of `length` seconds; what is left over is dropped, half at either end.

    There the measured state, which each of them starts from, is known least. A recording shorter
    than `length`, or of too few samples a segment, is one segment.
    """
    time = recording.time
    count = int((time[-1] - time[0]) / length)
    if count == 0:
        return whole(recording)
    left = float(time[-1] - time[0]) - length * count
    edges = np.searchsorted(time, time[0] + left / 2 + length * np.arange(count + 1))
    found = tuple(
        Segment(recording=recording, first=int(first), last=int(last))
        for first, last in itertools.pairwise(edges)
        if last - first >= _FEWEST_ROWS
    )
    return found or whole(recording)


def stretches(recording: Recording, longest: float) -> tuple[Segment, ...]:
    """The whole recording in equal parts of at most `longest` seconds."""
    time = recording.time
    duration = float(time[-1] - time[0])
    count = max(1, int(np.ceil(duration / longest - 1e-6)))
    return windows(recording, duration / count * (1 - 1e-12))


def cut(recordings: Sequence[Recording], length: float | None) -> tuple[Segment, ...]:
    """All recordings as windows of `length` seconds, or whole where it is None."""
    return tuple(
        segment
        for recording in recordings
        for segment in (whole(recording) if length is None else windows(recording, length))
    )
