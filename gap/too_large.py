"""What an angle may be that is too large for radians: degrees, per cent of a range, encoder ticks.

    looks_like([position, target], lower, upper)    # "degrees; multiply both by pi/180; or per ..."

Several are said where the numbers do not decide, since who follows the wrong one gets a log that is
read without a word and has the wrong scale.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_BITS = (10, 12, 14, 16, 18, 20, 24)  # of usual encoders
_FEW_TICKS = 16  # different whole numbers, below which they may be anything
_FULL = 100.5  # per cent, with a little for a range that was not calibrated to its end
_BEYOND = 1.2  # times a range, where nothing is as far


def looks_like(columns: Sequence[FloatArray], lower: float, upper: float) -> str:
    """The units that a joint's positions and targets may be in, each with what to do, a clause.

    Args:
        columns: (T,) of the same joint and the same unit.
        lower: least of the joint's range [rad], infinite where it has none.
        upper: its greatest [rad].
    """
    every = np.concatenate(list(columns))
    least, most = float(every.min()), float(every.max())
    peak = max(abs(least), abs(most))
    it = "it" if len(columns) == 1 else "both"
    found = []
    resolution = _ticks(every)
    reach = max(abs(lower), abs(upper))
    if np.deg2rad(peak) <= _BEYOND * reach and not (resolution and peak > 360):
        found.append(f"degrees; multiply {it} by pi/180 (numpy.deg2rad)")
    each = "it" if len(columns) == 1 else "each"
    if peak <= _FULL and np.isfinite(reach):
        ends, share = ("0 to 100", "p / 100") if least >= 0 else ("-100 to 100", "(p + 100) / 200")
        found.append(
            f"per cent of the range, {ends} (LeRobot's default); make {each} "
            f"{lower:g} + {share} * ({upper:g} - ({lower:g})), with the range that was calibrated "
            "where that is not the model's"
        )
    if resolution:
        middle = resolution // 2
        found.append(
            f"ticks of an encoder, {resolution} a turn; make {each} n * 2 * pi / {resolution}"
            if least < 0
            else f"ticks of an encoder, {resolution} a turn; make {each} "
            f"(n - {middle}) * 2 * pi / {resolution}, where {middle} is the tick at zero"
        )
    if not found:
        found.append(f"degrees; multiply {it} by pi/180 (numpy.deg2rad)")
    if len(found) == 1:
        return found[0]
    return f"{'; or '.join(found)}. Whoever wrote the log knows which"


def _ticks(values: FloatArray) -> int | None:
    """The ticks of a turn, where all are whole numbers of an encoder; None where they are not."""
    if (values != np.rint(values)).any() or np.unique(values).size < _FEW_TICKS:
        return None
    span = max(float(values.max()), 2 * float(-values.min()), float(np.ptp(values)))
    return next((2**bits for bits in _BITS if span < 2**bits), None)
