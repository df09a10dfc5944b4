"""Inertia that the model lacks."""

from __future__ import annotations

from collections.abc import Sequence

from walkerkit.gap.effects.base import Effect, FloatArray, JointEffect, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials


class Armature(JointEffect):
    """Inertia of the rotor and gears as it appears at the joint."""

    name = "armature"
    equation = "τ = −Iₐ q̈, Iₐ: armature [kg·m²]"
    symptom = "proportional to acceleration"
    added_as = "joint armature"
    source = "MuJoCo XML reference, joint/armature"

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The reflected inertia to add; what the model has can be taken away."""
        joint = robot.joints[site]
        size = 0.2 * float(robot.model.dof_M0[joint.dof])
        return (
            Parameter(
                name="armature",
                unit="kg" if joint.slide else "kg·m²",
                lower=-float(robot.model.dof_armature[joint.dof]),
                upper=100 * size,
                scale=size,
                starts=(0.5 * size, 2 * size),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to `dof_armature`."""
        trials.field("dof_armature")[:, trials.robot.joints[site].dof] += values[:, 0]


class Payload(Effect):
    """Mass that a body carries at its centre of mass: a battery, a foot, a cable."""

    name = "payload"
    equation = "body mass + Δm at its centre of mass, Δm: mass [kg]"
    symptom = "pose and acceleration"
    added_as = "body mass"
    source = "MuJoCo XML reference, body/inertial"
    kind = "body"

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """Bodies that a measured joint moves."""
        model = robot.model
        moved = {int(model.jnt_bodyid[robot.joints[name].id]) for name in joints}

        def is_moved(body: int) -> bool:
            while body and body not in moved:
                body = int(model.body_parentid[body])
            return body != 0

        return tuple(
            name
            for name in robot.bodies
            if is_moved(model.body(name).id) and model.body(name).mass[0] > 0
        )

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
