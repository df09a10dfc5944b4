"""Which feet stand, along a log: as foot sensors say, else as joint efforts or heights do.

    found = standing(robot, recording, feet, joints, attitude, legs)
    found.stands                 # (T, n_feet) bool
    found.source                 # "logged", "efforts" or "heights"

Efforts tell the force on a foot by inverse dynamics, where its leg has three joints at least. With
neither sensors nor efforts the feet that are as low as the lowest are taken to stand, which is
wrong in flight; the filter trusts a foot less that moves meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.feet import Foot, Legs
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]
Bools = NDArray[np.bool_]
Source = Literal["logged", "efforts", "heights"]

_LOADED = 0.25  # of a force sensor's range
_CARRIES = 0.5  # of what a foot carries when all stand alike, by efforts; friction looks like less
_UNLOADED = 0.3  # of its largest force; a sensor that never reads less never leaves the ground
_AS_LOW = 8e-3  # m
_SURE = 0.01  # s before and after a change in which a foot is not sure to stand
_AVERAGED = 0.02  # s, of forces that efforts tell


@dataclass(frozen=True, kw_only=True)
class Standing:
    """Which feet stand.

    Attributes:
        stands: (T, n_feet).
        source: what said so.
    """

    stands: Bools
    source: Source


def standing(
    robot: Robot,
    base: Base,
    recording: Recording,
    feet: Sequence[Foot],
    states: tuple[FloatArray, FloatArray, FloatArray],
    rotation: FloatArray,
    pushing: FloatArray,
    legs: Legs,
) -> Standing:
    """Which feet stand at each row of a log.

    Args:
        robot: the robot.
        base: its base.
        recording: the log, evenly sampled.
        feet: its feet.
        states: (T, nq) positions, (T, nv) velocities and accelerations of the joints.
        rotation: (T, 3, 3) from the base to the world, roughly.
        pushing: (T, 3) what an accelerometer at the base's origin reads [m/s²].
        legs: where the feet are.
    """
    logged = [logged_stance(recording, foot) for foot in feet]
    source: Source = "logged"
    if any(one is None for one in logged):
        efforts = _carried(robot, base, recording, feet, states, rotation, pushing)
        if efforts is not None:
            source = "efforts"
            rows = max(1, round(_AVERAGED * recording.rate))
            share = _weight(robot.model, base) / len(feet)
            guessed = uniform_filter1d(efforts, rows, axis=0) > _CARRIES * share
        else:
            source = "heights"
            guessed = as_low_as_the_lowest(rotation, legs, len(feet))
        logged = [guessed[:, f] if one is None else one for f, one in enumerate(logged)]
    stands = np.stack([one for one in logged if one is not None], axis=1)
    sure = 2 * max(1, round(_SURE * recording.rate)) + 1
    sure_ones = minimum_filter1d(stands.view(np.uint8), sure, axis=0, mode="nearest")
    return Standing(stands=sure_ones.view(np.bool_), source=source)


def logged_names(recording: Recording, feet: Sequence[Foot]) -> dict[str, str]:
    """The column of each foot that has a sensor, by the foot's name."""
    found = {}
    for foot in feet:
        for name in (foot.name, *foot.names):
            column = next(
                (c for c in (f"{name}/contact", f"{name}/force") if c in recording.columns), None
            )
            if column is not None:
                found[foot.name] = column
                break
    return found


def logged_stance(recording: Recording, foot: Foot) -> Bools | None:
    """(T,) whether a foot's sensor says that it stands, None where it has none."""
    column = logged_names(recording, [foot]).get(foot.name)
    if column is None:
        return None
    values = recording.columns[column]
    if column.endswith("/contact"):
        stands: Bools = values > 0.5
        return stands
    low, high = np.quantile(values, (0.02, 0.98))
    if low > _UNLOADED * high:
        return np.ones(len(values), dtype=bool)
    loaded: Bools = values > low + _LOADED * (high - low)
    return loaded


def _weight(model: mujoco.MjModel, base: Base) -> float:
    gravity = float(np.linalg.norm(model.opt.gravity))
    return gravity * float(model.body_subtreemass[base.id])


def _carried(
    robot: Robot,
    base: Base,
    recording: Recording,
    feet: Sequence[Foot],
    states: tuple[FloatArray, FloatArray, FloatArray],
    rotation: FloatArray,
    pushing: FloatArray,
) -> FloatArray | None:
    """(T, n_feet) the vertical force on each foot [N], None where efforts do not tell.

    The equations of motion of a leg's joints, M q̈ + c = τ + Jᵀ F, are solved for the force F.
    """
    model = robot.model
    chains = [_chain(robot, foot, recording) for foot in feet]
    if any(len(chain) < 3 for chain in chains):
        return None
    effort = np.zeros((len(recording.time), model.nv))
    for name in recording.joints:
        measured = recording.signal(name, "effort")
        if measured is not None:
            effort[:, robot.joints[name].dof] = measured
    qpos, qvel, qacc = states
    data = mujoco.MjData(model)
    jacobian, asked = np.empty((3, model.nv)), np.empty(model.nv)
    carried = np.empty((len(qpos), len(feet)))
    pose, free = slice(base.qpos, base.qpos + 7), slice(base.dof, base.dof + 6)
    quaternion = np.empty(4)
    for t in range(len(qpos)):
        mujoco.mju_mat2Quat(quaternion, rotation[t].ravel())
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos[t], qvel[t], qacc[t]
        data.qpos[pose] = (0, 0, 0, *quaternion)
        data.qvel[free] = 0
        data.qacc[free] = 0
        data.qacc[base.dof : base.dof + 3] = rotation[t] @ pushing[t] + model.opt.gravity
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, asked)
        asked += model.dof_armature * data.qacc + model.dof_damping * data.qvel
        for f, foot in enumerate(feet):
            point = data.geom_xpos[list(foot.geoms)].mean(axis=0)
            mujoco.mj_jac(model, data, jacobian, None, point, foot.body)
            own = jacobian[:, chains[f]].T
            force = np.linalg.lstsq(own, (asked - effort[t])[chains[f]], rcond=1e-3)[0]
            carried[t, f] = force[2]
    return carried


def _chain(robot: Robot, foot: Foot, recording: Recording) -> list[int]:
    """Dofs of the joints between the base and a foot of which the effort is measured."""
    model, above = robot.model, set[int]()
    body = foot.body
    while body:
        above.add(body)
        body = int(model.body_parentid[body])
    return [
        joint.dof
        for name, joint in robot.joints.items()
        if int(model.jnt_bodyid[joint.id]) in above
        and name in recording.joints
        and recording.signal(name, "effort") is not None
    ]


def as_low_as_the_lowest(rotation: FloatArray, legs: Legs, count: int) -> Bools:
    """(T, n_feet) whether a foot's lowest point is about as low as that of any.

    Args:
        rotation: (T, 3, 3) from the base to the world.
        legs: where the feet are.
        count: how many there are.
    """
    down = -rotation[:, 2]
    depth = np.stack(
        [np.einsum("ti,ti->t", legs.point(f, down), down) for f in range(count)], axis=1
    )
    low: Bools = depth > depth.max(axis=1, keepdims=True) - _AS_LOW
    return low
