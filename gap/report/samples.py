"""The signals of the report, packed: sixteen bits a sample are finer than any screen.

    packed(trace, size, mended=True)     # what report.js unpacks and draws

Errors are packed apart from the signal that they are errors of, so that zooming into a small error
of a large motion shows the error and not the packing. Where a simulation starts again from the
measured state, its line breaks.
"""

from __future__ import annotations

import base64
import itertools
from collections.abc import Iterable, Mapping
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
_PAUSE = 5  # samples that a log leaves out, so that its line breaks, too


def packed(
    trace: Trace, size: GapSize | None, *, mended: bool, points: int = POINTS
) -> dict[str, Any]:
    """One trace as the page takes it.

    Args:
        trace: what to show.
        size: its gap, for the band of the noise floor; None for no band.
        mended: whether there is a mended model to show beside the one that was given.
        points: about how many samples are shown.
    """
    kept = decimated(trace, points)
    # A restart comes before the first sample that is kept of what follows it.
    starts = np.unique(np.searchsorted(kept, trace.restarts))
    starts = starts[starts < kept.size]
    paused = np.isin(starts, np.searchsorted(kept, _pauses(trace)))
    measured = trace.measured[kept]
    simulated = (trace.before, trace.after) if mended else (trace.before,)
    errors = [values[kept] - measured for values in simulated]
    unit = scale(_largest((measured, *(values[kept] for values in simulated))), trace.unit)
    error_unit = scale(_largest(errors), trace.unit)

    def broken(values: FloatArray, breaks: NDArray[np.bool_]) -> dict[str, Any]:
        """With one more sample before each restart, which is none where the line breaks."""
        return pack(np.insert(values, starts, np.where(breaks, np.nan, values[starts])))

    never, always = np.zeros_like(paused), np.ones_like(paused)
    target = None if trace.target is None else trace.target[kept] * unit.factor
    return {
        "recording": wording.label(trace.recording),
        "joint": wording.label(trace.joint),
        "signal": wording.words(trace.signal),
        "heldOut": trace.held_out,
        "unit": unit.unit,
        "errorUnit": error_unit.unit,
        "errorFactor": error_unit.factor / unit.factor,
        "floor": 0.0 if size is None else size.noise_floor * error_unit.factor,
        "time": broken(trace.time[kept], never),
        "measured": broken(measured * unit.factor, paused),
        "commanded": None if target is None else broken(target, paused),
        "errors": [broken(values * unit.factor, always) for values in errors],
    }


def pack(values: FloatArray, steps: int = _HOLE - 1) -> dict[str, Any]:
    """Numbers as offset + step × sixteen bits; what is no number is 65535.

    `data` has the low bytes of how each differs from the one before it, then the high bytes, which
    packs better.

    Args:
        values: (n,) numbers.
        steps: into how many their range is divided.
    """
    finite = values[np.isfinite(values)]
    offset = float(finite.min()) if finite.size else 0.0
    step = float(np.ptp(finite)) / steps if finite.size else 0.0
    codes = np.full(values.shape, _HOLE, dtype="<u2")
    known = np.isfinite(values)
    codes[known] = np.round((values[known] - offset) / step) if step > 0 else 0
    changes = np.diff(codes, prepend=codes.dtype.type(0))
    planes = changes.view(np.uint8).reshape(-1, 2).T
    data = base64.b64encode(planes.tobytes()).decode()
    return {"offset": offset, "step": step, "data": data}


def unpack(packed: Mapping[str, Any]) -> FloatArray:
    """What `pack` was given, as report.js reads it."""
    planes = np.frombuffer(base64.b64decode(packed["data"]), dtype=np.uint8).reshape(2, -1)
    changes = np.ascontiguousarray(planes.T).view("<u2").reshape(-1)
    codes = np.cumsum(changes, dtype="<u2")
    return np.where(codes == _HOLE, np.nan, packed["offset"] + packed["step"] * codes)


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


def _pauses(trace: Trace) -> NDArray[np.intp]:
    """The restarts before which samples were left out."""
    steps = np.diff(trace.time)
    if not steps.size:
        return trace.restarts
    starts = trace.restarts
    return starts[steps[starts - 1] > _PAUSE * np.median(steps)]


def _largest(group: Iterable[FloatArray]) -> float:
    finite = (values[np.isfinite(values)] for values in group)
    return max((float(np.abs(values).max(initial=0.0)) for values in finite), default=0.0)
