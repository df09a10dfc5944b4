"""`Stand` and `TrackVelocity` for many copies: the same terms, from arrays."""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.tasks import batched_rewards, stand, track_velocity
from walkerkit.tasks.vector.copies import Copies
from walkerkit.tasks.vector.vector_task import Function, VectorTask

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_TOUCH: Final = "walkerkit/touch"
_SEEN_AT: Final = 0.01  # m; farther from the ground than this, the distance does not matter


class UprightCopies(VectorTask):
    """Trunks of many copies, and whether they fell; see `tasks.trunk` and `tasks.falls`.

    Args:
        task: the task that begins the episodes.
    """

    def __init__(self, task: Any):
        self._task = task
        self._touch: list[tuple[str, float]] = []

    def edit(self, spec: mujoco.MjSpec, physics: Any) -> None:
        """Measures the distance to the ground of what must not touch it.

        The batch does not tell its contacts.
        """
        if not self._task.fall_limits.contact:
            return
        model = physics.model.ptr
        for own, ground in self._task.ground.watched:
            name = f"{_TOUCH}_{len(self._touch)}"
            margin = max(model.geom_margin[own], model.geom_margin[ground])
            spec.add_sensor(
                name=name,
                type=mujoco.mjtSensor.mjSENS_GEOMDIST,
                objtype=mujoco.mjtObj.mjOBJ_GEOM,
                objname=model.geom(own).name,
                reftype=mujoco.mjtObj.mjOBJ_GEOM,
                refname=model.geom(ground).name,
                cutoff=margin + _SEEN_AT,
            )
            self._touch.append((name, margin))

    def attach(self, copies: Copies) -> None:
        """As in `VectorTask`."""
        model, n = copies.model, copies.n_sims
        self._body = int(copies.physics.bind(copies.walker.root_body).element_id)
        self._tree = int(model.body_rootid[self._body])
        self._distances = np.array(
            [model.sensor(name).adr[0] for name, _ in self._touch], dtype=np.intp
        )
        self._margins = np.array([margin for _, margin in self._touch])
        self._effort_limits = copies.drivetrain.joints.efforts
        self._positions_at = self._task.positions_at
        self._home = np.zeros((n, 3, 3))
        self._home_height = np.ones(n)
        self._home_pose = np.zeros((n, len(self._positions_at)))
        for name in ("xpos", "xmat", "cvel", "subtree_com", "sensordata"):
            copies.field(name)

    def begin(self, row: int) -> None:
        """As in `VectorTask`."""
        trunk = self._task.trunk
        self._home[row], self._home_height[row] = trunk.home, trunk.home_height
        self._home_pose[row] = self._task.home_pose

    @abc.abstractmethod
    def terms(self, copies: Copies) -> dict[str, FloatArray]:
        """The terms of the reward, (n_sims,) each, as `reward_terms` of the task."""

    def reward(self, copies: Copies) -> FloatArray:
        """As in `VectorTask`."""
        return batched_rewards.weighted_mean(self.terms(copies), self._task.weights)

    def terminated(self, copies: Copies) -> BoolArray:
        """The walkers that fell."""
        limits = self._task.fall_limits
        fallen = self.cos_tilt(copies) < math.cos(limits.tilt)
        fallen |= self.height(copies) < limits.height * self._home_height
        if limits.contact:
            distances = copies.field("sensordata")[:, self._distances]
            fallen |= (distances < self._margins).any(axis=1)
        return np.asarray(fallen)

    # Of the trunk.

    def cos_tilt(self, copies: Copies) -> FloatArray:
        """As `Trunk.cos_tilt`, (n_sims,)."""
        return np.asarray(np.sum(self._orientation(copies)[:, 2] * self._home[:, 2], axis=-1))

    def height(self, copies: Copies) -> FloatArray:
        """As `Trunk.height` [m], (n_sims,)."""
        return np.asarray(copies.field("xpos")[:, self._body, 2])

    def velocity(self, copies: Copies) -> FloatArray:
        """As `Trunk.velocity` [m/s; m/s; rad/s], (n_sims, 3)."""
        angular, linear = np.split(copies.field("cvel")[:, self._body], 2, axis=-1)
        # MuJoCo gives the velocity of a point at the centre of mass of the whole tree.
        lever = copies.field("xpos")[:, self._body] - copies.field("subtree_com")[:, self._tree]
        x, y, _ = (linear - np.cross(lever, angular)).T
        now, home = self._orientation(copies), self._home
        facing = np.einsum("nij,nj->ni", now[:, :2], home[:, 0])
        norm = np.hypot(*facing.T)
        some = norm > 0
        cos = np.divide(facing[:, 0], norm, out=np.ones_like(norm), where=some)
        sin = np.divide(facing[:, 1], norm, out=np.zeros_like(norm), where=some)
        return np.stack([cos * x + sin * y, cos * y - sin * x, angular[:, 2]], axis=-1)

    def pose_error(self, copies: Copies) -> FloatArray:
        """How far the joints are from home [rad; m], (n_sims, n_joints)."""
        return np.asarray(copies.field("qpos")[:, self._positions_at] - self._home_pose)

    def low_effort(self, copies: Copies) -> FloatArray:
        """The term `effort`, (n_sims,)."""
        return batched_rewards.low_effort(copies.actuators.applied_effort, self._effort_limits)

    def _orientation(self, copies: Copies) -> FloatArray:
        return np.asarray(copies.field("xmat")[:, self._body].reshape(-1, 3, 3))


class StandCopies(UprightCopies):
    """`tasks.stand`."""

    def terms(self, copies: Copies) -> dict[str, FloatArray]:
        """As `Stand.reward_terms`."""
        home = self._home_height
        risen = (self.height(copies) - home)[:, None]
        return {
            "upright": batched_rewards.upright(self.cos_tilt(copies)),
            "height": batched_rewards.closeness(risen, stand.HEIGHT_SCALE * home[:, None]),
            "pose": batched_rewards.closeness(self.pose_error(copies), stand.POSE_SCALE),
            "effort": self.low_effort(copies),
        }


class TrackVelocityCopies(UprightCopies):
    """`tasks.track_velocity`."""

    def attach(self, copies: Copies) -> None:
        """As in `VectorTask`."""
        super().attach(copies)
        self._command = np.zeros((copies.n_sims, 3))

    def begin(self, row: int) -> None:
        """As in `VectorTask`."""
        super().begin(row)
        self._command[row] = self._task.command

    def observations(self) -> Mapping[str, Function]:
        """`command`."""
        return {"command": lambda _: self._command}

    def terms(self, copies: Copies) -> dict[str, FloatArray]:
        """As `TrackVelocity.reward_terms`."""
        error = self.velocity(copies) - self._command
        planar = np.hypot(error[:, 0], error[:, 1])
        return {
            "velocity": batched_rewards.closeness(planar[:, None], track_velocity.VELOCITY_SCALE),
            "yaw_rate": batched_rewards.closeness(error[:, 2:], track_velocity.YAW_RATE_SCALE),
            "upright": batched_rewards.upright(self.cos_tilt(copies)),
            "effort": self.low_effort(copies),
            "smoothness": batched_rewards.smoothness(copies.action, copies.previous_action),
        }


def vector_task(task: Any) -> VectorTask | None:
    """What this package knows of a task for many copies; None of those of others."""
    if type(task) is stand.Stand:  # what others override is not known here
        return StandCopies(task)
    if type(task) is track_velocity.TrackVelocity:
        return TrackVelocityCopies(task)
    return None
