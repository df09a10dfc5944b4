"""Dry friction that knows a direction, a speed, a load or a memory."""

from __future__ import annotations

from functools import partial
from types import MappingProxyType

import numpy as np

from walkerkit.actuators import drivetrain
from walkerkit.gap.effects import fields
from walkerkit.gap.effects.added_dry_friction import stiffen_dry_friction
from walkerkit.gap.effects.effect import FloatArray, JointEffect, Parameter
from walkerkit.gap.effects.law_effect import LawEffect
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials


def _effort_unit(robot: Robot, joint: str) -> str:
    return "N" if robot.joints[joint].slide else "N·m"


class LoadDependentFriction(LawEffect):
    """Dry friction of gear teeth: it grows with the load that they pass on."""

    law = drivetrain.LoadDependentFriction
    driven = dry = True
    name = "load_dependent_friction"
    part = "friction"
    equation = "τ = −μ|τ| sgn q̇ of the drive's τ, μ: coefficient [1]"
    symptom = "grows with load"
    source = "Hamon, Gautier, Garrec, IEEE/RSJ IROS 2010; Duclusaud et al., BAM, 2024"

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The coefficient."""
        return (
            Parameter(
                name="coefficient",
                unit="1",
                zero=self.known(robot, site)["coefficient"],
                lower=0.0,
                upper=0.95,
                scale=0.05,
                starts=(0.05, 0.2, 0.5),
            ),
        )


class DirectionalEfficiency(LawEffect):
    """A gear that is worth less when it drives than when it is driven."""

    law = drivetrain.DirectionalEfficiency
    driven = dry = True
    name = "directional_efficiency"
    part = "friction"
    equation = "τ η₁ while τ q̇ > 0, τ η₂ while τ q̇ < 0; η₁: driving [1], η₂: backdriving [1]"
    symptom = "drive ≠ backdrive"
    source = "Wang, Kim, Directional efficiency in geared transmissions, IEEE ICRA 2015"
    extends = ("load_dependent_friction", "torque_constant")

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Both factors."""
        known = self.known(robot, site)
        return tuple(
            Parameter(
                name=name,
                unit="1",
                zero=known[name],
                lower=0.05,
                upper=upper,
                scale=0.05,
                starts=starts,
            )
            for name, upper, starts in (
                ("driving", 2.0, (0.9, 0.7, 0.8)),
                ("backdriving", 4.0, (1.0, 1.0, 1.25)),
            )
        )


def _one_way(name: str) -> str:
    return f"joint/frictionloss + {fields.law(drivetrain.AsymmetricFriction, name).path}"


def _dry(way: str, robot: Robot, site: str, given: Robot) -> float:
    """All dry friction of one direction."""
    own = float(robot.model.dof_frictionloss[robot.joints[site].dof])
    return own + robot.laws.get(site, {}).get(drivetrain.AsymmetricFriction.name, {}).get(way, 0.0)


class AsymmetricFriction(JointEffect):
    """Dry friction that is stronger one way: a preloaded gear, a brush, a seal."""

    name = "asymmetric_friction"
    part = "friction"
    equation = "τ = −Fc⁺ for q̇ > 0, Fc⁻ for q̇ < 0; Fc⁺: forward, Fc⁻: backward [N·m]"
    symptom = "one direction only"
    added_as = (
        "joint frictionloss, and a drivetrain law in actuators.json for what one way has more"
    )
    source = "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30, 1994"
    fields = MappingProxyType(
        {
            "forward": fields.Field(path=_one_way("forward"), read=partial(_dry, "forward")),
            "backward": fields.Field(path=_one_way("backward"), read=partial(_dry, "backward")),
        }
    )
    extends = ("coulomb_friction",)

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """What to add to the dry friction each way; what the robot has can be taken away."""
        size = 0.1 * robot.excursion(site).effort
        own = float(robot.model.dof_frictionloss[robot.joints[site].dof])
        laws = robot.laws.get(site, {}).get(drivetrain.AsymmetricFriction.name, {})
        starts = (0.3 * size, 1.5 * size, size, 5 * size)
        return tuple(
            Parameter(
                name=name,
                unit=_effort_unit(robot, site),
                lower=-own - laws.get(name, 0.0),
                upper=20 * size,
                scale=size,
                starts=values,
            )
            for name, values in (
                ("forward", starts),
                ("backward", (starts[1], starts[0], starts[3], starts[2])),
            )
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """What both directions share goes to `dof_frictionloss`, the rest to the law."""
        changed = (values != 0).any(axis=1)
        law = trials.law(drivetrain.AsymmetricFriction, site)
        both = np.stack([law["forward"], law["backward"]], axis=1) + values
        shared = both.min(axis=1)
        trials.field("dof_frictionloss")[changed, trials.robot.joints[site].dof] += shared[changed]
        law["forward"][changed] = (both[:, 0] - shared)[changed]
        law["backward"][changed] = (both[:, 1] - shared)[changed]
        stiffen_dry_friction(trials, site, changed)


class StribeckFriction(LawEffect):
    """Dry friction that falls as the lubricant begins to carry: joints stick and slip."""

    law = drivetrain.StribeckFriction
    dry = True
    name = "stribeck_friction"
    part = "friction"
    equation = (
        "τ = −(Fs − Fc) exp(−|q̇/vs|^α) sgn q̇; Fs − Fc: breakaway [N·m], vs: velocity [rad/s], "
        "α: exponent [1]"
    )
    symptom = "low speed, stick-slip"
    source = "Stribeck, VDI-Zeitschrift 46, 1902; Tustin, Journal of the IEE 94, 1947"
    extends = ("coulomb_friction",)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """How much more there is at rest, where it has fallen to 37 %, and how suddenly."""
        excursion, known = robot.excursion(site), self.known(robot, site)
        size, speed = 0.1 * excursion.effort, excursion.velocity
        slide = robot.joints[site].slide
        known_speed = known["velocity"] if known["breakaway"] else 0.05 * speed
        return (
            Parameter(
                name="breakaway",
                unit=_effort_unit(robot, site),
                zero=known["breakaway"],
                lower=0.0,
                upper=max(20 * size, 2 * known["breakaway"]),
                scale=size,
                starts=(0.2 * size, size, 3 * size, 3 * size),
            ),
            Parameter(
                name="velocity",
                unit="m/s" if slide else "rad/s",
                zero=known_speed,
                lower=min(1e-3 * speed, known_speed),
                upper=max(2 * speed, known_speed),
                scale=0.02 * speed,
                starts=(0.1 * speed, 0.1 * speed, 0.02 * speed, 0.2 * speed),
                shape=not known["breakaway"],
            ),
            Parameter(
                name="exponent",
                unit="1",
                zero=known["exponent"],
                lower=0.3,
                upper=3.0,
                scale=0.2,
                starts=(1.0, 1.0, 1.0, 1.0),
                shape=not known["breakaway"],
            ),
        )


def _bend(robot: Robot, site: str, given: Robot) -> float | None:
    """How far the bristles of all dry friction bend; None where it has none."""
    law = robot.laws.get(site, {}).get(drivetrain.PreslidingFriction.name)
    if law is None:
        return None
    return float(robot.model.dof_frictionloss[robot.joints[site].dof]) / law["bristle_stiffness"]


class PreslidingFriction(JointEffect):
    """Bristles, seals or grease that bend before the joint slides; all its dry friction does.

    Bristles that do not bend are `coulomb_friction`.
    """

    name = "presliding_friction"
    part = "friction"
    equation = (
        "τ = −σ₀ z, ż = q̇ − σ₀|q̇| z/Fc, σ₀ = Fc/bend [N·m/rad]; bend: how far they bend [rad], "
        "Fc: the model's dry friction and frictionloss [N·m]"
    )
    symptom = "hysteresis below breakaway"
    added_as = "joint frictionloss, and a drivetrain law in actuators.json"
    source = "Canudas de Wit, Olsson, Åström, Lischinsky (LuGre), IEEE TAC 40, 1995"
    fields = MappingProxyType(
        {
            "frictionloss": fields.joint("frictionloss", "dof_frictionloss"),
            "bend": fields.Field(
                path="joint/frictionloss ÷ "
                + fields.law(drivetrain.PreslidingFriction, "bristle_stiffness").path,
                read=_bend,
            ),
        }
    )
    extends = ("coulomb_friction",)

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The friction to add, and how far the bristles of all of it bend."""
        joint, excursion = robot.joints[site], robot.excursion(site)
        own = float(robot.model.dof_frictionloss[joint.dof])
        laws = robot.laws.get(site, {}).get(drivetrain.PreslidingFriction.name)
        size, little, much = 0.1 * excursion.effort, 0.006 * excursion.range, 0.03 * excursion.range
        known = own / laws["bristle_stiffness"] if laws else 0.0
        return (
            Parameter(
                name="frictionloss",
                unit=_effort_unit(robot, site),
                lower=-own,
                upper=20 * size,
                scale=size,
                # The dry friction that is there may bend as it is; of none, nothing bends.
                starts=(0.01 * size, 0.01 * size, size, size, 4 * size, 4 * size),
            ),
            Parameter(
                name="bend",
                unit="m" if joint.slide else "rad",
                zero=known,
                lower=0.0,
                upper=max(excursion.range, 2 * known),
                scale=little,
                starts=(little, much) * 3,
                shape=not own,
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to `dof_frictionloss`, and softens it by the law."""
        model, joint = trials.robot.model, trials.robot.joints[site]
        changed = (values != [p.zero for p in self.parameters(trials.robot, site)]).any(axis=1)
        friction = trials.field("dof_frictionloss")[:, joint.dof]
        friction[changed] += values[changed, 0]
        stiffen_dry_friction(trials, site, changed)
        # Stiffer bristles than the timestep resolves would ring.
        hardest = float(model.dof_M0[joint.dof]) / model.opt.timestep**2
        stiffness = trials.law(drivetrain.PreslidingFriction, site)["bristle_stiffness"]
        soft = changed & (friction > 0)
        stiffness[changed] = drivetrain.PreslidingFriction.neutral["bristle_stiffness"]
        bend = np.maximum(values[soft, 1], friction[soft] / hardest)
        stiffness[soft] = friction[soft] / bend
