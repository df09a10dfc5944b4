"""A mount that gives way: two hinges under the body that carries a robot which does not float.

    robot = with_mount(robot)
    robot.joints["mount_roll"], robot.joints["mount_pitch"]     # about the world's x and y

They are joints of the carrying body itself, before its own, through its origin, and plain MJCF:
springs of one stiffness with the damping of a ratio to the critical one. The stand has inertia,
too: a small part of what it carries, without which it could not be told from the first joint.

Limits: a stand turns; one that is pushed aside without turning is not modelled. Springs that a step
h cannot follow are as stiff as it can (√(K/I) = 1/h).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.simulation.gear_play import PLAIN, become, stiffest, with_zero
from walkerkit.gap.simulation.robot import Joint, Play, Robot, scalar_joints
from walkerkit.gap.simulation.start import rest
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]

MOUNTS: Final = ("mount_roll", "mount_pitch")
"""Names of the hinges, about the world's x and y."""
STAND: Final = 0.05
"""Inertia of the stand itself, of that of what it carries."""

_MOST_DOFS = 6  # of a body


def carrier(robot: Robot) -> int | None:
    """The body that carries the whole robot, by its id; None where no mount can be under it.

    It is the first that weighs something: what is fixed to the world before it is the world.

    A robot that floats has no mount, nor has one of several parts, or one whose carrying body
    weighs nothing or moves in all directions, to which MuJoCo can add no joint.
    """
    model = robot.model
    roots = {int(model.body_rootid[model.jnt_bodyid[joint.id]]) for joint in robot.joints.values()}
    if robot.base is not None or len(roots) != 1:
        return None
    (body,) = roots
    while not model.body_mass[body] and not model.body_dofnum[body]:
        inside = np.flatnonzero(model.body_parentid == body)
        if len(inside) != 1:
            return None
        body = int(inside[0])
    free = _MOST_DOFS - int(model.body_dofnum[body])
    return body if model.body_mass[body] > 0 and free >= len(MOUNTS) else None


def mounts(robot: Robot) -> tuple[Joint, ...]:
    """The hinges of a mount, where the model has one."""
    return tuple(robot.joints[name] for name in MOUNTS if name in robot.joints)


def resting(robot: Robot) -> list[Joint]:
    """The hinges of a mount as plays of their own, which start where the load puts them."""
    return [
        replace(joint, play=Play(name=joint.name, id=joint.id, qpos=joint.qpos, dof=joint.dof))
        for joint in mounts(robot)
        if robot.model.jnt_stiffness[joint.id] > 0
    ]


def with_mount(robot: Robot) -> Robot:
    """The robot on a mount, which is stiff until `set_mount` gives it a size.

    Args:
        robot: a robot with a `carrier`.

    Raises:
        ValueError: nothing carries it, or a name is taken.
    """
    root = carrier(robot)
    if root is None or mounts(robot):
        raise ValueError(f"{robot.source}: no mount can be put under it")
    spec = robot.spec.copy()
    spec.compile()  # gives the elements of the copy the ids of the compiled model
    body = next(one for one in spec.bodies if one.id == root)
    model = robot.model
    of_robot = [
        one for one in range(model.njnt) if model.body_rootid[model.jnt_bodyid[one]] == root
    ]
    for key in spec.keys:
        for _ in MOUNTS:
            key.qpos = with_zero(key.qpos, int(model.jnt_qposadr[of_robot].min()))
            key.qvel = with_zero(key.qvel, int(model.jnt_dofadr[of_robot].min()))
    data = rest(model)
    mujoco.mj_kinematics(model, data)
    turn = data.xmat[root].reshape(3, 3)
    added = _in_front(body, len(MOUNTS))
    for joint, name, axis in zip(added, MOUNTS, turn[:2], strict=True):
        for field, value in PLAIN.items():
            setattr(joint, field, value)
        for field in ("stiffness", "damping", "springdamper", "range", "actfrcrange"):
            getattr(joint, field)[:] = 0
        joint.type = mujoco.mjtJoint.mjJNT_HINGE
        joint.name, joint.pos, joint.axis, joint.limited = name, [0.0, 0.0, 0.0], axis, False
        joint.armature = 1.0
    carried = spec.compile()
    for joint in added:
        own = float(carried.dof_M0[carried.joint(joint.name).dofadr[0]]) - 1.0
        joint.armature = STAND * own
        joint.stiffness[0] = own / float(spec.option.timestep) ** 2
    compiled = spec.compile()
    return replace(
        robot,
        spec=spec,
        model=compiled,
        joints={
            name: replace(joint, drives=robot.joints[name].drives, inputs=robot.joints[name].inputs)
            if name in robot.joints
            else joint
            for name, joint in scalar_joints(compiled).items()
        },
    )


def _in_front(body: Any, count: int) -> list[Any]:
    """Joints of a body before its own, which are whatever these were.

    A body moves by its joints in their order, and new ones are the last: each passes on what it is.
    """
    chain = [*body.joints, *(body.add_joint() for _ in range(count))]
    for source, target in reversed([*zip(chain[:-count], chain[count:], strict=True)]):
        become(source, target)
        passed, source.name = source.name, ""
        target.name = passed
    return chain[:count]


def set_mount(trials: Trials, values: Mapping[str, FloatArray]) -> None:
    """Writes a mount's stiffness and damping to the model's fields.

    Args:
        trials: variants of a robot with a mount.
        values: what `Trials.mount` has, (n,) each.
    """
    model = trials.robot.model
    for joint in mounts(trials.robot):
        inertia = float(model.dof_M0[joint.dof])
        least = stiffest(float(model.opt.timestep), inertia)
        stiffness = 1 / np.maximum(values["compliance"], least)
        trials.field("jnt_stiffness")[:, joint.id] = stiffness
        damping = 2 * values["damping_ratio"] * np.sqrt(stiffness * inertia)
        trials.field("dof_damping")[:, joint.dof] = damping


def made_mount(robot: Robot) -> dict[str, float | None]:
    """What a robot's model says of its mount, as `set_mount` has written it.

    Returns:
        `compliance` [rad/(N·m)], 0 where there is no mount, and its `damping_ratio` [1], None
        without one.
    """
    model, hinges = robot.model, mounts(robot)
    if not hinges or model.jnt_stiffness[hinges[0].id] <= 0:
        return {"compliance": 0.0, "damping_ratio": None}
    stiffness = float(model.jnt_stiffness[hinges[0].id])
    critical = 2 * np.sqrt(stiffness * float(model.dof_M0[hinges[0].dof]))
    damping = float(model.dof_damping[hinges[0].dof])
    return {"compliance": 1 / stiffness, "damping_ratio": damping / critical}
