"""What a number may be that is too large for radians, and that each remedy gives the angle back."""

import re

import numpy as np
import pytest

from walkerkit.gap.too_large import looks_like

LOWER, UPPER = -1.2, 2.0
ANGLE = 0.4 + 1.1 * np.sin(np.linspace(0, 20, 500))
SHARE = (ANGLE - LOWER) / (UPPER - LOWER)
UNITS = {
    "degrees": np.rad2deg(ANGLE),
    "per cent of the range, -100 to 100": 200 * SHARE - 100,
    "per cent of the range, 0 to 100": 100 * SHARE,
    "ticks of an encoder, 4096 a turn": np.rint(2048 + ANGLE * 4096 / (2 * np.pi)),
    "ticks of an encoder, 65536 a turn": np.rint(32768 + ANGLE * 65536 / (2 * np.pi)),
}
SYMBOLS = r"make (?:it|each) (.*?)(?:, with|, where|\. Who|$)"


@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_is_among_those_told_and_its_remedy_gives_the_angle_back(unit):
    told = looks_like([UNITS[unit]], LOWER, UPPER)
    assert unit in told
    clause = next(one for one in told.split("; or ") if one.startswith(unit))
    if unit == "degrees":
        assert "numpy.deg2rad" in clause
        return
    formula = re.search(SYMBOLS, clause)[1]
    values = {"p": UNITS[unit], "n": UNITS[unit], "pi": np.pi}
    np.testing.assert_allclose(eval(formula, {}, values), ANGLE, atol=1.6e-3)


@pytest.mark.parametrize(
    ("unit", "not_told"),
    [
        ("ticks of an encoder, 4096 a turn", "degrees"),
        ("ticks of an encoder, 4096 a turn", "per cent"),
        ("degrees", "ticks"),
        ("per cent of the range, -100 to 100", "ticks"),
    ],
)
def test_what_the_numbers_rule_out_is_not_told(unit, not_told):
    assert not_told not in looks_like([UNITS[unit]], LOWER, UPPER)


def test_more_than_a_hundred_is_no_per_cent():
    assert looks_like([np.array([0.0, 110.0])], -2.0, 2.0) == (
        "degrees; multiply it by pi/180 (numpy.deg2rad)"
    )


def test_without_a_range_there_is_no_per_cent_of_it():
    assert "per cent" not in looks_like([np.array([0.0, 70.5])], -np.inf, np.inf)


def test_ticks_about_a_middle_need_no_shift():
    told = looks_like([np.rint(ANGLE * 4096 / (2 * np.pi))], LOWER, UPPER)
    assert "make it n * 2 * pi / 4096" in told
