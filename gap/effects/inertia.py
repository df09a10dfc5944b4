"""Inertia that the model lacks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from types import MappingProxyType

import mujoco
import numpy as np

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import Effect, FloatArray, JointEffect, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_SMALLEST = 1e-3  # m
_ALONG = 1e-4  # sine of the angle below which two axes are one


def _mass(robot: Robot, site: str, given: Robot) -> float:
    return float(robot.model.body(site).mass[0])


def _centre(axis: int, robot: Robot, site: str, given: Robot) -> float:
    return float(robot.model.body(site).ipos[axis])


class Armature(JointEffect):
    """Inertia of the rotor and gears as it appears at the joint."""

    name = "armature"
    part = "mass"
    ordinary = True
    equation = "τ = −Iₐ q̈, Iₐ: armature [kg·m²]"
    symptom = "proportional to acceleration"
    added_as = "joint armature"
    source = "MuJoCo XML reference, joint/armature"
    fields = MappingProxyType({"armature": fields.joint("armature", "dof_armature")})

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The reflected inertia to add; what the model has can be taken away.

        A model may lack as much as the joint moves: gears are chosen so that rotor and load match
        (Pasch and Seering, ASME Journal of Mechanisms 106, 1984).
        """
        joint = robot.joints[site]
        moved = float(robot.model.dof_M0[joint.dof])
        size = 0.2 * moved
        return (
            Parameter(
                name="armature",
                unit="kg" if joint.slide else "kg·m²",
                lower=-float(robot.model.dof_armature[joint.dof]),
                upper=100 * size,
                scale=size,
                starts=(0.5 * size, 2 * size),
                prior=moved,
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to `dof_armature`."""
        trials.field("dof_armature")[:, trials.robot.joints[site].dof] += values[:, 0]


def _moved_bodies(robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
    """Bodies with a mass that one of the joints moves; all of them where the base floats."""
    model = robot.model
    moved = {int(model.jnt_bodyid[robot.joints[name].id]) for name in joints}
    if robot.base is not None:
        moved.add(robot.base.id)

    def is_moved(body: int) -> bool:
        while body and body not in moved:
            body = int(model.body_parentid[body])
        return body != 0

    return tuple(
        name
        for name in robot.bodies
        if is_moved(model.body(name).id) and model.body(name).mass[0] > 0
    )


class Payload(Effect):
    """Mass that a body carries at its centre of mass: a battery, a foot, a cable."""

    name = "payload"
    part = "mass"
    equation = "body mass + Δm at its centre of mass, Δm: mass [kg]"
    symptom = "pose and acceleration"
    added_as = "body mass"
    source = "MuJoCo XML reference, body/inertial"
    resembles = ("com_offset", "torque_constant", "encoder_gain")
    fields = MappingProxyType({"mass": fields.Field(path="inertial/mass", read=_mass)})
    kind = "body"

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """Bodies that a measured joint moves, with what is welded to them; a base that floats."""
        return _moved_bodies(robot, joints)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The mass to add; up to nine tenths of the body's own can be taken away."""
        body = robot.model.body(site)
        mass, carried = float(body.mass[0]), float(body.subtreemass[0])
        size = 0.1 * carried
        return (
            Parameter(
                name="mass",
                unit="kg",
                lower=-0.9 * mass,
                upper=20 * carried,
                scale=size,
                starts=(-min(0.5 * size, 0.5 * mass), size, 3 * size),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to `body_mass`."""
        trials.field("body_mass")[:, trials.robot.model.body(site).id] += values[:, 0]


class ComOffset(Effect):
    """The centre of mass of a body is not where the model has it.

    On a robot of one hinge this can do all that a tilted base or an encoder offset can.
    """

    name = "com_offset"
    part = "mass"
    equation = "centre of mass + Δr in the body's frame, Δr: x, y, z [m]"
    symptom = "sin/cos of pose"
    added_as = "inertial pos"
    source = "MuJoCo XML reference, body/inertial/pos"
    resembles = ("payload", "torque_constant", "encoder_gain")
    fields = MappingProxyType(
        {
            "x": fields.Field(path="inertial/pos", read=partial(_centre, 0)),
            "y": fields.Field(path="inertial/pos", read=partial(_centre, 1)),
            "z": fields.Field(path="inertial/pos", read=partial(_centre, 2)),
        }
    )
    kind = "body"

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """Bodies that a measured joint turns.

        None that is welded to another, which has that offset too, and none whose centre of mass is
        on the axes of the only joints that it or any other body of its robot has: MuJoCo computes
        such a body by a short cut that no trial can leave.
        """
        model = robot.model
        return tuple(
            name
            for name in _moved_bodies(robot, joints)
            if _felt(robot, name) and _turns_by_itself(model, model.body(name).id)
        )

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Those of the three that the motion can feel."""
        model = robot.model
        body = model.body(site)
        gyration = float(np.sqrt(0.5 * body.inertia.sum() / body.mass[0]))
        size = 0.1 * max(gyration, 0.1 * float(np.linalg.norm(body.ipos)), _SMALLEST)
        axes = _felt(robot, site)
        return tuple(
            Parameter(
                name=axis,
                unit="m",
                lower=-30 * size,
                upper=30 * size,
                scale=size,
                starts=tuple(
                    sign * 3 * size if axis == other else 0.0 for other in axes for sign in (1, -1)
                ),
            )
            for axis in axes
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to `body_ipos`."""
        columns = ["xyz".index(axis) for axis in _felt(trials.robot, site)]
        trials.field("body_ipos")[:, trials.robot.model.body(site).id, columns] += values


def _turns_by_itself(model: mujoco.MjModel, body: int) -> bool:
    """Whether a body is not welded to another, and its centre of mass is none by a short cut."""
    return bool(model.body_weldid[body] == body and not model.body_simple[body])


def _felt(robot: Robot, body: str) -> str:
    """Of the axes of a body's frame those along which the motion feels its centre of mass move.

    About one direction only, nothing feels where along it the mass is; without any turning,
    nothing feels where it is at all.
    """
    model = robot.model
    turning, at = [], int(model.body(body).id)
    frame = np.eye(3)  # of what is reached, in that of the body
    while at:
        first = int(model.body_jntadr[at])
        for joint in range(first, first + int(model.body_jntnum[at])):
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
                turning.append(frame @ model.jnt_axis[joint])
            elif model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_SLIDE:
                return "xyz"
        turned = np.empty(9)
        mujoco.mju_quat2Mat(turned, model.body_quat[at])
        frame = frame @ turned.reshape(3, 3).T
        at = int(model.body_parentid[at])
    if not turning:
        return ""
    if any(np.linalg.norm(np.cross(turning[0], axis)) > _ALONG for axis in turning):
        return "xyz"
    return "".join(
        axis for axis, part in zip("xyz", turning[0], strict=True) if abs(part) < 1 - _ALONG
    )
