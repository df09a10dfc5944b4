"""Numbers with units: the unit, the digits, and what is not a number."""

from __future__ import annotations

import math

import pytest

from walkerkit.gap.report.quantity import estimate_text, number, percent, quantity, span


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0066, "rad", "6.6 mrad"),
        (0.1, "rad", "0.10 rad"),
        (-0.0066, "rad", "−6.6 mrad"),
        (3e-5, "rad", "30 µrad"),
        (0.0042, "m", "4.2 mm"),
        (4.2e-6, "m", "4.2 µm"),
        (0.0123, "s", "12 ms"),
        (0.0066, "N·m", "0.0066 N·m"),
        (0.041, "N", "0.041 N"),
        (4.123e-4, "kg·m²", "4.1×10⁻⁴ kg·m²"),
        (123.4, "N", "123 N"),
        (0.0, "rad", "0 rad"),
        (math.nan, "rad", "unknown rad"),
        (-math.inf, "N", "−∞ N"),
    ],
)
def test_units_and_digits(value: float, unit: str, text: str) -> None:
    assert quantity(value, unit) == text


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (0.1523, 0.0041, "N·m", "0.152 ± 0.004 N·m"),
        (0.01234, 0.0002, "s", "12.34 ± 0.20 ms"),
        (0.0123, 0.0018, "rad", "12.3 ± 1.8 mrad"),
        (-0.5, 0.2, "m", "−0.50 ± 0.20 m"),
        (1234.6, 45.0, "N·m/rad", "1235 ± 45 N·m/rad"),
        (4.123e-4, 3e-6, "kg·m²", "(4.12 ± 0.03)×10⁻⁴ kg·m²"),
        (0.0996, 0.00996, "N·m", "0.100 ± 0.010 N·m"),
        (-1e-5, 2e-3, "kg", "0.0000 ± 0.0020 kg"),
        (0.5, None, "kg", "0.500 kg"),
        (0.5, 0.0, "kg", "0.500 kg"),
        (0.5, math.inf, "kg", "0.500 kg"),
        (math.nan, 0.1, "kg", "unknown kg"),
    ],
)
def test_the_standard_error_decides_the_digits(
    value: float, std: float | None, unit: str, text: str
) -> None:
    assert " ".join(estimate_text(value, std, unit)) == text


def test_rounding_up_does_not_gain_a_digit() -> None:
    assert number(9.96) == "10"
    assert number(0.0996) == "0.10"


def test_a_span_names_the_unit_once_where_it_is_the_same() -> None:
    assert span((0.0066, 0.0011), "rad") == ("6.6", "1.1 mrad")
    assert span((0.35, 0.0011), "rad") == ("0.35 rad", "1.1 mrad")


@pytest.mark.parametrize(
    ("part", "text"),
    [
        (0.98, "98 %"),
        (0.999, ">99 %"),
        (1.0, "100 %"),
        (0.001, "<1 %"),
        (0.0, "0 %"),
        (-0.02, "−2 %"),
        (-math.inf, "unknown"),
    ],
)
def test_percentages_do_not_round_to_certainty(part: float, text: str) -> None:
    assert percent(part) == text
