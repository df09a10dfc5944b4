"""What is seen of a robot: its geoms, and rods where a body that moves has none.

shapes(model)       # as bodies carry them
clad(spec, model)   # the model with such rods, for a renderer
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_GEOM = mujoco.mjtGeom
_KINDS = {
    int(_GEOM.mjGEOM_PLANE): "plane",
    int(_GEOM.mjGEOM_SPHERE): "sphere",
    int(_GEOM.mjGEOM_CAPSULE): "capsule",
    int(_GEOM.mjGEOM_ELLIPSOID): "ellipsoid",
    int(_GEOM.mjGEOM_CYLINDER): "cylinder",
    int(_GEOM.mjGEOM_BOX): "box",
    int(_GEOM.mjGEOM_MESH): "mesh",
}
_SEEN_GROUPS = 3  # of geoms, that viewers show
_THICKNESS, _THINNEST = 0.06, 0.002  # radius of rods: of the longest one's length; m
_SHORTEST = 1e-4  # m


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One thing that is seen.

    Attributes:
        body: id of its body.
        kind: MuJoCo's name of the type of geom.
        size: (3,) as of a geom [m].
        pos, quat: where it is on its body [m, real part first].
        mesh: id of its mesh, or -1.
        bound: radius of a ball about `pos` that holds it [m].
        moves: whether its body does.
    """

    body: int
    kind: str
    size: FloatArray
    pos: FloatArray
    quat: FloatArray
    mesh: int
    bound: float
    moves: bool


def shapes(model: mujoco.MjModel) -> tuple[Shape, ...]:
    """All that is seen: the geoms that are, and rods where a body that moves has none.

    Height fields are left out.

    Args:
        model: the compiled model.
    """
    found = [
        Shape(
            body=int(model.geom_bodyid[g]),
            kind=_KINDS[int(model.geom_type[g])],
            size=np.array(model.geom_size[g]),
            pos=np.array(model.geom_pos[g]),
            quat=np.array(model.geom_quat[g]),
            mesh=int(model.geom_dataid[g]),
            bound=float(model.geom_rbound[g]),
            moves=bool(model.body_weldid[model.geom_bodyid[g]]),
        )
        for g in seen_geoms(model)
        if int(model.geom_type[g]) in _KINDS
    ]
    return (*found, *(_rod(*rod) for rod in _rods(model)))


def seen_geoms(model: mujoco.MjModel) -> list[int]:
    """The geoms that are seen: a body's visible ones, else those that it collides with."""
    visible = (model.geom_group < _SEEN_GROUPS) & (model.geom_rgba[:, 3] > 0)
    clothed = {int(body) for body in model.geom_bodyid[visible]}
    return [g for g in range(model.ngeom) if visible[g] or int(model.geom_bodyid[g]) not in clothed]


def clad(spec: mujoco.MjSpec, model: mujoco.MjModel) -> mujoco.MjModel:
    """The model with rods where a body that moves has no geom; itself where none is missing.

    Args:
        spec: what the model is compiled from.
        model: the compiled model.
    """
    rods = list(_rods(model))
    if not rods:
        return model
    own = spec.copy()
    for body, start, end, radius in rods:
        own.bodies[body].add_geom(
            type=_GEOM.mjGEOM_CAPSULE,
            fromto=[*start, *end],
            size=[radius, 0, 0],
            mass=0,
            contype=0,
            conaffinity=0,
        )
    return own.compile()


def _rods(model: mujoco.MjModel) -> Iterator[tuple[int, FloatArray, FloatArray, float]]:
    """Body, both ends on it and radius [m] of what stands for bodies that move without a geom."""
    clothed = {int(body) for body in model.geom_bodyid}
    bare = [b for b in range(1, model.nbody) if model.body_weldid[b] and b not in clothed]
    ends = []
    for body in bare:
        children = np.flatnonzero(model.body_parentid == body)
        far = [np.array(model.body_pos[child]) for child in children]
        # What has a child off its own origin reaches there; an end, to about its length.
        far = [end for end in far if np.linalg.norm(end) > _SHORTEST] or [
            2 * np.array(model.body_ipos[body])
        ]
        ends += [(body, end) for end in far if np.linalg.norm(end) > _SHORTEST]
    longest = max((float(np.linalg.norm(end)) for _, end in ends), default=0.0)
    radius = max(_THICKNESS * longest, _THINNEST)
    for body, end in ends:
        yield body, np.zeros(3), end, radius


def _rod(body: int, start: FloatArray, end: FloatArray, radius: float) -> Shape:
    half = float(np.linalg.norm(end - start)) / 2
    quat = np.zeros(4)
    mujoco.mju_quatZ2Vec(quat, end - start)
    return Shape(
        body=body,
        kind="capsule",
        size=np.array([radius, half, 0.0]),
        pos=(start + end) / 2,
        quat=quat,
        mesh=-1,
        bound=half + radius,
        moves=True,
    )


def placed(every: Sequence[Shape], data: mujoco.MjData) -> tuple[FloatArray, FloatArray]:
    """Where shapes are in the world, (n, 3) [m], and along what their z axes are, (n, 3).

    Args:
        every: shapes of a model.
        data: of the same, with its kinematics done.
    """
    places, axes = np.zeros((len(every), 3)), np.zeros((len(every), 3))
    turn = np.zeros(9)
    for k, one in enumerate(every):
        body = data.xmat[one.body].reshape(3, 3)
        mujoco.mju_quat2Mat(turn, one.quat)
        places[k] = data.xpos[one.body] + body @ one.pos
        axes[k] = body @ turn.reshape(3, 3)[:, 2]
    return places, axes
