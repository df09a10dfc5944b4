"""What a robot stands on: the points in which it touches the ground, and the area that they span.

soles = soles_at(robot, qpos)                 # one for each rigid body that touches the ground
points = soles[0].where(data)                 # (n, 3) in the world, at another pose
area = Area(np.concatenate([...])[:, :2])     # the support polygon
area.margin(pressure)                         # (T,) how far inside it points are [m]
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from walkerkit.gap.errors import refusal
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.ground_geoms import Ground
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]

_NEAR = 0.03  # m; a keyframe's base may be that much too high or too low
_FAR = 2.0  # m, within which the ground is looked for
_EXACT = 1e-5  # m


@dataclass(frozen=True, kw_only=True)
class Sole:
    """The part of a rigid body that touches the ground.

    Attributes:
        name: of its geom, or of its body.
        body: id of the body that moves; others may be welded to it.
        points: (n, 3) in that body's frame [m].
    """

    name: str
    body: int
    points: FloatArray

    def where(self, data: mujoco.MjData) -> FloatArray:
        """(n, 3) its points in the world's frame, at the pose whose kinematics are known [m]."""
        turned = data.xmat[self.body].reshape(3, 3)
        found: FloatArray = data.xpos[self.body] + self.points @ turned.T
        return found


class Area:
    """The convex hull of points on the ground.

    Args:
        points: (n, 2) in the world's frame [m].

    Attributes:
        centre: (2,) the middle of its corners [m].
        depth: how far a point of it is from its edges at most; 0 where it has no inside, as
            between two points [m].
    """

    def __init__(self, points: FloatArray):
        self.centre: FloatArray = points.mean(axis=0)
        self.depth = 0.0
        self._edges: FloatArray = np.zeros((0, 3))
        try:
            hull = ConvexHull(points)
        except (QhullError, ValueError):
            return
        self._edges = np.array(hull.equations, dtype=np.float64)
        self.centre = points[hull.vertices].mean(axis=0)
        # The largest circle in it: n·x + r ≤ −d for every edge.
        room = np.column_stack([self._edges[:, :2], np.ones(len(self._edges))])
        bounds = [(None, None), (None, None), (0, None)]
        found = linprog([0, 0, -1], A_ub=room, b_ub=-self._edges[:, 2], bounds=bounds)
        self.depth = float(np.array(found.x)[2])

    def margin(self, points: FloatArray) -> FloatArray:
        """(T,) distance of (T, 2) points from its nearest edge, negative outside [m]."""
        if not len(self._edges):
            return np.full(len(points), -np.inf)
        inside: FloatArray = -(points @ self._edges[:, :2].T + self._edges[:, 2]).max(axis=1)
        return inside


def touching(model: mujoco.MjModel, data: mujoco.MjData, ground: Ground) -> list[int]:
    """Which contacts of a pose, whose collisions are known, are with the ground."""
    fixed = {*ground.fixed.tolist()}
    paired = {
        frozenset((int(model.pair_geom1[pair]), int(model.pair_geom2[pair])))
        for pair in ground.pairs
    }
    return [
        k
        for k in range(data.ncon)
        if data.contact[k].dist <= 0
        and (
            fixed.intersection(data.contact[k].geom.tolist())
            or frozenset(data.contact[k].geom.tolist()) in paired
        )
    ]


def collided(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Kinematics and contacts of a pose."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)


def soles_at(robot: Robot, qpos: FloatArray) -> tuple[Sole, ...]:
    """What of a robot touches the ground in a pose, in the order of its bodies.

    Args:
        robot: the robot.
        qpos: (nq,) the pose.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = qpos
    collided(model, data)
    found: dict[int, list[tuple[int, FloatArray]]] = {}
    for k in touching(model, data, Ground(model)):
        contact = data.contact[k]
        # The one of the two that moves; the other is welded to the world.
        geom = max(contact.geom, key=lambda one: model.body_weldid[model.geom_bodyid[one]] != 0)
        body = int(model.body_weldid[model.geom_bodyid[geom]])
        own = data.xmat[body].reshape(3, 3).T @ (contact.pos - data.xpos[body])
        found.setdefault(body, []).append((int(geom), own))
    return tuple(
        Sole(
            name=model.geom(some[0][0]).name or model.body(model.geom_bodyid[some[0][0]]).name,
            body=body,
            points=np.stack([point for _, point in some]),
        )
        for body, some in sorted(found.items())
    )


def put_down(robot: Robot, base: Base) -> FloatArray:
    """The pose of the first keyframe, its base moved up or down until a foot touches the ground.

    Args:
        robot: the robot.
        base: its base.

    Returns:
        (nq,) the pose.

    Raises:
        InputError: the robot is nowhere near the ground there.
    """
    model, data, ground = robot.model, rest(robot.model), Ground(robot.model)
    home: FloatArray = data.qpos.copy()

    def touches(lowered: float) -> bool:
        data.qpos[:] = home
        data.qpos[base.qpos + 2] -= lowered
        collided(model, data)
        return bool(touching(model, data, ground))

    gap = _first(touches)
    where = "first keyframe" if model.nkey else "reference pose (it has no keyframe)"
    if model.nkey and model.key(0).name:
        where = f"keyframe {model.key(0).name!r}"
    if gap is None:
        raise refusal(
            f"{robot.source}: nothing of the robot touches the ground in its {where}, even with "
            f"its base {_FAR:g} m lower. Let feet and ground collide (contype, conaffinity)."
        )
    height = float(home[base.qpos + 2])
    if abs(gap) > _NEAR:
        how = f"{gap:.3f} m above" if gap > 0 else f"{-gap:.3f} m deep in"
        raise refusal(
            f"{robot.source}: in its {where} the robot does not stand: its lowest geom is {how} "
            f"the ground. Make the pose in which it stands the first keyframe; of this one, with "
            f"{height - gap:.4g} in place of {height:.4g} as the height of the base in its qpos."
        )
    home[base.qpos + 2] -= gap
    return home


def _first(touches: Callable[[float], bool]) -> float | None:
    """How far down something first touches, to 10 µm; None where nothing does."""
    steps = np.arange(-_FAR, _FAR, _NEAR / 2)
    hit = next((float(step) for step in steps if touches(float(step))), None)
    if hit is None:
        return None
    low, high = hit - _NEAR / 2, hit
    while high - low > _EXACT:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if touches(middle) else (middle, high)
    return high
