"""The figures: what is drawn, and how names are kept from being read as more than text."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from walkerkit.gap.report import figures
from walkerkit.gap.report.diagnosis import Diagnosis, Location

LegDiagnosis = Callable[..., Diagnosis]


def test_steps_show_every_gap_and_both_floors_in_one_unit(confused: Diagnosis) -> None:
    bars, noise, numerical = figures.steps(confused)["data"]
    np.testing.assert_allclose(bars["x"], [6.6, 4.1, 3.1, 2.4, 2.2])
    assert bars["text"][:2] == ["6.6 mrad", "4.1 mrad (−38 %)"]
    np.testing.assert_allclose(noise["x"], [1.0, 1.0])
    np.testing.assert_allclose(numerical["x"], [0.3, 0.3])
    assert noise["line"]["dash"] != numerical["line"]["dash"]


def test_steps_end_with_the_last_effect_where_nothing_changed_after_it(leg: LegDiagnosis) -> None:
    np.testing.assert_allclose(figures.steps(leg())["data"][0]["x"], [6.6, 1.1])


def test_steps_survive_a_model_that_diverges(leg: LegDiagnosis) -> None:
    gap = leg().gap
    diverged = replace(gap, position=replace(gap.position, before=float("inf")))
    bars = figures.steps(replace(leg(), gap=diverged))["data"][0]
    assert bars["x"][0] is None
    assert bars["text"] == ["∞ rad", "1.1 mrad"]


def test_heat_map_has_shares_in_cells_lift_in_the_hover_and_holes() -> None:
    locations = (
        Location(joint="knee", regime="high_speed", share=0.7, lift=3.2),
        Location(joint="hip", regime="pose", share=0.004, lift=0.5),
    )
    drawn = figures.heat_map(locations, ["hip", "knee"], ["high_speed", "pose"])
    (cells,) = drawn["data"]
    assert cells["z"] == [[None, 0.004], [0.7, None]]
    assert cells["hovertext"][1][0].startswith("knee (high speed)<br>70 % of the squared gap")
    assert "lift 3.2" in cells["hovertext"][1][0]
    assert cells["text"] == [["", "&lt;1"], ["70", ""]]


def test_series_differ_by_dash_and_without_a_mended_model_there_is_none() -> None:
    drawn = figures.comparison(mended=True)["data"]
    dashes = {series["name"]: series["line"].get("dash") for series in drawn}
    assert dashes == {"measured": None, "as given": "dot", "mended": "dash"}
    assert [s["name"] for s in figures.comparison(mended=False)["data"]] == [
        *("measured", "as given", "as given")
    ]


def test_choice_holds_the_signals_their_differences_and_the_floor(leg: LegDiagnosis) -> None:
    trace, size = leg().traces[2], leg().gap.joints["calf"]
    choice = figures.comparison_choice(trace, size, mended=True)
    measured, *_, before_error, after_error = np.array(choice["data"]["y"])
    kept = figures.decimated(trace)
    np.testing.assert_allclose(choice["data"]["x"][0], trace.time[kept], atol=1e-6)
    np.testing.assert_allclose(measured, trace.measured[kept], atol=1e-4)
    np.testing.assert_allclose(before_error, 1e3 * (trace.before - trace.measured)[kept], atol=1e-2)
    np.testing.assert_allclose(after_error, 1e3 * (trace.after - trace.measured)[kept], atol=1e-2)
    assert choice["layout"]["yaxis.title.text"] == "position [rad]"
    assert choice["layout"]["yaxis2.title.text"] == "error [mrad]"
    assert choice["layout"]["shapes[0].y1"] == pytest.approx(1.0)
    assert len(figures.comparison_choice(trace, None, mended=False)["data"]["y"]) == 3


def test_long_traces_keep_both_ends_and_the_extremes_of_both_errors(leg: LegDiagnosis) -> None:
    trace = leg(samples=40_000).traces[2]
    before, after = trace.before.copy(), trace.after.copy()
    before[12_345], after[23_457] = 9.0, -9.0
    kept = figures.decimated(replace(trace, before=before, after=after))
    assert 1000 <= kept.size <= figures.POINTS + 2
    assert {0, 12_345, 23_457, 39_999} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)


def test_short_traces_are_kept_whole(leg: LegDiagnosis) -> None:
    assert figures.decimated(leg(samples=50).traces[0]).size == 50


def test_what_diverged_is_a_hole_and_valid_json(leg: LegDiagnosis) -> None:
    trace = leg(samples=50).traces[0]
    before = trace.before.copy()
    before[30:] = [np.inf, np.nan] * 10
    choice = figures.comparison_choice(replace(trace, before=before), None, mended=True)
    json.dumps(choice, allow_nan=False)
    assert choice["data"]["y"][1][29] is not None
    assert choice["data"]["y"][1][30:] == [None] * 20


def test_an_empty_and_a_constant_trace_can_be_drawn(leg: LegDiagnosis) -> None:
    trace = leg(samples=50).traces[0]
    empty = replace(trace, time=np.zeros(0), measured=np.zeros(0), before=np.zeros(0))
    empty = replace(empty, after=np.zeros(0))
    assert figures.comparison_choice(empty, None, mended=True)["data"]["y"] == [[]] * 5
    still = replace(trace, measured=np.ones(50), before=np.ones(50), after=np.ones(50))
    assert figures.comparison_choice(still, None, mended=True)["data"]["y"][3] == [0.0] * 50


def test_long_names_break_at_underscores_and_end_in_dots() -> None:
    names = ["left_hip_abduction_joint", "a_very_long_name_that_no_axis_has_the_room_for"]
    at = Location(joint=names[0], regime="pose", share=1.0, lift=1.0)
    drawn = figures.heat_map([at], names, ["pose"])
    assert drawn["layout"]["yaxis"]["ticktext"] == [
        "left_hip_<br>abduction_joint",
        "a_very_long_name_<br>that_no_axis_…",
    ]


def test_plotly_reads_neither_tags_nor_mathematics_in_names() -> None:
    name = "<b>$x$ %{y}"
    at = Location(joint=name, regime="pose", share=1.0, lift=1.0)
    drawn = figures.heat_map([at], [name], ["pose"])
    assert drawn["layout"]["yaxis"]["ticktext"] == ["&lt;b&gt;&#36;x&#36; %{y}"]
    assert drawn["data"][0]["hovertemplate"] == "%{hovertext}<extra></extra>"
