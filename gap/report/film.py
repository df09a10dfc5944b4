"""A motion as a video: measured as a ghost over simulated, as given on the left, mended beside it.

    python -m walkerkit.gap.report.film '{"folder": "diagnosis", "out": "walk.mp4"}'

It is a program of its own, since what MuJoCo renders with is chosen before MuJoCo is imported.
"""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.report.motion import Motion, Which, load_motions
from walkerkit.gap.report.shapes import seen_geoms

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

WIDTH, HEIGHT = 640, 480
"""Pixels of one panel."""
_INKS = {"before": (0.84, 0.37, 0.0, 1.0), "after": (0.0, 0.45, 0.7, 1.0)}  # as in the report
_GHOST = (0.85, 0.85, 0.85, 0.45)
_AZIMUTH, _ELEVATION = 123.0, -17.0  # degrees
_CLOSE = 0.9  # of the distance at which all would be seen for certain
_UNSEEN = 5  # group of geoms
_SOME = 30  # frames that tell how far a motion reaches


def pictures(motion: Motion, *, factor: float = 1.0) -> Iterator[Picture]:
    """Renders a motion frame by frame.

    Args:
        motion: what moved.
        factor: how many times as large as they are errors are drawn.

    Yields:
        (480, 640, 3), twice as wide where a mended model is beside the given one.
    """
    model = copy.copy(motion.model)
    model.vis.global_.offwidth = max(WIDTH, int(model.vis.global_.offwidth))
    model.vis.global_.offheight = max(HEIGHT, int(model.vis.global_.offheight))
    seen = seen_geoms(model)
    model.geom_group[:] = _UNSEEN
    model.geom_group[seen] = 0
    shown: tuple[Which, ...] = ("before", "after") if motion.mended else ("before",)
    qpos = {which: motion.qpos(which, factor) for which in ("measured", *shown)}
    middles, radius = _extent(model, qpos["measured"], seen)
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation = _AZIMUTH, _ELEVATION
    camera.distance = _CLOSE * radius / np.sin(np.radians(model.vis.global_.fovy) / 2)
    follows = any(name.startswith("base/") for name in motion.joints)
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        for costly in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[costly] = False
        for frame in range(motion.time.size):
            camera.lookat[:] = middles[frame] if follows else np.nanmean(middles, axis=0)
            ghost = _posed(model, qpos["measured"][frame])
            panels = [
                _panel(renderer, camera, _posed(model, qpos[which][frame]), ghost, _INKS[which])
                for which in shown
            ]
            yield np.concatenate(panels, axis=1)


def write_video(motion: Motion, path: Path, *, factor: float = 1.0) -> None:
    """Writes a motion as an mp4.

    Args:
        motion: what moved, of at least one frame.
        path: the file; one that is there is replaced.
        factor: how many times as large as they are errors are drawn.
    """
    from imageio_ffmpeg import write_frames

    step = float(np.median(np.diff(motion.time))) if motion.time.size > 1 else 1.0
    every = pictures(motion, factor=factor)
    first = next(every)
    writer = write_frames(str(path), (first.shape[1], first.shape[0]), fps=round(1 / step, 3))
    writer.send(None)
    for picture in (first, *every):
        writer.send(np.ascontiguousarray(picture))
    writer.close()


def _posed(model: mujoco.MjModel, qpos: FloatArray) -> mujoco.MjData | None:
    """The model at some positions; None where it has none."""
    if not np.isfinite(qpos).all():
        return None
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    return data


def _extent(
    model: mujoco.MjModel, qpos: FloatArray, seen: Sequence[int]
) -> tuple[FloatArray, float]:
    """The middle of what is seen to move in each frame, (n, 3) [m], and how far it reaches [m]."""
    moving = [g for g in seen if model.body_weldid[model.geom_bodyid[g]]]
    middles, found = np.full((len(qpos), 3), np.nan), [1e-2]
    every = max(1, len(qpos) // _SOME)
    for frame, row in enumerate(qpos):
        data = _posed(model, row)
        if data is None or not moving:
            middles[frame] = middles[frame - 1] if frame else 0.0
            continue
        places = data.geom_xpos[moving]
        middles[frame] = places.mean(axis=0)
        if frame % every == 0:
            off = np.linalg.norm(places - middles[frame], axis=1)
            found.append(float((off + model.geom_rbound[moving]).max()))
    return np.nan_to_num(middles), max(found)


def _panel(
    renderer: mujoco.Renderer,
    camera: mujoco.MjvCamera,
    simulated: mujoco.MjData | None,
    measured: mujoco.MjData | None,
    ink: tuple[float, ...],
) -> Picture:
    """One simulated robot under its ghost; what has no pose is left out."""
    model, scene = renderer.model, renderer.scene
    renderer.update_scene(simulated or measured or mujoco.MjData(model), camera)
    for geom in scene.geoms[: scene.ngeom]:
        if geom.category == mujoco.mjtCatBit.mjCAT_DYNAMIC:
            geom.rgba[:] = ink if simulated is not None else (0, 0, 0, 0)
            geom.matid = -1
    if measured is not None:
        own = scene.ngeom
        mujoco.mjv_addGeoms(
            model,
            measured,
            mujoco.MjvOption(),
            mujoco.MjvPerturb(),
            mujoco.mjtCatBit.mjCAT_DYNAMIC.value,
            scene,
        )
        for geom in scene.geoms[own : scene.ngeom]:
            geom.rgba[:] = _GHOST
            geom.matid = -1
            geom.transparent = 1
    return np.asarray(renderer.render(), dtype=np.uint8)


def main(wanted: dict[str, Any]) -> None:
    """Writes the video that is asked for: `folder`, `motion`, `out`, `factor`, `allow_outside`."""
    motions = load_motions(wanted["folder"], allow_outside=wanted.get("allow_outside", False))
    motion = motions[wanted.get("motion", 0)]
    write_video(motion, Path(wanted["out"]), factor=wanted.get("factor", 1.0))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
