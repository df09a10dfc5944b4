"""How a log begins: at rest, or while joints move, by commands that are not in it.

    moving(recording)                     # ("knee",), which move at its first row
    recording = from_known(recording)     # what comes after the latest commands it does not know

What holds a robot at rest before a log is what its first row has. What moved it, nobody knows, and
a replay from there goes astray by it, as if the drives lacked something.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from walkerkit.gap.recordings.noise import estimate
from walkerkit.gap.recordings.recording import Recording

LONGEST_DELAY: Final = 0.1
"""The longest that is looked for between a command and its effect, or a state and its log [s]."""

_FIRST = 0.05  # s, in which a joint gets nowhere from rest
_SLOW = 0.1  # of its largest speed
_CLEAR = 4.0  # standard deviations of the noise, by which it moves
_MOST = 0.2  # of a log, that may be left out


def moving(recording: Recording) -> tuple[str, ...]:
    """The joints that move at the first row, or get away from there as fast as if they did."""
    span = max(1, int(np.searchsorted(recording.time, recording.time[0] + _FIRST)))
    if 4 * span > len(recording.time):
        return ()
    found = []
    for joint in recording.joints:
        position = recording.columns[f"{joint}/position"]
        steps = np.abs(position[span:] - position[:-span])
        noise = _CLEAR * estimate([position]).std
        if steps[0] > max(_SLOW * steps.max(), noise):
            found.append(joint)
    return tuple(found)


def from_known(recording: Recording) -> Recording:
    """A log without its beginning, if joints move in it; that still tells what was commanded."""
    if _MOST * recording.duration < LONGEST_DELAY or not moving(recording):
        return recording
    end = np.nextafter(recording.time[-1], np.inf)
    part = recording.between(float(recording.time[0]) + LONGEST_DELAY, float(end))
    return replace(part, name=recording.name)
