"""Between motor and link, where the two can part: a gap, or a spring.

Both make of a joint two, the motor's side as seen through the gear, which keeps the joint's name,
actuators and losses, and the play that takes the link along (`simulation.gear_play`). Where the
model has no armature the rotor's inertia is found with them: a rotor without one has no motion.

Encoders sit on the motor or on the link. Which one it is can only be chosen, not fitted: both are
tried, and what the log shows, and the drive is fed back, is then the motor or the link.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from types import MappingProxyType

import mujoco
import numpy as np

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import FloatArray, JointEffect, Parameter
from walkerkit.gap.simulation.gear_play import SUFFIX, made_play, stiffest
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_ROTORS = (0.1, 0.5)  # of a joint's inertia; the usual sizes of one that is not known
_BOTH_SIDES = 0.5  # of the play before the encoder; more is an encoder on the link
_GAPS = (0.005, 0.015, 0.045)  # of how far the joint went
_RESONANCES = (40.0, 16.0, 7.0)  # Hz; of the link on its spring, with the motor held
_TYPICAL, _SOFTEST = 25.0, 2.0  # Hz


def _made(name: str, robot: Robot, site: str, given: Robot) -> float | None:
    return made_play(robot, site)[name]


_BESIDE = {
    "load_side": fields.measurement("load_side"),
    "armature": fields.joint("armature", "dof_armature"),
}


class Backlash(JointEffect):
    """Teeth that do not touch for a while when the load changes sides."""

    name = "backlash"
    part = "play"
    equation = "τ passes only where |θ − q| = ε, 2ε: width [rad], θ: of the motor"
    symptom = "flat, then an impact, at reversals"
    added_as = "two joints, the second with a range"
    source = "Nordin and Gutman, Automatica 38, 2002"
    fields = MappingProxyType(
        {
            "width": fields.Field(
                path=f"joint[<joint>{SUFFIX}]/range", read=partial(_made, "width")
            ),
            **_BESIDE,
        }
    )

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Driven joints that have no play yet."""
        return _may_part(robot, joint)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The gap from one flank to the other."""
        size = robot.excursion(site).range
        tries = _tries(robot, site, _GAPS)
        return (
            Parameter(
                name="width",
                unit="m" if robot.joints[site].slide else "rad",
                lower=0.0,
                upper=0.3 * size,
                scale=0.1 * size,
                starts=tuple(part * size for part, _, _ in tries),
            ),
            _side(tries),
            *_rotor(robot, site, tries),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the gap of the joint's play, where it is wide enough to be one.

        The slightest gap frees the rotor for a step at each reversal. So there is none below half
        of the least that is tried: that nothing is there would be no neighbour of little else.
        """
        narrowest = 0.5 * _GAPS[0] * trials.robot.excursion(site).range
        _add(trials, site, values, ("width", "load_side", "armature"), narrowest)


class SeriesElasticity(JointEffect):
    """A gear, a belt or a spring between motor and link that gives way.

    The link follows late, and moves a little before dry friction lets go.
    """

    name = "series_elasticity"
    part = "play"
    equation = "τ = K (θ − q), 1/K: compliance [rad/(N·m)], θ: of the motor"
    symptom = "resonance"
    added_as = "two joints, the second with stiffness and damping"
    source = "Spong, J. Dyn. Sys. Meas. Control 109, 1987"
    fields = MappingProxyType(
        {
            "compliance": fields.Field(
                path=f"joint[<joint>{SUFFIX}]/stiffness", read=partial(_made, "compliance")
            ),
            "damping_ratio": fields.Field(
                path=f"joint[<joint>{SUFFIX}]/damping", read=partial(_made, "damping_ratio")
            ),
            **_BESIDE,
        }
    )

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Driven joints that have no play yet."""
        return _may_part(robot, joint)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Compliance, and the damping of rotor against link over the critical one."""
        joint, model = robot.joints[site], robot.model
        tries = _tries(robot, site, _RESONANCES)
        rotor = _rotor(robot, site, tries)
        own = float(model.dof_armature[joint.dof])
        link = float(model.dof_M0[joint.dof]) - own
        inertia = 1 / (1 / link + 1 / (rotor[0].zero if rotor else own))
        # Springs stiffer than this shake faster than the timestep can tell.
        least = 4 * stiffest(float(model.opt.timestep), inertia)

        def compliance(frequency: float) -> float:
            return max(least, 1 / (link * (2 * np.pi * frequency) ** 2))

        return (
            Parameter(
                name="compliance",
                unit="m/N" if joint.slide else "rad/(N·m)",
                lower=0.0,
                upper=max(compliance(_SOFTEST), 10 * least),
                scale=compliance(_TYPICAL),
                starts=tuple(compliance(frequency) for frequency, _, _ in tries),
                inverse=("stiffness", "N/m" if joint.slide else "N·m/rad"),
            ),
            spring_damping(len(tries)),
            _side(tries),
            *rotor,
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the compliance of the joint's play."""
        _add(trials, site, values, ("compliance", "damping_ratio", "load_side", "armature"), 0.0)


def spring_damping(starts: int) -> Parameter:
    """The damping ratio of a spring that several sizes are tried of."""
    return Parameter(
        name="damping_ratio",
        unit="1",
        zero=0.1,
        lower=0.005,  # below which a simulation's own damping is more
        upper=1.0,
        end=0.005,
        scale=0.05,
        starts=(0.1,) * starts,
        shape=True,
    )


def _may_part(robot: Robot, joint: str) -> bool:
    return bool(robot.joints[joint].drives) and robot.joints[joint].play is None


def _tries(
    robot: Robot, site: str, sizes: tuple[float, float, float]
) -> list[tuple[float, float, float]]:
    """Sizes of an effect, sides of the encoder and rotors, in parts of the joint's inertia.

    Encoders on the link are tried with the least only, since what gives way much cannot be
    controlled from behind it.
    """
    rotors = _ROTORS if robot.model.dof_armature[robot.joints[site].dof] == 0 else (0.0,)
    cases = [*((size, 0.0) for size in sizes), (sizes[0], 1.0)]
    return [(size, side, rotor) for size, side in cases for rotor in rotors]


def _side(tries: Sequence[tuple[float, float, float]]) -> Parameter:
    """Whether the encoder, which is logged and fed back, is on the link instead of the motor."""
    return Parameter(
        name="load_side",
        unit="1",
        lower=0.0,
        upper=1.0,
        scale=0.5,
        starts=tuple(side for _, side, _ in tries),
        choice=True,
        shape=True,
    )


def _rotor(
    robot: Robot, site: str, tries: Sequence[tuple[float, float, float]]
) -> tuple[Parameter, ...]:
    """The rotor's inertia, where the model has none: it is added with the play, not without."""
    joint, model = robot.joints[site], robot.model
    if model.dof_armature[joint.dof] > 0:
        return ()
    inertia, step = float(model.dof_M0[joint.dof]), float(model.opt.timestep)
    # What the drive's gains can move alone without shaking at this timestep.
    explicit = model.opt.integrator in (
        mujoco.mjtIntegrator.mjINT_EULER,
        mujoco.mjtIntegrator.mjINT_RK4,
    )
    least = max(
        0.01 * inertia,
        *(drive.stiffness * step**2 for drive in joint.drives),
        *(drive.damping * step for drive in joint.drives if explicit or drive.in_python),
    )
    starts = tuple(max(size * inertia, 2 * least) for _, _, size in tries)
    return (
        Parameter(
            name="armature",
            unit="kg" if joint.slide else "kg·m²",
            zero=starts[0],
            lower=least,
            upper=20 * max(starts),
            scale=5 * starts[0],
            starts=starts,
            shape=True,
        ),
    )


def _add(trials: Trials, site: str, values: FloatArray, names: Sequence[str], least: float) -> None:
    """Adds to a joint's play, in the variants where the first of the values is above the least."""
    play, parts = trials.play(site), values[:, 0] > least
    for name, column in zip(names[: values.shape[1]], values.T, strict=True):
        if name == "load_side":
            trials.load_side[site][parts] = column[parts] > _BOTH_SIDES
        else:
            play[name][parts] += column[parts]
