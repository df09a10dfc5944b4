"""Whether recordings can be compared with a simulation, and in what, before any time is spent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording

if TYPE_CHECKING:  # reading a log checks its units, and a manifest reads logs
    from walkerkit.gap.experiments.experiment import Experiment

_FEWEST_SAMPLES = 20  # of a recording
_FEWEST_IN_WINDOW = 8
_LONGEST_PAUSE = 0.5  # s
_COMPARED = ("position", "effort")
_PLACEHOLDERS = ("velocity", "effort")
_SPARES = ("current",)  # that a log may have and nothing reads
_ECHO = 1e-4  # of the largest effort; rounding in a file is less, what a drive measures is more


def check_recordings(recordings: Sequence[Recording]) -> None:
    """Refuses recordings that are too short, have pauses, measure nothing, or hold no motion.

    Args:
        recordings: all that are used together.

    Raises:
        InputError: one of them is such a recording, or no joint moves in any.
    """
    for recording in recordings:
        for joint in recording.joints:
            position = recording.columns[f"{joint}/position"]
            target = recording.columns.get(f"{joint}/position_target")
            if target is not None and np.ptp(position) and np.array_equal(position, target):
                raise InputError(
                    f"{source(recording)}: column '{joint}/position' is '{joint}/position_target' "
                    "to the bit, so no encoder has measured it. Log what was measured."
                )
        if len(recording.time) < _FEWEST_SAMPLES:
            raise InputError(
                f"{source(recording)}: it has {len(recording.time)} samples, and a comparison "
                f"takes at least {_FEWEST_SAMPLES}. Record for longer."
            )
        steps = np.where(recording.starts_anew, 0.0, np.diff(recording.time))
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


def check_seconds(window: float | None) -> None:
    """Refuses a window that is no positive number of seconds, where one is given.

    Raises:
        InputError: it is none.
    """
    if window is None:
        return
    number = isinstance(window, int | float | np.integer | np.floating)
    if not number or not window > 0:
        raise InputError(
            f"window is {f'{window} s' if number else repr(window)}; give a positive number of "
            "seconds."
        )


def shortest_window(recording: Recording) -> float:
    """The shortest window in which a recording has enough samples [s]."""
    return float(_FEWEST_IN_WINDOW / recording.rate)


def check_window(window: float, recordings: Sequence[Recording]) -> None:
    """Refuses a window that is too short for one of the recordings.

    Raises:
        InputError: the window is shorter than a few samples.
    """
    for recording in recordings:
        least = shortest_window(recording)
        if window < least * (1 - 1e-6):
            raise InputError(
                f"window is {window:g} s, less than {_FEWEST_IN_WINDOW} samples of "
                f"{source(recording)} at {recording.rate:.4g} Hz; give at least {least:.2g} s."
            )


def without_placeholders(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """The experiments without what nothing reads, and efforts and velocities that never change.

    Drives that cannot measure their effort log zeros, which no simulation should be held to. All of
    these become `unused`.
    """
    recordings = [r for experiment in experiments for r in experiment.recordings]
    columns = dict.fromkeys(
        f"{joint}/{signal}" for r in recordings for joint in r.joints for signal in _PLACEHOLDERS
    )
    silent = {
        column
        for column in columns
        if not any(np.ptp(r.columns[column]) for r in recordings if column in r.columns)
    }
    silent |= {c for r in recordings for c in r.columns if c.rpartition("/")[2] in _SPARES}
    return tuple(
        replace(experiment, recordings=tuple(without(r, silent) for r in experiment.recordings))
        for experiment in experiments
    )


def without(recording: Recording, silent: set[str]) -> Recording:
    """The recording without some columns, which become `unused`."""
    dropped = tuple(column for column in recording.columns if column in silent)
    if not dropped:
        return recording
    columns = {name: v for name, v in recording.columns.items() if name not in silent}
    return replace(recording, columns=columns, unused=(*recording.unused, *dropped))


def without_echoes(recording: Recording, joints: Sequence[str]) -> Recording:
    """The recording without efforts that only repeat their commands; those become `unused`.

    Where a controller logs what it sends in place of what the drive measures, the drive would be
    known to be neither late nor weak. The log of an ideal one, as in a simulator, loses nothing.

    Args:
        recording: the log.
        joints: those that take efforts alone; a servo makes more than the effort that it is told.
    """
    echoes = {}
    for joint in joints:
        effort, target = (recording.signal(joint, s) for s in ("effort", "effort_target"))
        if effort is None or target is None or np.ptp(effort) == 0 or np.ptp(target) == 0:
            continue
        factor = float(effort @ target / (target @ target))
        if np.abs(effort - factor * target).max() <= _ECHO * np.abs(effort).max():
            echoes[f"{joint}/effort"] = f"{joint}/effort_target" + (
                " again" if abs(factor - 1) <= _ECHO else f" times {factor:.4g}"
            )
    if not echoes:
        return recording
    notes = (
        f"{column} is {target}, so it tells nothing of the drive and is not compared. Log what "
        "the drive measures: its current times its torque constant"
        for column, target in echoes.items()
    )
    return replace(without(recording, set(echoes)), notes=(*recording.notes, *notes))


def lopsided(fitted: Sequence[Recording], held_out: Sequence[Recording]) -> str | None:
    """A compared column that only one half of the recordings has, or None where both have all."""
    compared = dict.fromkeys(
        f"{joint}/{signal}"
        for recording in (*fitted, *held_out)
        for joint in recording.joints
        for signal in _COMPARED
        if recording.signal(joint, signal) is not None
    )
    for column in compared:
        if not all(any(column in r.columns for r in half) for half in (fitted, held_out)):
            return column
    return None


def source(recording: Recording) -> str:
    """What a user knows a recording by: its file, or its name where it has none."""
    return str(recording.source or recording.name)
