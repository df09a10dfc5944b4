"""Some poses of a motion as lines, for browsers without WebGL, for paper, and to see at a glance.

drawn(motion)      # what report.html.j2 makes SVG of
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.report.motion import Motion, Which
from walkerkit.gap.report.shapes import placed, shapes

FloatArray = NDArray[np.float64]

_POSES = 5
_SIZE, _MARGIN = 160.0, 12.0  # of a picture, in its own units
_AZIMUTH, _ELEVATION = -1.0, 0.3  # rad, of the eye, as in view.js
_LONG = ("capsule", "cylinder")
_SHORTEST = 1e-3  # m, of a line that is drawn


def drawn(motion: Motion, *, mended: bool) -> list[dict[str, Any]]:
    """Pictures of a motion, evenly spaced in time, all to one scale.

    Args:
        motion: what moved.
        mended: whether there is a mended model to show beside the one that was given.

    Returns:
        Of each its `time` [s], and as `lines` pairs of what they are of and an SVG path, what lies
        below first; none where the robot has nothing to draw.
    """
    frames = np.unique(np.linspace(0, motion.time.size - 1, _POSES).round().astype(int)).tolist()
    shown: Sequence[Which] = [w for w in ("after", "before", "measured") if mended or w != "after"]
    seen = {which: skeletons(motion, which, frames) for which in shown}
    flat = {which: [_flat(lines) for lines in some] for which, some in seen.items()}
    finite = [
        lines[np.isfinite(lines).all(axis=(1, 2))].reshape(-1, 2)
        for lines in flat["measured"]
        if np.isfinite(lines).any()
    ]
    if not any(some.size for some in finite):
        return []
    # One scale and, but for a base that goes away, one place for all.
    middles = [(some.min(axis=0) + some.max(axis=0)) / 2 for some in finite]
    every = np.concatenate(finite)
    floats = any(name.startswith("base/") for name in motion.joints)
    middle = (every.min(axis=0) + every.max(axis=0)) / 2
    sizes = [
        np.abs(some - (own if floats else middle)).max()
        for some, own in zip(finite, middles, strict=True)
    ]
    zoom = (_SIZE / 2 - _MARGIN) / max(*sizes, _SHORTEST)
    pictures = []
    for k, frame in enumerate(frames):
        own = flat["measured"][k].reshape(-1, 2)
        at = middle
        if floats and np.isfinite(own).all():
            at = (own.min(axis=0) + own.max(axis=0)) / 2
        lines = [(which, _path(flat[which][k], at, zoom)) for which in shown]
        pictures.append({"time": f"{motion.time[frame]:.2f} s", "lines": lines})
    return pictures


def skeletons(motion: Motion, which: Which, frames: Sequence[int]) -> list[FloatArray]:
    """Lines in space through what moves, (n, 2, 3) [m] of each frame; NaN where it has no pose."""
    model, data = motion.model, mujoco.MjData(motion.model)
    qpos = motion.qpos(which)
    seen = [one for one in shapes(model) if one.moves]
    rods = np.array([one.size[1] if one.kind in _LONG else 0.0 for one in seen])
    origins = [one.body for one in seen if one.kind not in _LONG]
    linked = [
        b
        for b in range(1, model.nbody)
        if model.body_weldid[b] and model.body_weldid[model.body_parentid[b]]
    ]
    found = []
    for frame in frames:
        fine = bool(np.isfinite(qpos[frame]).all())
        data.qpos[:] = qpos[frame] if fine else model.qpos0
        mujoco.mj_kinematics(model, data)
        places, axes = placed(seen, data)
        axes *= rods[:, None]
        ends = [
            np.stack([places - axes, places + axes], axis=1)[rods > 0],
            np.stack([data.xpos[origins], places[rods == 0]], axis=1),
            np.stack([data.xpos[model.body_parentid[linked]], data.xpos[linked]], axis=1),
        ]
        lines = np.concatenate(ends)
        found.append(lines if fine else np.full(lines.shape, np.nan))
    return found


def _flat(lines: FloatArray) -> FloatArray:
    """Lines (n, 2, 3) as seen from afar, (n, 2, 2): to the right and up [m]."""
    sin, cos = np.sin(_AZIMUTH), np.cos(_AZIMUTH)
    right = np.array([-sin, cos, 0.0])
    back = np.array([np.cos(_ELEVATION) * cos, np.cos(_ELEVATION) * sin, np.sin(_ELEVATION)])
    return np.asarray(lines @ np.stack([right, np.cross(back, right)], axis=1))


def _path(lines: FloatArray, middle: FloatArray, zoom: float) -> str:
    """An SVG path of lines (n, 2, 2) [m]; their middle is that of the picture."""
    if not np.isfinite(lines).all():
        return ""
    long = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) > _SHORTEST
    places = (lines[long] - middle) * zoom * np.array([1.0, -1.0]) + _SIZE / 2
    return "".join(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for (a, b), (c, d) in places)
