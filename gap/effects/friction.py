"""Friction in the joint."""

from __future__ import annotations

from types import MappingProxyType

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.added_dry_friction import stiffen_dry_friction
from walkerkit.gap.effects.effect import FloatArray, JointEffect, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials


class ViscousFriction(JointEffect):
    """Friction that grows with speed. Back-EMF of a voltage-driven motor has the same form."""

    name = "viscous_friction"
    part = "friction"
    ordinary = True
    equation = "τ = −b q̇, b: damping [N·m·s/rad]"
    symptom = "grows with speed"
    added_as = "joint damping"
    source = "MuJoCo XML reference, joint/damping"
    fields = MappingProxyType({"damping": fields.joint("damping", "dof_damping")})

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The damping to add; what the model has can be taken away."""
        joint, excursion = robot.joints[site], robot.excursion(site)
        size = 0.1 * excursion.effort / excursion.velocity
        return (
            Parameter(
                name="damping",
                unit="N·s/m" if joint.slide else "N·m·s/rad",
                lower=-float(robot.model.dof_damping[joint.dof]),
                upper=200 * size,
                scale=size,
                starts=(size, 5 * size),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to `dof_damping`."""
        trials.field("dof_damping")[:, trials.robot.joints[site].dof] += values[:, 0]


class CoulombFriction(JointEffect):
    """Dry friction: constant, against the motion."""

    name = "coulomb_friction"
    part = "friction"
    ordinary = True
    equation = "τ = −Fc sgn q̇, Fc: frictionloss [N·m]"
    symptom = "jump at velocity reversal"
    added_as = (
        "joint frictionloss, and where there was none solreffriction and solimpfriction stiff "
        "enough not to creep"
    )
    source = "MuJoCo XML reference, joint/frictionloss"
    fields = MappingProxyType({"frictionloss": fields.joint("frictionloss", "dof_frictionloss")})

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The dry friction to add; what the model has can be taken away."""
        joint = robot.joints[site]
        size = 0.1 * robot.excursion(site).effort
        return (
            Parameter(
                name="frictionloss",
                unit="N" if joint.slide else "N·m",
                lower=-float(robot.model.dof_frictionloss[joint.dof]),
                upper=20 * size,
                scale=size,
                starts=(0.3 * size, 1.5 * size, 4 * size),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to `dof_frictionloss`; where the model had none, its constraint is made stiff."""
        trials.field("dof_frictionloss")[:, trials.robot.joints[site].dof] += values[:, 0]
        stiffen_dry_friction(trials, site, values[:, 0] != 0)


class QuadraticDrag(JointEffect):
    """Drag of a fluid or a fan: it grows with the square of speed."""

    name = "quadratic_drag"
    part = "friction"
    equation = "τ = −b₂ q̇|q̇|, b₂: drag [N·m·s²/rad²]"
    symptom = "high speed only"
    added_as = 'joint damping="b b₂ b₃"'
    source = "MuJoCo XML reference, joint/damping"
    fields = MappingProxyType({"drag": fields.joint("damping", "dof_dampingpoly", column=0)})

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The drag to add; what the model has can be taken away."""
        joint, excursion = robot.joints[site], robot.excursion(site)
        size = 0.1 * excursion.effort / excursion.velocity**2
        return (
            Parameter(
                name="drag",
                unit="N·s²/m²" if joint.slide else "N·m·s²/rad²",
                lower=-float(robot.model.dof_dampingpoly[joint.dof, 0]),
                upper=200 * size,
                scale=size,
                starts=(size, 5 * size),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to `dof_dampingpoly`."""
        trials.field("dof_dampingpoly")[:, trials.robot.joints[site].dof, 0] += values[:, 0]
