"""The packed signals: what a page unpacks is what was measured and simulated."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from walkerkit.gap.report.diagnosis import Diagnosis
from walkerkit.gap.report.samples import POINTS, decimated, pack, packed, unpack

LegDiagnosis = Callable[..., Diagnosis]


def test_signal_errors_units_and_floor(leg: LegDiagnosis) -> None:
    trace, size = leg().traces[2], leg().gap.joints["calf"]
    trace = replace(trace, target=trace.before + 0.1)
    kept = decimated(trace)
    shown = packed(trace, size, mended=True)
    json.dumps(shown, allow_nan=False)
    assert (shown["recording"], shown["joint"], shown["signal"]) == ("chirp", "calf", "position")
    assert (shown["unit"], shown["errorUnit"], shown["floor"]) == ("rad", "mrad", 1.0)
    assert shown["errorFactor"] == 1e3
    np.testing.assert_allclose(unpack(shown["time"]), trace.time[kept], atol=2e-4)
    np.testing.assert_allclose(unpack(shown["measured"]), trace.measured[kept], atol=1e-5)
    np.testing.assert_allclose(unpack(shown["commanded"]), trace.target[kept], atol=1e-5)  # type: ignore[index]
    for error, simulated in zip(shown["errors"], (trace.before, trace.after), strict=True):
        exact = (simulated - trace.measured)[kept]
        np.testing.assert_allclose(unpack(error), exact, atol=1e-5 * np.ptp(exact))
    alone = packed(trace, None, mended=False)
    assert len(alone["errors"]) == 1
    assert alone["floor"] == 0.0
    untold = replace(trace, target=None)
    assert packed(untold, None, mended=True)["commanded"] is None


def test_long_traces_keep_both_ends_and_the_extremes_of_both_errors(leg: LegDiagnosis) -> None:
    trace = leg(samples=40_000).traces[2]
    before, after = trace.before.copy(), trace.after.copy()
    before[12_345], after[23_457] = 9.0, -9.0
    kept = decimated(replace(trace, before=before, after=after))
    assert 1000 <= kept.size <= POINTS + 2
    assert {0, 12_345, 23_457, 39_999} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)


def test_short_traces_are_kept_whole(leg: LegDiagnosis) -> None:
    assert decimated(leg(samples=50).traces[0]).size == 50


def test_what_diverged_is_a_hole(leg: LegDiagnosis) -> None:
    trace = leg(samples=50).traces[0]
    before = trace.before.copy()
    before[30:] = [np.inf, np.nan] * 10
    shown = packed(replace(trace, before=before), None, mended=True)
    json.dumps(shown, allow_nan=False)
    assert np.isnan(unpack(shown["errors"][0])).tolist() == [False] * 30 + [True] * 20


@pytest.mark.parametrize("values", [[], [2.5, 2.5], [np.nan, np.nan], [np.nan, 1.0]])
def test_empty_constant_and_missing_values(values: list[float]) -> None:
    np.testing.assert_array_equal(unpack(pack(np.array(values))), values)


def test_a_line_breaks_where_the_simulation_starts_again(leg: LegDiagnosis) -> None:
    trace = leg(samples=50).traces[0]
    late = trace.time + np.where(np.arange(50) >= 40, 1.0, 0.0)  # a part was left out
    again = replace(trace, time=late, restarts=np.array([20, 40]))
    shown = packed(again, None, mended=True)
    error, measured = unpack(shown["errors"][0]), unpack(shown["measured"])
    assert np.flatnonzero(np.isnan(error)).tolist() == [20, 41]
    assert np.flatnonzero(np.isnan(measured)).tolist() == [41]  # it was measured all the while
    assert unpack(shown["time"]).size == 52
    few = packed(again, None, mended=True, points=12)
    assert np.isnan(unpack(few["errors"][0])).sum() == 2
