"""Time stamps that have lost their digits: many rows share one, and the next is far off.

coarse_stamps(time)      # "" or why, and what to do about it
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_SHARED = 0.2  # of the rows have the stamp of the row before
_FEWEST = 2  # such rows; a single one, however short the log, may be there twice
_ROUNDED = 1e-6  # of a step of the digits


def coarse_stamps(time: FloatArray) -> str:
    """What is wrong with stamps that were rounded; empty where they were not.

    Single precision has seven digits: seconds since 1970 are told to 128 s. Others are written with
    few decimals. Rows that are there twice repeat their stamps as well, but here and there only.

    Args:
        time: (T,) s, not decreasing where it was rounded.
    """
    steps = np.diff(time)
    if not steps.size or (steps < 0).any():
        return ""
    shared = np.count_nonzero(steps == 0)
    if shared < max(_FEWEST, _SHARED * steps.size):
        return ""
    different = np.unique(time)
    stamps = "one stamp" if different.size == 1 else f"{different.size} different stamps"
    shown = f"has {stamps} in {time.size} rows"
    largest = float(np.abs(time).max())
    single = bool((time == time.astype(np.float32)).all())
    digits = float(np.spacing(np.float32(largest)))
    apart = float(np.diff(different).min()) if different.size > 1 else digits
    if single and apart >= digits * (1 - _ROUNDED) and largest > 1e3:
        return (
            f"{shown}: they went through single precision (float32), which at {largest:.4g} s has "
            f"steps of {digits:.3g} s. Write them in double precision, or take the first stamp "
            "away before they are narrowed; where the rows came at a fixed rate, number them: "
            "time = row / rate"
        )
    if different.size < 2:
        return f"{shown}, {largest!r} s. Write the time at which each row was taken"
    return (
        f"{shown}, {apart:.3g} s apart: they were rounded. Write them with more decimals; where "
        "the rows came at a fixed rate, number them: time = row / rate"
    )
