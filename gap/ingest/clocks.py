"""Stamps of any unit as nanoseconds on one clock.

    clocks = Clocks(log, TimeMap(clock="header", unit="ns"), rows="/joint_states")
    clocks.of("/commands")      # (T,) ns; its own stamps, or when it was received on that clock
    clocks.notes

What went through 32-bit floats is told: stamps that are even within their rounding become even, and
those of which the rounding has made steps of seconds are refused.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import closest, refusal
from walkerkit.gap.ingest.column_map import TIME_UNITS, TimeMap
from walkerkit.gap.ingest.log import Log, Stamps, Topic
from walkerkit.gap.ingest.words import time_unit

Nanoseconds = NDArray[np.int64]

_EPOCH = 9e8, 4e9  # s since 1970, of this century
_LIKELY = 1e-5, 10.0  # s, of a step
_STEPS = {"ns": 2e5, "us": 200.0, "ms": 0.2, "s": 0.0}  # from where on a relative one's median is
_RECEIVED = "received"


class Clocks:
    """The clocks of a log, put on that of its rows.

    Attributes:
        notes: what a user should know of them.
    """

    def __init__(self, log: Log, time: TimeMap, rows: str):
        self._log, self._time, self._rows = log, time, rows
        self.notes: list[str] = []
        self._known: dict[tuple[str, str | None, float | None], Nanoseconds] = {}

    def of(self, topic: str, clock: str | None = None, rate: float | None = None) -> Nanoseconds:
        """When the samples of a topic are from.

        Args:
            topic: one of the log's.
            clock: one of its clocks, instead of the rows'.
            rate: samples a second, instead of a clock.

        Returns:
            (T,) ns, as they are in the log: they may repeat and go backwards.

        Raises:
            InputError: it has no such clock, or its stamps have lost what they told.
        """
        key = topic, clock, rate
        if key not in self._known:
            self._known[key] = self._of(topic, clock, rate)
        return self._known[key]

    def _of(self, topic: str, clock: str | None, rate: float | None) -> Nanoseconds:
        found = self._log.topics[topic]
        if clock is not None and clock not in found.clocks:
            raise refusal(_no_clock(self._log, topic, found, clock))
        rate = rate or (self._time.rate if clock is None else None)
        clock = clock or self._time.clock
        if rate is not None:
            counted = found.clocks.get(clock)
            counts = np.arange(found.size) if counted is None else counted - counted[0]
            even: Nanoseconds = np.rint(1e9 * (counts / rate)).astype(np.int64)
            return even
        if clock in found.clocks:
            return self._exact(found.clocks[clock], self._time.unit)
        rows = self._log.topics[self._rows].clocks
        if topic != self._rows and _RECEIVED in found.clocks and clock in rows:
            # It is known only when these were received; the rows tell how the clocks differ.
            ahead = int(np.median(rows[_RECEIVED].astype(np.int64) - rows[clock].astype(np.int64)))
            self.notes.append(
                f"commands of {topic} have no stamps; they count from when they were received"
            )
            return found.clocks[_RECEIVED].astype(np.int64) - ahead
        if topic != self._rows and len(found.clocks) == 1:
            name, stamps = next(iter(found.clocks.items()))
            return self._exact(stamps, unit_of(name, stamps))
        raise refusal(_no_clock(self._log, topic, found, clock))

    def _exact(self, stamps: Stamps, unit: str) -> Nanoseconds:
        factor = TIME_UNITS[unit]
        if stamps.dtype.kind in "iu":
            return stamps.astype(np.int64) * int(factor)
        finite = stamps[np.isfinite(stamps)]
        if len(finite) > 2 and np.array_equal(finite, finite.astype(np.float32)):
            even = _even(finite, factor / 1e9)
            if even is not None and len(finite) == len(stamps):
                rate, exact = even
                self.notes.append(
                    f"stamps are 32-bit floats, even within their rounding: {rate:g} Hz were taken"
                )
                return exact
            rounding = float(np.spacing(np.float32(np.abs(finite).max()))) * factor / 1e9
            steps = np.diff(finite)
            if np.mean(steps == 0) > 0.5 and rounding > 1e-3:
                raise refusal(
                    f"{self._log.path}: its stamps went through 32-bit floats, which tell "
                    f"{finite[0]:.10g} to {rounding:.3g} s only, so that most repeat the one "
                    "before. Write the samples a second into a map, [time] with rate = 200 for "
                    "example, and give it with --map; or log seconds from the start of the run."
                )
        whole = np.where(np.isfinite(stamps), stamps, np.nan)
        start = np.nanmin(whole)
        offset = np.rint(np.nan_to_num(factor * (whole - start)))
        nanoseconds: Nanoseconds = offset.astype(np.int64) + int(np.rint(factor * start))
        return nanoseconds


def unit_of(name: str, stamps: Stamps) -> str:
    """The unit of a clock: as its name says, else as its size or its steps do."""
    told = time_unit(name)
    values = stamps[np.isfinite(stamps)].astype(float)
    if values.size < 2:
        return told or "s"
    largest, step = float(np.abs(values).max()), float(np.median(np.abs(np.diff(values))))
    if step == 0.0:
        step = float((values.max() - values.min()) / len(values))
    for unit, nanoseconds in TIME_UNITS.items():
        seconds = 1e-9 * nanoseconds
        since_1970 = _EPOCH[0] <= seconds * largest <= _EPOCH[1]
        if since_1970 and _LIKELY[0] <= seconds * step <= _LIKELY[1]:
            return unit
    return told or next(unit for unit, least in _STEPS.items() if step >= least)


def _even(stamps: NDArray[Any], seconds: float) -> tuple[float, Nanoseconds] | None:
    """The rate [Hz] and exact times of stamps that are even within the rounding of float32."""
    step = float(stamps[-1] - stamps[0]) / (len(stamps) - 1)
    if not step > 0:
        return None
    rate = 1.0 / (step * seconds)
    rounding = np.spacing(np.abs(stamps).max().astype(np.float32)).astype(float)
    round_rate = float(np.rint(rate))
    if abs(round_rate - rate) * step * seconds * (len(stamps) - 1) <= 2 * rounding * rate * seconds:
        rate = max(round_rate, 1.0)
    counts = np.arange(len(stamps))
    exact = counts / rate
    if np.abs((stamps - stamps[0]) * seconds - exact).max() > 1.5 * rounding * seconds:
        return None
    start = int(np.rint(1e9 * float(stamps[0]) * seconds))
    return rate, np.rint(1e9 * exact).astype(np.int64) + start


def _no_clock(log: Log, topic: str, found: Topic, clock: str) -> str:
    where = f"topic {topic!r}" if topic else "it"
    if not clock and not found.clocks:
        return (
            f"{log.path}: {where} has no column of time. Write the samples a second into a map, "
            "[time] with rate = 200 for example, and give it with --map."
        )
    return (
        f"{log.path}: {where} has no clock {clock!r}{closest(clock, found.clocks)}. It has "
        f"{', '.join(map(repr, found.clocks)) or 'none'}; write [time] with clock = one of them, "
        "or with rate = samples a second, into the map."
    )
