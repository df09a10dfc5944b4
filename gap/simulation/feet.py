"""The feet of a robot that floats: what it stands on, where that is, and how it moves.

    feet = find_feet(model, base)                   # (Foot(name="FL_foot", ...), ...)
    legs = Legs(model, base, feet, qpos, qvel, errors)    # along a log
    point = legs.point(0, down)                     # (T, 3) the first's lowest, in the base's frame
    legs.velocity(0, point)                         # (T, 3) of that point against the base

A foot is a rigid body that reaches as low as the lowest, in the model's first keyframe, with what
of it can touch the ground. So a flat foot is one, whatever it is made of, and hands are none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.ground_geoms import Ground
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]

_AS_LOW = 0.15  # of the base's height over its lowest foot
_SOLE = 5e-3  # m above a foot's lowest point, what touches down with it


@dataclass(frozen=True, kw_only=True)
class Foot:
    """A rigid body that the robot stands on.

    Attributes:
        name: of its first geom that touches the ground, or of its body.
        body: id of the body that moves; others may be welded to it.
        geoms: ids of what of it touches the ground first.
        reach: ids of all of it that can touch the ground.
        distance: of its lowest point from the origin of the body that moves [m].
        names: by which a log may call it: bodies, geoms and sites of it, the end of its leg first.
    """

    name: str
    body: int
    geoms: tuple[int, ...]
    reach: tuple[int, ...]
    distance: float
    names: tuple[str, ...]


def find_feet(model: mujoco.MjModel, base: Base | None) -> tuple[Foot, ...]:
    """The feet of a robot, in the order of its bodies.

    Args:
        model: the model, with its ground.
        base: what floats; None for a robot that is mounted, which has no feet.
    """
    if base is None:
        return ()
    ground = Ground(model)
    paired = np.concatenate([model.pair_geom1[ground.pairs], model.pair_geom2[ground.pairs]])
    own = np.unique([*ground.moving, *paired]).astype(np.intp)
    own = own[model.body_rootid[model.geom_bodyid[own]] == base.id]
    if not own.size:
        return ()
    data = rest(model)
    mujoco.mj_kinematics(model, data)
    up = -_direction_of_gravity(model)
    low = np.array([float(lowest(model, data, geom, -up) @ up) for geom in own])
    height = float(data.xpos[base.id] @ up) - float(low.min())
    rigid = model.body_weldid[model.geom_bodyid[own]]
    bodies = dict.fromkeys(int(one) for one in rigid)
    least = {body: float(low[rigid == body].min()) for body in bodies}
    # A shin is nearly as low as the foot that it carries.
    shins = {
        above
        for body in bodies
        for above in _above(model, body)
        if above != base.id and above in least and least[above] > least[body]
    }
    feet = []
    for body in bodies:
        reach, depth = own[rigid == body], low[rigid == body]
        if body in shins or depth.min() > low.min() + _AS_LOW * max(height, 0.0):
            continue
        sole = reach[depth <= depth.min() + _SOLE]
        feet.append(
            Foot(
                name=next(
                    (name for geom in sole if (name := model.geom(geom).name)),
                    model.body(model.geom_bodyid[sole[0]]).name or f"body {body}",
                ),
                body=body,
                geoms=tuple(int(one) for one in sole),
                reach=tuple(int(one) for one in reach),
                distance=float(
                    np.linalg.norm(lowest(model, data, int(sole[0]), -up) - data.xpos[body])
                ),
                names=_names(model, body),
            )
        )
    return tuple(feet)


def _above(model: mujoco.MjModel, body: int) -> Iterator[int]:
    """The bodies between a body and the world."""
    while body := int(model.body_parentid[body]):
        yield body


def _names(model: mujoco.MjModel, body: int) -> tuple[str, ...]:
    """Names of a rigid body and of what is on it."""
    welded = np.flatnonzero(model.body_weldid == body)[::-1]
    found = [model.body(one).name for one in welded]
    for number, owner, kind in (
        (model.ngeom, model.geom_bodyid, model.geom),
        (model.nsite, model.site_bodyid, model.site),
    ):
        found += [kind(k).name for k in range(number) if owner[k] in welded]
    return tuple(dict.fromkeys(name for name in found if name))


def in_frame_of(model: mujoco.MjModel, body: int, shank: int) -> FloatArray:
    """(3, 3) turns row vectors in the frame of a shank into those of a body welded to it."""
    turned, one = np.eye(3), np.empty(9)
    while body != shank:
        mujoco.mju_quat2Mat(one, model.body_quat[body])
        turned = one.reshape(3, 3) @ turned
        body = int(model.body_parentid[body])
    return turned


def _direction_of_gravity(model: mujoco.MjModel) -> FloatArray:
    """The unit vector in which things fall; straight down where nothing does."""
    size = float(np.linalg.norm(model.opt.gravity))
    down: FloatArray = model.opt.gravity / size if size else np.array([0.0, 0.0, -1.0])
    return down


def lowest(model: mujoco.MjModel, data: mujoco.MjData, geom: int, down: FloatArray) -> FloatArray:
    """The point of a geom that is furthest in a direction, (3,) in the world's frame [m]."""
    frame = data.geom_xmat[geom].reshape(1, 3, 3)
    point: FloatArray = _support(model, geom, data.geom_xpos[geom][None], frame, down[None])[0]
    return point


def _support(
    model: mujoco.MjModel, geom: int, centre: FloatArray, frame: FloatArray, down: FloatArray
) -> FloatArray:
    """Points of a geom that are furthest in (T, 3) directions, (T, 3).

    Args:
        model: the model.
        geom: its id.
        centre: (T, 3) where it is [m].
        frame: (T, 3, 3) how it is turned.
        down: (T, 3) unit vectors.
    """
    own = np.einsum("tji,tj->ti", frame, down)  # in the geom's frame
    size = model.geom_size[geom]
    kinds = mujoco.mjtGeom
    match int(model.geom_type[geom]):
        case kinds.mjGEOM_SPHERE:
            at = size[0] * own
        case kinds.mjGEOM_CAPSULE:
            at = size[0] * own
            at[:, 2] += size[1] * np.sign(own[:, 2])
        case kinds.mjGEOM_ELLIPSOID:
            scaled = size * own
            at = size * scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
        case kinds.mjGEOM_CYLINDER:
            flat = np.linalg.norm(own[:, :2], axis=1, keepdims=True)
            at = size[0] * own / np.where(flat > 1e-9, flat, np.inf)
            at[:, 2] = size[1] * np.sign(own[:, 2])
        case kinds.mjGEOM_BOX:
            at = size * np.sign(own)
        case kinds.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
            vertices = model.mesh_vert[first : first + count].astype(np.float64)
            at = vertices[np.argmax(own @ vertices.T, axis=1)]
        case _:
            at = np.zeros_like(own)
    point: FloatArray = centre + np.einsum("tij,tj->ti", frame, at)
    return point


class Legs:
    """Where feet are along a log, and how fast, as seen from the base.

    Args:
        model: the model.
        base: its base.
        feet: its feet.
        qpos: (T, nq) joints where they were measured; where the base is does not matter.
        qvel: (T, nv) their speeds.
        errors: (nv,) standard deviations of those speeds, 0 of what is no measured joint.

    Attributes:
        rows: how many instants.
        noise: (n_feet,) standard deviation of a foot's velocity for the sake of those [m/s].
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        base: Base,
        feet: Sequence[Foot],
        qpos: FloatArray,
        qvel: FloatArray,
        errors: FloatArray,
    ):
        self._model, self._feet = model, feet
        rows, count = len(qpos), len(feet)
        self.rows = rows
        self._centre = [np.empty((rows, len(foot.reach), 3)) for foot in feet]
        self._frame = [np.empty((rows, len(foot.reach), 3, 3)) for foot in feet]
        self._moving = np.empty((rows, count, 6))
        self._origin = np.empty((rows, count, 3))
        data = rest(model)
        jacobian = np.empty((3, model.nv))
        squares, looks = np.zeros(count), range(0, rows, max(1, rows // 20))
        pose, free = slice(base.qpos, base.qpos + 7), slice(base.dof, base.dof + 6)
        for t in range(rows):
            data.qpos[:], data.qvel[:] = qpos[t], qvel[t]
            # Everything is seen from a base that stays at the origin.
            data.qpos[pose], data.qvel[free] = (0, 0, 0, 1, 0, 0, 0), 0
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            for f, foot in enumerate(feet):
                reach = list(foot.reach)
                self._centre[f][t] = data.geom_xpos[reach]
                self._frame[f][t] = data.geom_xmat[reach].reshape(-1, 3, 3)
                mujoco.mj_objectVelocity(
                    model, data, mujoco.mjtObj.mjOBJ_XBODY, foot.body, self._moving[t, f], 0
                )
                self._origin[t, f] = data.xpos[foot.body]
                if t in looks:
                    mujoco.mj_jac(
                        model, data, jacobian, None, data.geom_xpos[reach].mean(axis=0), foot.body
                    )
                    squares[f] += float(np.square(jacobian * errors).sum()) / 3
        self.noise: FloatArray = np.sqrt(squares / len(looks))

    def point(self, foot: int, down: FloatArray) -> FloatArray:
        """A foot's lowest point, where (T, 3) unit vectors of the base's frame are down: (T, 3)."""
        geoms = self._feet[foot].reach
        points = np.stack(
            [
                _support(self._model, g, self._centre[foot][:, k], self._frame[foot][:, k], down)
                for k, g in enumerate(geoms)
            ],
            axis=1,
        )
        best = np.argmax(np.einsum("tgi,ti->tg", points, down), axis=1)
        found: FloatArray = points[np.arange(len(points)), best]
        return found

    def velocity(self, foot: int, point: FloatArray) -> FloatArray:
        """Velocity against the base of (T, 3) points that are fixed to a foot, (T, 3) [m/s]."""
        turning, moving = self._moving[:, foot, :3], self._moving[:, foot, 3:]
        found: FloatArray = moving + np.cross(turning, point - self._origin[:, foot])
        return found
