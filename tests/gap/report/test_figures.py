"""The figures: what is drawn, and how names are kept from being read as more than text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from walkerkit.gap.report import figures
from walkerkit.gap.report.diagnosis import Diagnosis
from walkerkit.gap.report.gaps import GapSize

LegDiagnosis = Callable[..., Diagnosis]


def texts(drawn: figures.Specification) -> list[str]:
    return [note["text"].strip() for note in drawn["layout"]["annotations"]]


def test_every_step_shows_what_is_left_and_what_it_took_away(confused: Diagnosis) -> None:
    drawn = figures.waterfall(confused)
    left, taken, noise, numerical = drawn["data"]
    np.testing.assert_allclose(left["x"], [6.6, 4.1, 3.1, 2.4, 2.2])
    assert taken["name"] == "taken away"
    # Each bar hangs from where the one before it ended.
    np.testing.assert_allclose(np.add(taken["base"], taken["x"]), [6.6, 4.1, 3.1, 2.4])
    np.testing.assert_allclose(taken["base"], left["x"][1:])
    np.testing.assert_allclose(noise["x"], [1.0, 1.0])
    np.testing.assert_allclose(numerical["x"], [0.3, 0.3])
    assert noise["line"]["dash"] != numerical["line"]["dash"]
    assert texts(drawn)[:4] == [
        *("model as given", "6.6 mrad", "+ coulomb_friction at calf", "4.1 mrad (−38 %)")
    ]
    assert "all, fitted together" in texts(drawn)


def test_a_step_that_makes_the_gap_larger_is_seen(confused: Diagnosis) -> None:
    first, *others = confused.effects
    worse = replace(confused, effects=(replace(first, gap_after=0.0070), *others))
    _, taken, added, *_ = figures.waterfall(worse)["data"]
    assert added["name"] == "added"
    np.testing.assert_allclose([added["base"][0], added["x"][0]], [6.6, 0.4])
    assert added["marker"]["pattern"]["shape"] != taken["marker"]["pattern"]["shape"]


def test_it_ends_with_the_last_effect_where_nothing_changed_after_it(leg: LegDiagnosis) -> None:
    np.testing.assert_allclose(figures.waterfall(leg())["data"][0]["x"], [6.6, 1.1])


def test_a_gap_that_the_position_hides_falls_in_the_effort(leg: LegDiagnosis) -> None:
    diagnosis = leg()
    stiff = GapSize(unit="rad", before=0.001, after=0.001, noise_floor=0.001)
    (named,) = diagnosis.effects
    hidden = replace(
        diagnosis,
        gap=replace(diagnosis.gap, position=stiff),
        effects=(replace(named, gap_after=0.001, gaps_after={"effort": 0.041}),),
    )
    drawn = figures.waterfall(hidden)
    np.testing.assert_allclose(drawn["data"][0]["x"], [0.52, 0.041])
    assert drawn["layout"]["xaxis"]["title"]["text"] == "effort error, rms [N·m]"
    assert [trace.get("name") for trace in drawn["data"][2:]] == [
        *("noise floor, 0.030 N·m", "numerical floor, 0.012 N·m")
    ]


def test_it_survives_a_model_that_diverges(leg: LegDiagnosis) -> None:
    gap = leg().gap
    diverged = replace(gap, position=replace(gap.position, before=float("inf")))
    drawn = figures.waterfall(replace(leg(), gap=diverged))
    assert drawn["data"][0]["x"][0] is None
    assert "∞ rad" in texts(drawn)


@pytest.mark.parametrize("mended", [True, False])
def test_series_differ_by_dash_and_without_a_mended_model_there_is_none(mended: bool) -> None:
    drawn = figures.comparison(mended)["data"]
    dashes = {series["name"]: series["line"].get("dash") for series in drawn}
    assert len(set(dashes.values())) == len(dashes)
    simulated = ["as given", "mended"] if mended else ["as given"]
    assert [s["name"] for s in drawn] == ["measured", "commanded", *simulated, *simulated]


def test_plotly_reads_neither_tags_nor_mathematics_in_names(leg: LegDiagnosis) -> None:
    drawn = figures.waterfall(leg(joints=("hip", "thigh", "<b>$x$ %{y}")))
    assert "+ coulomb_friction at &lt;b&gt;&#36;x&#36; %{y}" in texts(drawn)


def test_a_long_step_ends_in_dots(leg: LegDiagnosis) -> None:
    drawn = figures.waterfall(leg(joints=("hip", "thigh", "a_very_long_name_of_a_joint" * 2)))
    assert texts(drawn)[2].endswith("…")
    assert len(texts(drawn)[2]) < 46
