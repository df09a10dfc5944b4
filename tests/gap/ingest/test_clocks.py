from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from walkerkit.gap.ingest.clocks import Clocks, unit_of
from walkerkit.gap.ingest.column_map import TIME_UNITS, TimeMap
from walkerkit.gap.ingest.log import Log, Topic


def clocks(stamps: np.ndarray, **time: object) -> Clocks:
    topic = Topic(size=len(stamps), clocks={"stamp": stamps})
    log = Log(path=Path("log"), name="log", topics={"": topic}, columns={})
    return Clocks(log, TimeMap(clock="stamp", **time), "")  # type: ignore[arg-type]


@given(
    unit=st.sampled_from([*TIME_UNITS]),
    rate=st.sampled_from([50, 100, 200, 333, 500, 1000]),
    start=st.sampled_from([0.0, 12.5, 1.7e9]),
)
def test_stamps_of_any_unit_are_known_and_exact(unit: str, rate: int, start: float) -> None:
    exact = (np.arange(400) * (10**9 // rate)).astype(np.int64) + round(start * 1e9)
    stamps = exact // int(TIME_UNITS[unit]) if unit != "s" else exact / 1e9
    assert unit_of("stamp", stamps) == unit
    found = clocks(stamps, unit=unit).of("")
    # A float of seconds since 1970 holds a quarter of a microsecond.
    lost = 300 if unit == "s" and start > 1e9 else TIME_UNITS[unit] if unit != "s" else 1
    assert np.abs((found - found[0]) - (exact - exact[0])).max() <= lost


@given(
    rate=st.sampled_from([30, 50, 200, 400, 500, 1000]), start=st.sampled_from([0.0, 3.7, 900.0])
)
def test_even_stamps_in_float32_become_even(rate: int, start: float) -> None:
    time = np.arange(1000) / rate
    found = clocks((time + start).astype(np.float32), unit="s").of("")
    np.testing.assert_array_equal(found - found[0], np.rint(1e9 * time).astype(np.int64))


def test_uneven_stamps_in_float32_stay() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.001, 0.003, 500)).astype(np.float32)
    found = clocks(time, unit="s").of("")
    np.testing.assert_allclose((found - found[0]) / 1e9, time - time[0], atol=2e-6)


def test_counted_samples_need_no_stamp() -> None:
    found = clocks(np.array([7, 8, 10]), rate=100.0).of("")
    np.testing.assert_array_equal(found, [0, 10_000_000, 30_000_000])


def test_whole_nanoseconds_are_exact() -> None:
    stamps = np.array([1_700_000_000_123_456_789, 1_700_000_000_123_456_790])
    np.testing.assert_array_equal(clocks(stamps, unit="ns").of(""), stamps)


def test_a_clock_that_is_not_there() -> None:
    topic = Topic(size=2, clocks={"stamp": np.arange(2)})
    log = Log(path=Path("log"), name="log", topics={"": topic}, columns={})
    with pytest.raises(ValueError, match=r"it has no clock 'stmap'.*did you mean 'stamp'"):
        Clocks(log, TimeMap(clock="stmap"), "").of("")
