"""Numbers of the files, as they were and as they are."""

from dataclasses import replace

import pytest

from walkerkit.gap.report.changes import changes
from walkerkit.gap.report.console import as_text
from walkerkit.gap.report.diagnosis import Change
from walkerkit.gap.report.estimates import _inverted


def changed(diagnosis, **given):
    (named,) = diagnosis.effects
    estimate = replace(named.parameters[0], **given)
    return replace(diagnosis, effects=(replace(named, parameters=(estimate,)),))


def test_a_number_was_and_is(leg):
    (row,) = changes(leg())
    assert (row.field, row.was, row.now) == ("joint/frictionloss", "0.05000", "0.2023")
    assert (row.change, row.unit) == ("+0.1523", "N·m")


def test_what_the_model_did_not_have_is_a_dash(leg):
    one = Change(model="leg", place="FL_calf_joint", was=None, now=17.2)
    (row,) = changes(changed(leg(), changes=(one,)))
    assert (row.was, row.now, row.change) == ("–", "17.20", "–")


@pytest.mark.parametrize(
    ("field", "told"),
    [
        ("actuators.json/laws/iron/bend", "1 / actuators.json/laws/iron/bend"),
        ("joint/stiffness", "joint/stiffness"),
    ],
)
def test_one_over_a_number_of_the_sidecar_says_so(leg, field, told):
    diagnosis = changed(leg(), field=field, changes=(Change(model="leg", place="", was=0, now=4),))
    (named,) = diagnosis.effects
    of = _inverted(named.parameters[0], "effort", "N·m")
    (row,) = changes(changed(diagnosis, field=of.field, changes=of.changes))
    assert (row.field, row.was, row.now) == (told, "–", "0.2500")


def test_models_that_differ_have_a_row_each(leg):
    of = tuple(
        Change(model=model, place="knee", was=was, now=was - 3)
        for model, was in (("kp100", 10.0), ("kp200", 20.0))
    )
    rows = changes(changed(leg(), changes=of))
    assert [(row.place, row.now) for row in rows] == [
        ("knee (kp100)", "7.000"),
        ("knee (kp200)", "17.00"),
    ]


def test_models_that_agree_have_one(leg):
    of = tuple(Change(model=m, place="knee", was=1.0, now=2.0) for m in ("kp100", "kp200"))
    assert len(changes(changed(leg(), changes=of))) == 1


def test_small_angles_are_in_milliradians(leg):
    one = Change(model="leg", place="knee", was=0.0, now=0.0123)
    (row,) = changes(changed(leg(), unit="rad", changes=(one,)))
    assert (row.now, row.unit) == ("12.30", "mrad")


def test_the_console_shows_them(leg):
    text = as_text(leg())
    assert "What changes in the model" in text
    assert "joint/frictionloss" in text
