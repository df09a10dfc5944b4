"""Errors of wiring: a sign that is flipped, two joints that are exchanged, in the log's columns.

    error = WiringError(kind="sign_flip", joints=("knee",), columns=("knee/position",), ...)
    rewired(recording, error.kind, error.columns)     # the log as it should have been
    named_errors(recordings)                          # what was mended in them, each once

`walkerkit.gap.wiring` finds them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from walkerkit.gap.recordings.recording import Recording

Kind = Literal["sign_flip", "joint_swap"]


@dataclass(frozen=True, kw_only=True)
class WiringError:
    """One of them.

    Attributes:
        kind: `sign_flip`, or `joint_swap` of two joints.
        joints: whose columns.
        columns: those that were negated, or exchanged between the two joints.
        gap_before, gap_after: root-mean-square gap of the joints before and after that, over the
            stretches that were looked at.
        unit: of the gaps.
        recordings: names of the recordings that have it.
        or_else: columns that could be the wrong ones instead, as far as these logs can tell.
    """

    kind: Kind
    joints: tuple[str, ...]
    columns: tuple[str, ...]
    gap_before: float
    gap_after: float
    unit: str
    recordings: tuple[str, ...]
    or_else: tuple[str, ...] = ()

    def sentence(self, everything: bool) -> str:
        """What a reader of the report should do about it.

        Args:
            everything: whether all recordings have it.
        """
        listed = ", ".join(self.columns)
        if self.kind == "sign_flip":
            what = f"The sign of {self.joints[0]} is flipped: {listed}"
            done = "negated"
        else:
            what = f"Joints {self.joints[0]} and {self.joints[1]} are swapped: {listed}"
            done = "exchanged"
        where = "" if everything else f" (in {', '.join(self.recordings)})"
        other = (
            f" These logs cannot tell whether it is {', '.join(self.or_else)} instead."
            if self.or_else
            else ""
        )
        return (
            f"{what}{where}. With them {done}, the gap there falls from {self.gap_before:.3g} to "
            f"{self.gap_after:.3g} {self.unit}. All that follows, the mended model too, is for the "
            f"log as corrected; mend the wiring, or what writes the log.{other}"
        )


def rewired(recording: Recording, error: WiringError) -> Recording:
    """A recording with the error mended and remembered."""
    columns = exchanged(recording, error.kind, error.columns)
    return replace(columns, wiring=(*recording.wiring, error))


def exchanged(recording: Recording, kind: Kind, columns: Sequence[str]) -> Recording:
    """A recording with some columns negated, or exchanged with those of the other joint.

    Args:
        recording: the log.
        kind: what is done.
        columns: of one joint, or the same signals of two.
    """
    changed = dict(recording.columns)
    for name in columns:
        if kind == "sign_flip":
            if name in changed:
                changed[name] = -recording.columns[name]
            continue
        # One of the two may be left out, as a velocity that is not compared.
        other = recording.columns.get(_partner(name, columns))
        if other is None:
            changed.pop(name, None)
        else:
            changed[name] = other
    return replace(recording, columns=changed)


def _partner(name: str, columns: Sequence[str]) -> str:
    """The same signal of the other joint."""
    joint, _, signal = name.rpartition("/")
    return next(
        other
        for other in columns
        if other.rpartition("/")[2] == signal and other.rpartition("/")[0] != joint
    )


def named_errors(recordings: Sequence[Recording]) -> tuple[WiringError, ...]:
    """What was mended in some recordings, each once, in the order in which it was found."""
    found: dict[tuple[str, ...], list[WiringError]] = {}
    for error in dict.fromkeys(error for r in recordings for error in r.wiring):
        found.setdefault((error.kind, *error.columns), []).append(error)
    return tuple(
        replace(
            same[0],
            gap_before=math.hypot(*(e.gap_before for e in same)) / math.sqrt(len(same)),
            gap_after=math.hypot(*(e.gap_after for e in same)) / math.sqrt(len(same)),
            recordings=tuple(dict.fromkeys(name for e in same for name in e.recordings)),
        )
        for same in found.values()
    )
