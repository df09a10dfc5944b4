"""Notes of recordings, of which each is said once, with how many more there are like it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from walkerkit.gap.recordings.recording import Recording

_NUMBER = re.compile(r"(?<![\w/])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_MOST = 3  # names that are listed


def folded(recordings: Iterable[Recording]) -> Iterator[str]:
    """The notes of some recordings, in their order.

    Notes that differ in joint and numbers alone are one: the first of them, with the other joints.
    Parts of one recording have the notes of the whole.

    Args:
        recordings: all of a diagnosis.
    """
    alike: dict[str, list[tuple[str, str, str]]] = {}
    for recording in recordings:
        for note in recording.notes:
            joint = _joint(note, recording)
            kind = _NUMBER.sub("#", note.replace(joint, "<joint>") if joint else note)
            alike.setdefault(kind, []).append((recording.whole.name, joint, note))
    for same in alike.values():
        same = list(dict.fromkeys(same))
        name, joint, note = same[0]
        yield f"{name}: {note}{_more(same)}"


def _joint(note: str, recording: Recording) -> str:
    """The joint that a note is of, the longest name that it has; "" for none."""
    found = (j for j in recording.joints if f"{j}/" in note or f"{j!r}" in note)
    return max(found, key=len, default="")


def _more(same: list[tuple[str, str, str]]) -> str:
    """Of what else a note is true."""
    (first, of, _), *others = same
    if not others:
        return ""
    joints = [joint for joint in dict.fromkeys(j for _, j, _ in others) if joint != of]
    logs = [log for log in dict.fromkeys(log for log, _, _ in others) if log != first]
    where = " and ".join(
        f"{what} {', '.join(some[:_MOST])}{f' and {len(some) - _MOST} more' * (len(some) > _MOST)}"
        for what, some in (("of", joints), ("in", logs))
        if some
    )
    return f" (and {len(others)} more like it{', ' if where else ''}{where})"
