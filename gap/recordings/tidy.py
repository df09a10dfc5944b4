"""What logs of real machines have that no simulation does: turned into plain data, or told.

    recording = tidied(recording)       # angles that wrapped at ±π go on, with a note
    recording.notes                     # and what was left as it is: clipped, stale, out of step

An encoder that wraps jumps by a whole turn from one sample to the next, and so does the target
that was read from it. No joint makes a turn between two samples, but one may be asked to: a target
that its position is nearer to with the jumps keeps them. Nothing else is changed: what is clipped
or repeated cannot be known again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import some
from walkerkit.gap.recordings.base_state import missing
from walkerkit.gap.recordings.beginning import LONGEST_DELAY, moving
from walkerkit.gap.recordings.imu import has_imu
from walkerkit.gap.recordings.recording import Recording

FloatArray = NDArray[np.float64]

_TURN = 2 * np.pi
_NEAR_A_TURN = 0.6  # rad; between two samples a joint turns by less
_FLAT, _FLAT_TIME = 5, 0.02  # samples and seconds that a reading has to stay at its largest
_AVERAGED = 10  # samples, over which a speed is taken
_AT_SPEED = 0.5  # of the largest; a joint that stops has slowed down before
_MOVES = 3.0  # least steps of the encoder between samples, for repeated ones to mean anything
_ON = 0.01  # of the target's own way, that it moves on while a reading stands
_REPEATS = 0.4  # of the samples of a motion
_LEAD_ALIKE = 0.8  # correlation of the speeds of target and measurement
_LEAD_CLEARER = 0.05  # by which it has to be better than in step
_LONGEST_LEAD = 0.2  # s
_MOSTLY_GAPS = 10.0  # samples that a recording would have at its own rate, for each that it has


def tidied(recording: Recording) -> Recording:
    """A recording without wrapped angles, and with notes of what else is odd about its signals.

    Args:
        recording: the log, of hinges; a slide joint does not jump by 2π metres.
    """
    recording = _unwrapped(recording)
    return replace(recording, notes=(*recording.notes, *_quirks(recording)))


def _unwrapped(recording: Recording) -> Recording:
    columns = dict(recording.columns)
    notes = []
    for joint in recording.joints:
        for signal in ("position", "position_target"):
            name = f"{joint}/{signal}"
            if name not in columns:
                continue
            jumps = np.diff(columns[name])
            wraps = np.abs(np.abs(jumps) - _TURN) < _NEAR_A_TURN
            if not wraps.any():
                continue
            whole = np.cumsum(-np.sign(jumps) * wraps)
            unwrapped = columns[name] + _TURN * np.concatenate([[0.0], whole])
            position = columns[f"{joint}/position"]
            if signal == "position_target" and _apart(position, columns[name]) < _apart(
                position, unwrapped
            ):
                continue
            columns[name] = unwrapped
            first = recording.time[np.argmax(wraps) + 1]
            notes.append(
                f"{name} jumps by a turn {np.count_nonzero(wraps)} times, first at {first:.6g} s; "
                "it was unwrapped"
            )
        target = columns.get(f"{joint}/position_target")
        if target is not None:
            turns = _turns(columns[f"{joint}/position"], target)
            if turns:
                columns[f"{joint}/position"] = columns[f"{joint}/position"] - turns * _TURN
                notes.append(
                    f"{joint}/position is {turns:+d} turns from its target; they were taken away"
                )
    if not notes:
        return recording
    return replace(recording, columns=columns, notes=(*recording.notes, *notes))


def _turns(position: FloatArray, target: FloatArray) -> int:
    """Whole turns that a position is from its target for the most part."""
    apart = float(np.median(position - target))
    turns = int(np.rint(apart / _TURN))
    return turns if abs(apart - turns * _TURN) < _NEAR_A_TURN else 0


def _apart(position: FloatArray, target: FloatArray) -> float:
    """How far a position is from its target on average [rad].

    Not counted are the whole turns from which it starts, and its sign, which may be wrong.
    """
    return min(
        float(np.abs(one - target - _TURN * _turns(one[:1], target[:1])).mean())
        for one in (position, -position)
    )


def _quirks(recording: Recording) -> Iterator[str]:
    for joint in recording.joints:
        position = recording.columns[f"{joint}/position"]
        if np.ptp(position) == 0:
            continue
        yield from _clipped(recording, joint, position)
        yield from _stale(recording, joint, position)
    yield from _in_motion(recording)
    ahead = [note for joint in recording.joints for note in _leads(recording, joint)]
    # On its feet a robot's joints move each other, some of them before they are told to.
    on_feet = not missing(recording) or has_imu(recording)
    if not on_feet or 2 * len(ahead) > len(recording.joints):
        yield from ahead


def _in_motion(recording: Recording) -> Iterator[str]:
    """A log that begins while joints move, whose commands before are not in it."""
    joints = moving(recording)
    if joints:
        yield (
            f"it begins while {some(joints)} move{'s' if len(joints) == 1 else ''}: what the "
            f"targets were before its first row is unknown. Replays of it as a whole begin "
            f"{LONGEST_DELAY:g} s later, unless it is short, and take them to be what they are "
            "there"
        )


def _clipped(recording: Recording, joint: str, position: FloatArray) -> Iterator[str]:
    """A reading that runs into its largest value at full speed and stays there to the last bit."""
    span = min(_AVERAGED, len(position) - 1)
    speed = np.abs(position[span:] - position[:-span]) / span
    changes = np.abs(np.diff(position))
    fast = max(_AT_SPEED * speed.max(), changes[changes > 0].min())
    for extreme, word in ((position.max(), "largest"), (position.min(), "smallest")):
        at = np.concatenate([[False], position == extreme, [False]])
        starts, ends = np.flatnonzero(np.diff(at.astype(int))).reshape(-1, 2).T
        for start, end in zip(starts, ends, strict=True):
            length = recording.time[end - 1] - recording.time[start]
            if start < span or end - start < _FLAT or length < _FLAT_TIME:
                continue
            sign = 1.0 if word == "largest" else -1.0
            if speed[start - span] >= fast and _goes_on(recording, joint, sign, start, end):
                yield (
                    f"{joint}/position stays at its {word} value {extreme:.6g} for {length:.3g} s "
                    f"from {recording.time[start]:.6g} s, and reached it at speed: a saturated "
                    "encoder, or a stop. It was taken as measured"
                )
                break


def _goes_on(recording: Recording, joint: str, sign: float, start: int, end: int) -> bool:
    """Whether a joint was to move on in a direction while its samples stood, first to past last.

    A servo that has got where it was to go stands as well.
    """
    target = recording.signal(joint, "position_target")
    if target is None:
        return True  # nobody knows
    before = target[max(start - _AVERAGED, 0)]
    return bool((sign * (target[start:end] - before)).max() > _ON * np.ptp(target)) and bool(
        np.ptp(target[start:end]) > 0
    )


def _stale(recording: Recording, joint: str, position: FloatArray) -> Iterator[str]:
    """Samples that repeat the one before while the joint moves."""
    changes = np.abs(np.diff(position))
    counts = changes[changes > 0]
    if counts.size < _FLAT:
        return
    # A repeated sample does not look like a joint at rest so.
    span = min(_AVERAGED, len(position) - 1)
    speed = np.abs(position[span:] - position[:-span]) / span
    moving = np.flatnonzero(speed > max(_MOVES * counts.min(), 0.3 * speed.max()))
    if moving.size < 2 * _FLAT:
        return
    share = float(np.mean(changes[moving + span // 2] == 0))
    if share > _REPEATS:
        yield (
            f"{joint}/position repeats the sample before it in {share:.0%} of a motion: it was "
            f"logged about {1 / (1 - share):.0f} times as fast as it was measured"
            if share < 1
            else f"{joint}/position repeats the sample before it"
        )


def _leads(recording: Recording, joint: str) -> Iterator[str]:
    """A measurement that follows a target which has not come yet."""
    target = recording.signal(joint, "position_target")
    if target is None or np.ptp(target) == 0:
        return
    step = float(np.median(np.diff(recording.time)))
    start, end = float(recording.time[0]), float(recording.time[-1])
    if (end - start) / len(recording.time) > _MOSTLY_GAPS * step:
        return
    time = np.arange(start, end, step)
    most = min(round(_LONGEST_LEAD / step), len(time) // 4)
    if most < 2:
        return
    wanted, shown = (
        np.diff(np.interp(time, recording.time, values))
        for values in (target, recording.columns[f"{joint}/position"])
    )
    width = max(1, most // 10)
    wanted, shown = (np.convolve(v, np.ones(width) / width, "same") for v in (wanted, shown))
    alike = {lead: _alike(wanted, shown, lead) for lead in range(-most, most + 1, max(1, width))}
    best = max(alike, key=lambda lead: alike[lead])
    behind = max(value for lead, value in alike.items() if lead <= 0)
    if best > width and alike[best] > _LEAD_ALIKE and alike[best] > behind + _LEAD_CLEARER:
        yield (
            f"{joint}/position is {best * step * 1e3:.3g} ms ahead of its target, which no machine "
            "can be: the columns are out of step. Shift one of them and diagnose again"
        )


def _alike(wanted: FloatArray, shown: FloatArray, lead: int) -> float:
    """Correlation of the target's speed with the measured one, `lead` samples earlier."""
    if lead > 0:
        wanted, shown = wanted[lead:], shown[:-lead]
    elif lead < 0:
        wanted, shown = wanted[:lead], shown[-lead:]
    scale = float(np.linalg.norm(wanted) * np.linalg.norm(shown))
    return float(wanted @ shown) / scale if scale else 0.0
