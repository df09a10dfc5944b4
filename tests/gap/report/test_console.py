"""The diagnosis as plain text."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import replace

import pytest
from rich.console import Console

from walkerkit.gap.report.console import as_text, render
from walkerkit.gap.report.diagnosis import Diagnosis, Verdict

LegDiagnosis = Callable[..., Diagnosis]


def row(text: str, start: str) -> str:
    """The first line that starts so, with single spaces."""
    return next(" ".join(line.split()) for line in text.splitlines() if line.startswith(start))


def test_verdict_tables_and_notes(leg: LegDiagnosis) -> None:
    text = as_text(leg())
    assert text.startswith(
        "Explained. The gap is explained by coulomb_friction at calf (98 % sure)"
    )
    assert row(text, "calf") == "calf velocity reversal 50 % 8.3×"
    assert row(text, "coulomb") == "coulomb_friction 98 % sure gap after: 1.1 mrad"
    assert row(text, "  calf") == "calf frictionloss 0.152 ± 0.004 N·m"
    assert row(text, "position") == "position 6.6 mrad 1.1 mrad 1.0 mrad"
    assert row(text, "effort") == "effort 0.52 N·m 0.041 N·m 0.030 N·m"
    assert row(text, "1.") == (
        "1. The velocity of hip was not recorded; the gap was taken from its position alone."
    )


def test_names_are_whole_on_a_narrow_terminal(leg: LegDiagnosis) -> None:
    diagnosis = leg()
    (named,) = diagnosis.effects
    name = "FL_upper_left_calf_joint"
    of = tuple(replace(one, place=name) for one in named.parameters)
    narrow = replace(diagnosis, effects=(replace(named, joints=(name,), parameters=of),))
    text = as_text(narrow, width=80)
    assert row(text, f"  {name}") == f"{name} frictionloss 0.152 ± 0.004 N·m"
    assert max(map(len, text.splitlines())) <= 80


def test_a_table_without_room_becomes_lines_that_break_no_name(leg: LegDiagnosis) -> None:
    diagnosis = leg()
    (named,) = diagnosis.effects
    (of,) = named.parameters
    name = "robot_0/front_left_upper_knee_pitch_joint"
    field = "joint/solreffriction and joint/solimpfriction"
    changes = tuple(replace(change, place=name) for change in of.changes)
    long = replace(of, place=name, field=field, changes=changes)
    wide = replace(diagnosis, effects=(replace(named, joints=(name,), parameters=(long,)),))
    for width in (60, 80):
        text = as_text(wide, width=width)
        changed = text.partition("What changes in the model\n")[2].partition("\n\n")[0]
        assert changed.splitlines() == [
            *(name, f"  field: {field}", "  was: 0.05000", "  is: 0.2023"),
            *("  change: +0.1523", "  unit: N·m"),
        ]
        assert max(map(len, text.splitlines())) <= width
        assert "(98 % sure)" in text or "98 % sure" in text


@pytest.mark.parametrize("width", range(40, 100, 7))
def test_no_line_ends_between_a_number_and_its_unit(leg: LegDiagnosis, width: int) -> None:
    text = as_text(leg(), width=width)
    sentences = text.partition("Where")[0] + text.partition("Notes")[2]
    assert not re.search(r"\d\n(?:%|mrad)", sentences)


def test_only_the_first_three_locations(leg: LegDiagnosis) -> None:
    text = as_text(leg())
    where = text.partition("Where")[2].partition("Effects")[0]
    assert len(where.split("\n")) - 5 == 3
    assert "50 %" in where


def test_locations_of_the_effort_say_so(leg: LegDiagnosis) -> None:
    diagnosis = leg()
    effort = tuple(replace(at, signal="effort") for at in diagnosis.locations)
    assert "of the effort gap" in as_text(replace(diagnosis, locations=effort))
    assert "of the gap" in as_text(diagnosis)


def test_doubts_bounds_and_bodies(confused: Diagnosis) -> None:
    text = as_text(confused)
    assert row(text, "payload  ") == "payload 91 % sure gap after: 2.4 mrad"
    assert row(text, "  body") == "body shin mass 0.500 (at its bound) kg"
    assert "it is no estimate, without ±" in text
    assert row(text, "command_delay  ") == "command_delay 52 % sure gap after: 3.1 mrad"
    assert row(text, "  whole") == "whole robot delay 12.34 ± 0.20 ms"
    flat = " ".join(text.split())
    assert "cannot be told from sensor_delay or setpoint_filter" in flat
    assert "is predicted to tell command_delay, sensor_delay and setpoint_filter apart" in flat
    assert "2. The recordings share one pose." in text


@pytest.mark.parametrize("verdict", ["no_gap", "unexplained"])
def test_without_effects_there_is_no_after(leg: LegDiagnosis, verdict: Verdict) -> None:
    text = as_text(replace(leg(), verdict=verdict, effects=(), locations=(), notes=()))
    assert row(text, "signal") == "signal gap noise floor"
    for absent in ("Effects", "Where", "Notes", "mended"):
        assert absent not in text


def test_names_are_not_markup_and_cannot_drive_the_terminal(leg: LegDiagnosis) -> None:
    text = as_text(leg(joints=("hip", "thigh", "[red]\x1b[2Jcalf")))
    assert "\x1b" not in text
    assert row(text, "[red]�[2Jcalf").startswith("[red]�[2Jcalf velocity reversal")


@pytest.mark.parametrize("width", [60, 100])
def test_lines_fit(confused: Diagnosis, width: int) -> None:
    assert max(len(line) for line in as_text(confused, width).splitlines()) <= width


def test_the_text_is_the_same_in_every_terminal(
    confused: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = as_text(confused)
    for name, value in {"FORCE_COLOR": "1", "COLUMNS": "40", "TERM": "xterm-256color"}.items():
        monkeypatch.setenv(name, value)
    assert as_text(confused) == plain
    assert "\x1b" not in plain


def test_colour_only_repeats_what_the_words_say(leg: LegDiagnosis) -> None:
    out = io.StringIO()
    console = Console(file=out, width=100, force_terminal=True, color_system="truecolor")
    console.print(render(leg()))
    assert "\x1b[1;32m" in out.getvalue()
    coloured = re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue())
    assert [line.rstrip() for line in coloured.splitlines()] == as_text(leg()).splitlines()
