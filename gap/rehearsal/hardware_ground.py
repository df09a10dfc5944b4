"""The rehearsal robot's ground: springs and Coulomb friction under its feet, none of it MuJoCo's.

    soil = Soil(model, hidden, step=5e-4)        # takes the feet's contacts out of the model
    soil.push(batch)                             # sets `xfrc_applied` for the next step

A foot is a sphere on which a floating robot stands at home, the ground a level plane: no further
from it than the sphere's radius. So a robot that falls does so on MuJoCo's ground. Where a foot is
δ deep, the
ground gives N = max(0, k δ + d δ'), and along the plane a bristle F = −k_t z − d_t z' that
stretches with the foot until |F| = μ N and is dragged on from there (Cundall and Strack,
Géotechnique 29, 1979). So a foot that does not slip does not creep either, and what it carries
decides how deep it stands. μ is the model's own; k is such that the robot stands `SINK` deep where
nothing is hidden.

Limits: feet against a plane; other contacts stay MuJoCo's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hardware_base import home
from walkerkit.gap.rehearsal.hidden import HiddenEffect

Array = NDArray[np.float64]

SINK: Final = 3e-4
"""How deep all feet together carry the weight, where nothing is hidden, m."""

_DAMPED = 0.3  # of critical, for a foot's share of the robot
_ALONG = 0.7  # stiffness along the ground over that into it
_EFFECTS = ("ground_friction", "ground_compliance", "foot_offset")


class Soil:
    """The ground under the feet of one robot, in many simulations.

    Attributes:
        any: whether there are feet at all.
        names: of the feet's geoms.
        carried: what the ground pushed up each foot with in the last step, shape (n_sims, n_feet).
    """

    def __init__(
        self, model: mujoco.MjModel, hidden: Sequence[HiddenEffect], *, step: float, n_sims: int
    ) -> None:
        """Takes the ground's contacts with the feet out of the model.

        Args:
            model: the robot's model, written to.
            hidden: effects; those that are not of the ground are left alone.
            step: time from one call to the next, s.
            n_sims: number of simulations.

        Raises:
            InputError: the ground is hidden, and the robot does not stand on its feet.
        """
        plane, feet = _feet(model)
        self.any = bool(feet)
        self.names = tuple(model.geom(foot).name or f"foot_{k}" for k, foot in enumerate(feet))
        self.carried = np.zeros((n_sims, len(feet)))
        mine = [effect for effect in hidden if effect.effect in _EFFECTS]
        if mine and not self.any:
            raise InputError(
                f"{mine[0].effect} is hidden, and the robot has no feet: give it a free joint, "
                "spheres to stand on and a level plane."
            )
        if not self.any:
            return
        self._feet = np.array(feet)
        self._bodies = model.geom_bodyid[self._feet]
        self._roots = model.body_rootid[self._bodies]
        self._legs = model.body_weldid[self._bodies]
        self._offset = np.zeros((len(feet), 3))
        self._radius = model.geom_size[self._feet, 0]
        self._level = float(model.geom_pos[plane, 2])
        self._step = step
        mass = float(model.body_subtreemass[self._roots[0]])
        share = mass / len(feet)
        gravity = float(np.linalg.norm(model.opt.gravity))
        self._stiffness = share * gravity / SINK
        self._friction = np.array([_sliding(model, plane, foot) for foot in feet])
        for effect in mine:
            match effect.effect:
                case "ground_friction":
                    self._friction[:] = effect.value("friction")
                case "ground_compliance":
                    self._stiffness = effect.value("stiffness")
                case _:
                    names = [leg for _, leg in feet_and_legs(model)]
                    shift = [effect.spread(axis, names) for axis in "xyz"]
                    self._offset += np.stack(shift, axis=1)
        self._damping = 2 * _DAMPED * float(np.sqrt(self._stiffness * share))
        self._stretch = np.zeros((n_sims, len(feet), 2))
        _take_apart(model, plane, self._feet)

    def watch(self, batch: Any) -> None:
        """Has a batch work out where the feet are and how they move."""
        for name in ("geom_xpos", "xmat", "cvel", "subtree_com", "xipos"):
            batch.bind(name)
        batch.forward(stage=int(mujoco.mjtStage.mjSTAGE_VEL))

    def push(self, batch: Any) -> None:
        """Sets what the ground applies to the feet in the next step.

        Args:
            batch: the simulations, whose velocities are those of now.
        """
        centre = batch.bind("geom_xpos")[:, self._feet]
        if self._offset.any():
            turned = batch.bind("xmat")[:, self._legs].reshape(*centre.shape, 3)
            centre = centre + np.einsum("sfij,fj->sfi", turned, self._offset)
        motion = batch.bind("cvel")[:, self._bodies]
        about = batch.bind("subtree_com")[:, self._roots]
        depth = self._level + self._radius - centre[..., 2]
        point = centre.copy()
        point[..., 2] -= self._radius - 0.5 * np.maximum(depth, 0.0)
        velocity = motion[..., 3:] + np.cross(motion[..., :3], point - about)
        down = self._stiffness * depth - self._damping * velocity[..., 2]
        normal = np.where(depth > 0, np.maximum(down, 0.0), 0.0)

        along, drag = _ALONG * self._stiffness, _ALONG * self._damping
        stretch = self._stretch + self._step * velocity[..., :2]
        force = -along * stretch - drag * velocity[..., :2]
        size = np.linalg.norm(force, axis=-1)
        most = self._friction * normal
        slips = size > most
        force *= np.where(slips, most / np.where(slips, size, 1.0), 1.0)[..., None]
        # A bristle that is dragged holds what it can, and one in the air is slack.
        self._stretch = np.where(
            (depth > 0)[..., None],
            np.where(slips[..., None], -(force + drag * velocity[..., :2]) / along, stretch),
            0.0,
        )
        self.carried = normal
        pushed = np.concatenate([force, normal[..., None]], axis=-1)
        applied = batch.bind("xfrc_applied")
        lever = point - batch.bind("xipos")[:, self._bodies]
        applied[:, np.unique(self._bodies)] = 0.0
        wrench = np.concatenate([pushed, np.cross(lever, pushed)], axis=-1)
        for foot, body in enumerate(self._bodies):
            applied[:, body] += wrench[:, foot]


def feet_and_legs(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """Names of a robot's feet, and of the bodies that carry them."""
    _, feet = _feet(model)
    legs = (model.body_weldid[model.geom_bodyid[foot]] for foot in feet)
    return [
        (model.geom(foot).name, model.body(leg).name) for foot, leg in zip(feet, legs, strict=True)
    ]


def _feet(model: mujoco.MjModel) -> tuple[int, list[int]]:
    """A level plane, and the spheres on which a floating robot stands there at home."""
    floating = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    planes = [
        geom
        for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
        if model.body_weldid[model.geom_bodyid[geom]] == 0
        and abs(model.geom_quat[geom, 1:3]).max() == 0
        and model.geom_bodyid[geom] == 0
    ]
    meets = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    if not floating.size or not planes or not meets:
        return -1, []
    plane = int(planes[0])
    data = mujoco.MjData(model)
    data.qpos[:] = home(model)
    mujoco.mj_kinematics(model, data)
    above = data.geom_xpos[:, 2] - model.geom_pos[plane, 2] - model.geom_size[:, 0]
    return plane, [
        int(geom)
        for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE)
        if model.body_rootid[model.geom_bodyid[geom]] in floating
        and above[geom] <= model.geom_size[geom, 0]
        and _meet(model, np.array([geom]), plane).any()
    ]


def _meet(model: mujoco.MjModel, geoms: NDArray[np.intp], plane: int) -> NDArray[np.bool_]:
    """Which of the geoms can touch the plane."""
    kinds, others = model.geom_contype, model.geom_conaffinity
    met: NDArray[np.bool_] = (kinds[geoms] & others[plane]) | (others[geoms] & kinds[plane]) != 0
    return met


def _take_apart(model: mujoco.MjModel, plane: int, feet: NDArray[np.intp]) -> None:
    """Has the plane meet all that it met but the feet, which still meet each other."""
    kinds, others = model.geom_contype, model.geom_conaffinity
    met = _meet(model, np.arange(model.ngeom), plane)
    met[feet] = False
    used = int(np.bitwise_or.reduce(others))
    free = next((1 << bit for bit in range(31) if not used >> bit & 1), 0)
    if not free:
        raise InputError(
            "the model's conaffinity uses all of its 31 bits, and the ground of a rehearsal needs "
            "one. Clear one in the geoms that have all of them."
        )
    kinds[plane], others[plane] = 0, free
    kinds[~met] &= ~free
    kinds[met] |= free


def _sliding(model: mujoco.MjModel, plane: int, foot: int) -> float:
    """The coefficient of sliding friction that the model has between two geoms."""
    first, second = model.geom_priority[[plane, foot]]
    pair = [plane, foot] if first == second else [plane if first > second else foot]
    if model.geom_condim[pair].max() == 1:
        return 0.0
    return float(model.geom_friction[pair, 0].max())
