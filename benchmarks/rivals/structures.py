"""Published sets of parameters as structures of the catalogue, fitted by its own means.

    effects, missing = structure("BAM M4", problem)
    found = fit(problem, effects)
    gap.replay(problem, mended(problem, found)).gap

PACE (Bjelonic, Tischhauser, Hutter, "Towards bridging the gap: systematic sim-to-real transfer for
diverse legged robots", 2025) fits armature, viscous and Coulomb friction and the bias of each
joint's position, and one delay of the commands for all. These are five effects, exactly; in place
of its optimizer (CMA-ES) there is ours.

BAM (Duclusaud, Passault, Padois, Ly, "Extended friction models for the physics simulation of servo
actuators", 2025) fits a motor (kt, R, armature, offset and, in its code of today, the delay of the
commands) under one of six models of friction:

| model | its friction | here |
|---|---|---|
| M1 | Coulomb and viscous | the same |
| M2 | M1, Stribeck | `stribeck_friction`: the same, exponent and velocity too |
| M3 | M1, load-dependent | `load_dependent_friction`: of the drive's effort alone |
| M4 | M2 and M3 | both; BAM's load-dependent part has a Stribeck term of its own |
| M5 | M4, other factors on the drive's load and on the external | `directional_efficiency` |
| M6 | M5, quadratic in the load | the catalogue has none: M5 with `quadratic_drag`, of the speed |

Its motor is `torque_constant` (kt/R) and `velocity_gain` (kt²/R, the back-EMF), which the model's
effort limit clips here while BAM clips the voltage before it: what is beyond, viscous friction
takes up. A drive that takes efforts has no gain to change, and goes without.

BAM's friction of the load is a|τ_drive| + b|τ_external|, with a = b up to M4. In steady motion it
makes the drive's effort worth (1 − a)/(1 + b) when it drives and (1 + a)/(1 − b) when it is driven.
With kt free these are the two numbers of `directional_efficiency`, whose mean is the torque
constant: M5 and M6 have it in place of both `torque_constant` and `load_dependent_friction`, and
span no more than M4 does there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.fit import fit as improve
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Structure, candidate_terms, carried
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]

_PLAIN = ("armature", "viscous_friction", "coulomb_friction", "encoder_offset", "command_delay")
_MOTOR = (*_PLAIN, "velocity_gain")

STRUCTURES: dict[str, tuple[str, ...]] = {
    "PACE": _PLAIN,
    "BAM M1": (*_MOTOR, "torque_constant"),
    "BAM M2": (*_MOTOR, "torque_constant", "stribeck_friction"),
    "BAM M3": (*_MOTOR, "torque_constant", "load_dependent_friction"),
    "BAM M4": (*_MOTOR, "torque_constant", "stribeck_friction", "load_dependent_friction"),
    "BAM M5": (*_MOTOR, "stribeck_friction", "directional_efficiency"),
    "BAM M6": (*_MOTOR, "stribeck_friction", "directional_efficiency", "quadratic_drag"),
}
NESTED: dict[str, tuple[str, ...]] = {
    "BAM M2": ("BAM M1",),
    "BAM M3": ("BAM M1",),
    "BAM M4": ("BAM M2", "BAM M3"),
    "BAM M5": ("BAM M4",),
    "BAM M6": ("BAM M5",),
}
"""What each is more of, which it fits at least as well as."""
_OPTIONAL = ("velocity_gain",)
_SURE = ("armature", "viscous_friction", "coulomb_friction")
_ITERATIONS = 40


def structure(name: str, problem: Problem) -> tuple[dict[str, str], tuple[str, ...]]:
    """A published set on the joints of a problem.

    Args:
        name: one of `STRUCTURES`.
        problem: what `gap.load` returned.

    Returns:
        What `gap.fit` takes, and the effects that no joint can have and the set can do without.

    Raises:
        ValueError: no joint can have an effect that makes the set what it is.
    """
    effects, missing = {}, []
    for effect in STRUCTURES[name]:
        if candidate_terms([CATALOGUE[effect]], problem.robots, problem.joints):
            effects[effect] = EVERYWHERE
        elif effect in _OPTIONAL:
            missing.append(effect)
        else:
            raise ValueError(f"{effect} can act on no joint")
    return effects, tuple(missing)


def fit(problem: Problem, effects: Mapping[str, str], nested: Sequence[Fit] = ()) -> Fit:
    """Fits a structure in several ways, and keeps the one that fits best.

    `gap.fit` adds the effects one by one, and what it adds first may take the place of what comes
    later. From armature and friction together it is another way down, from what it is more of a
    third.

    Args:
        problem: what `gap.load` returned.
        effects: what `structure` returned.
        nested: fits of what the structure is more of.
    """
    fitted = gap.fit(problem, effects)
    structure = fitted.fit.structure
    together = structure.zero.copy()
    for k, slot in enumerate(structure.slots):
        if slot.term.effect.name in _SURE:
            together[k] = slot.parameter.starts[0]
    values = [fitted.fit.values, together, *(start_from(one, structure) for one in nested)]
    problem.fit.refine(fitted.fit)
    objective = problem.fit.objective
    starts = evaluate(objective, [(structure, np.clip(v, *structure.bounds)) for v in values])
    return min(improve(objective, starts, iterations=_ITERATIONS), key=lambda one: one.score)


def start_from(one: Fit, structure: Structure) -> FloatArray:
    """The values with which a structure does what one does that it is more of.

    Args:
        one: a fit of what is nested.
        structure: the larger one.

    Returns:
        (n_parameters,) values. Where only the larger one has `directional_efficiency`, that takes
        up the other's torque constant 1 + α and load-dependent friction c: (1 + α)(1 ∓ c).
    """
    values = carried(one.values, one.structure, structure)
    known = {slot.key: value for slot, value in zip(one.structure.slots, one.values, strict=True)}
    for k, slot in enumerate(structure.slots):
        if slot.term.effect.name == "directional_efficiency" and slot.key not in known:
            gained = known.get(("torque_constant", slot.place, "strength"), 0.0)
            lost = known.get(("load_dependent_friction", slot.place, "coefficient"), 0.0)
            sign = -1 if slot.parameter.name == "driving" else 1
            values[k] = (1 + gained) * (1 + sign * lost)
    return values


def mended(problem: Problem, found: Fit) -> tuple[Robot, ...]:
    """The robots of a problem with what a fit has, one per experiment."""
    trials = (found.structure.trials(robot, found.values[None]) for robot in problem.robots)
    return tuple(map(mend, trials))
