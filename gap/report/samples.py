"""The signals of the report, packed: sixteen bits a sample are finer than any screen.

    packed(trace, size, mended=True)     # what report.js unpacks and draws

Errors are packed apart from the signal that they are errors of, so that zooming into a small error
of a large motion shows the error and not the packing.
"""

from __future__ import annotations

import base64
import itertools
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.report import wording
from walkerkit.gap.report.diagnosis import Trace
from walkerkit.gap.report.gaps import GapSize
from walkerkit.gap.report.quantity import scale

FloatArray = NDArray[np.float64]

POINTS = 2000  # of a trace; more than a screen has columns
_HOLE = 65535


def packed(trace: Trace, size: GapSize | None, *, mended: bool) -> dict[str, Any]:
    """One trace as the page takes it.

    Args:
        trace: what to show.
        size: its gap, for the band of the noise floor; None for no band.
        mended: whether there is a mended model to show beside the one that was given.
    """
    kept = decimated(trace)
    measured = trace.measured[kept]
    simulated = (trace.before, trace.after) if mended else (trace.before,)
    errors = [values[kept] - measured for values in simulated]
    unit = scale(_largest((measured, *(values[kept] for values in simulated))), trace.unit)
    error_unit = scale(_largest(errors), trace.unit)
    return {
        "recording": wording.label(trace.recording),
        "joint": wording.label(trace.joint),
        "signal": wording.words(trace.signal),
        "heldOut": trace.held_out,
        "unit": unit.unit,
        "errorUnit": error_unit.unit,
        "errorFactor": error_unit.factor / unit.factor,
        "floor": 0.0 if size is None else size.noise_floor * error_unit.factor,
        "time": pack(trace.time[kept]),
        "measured": pack(measured * unit.factor),
        "commanded": None if trace.target is None else pack(trace.target[kept] * unit.factor),
        "errors": [pack(values * unit.factor) for values in errors],
    }


def pack(values: FloatArray) -> dict[str, Any]:
    """Numbers as offset + step × little-endian sixteen bits; what is no number is 65535."""
    finite = values[np.isfinite(values)]
    offset = float(finite.min()) if finite.size else 0.0
    step = float(np.ptp(finite)) / (_HOLE - 1) if finite.size else 0.0
    codes = np.full(values.shape, _HOLE, dtype="<u2")
    known = np.isfinite(values)
    codes[known] = np.round((values[known] - offset) / step) if step > 0 else 0
    return {"offset": offset, "step": step, "data": base64.b64encode(codes.tobytes()).decode()}


def decimated(trace: Trace, points: int = POINTS) -> NDArray[np.intp]:
    """Indices of about `points` samples, with the extremes of both errors among them."""
    if trace.time.size <= points:
        return np.arange(trace.time.size)
    edges = np.linspace(0, trace.time.size, points // 4 + 1).astype(np.intp)
    kept = [np.array([0, trace.time.size - 1], dtype=np.intp)]
    for simulated in (trace.before, trace.after):
        # A rollout that diverged has no error there, and its last finite sample is an extreme.
        error = np.nan_to_num(simulated - trace.measured, nan=0.0, posinf=0.0, neginf=0.0)
        for pick in (np.argmin, np.argmax):
            picked = [a + pick(error[a:b]) for a, b in itertools.pairwise(edges)]
            kept.append(np.array(picked, dtype=np.intp))
    return np.unique(np.concatenate(kept))


def _largest(group: Iterable[FloatArray]) -> float:
    finite = (values[np.isfinite(values)] for values in group)
    return max((float(np.abs(values).max(initial=0.0)) for values in finite), default=0.0)
