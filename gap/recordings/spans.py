"""Spans of a recording that are left out: a hand on the robot, a fall, drives that were off.

    skips = [Skip.of("walk.csv=8.0:8.6"), Skip.of(":0.5")]      # a file, and from when to when
    spans_of("logs/walk.csv", skips)                            # ((8.0, 8.6), (-inf, 0.5))

Times are those of the file's `time`; the row of the first is left out and that of the last is kept.
A missing end is that of the recording. Without a file a span is of the only recording.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import closest, refusal

FloatArray = NDArray[np.float64]
Spans = tuple[tuple[float, float], ...]

_FORM = "Write it as 8.0:8.6 or walk.csv=8.0:8.6, from when to when in seconds"


@dataclass(frozen=True, kw_only=True)
class Skip:
    """A span, and of which recording.

    Attributes:
        file: its file or its name, or None for the only one.
        start, stop: s; infinite for the recording's own ends.
    """

    file: str | None
    start: float
    stop: float

    @classmethod
    def of(cls, text: object) -> Skip:
        """Reads one as it is written on the command line and in a manifest.

        Raises:
            InputError: it is none.
        """
        file, _, span = str(text).rpartition("=")
        first, colon, last = span.partition(":")
        try:
            start = float(first) if first.strip() else -np.inf
            stop = float(last) if last.strip() else np.inf
        except ValueError:
            start = stop = np.nan
        if (
            not colon
            or not isinstance(text, str)
            or not start < stop
            or np.isinf([start, stop]).all()
        ):
            raise refusal(f"{text!r} is no span to skip. {_FORM}.")
        return cls(file=file or None, start=start, stop=stop)

    def names(self, recording: str) -> bool:
        """Whether it is of a recording, by its path, the end of that, its file's name or stem."""
        path, mine = Path(recording), Path(self.file or "")
        return mine in (Path(path.name), Path(path.stem)) or path.resolve() == mine.resolve()

    def __str__(self) -> str:
        ends = ("" if np.isinf(t) else f"{t:g}" for t in (self.start, self.stop))
        return f"{f'{self.file}=' if self.file else ''}{':'.join(ends)}"


def spans_of(recording: str, skips: Sequence[Skip]) -> Spans:
    """The spans of one recording.

    Args:
        recording: its file or its name.
        skips: those of all.
    """
    return tuple((s.start, s.stop) for s in skips if s.file is None or s.names(recording))


def check_skips(skips: Sequence[Skip], recordings: Iterable[str]) -> None:
    """Refuses spans of a recording that is not there, or of nobody knows which.

    Raises:
        InputError: one of them is such a span.
    """
    names = list(recordings)
    for skip in skips:
        if skip.file is None and len(names) > 1:
            raise refusal(
                f"{skip} is to be skipped, but there are {len(names)} recordings. Say of which, as "
                f"in {names[0]}={skip}."
            )
        if skip.file is not None and not any(skip.names(name) for name in names):
            raise refusal(
                f"{skip} is to be skipped, but no recording is called {skip.file!r}"
                f"{closest(skip.file, names)}. Name the file of one of them."
            )


def kept_rows(time: FloatArray, spans: Spans, source: str) -> NDArray[np.bool_]:
    """Which rows are in none of the spans.

    Args:
        time: (T,) s.
        spans: from when to when.
        source: what messages call the recording.

    Raises:
        InputError: a span has no row, or they leave too few.
    """
    kept = np.ones(time.size, dtype=bool)
    for start, stop in spans:
        inside = (time >= start) & (time < stop)
        if not inside.any():
            raise refusal(
                f"{source}: no row lies between {start:g} and {stop:g} s, which are to be skipped. "
                f"Its time goes from {time.min():.10g} to {time.max():.10g} s."
            )
        kept &= ~inside
    if kept.sum() < 2:
        raise refusal(f"{source}: all of it is to be skipped. Leave it out, or skip less.")
    return kept
