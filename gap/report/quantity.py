"""Numbers with units, as a person would write them.

    quantity(0.0066, "rad")              # 6.6 mrad
    estimate_text(0.1523, 0.0041, "N·m") # 0.152 ± 0.004 N·m

Radians, metres and seconds below a tenth are written in thousandths, below a ten-thousandth in
millionths; every other unit stays as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_SMALL = {"rad": ("mrad", "µrad"), "m": ("mm", "µm"), "s": ("ms", "µs")}
_MILLI_BELOW, _MICRO_BELOW = 0.1, 1e-4
_PLAIN = (1e-3, 1e5)  # outside of this range a number is written with a power of ten
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_TWO_DIGITS_BELOW = 3  # a standard error that starts with 1 or 2 keeps its second digit


@dataclass(frozen=True, kw_only=True)
class Scale:
    """A unit to print in.

    Attributes:
        unit: its name.
        factor: what to multiply numbers of the original unit with.
    """

    unit: str
    factor: float


def scale(largest: float, unit: str) -> Scale:
    """The unit in which numbers up to `largest` (in `unit`) read best."""
    size = abs(largest)
    if unit in _SMALL and 0 < size < _MILLI_BELOW:
        milli, micro = _SMALL[unit]
        if size < _MICRO_BELOW:
            return Scale(unit=micro, factor=1e6)
        return Scale(unit=milli, factor=1e3)
    return Scale(unit=unit, factor=1.0)


def number(value: float, digits: int = 2) -> str:
    """A number to `digits` significant digits, never fewer than its integer part."""
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else f"{_sign(value)}∞"
    exponent = _exponent(value, digits)
    if value and not _PLAIN[0] <= abs(value) < _PLAIN[1]:
        return f"{_fixed(value / 10.0**exponent, digits - 1)}{_power(exponent)}"
    return _fixed(value, max(0, digits - 1 - exponent)) if value else "0"


def quantity(value: float, unit: str, digits: int = 2) -> str:
    """A number and its unit, e.g. `6.6 mrad`."""
    chosen = scale(value, unit)
    return f"{number(value * chosen.factor, digits)} {chosen.unit}".rstrip()


def span(values: tuple[float, ...], unit: str, digits: int = 2) -> tuple[str, ...]:
    """Several quantities; the unit stands only behind the last where all have the same."""
    written = [quantity(value, unit, digits) for value in values]
    units = {scale(value, unit).unit for value in values if value}
    if len(units) > 1:
        return tuple(written)
    return (*(text.partition(" ")[0] for text in written[:-1]), written[-1])


def estimate_text(value: float, std: float | None, unit: str) -> tuple[str, str]:
    """An estimate with as many digits as its standard error supports.

    Args:
        value: the estimate, in `unit`.
        std: its standard error, or None.
        unit: its unit.

    Returns:
        `("0.152 ± 0.004", "N·m")`; without ± where there is no standard error.
    """
    if std is None or not (0 < std < math.inf and math.isfinite(value)):
        chosen = scale(value, unit)
        return number(value * chosen.factor, 3), chosen.unit
    chosen = scale(max(abs(value), std), unit)
    value, std = value * chosen.factor, std * chosen.factor
    leading = int(f"{std:.0e}"[0])
    places = -_exponent(std, 1) + (leading < _TWO_DIGITS_BELOW)
    size = max(abs(value), std)
    if _PLAIN[0] <= size < _PLAIN[1]:
        return f"{_fixed(value, max(0, places))} ± {_fixed(std, max(0, places))}", chosen.unit
    exponent = _exponent(size, 3)
    places = max(0, places + exponent)
    mantissas = (_fixed(x / 10.0**exponent, places) for x in (value, std))
    return f"({' ± '.join(mantissas)}){_power(exponent)}", chosen.unit


def percent(part: float) -> str:
    """A part of one as a percentage; what is nearly nothing or all is not rounded to it."""
    if not math.isfinite(part):
        return "unknown"
    rounded = round(100 * part)
    if part > 0 and rounded == 0:
        return "<1 %"
    if part < 1 and rounded == 100:
        return ">99 %"
    return f"{_fixed(rounded, 0)} %"


def _exponent(value: float, digits: int) -> int:
    """Power of ten of the first digit, after rounding (0.0996 to two digits is 0.10)."""
    return int(f"{value:.{digits - 1}e}".partition("e")[2])


def _fixed(value: float, places: int) -> str:
    text = f"{abs(value):.{places}f}"
    return text if not float(text) else f"{_sign(value)}{text}"


def _sign(value: float) -> str:
    return "−" if value < 0 else ""


def _power(exponent: int) -> str:
    return f"×10{str(exponent).translate(_SUPERSCRIPT)}"
