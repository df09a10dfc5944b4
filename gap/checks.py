"""Whether recordings can be compared with a simulation at all, before any time is spent on it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from walkerkit.gap.errors import InputError
from walkerkit.gap.recording import Recording

_FEWEST_SAMPLES = 20  # of a recording
_FEWEST_IN_WINDOW = 8
_LONGEST_PAUSE = 0.5  # s
_COMPARED = ("position", "effort")


def check_recordings(recordings: Sequence[Recording]) -> None:
    """Refuses recordings that are too short, have pauses, or hold no motion.

    Args:
        recordings: all that are used together.

    Raises:
        InputError: one of them is such a recording, or no joint moves in any.
    """
    for recording in recordings:
        if len(recording.time) < _FEWEST_SAMPLES:
            raise InputError(
                f"{source(recording)}: it has {len(recording.time)} samples, and a comparison "
                f"takes at least {_FEWEST_SAMPLES}. Record for longer."
            )
        steps = np.diff(recording.time)
        longest = int(np.argmax(steps))
        if steps[longest] > _LONGEST_PAUSE:
            raise InputError(
                f"{source(recording)}: column 'time' has a pause of {steps[longest]:.4g} s after "
                f"{recording.time[longest]:.10g} s, in which the commands are unknown. Cut the "
                "file there into two recordings."
            )
    if not any(np.ptp(r.columns[f"{joint}/position"]) for r in recordings for joint in r.joints):
        raise InputError(
            f"{source(recordings[0])}: no joint moves, here or in any other recording. Record a "
            "motion; see whether the drives were on."
        )


def check_window(window: float, recordings: Sequence[Recording]) -> None:
    """Refuses a window that is too short for one of the recordings.

    Raises:
        InputError: the window is shorter than a few samples.
    """
    for recording in recordings:
        least = _FEWEST_IN_WINDOW / recording.rate
        if window < least:
            raise InputError(
                f"window is {window:g} s, less than {_FEWEST_IN_WINDOW} samples of "
                f"{source(recording)} at {recording.rate:.4g} Hz; give at least {least:.2g} s."
            )


def lopsided(fitted: Iterable[Recording], held_out: Iterable[Recording]) -> str | None:
    """A compared column that only one half of the recordings has, or None where both have all."""
    halves = [
        dict.fromkeys(
            f"{joint}/{signal}"
            for recording in half
            for joint in recording.joints
            for signal in _COMPARED
            if recording.signal(joint, signal) is not None
        )
        for half in (fitted, held_out)
    ]
    both = halves[0] | halves[1]
    return next((column for column in both if not all(column in half for half in halves)), None)


def source(recording: Recording) -> str:
    """What a user knows a recording by: its file, or its name where it has none."""
    return str(recording.source or recording.name)
