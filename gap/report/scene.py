"""What a page needs to draw a robot in three dimensions: its bodies, its shapes, how it moved.

    scene(model, vertices=6000)      # bodies with their joints, and what is seen of them
    frames(motion, 0, mended=True)   # positions of the joints, frame by frame

A browser finds the poses from these as `mj_kinematics` does. Meshes are drawn coarsely.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.report import wording
from walkerkit.gap.report.motion import WHICH, Motion
from walkerkit.gap.report.samples import pack
from walkerkit.gap.report.shapes import shapes
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]
Faces = NDArray[np.int64]

_JOINT = mujoco.mjtJoint
_JOINTS = {
    int(_JOINT.mjJNT_FREE): "free",
    int(_JOINT.mjJNT_BALL): "ball",
    int(_JOINT.mjJNT_SLIDE): "slide",
    int(_JOINT.mjJNT_HINGE): "hinge",
}
_CELLS = (128, 96, 64, 48, 32, 24, 16, 12, 8, 6, 4, 3, 2)  # along a mesh's longest side
_MESH_STEPS = 1023  # of its size, to which a vertex is kept
_DIGITS = 7


def scene(model: mujoco.MjModel, *, vertices: int) -> dict[str, Any]:
    """A robot as the page draws it.

    Args:
        model: the compiled model.
        vertices: of all meshes together, at most about.

    Returns:
        What JSON can hold: `bodies` in MuJoCo's order, `geoms` on them, `meshes` that these are of,
        and `qpos` at rest.
    """
    seen = shapes(model)
    used = sorted({one.mesh for one in seen if one.kind == "mesh"})
    number = {mesh: k for k, mesh in enumerate(used)}
    most = max(8, vertices // max(1, len(used)))
    return {
        "bodies": [_body(model, body) for body in range(model.nbody)],
        "geoms": [
            {
                "body": one.body,
                "shape": one.kind,
                "size": _short(one.size),
                "pos": _short(one.pos),
                "quat": _short(one.quat),
                "mesh": number.get(one.mesh, -1),
                "bound": round(one.bound, _DIGITS),
                "moves": one.moves,
            }
            for one in seen
        ],
        "meshes": [_mesh(*simplified(*mesh(model, k), most)) for k in used],
        "qpos": _short(rest(model).qpos),
    }


def frames(motion: Motion, index: int, *, mended: bool) -> dict[str, Any]:
    """One motion as the page draws it.

    Args:
        motion: what moved.
        index: of its scene.
        mended: whether there is a mended model to show beside the one that was given.
    """
    shown = [which for which in WHICH if mended or which != "after"]
    return {
        "recording": wording.label(motion.recording),
        "scene": index,
        "whole": motion.whole,
        "time": pack(motion.time),
        "addresses": list(motion.addresses),
        **{which: [pack(column) for column in getattr(motion, which).T] for which in shown},
        "absent": [wording.label(name) for name in motion.absent],
        "estimated": motion.base_estimated,
    }


def mesh(model: mujoco.MjModel, index: int) -> tuple[FloatArray, Faces]:
    """Vertices (n, 3) in the frame of its geoms [m], and faces (m, 3)."""
    first, count = int(model.mesh_vertadr[index]), int(model.mesh_vertnum[index])
    face, faces = int(model.mesh_faceadr[index]), int(model.mesh_facenum[index])
    vertices = np.asarray(model.mesh_vert[first : first + count], dtype=np.float64)
    return vertices, np.asarray(model.mesh_face[face : face + faces], dtype=np.int64)


def simplified(vertices: FloatArray, faces: Faces, most: int) -> tuple[FloatArray, Faces]:
    """A mesh of fewer vertices: those of a cell of space become one, in their middle.

    Args:
        vertices: (n, 3) [m].
        faces: (m, 3) indices.
        most: vertices that are left, at most about.

    Returns:
        The same of the simpler mesh, without faces that have no area.
    """
    if len(vertices) <= most:
        return vertices, faces
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    for cells in _CELLS:
        cell = np.minimum((vertices - low) * (cells / size), cells - 1).astype(np.int64)
        _, member = np.unique(cell, axis=0, return_inverse=True)
        member = member.reshape(-1)
        if member.max() < most:
            break
    count = np.bincount(member)
    sums = [np.bincount(member, weights=vertices[:, axis]) for axis in range(3)]
    merged = member[faces]
    flat = (merged == np.roll(merged, 1, axis=1)).any(axis=1)
    _, first = np.unique(np.sort(merged[~flat], axis=1), axis=0, return_index=True)
    return np.stack(sums, axis=1) / count[:, None], merged[~flat][np.sort(first)]


def _mesh(vertices: FloatArray, faces: Faces) -> dict[str, Any]:
    return {
        "vertices": [pack(column, steps=_MESH_STEPS) for column in vertices.T],
        "faces": faces.reshape(-1).tolist(),
    }


def _body(model: mujoco.MjModel, body: int) -> dict[str, Any]:
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    return {
        "parent": int(model.body_parentid[body]),
        "pos": _short(model.body_pos[body]),
        "quat": _short(model.body_quat[body]),
        "joints": [
            {
                "type": _JOINTS[int(model.jnt_type[j])],
                "pos": _short(model.jnt_pos[j]),
                "axis": _short(model.jnt_axis[j]),
                "at": int(model.jnt_qposadr[j]),
                "ref": round(float(model.qpos0[model.jnt_qposadr[j]]), _DIGITS),
            }
            for j in range(first, first + count)
        ],
    }


def _short(values: Sequence[float] | FloatArray) -> list[float]:
    return [round(float(value), _DIGITS) for value in values]
