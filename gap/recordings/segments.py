"""Stretches of a recording that are simulated in one go."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.smooth import AT_AN_END
from walkerkit.gap.recordings.state import MeasuredState

_FEWEST_ROWS = 4
_ROUNDED = 1e-9


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
    """Segments of `length` seconds, each from where the measured state is known well.

    The first begins when half the fits at the log's beginning are over, if enough is left; each
    other where the one before ends. Where a joint's motion is fast then, as in an impact, the
    segment waits for that to pass, for half a length at most. What is left over is dropped.

    A recording shorter than `length`, or of too few samples a segment, is one segment.
    """
    time = recording.time
    count = int((time[-1] - time[0]) / length)
    if count == 0:
        return whole(recording)
    fast = MeasuredState.shared(recording, recording.joints).fast_at(time)
    left = float(time[-1] - time[0]) - length * count
    start, spans = float(time[0]) + min(left, AT_AN_END), []
    while start + length <= time[-1] + _ROUNDED * length:
        first, late = np.searchsorted(time, (start, start + length / 2))
        quiet = np.flatnonzero(~fast[first:late])
        if quiet.size and quiet[0] and time[first + quiet[0]] + length <= time[-1]:
            first += quiet[0]
            start = float(time[first])
        start += length
        spans.append((first, np.searchsorted(time, start)))
    return _segments(recording, spans)


def stretches(recording: Recording, longest: float) -> tuple[Segment, ...]:
    """The whole recording in equal parts of at most `longest` seconds."""
    time = recording.time
    duration = float(time[-1] - time[0])
    count = max(1, int(np.ceil(duration / longest - 1e-6)))
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], count + 1))
    return _segments(recording, itertools.pairwise(edges))


def _segments(
    recording: Recording, spans: Iterable[tuple[np.integer, np.integer]]
) -> tuple[Segment, ...]:
    """Those from a first sample to one past a last that have enough samples, or the whole."""
    found = tuple(
        Segment(recording=recording, first=int(first), last=int(last))
        for first, last in spans
        if last - first >= _FEWEST_ROWS
    )
    return found or whole(recording)


def cut(recordings: Sequence[Recording], length: float | None) -> tuple[Segment, ...]:
    """All recordings as windows of `length` seconds, or whole where it is None."""
    return tuple(
        segment
        for recording in recordings
        for segment in (whole(recording) if length is None else windows(recording, length))
    )
