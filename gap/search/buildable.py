"""Effects that this robot cannot have: each costs itself, never the diagnosis.

effects, notes = buildable(effects, problem.robots, problem.joints)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from walkerkit.gap.effects import Effect
from walkerkit.gap.errors import one_line
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_DRY = ("dof_frictionloss", "dof_solref", "dof_solimp")
_TOUCH = ("geom_friction", "geom_solref", "geom_solimp", "geom_margin")
_SWITCHED_OFF: Mapping[str, tuple[str, ...]] = {
    "constraint": (*_DRY, *_TOUCH),
    "frictionloss": _DRY,
    "contact": _TOUCH,
    "damper": ("dof_damping",),
    "spring": ("jnt_stiffness", "qpos_spring"),
}
"""A flag of MuJoCo, and the fields that do nothing in a model where it is disabled."""
_ROWS = 3  # written at once at least, as an effect may know one row alone


def buildable(
    effects: Sequence[Effect], robots: Sequence[Robot], joints: Sequence[str]
) -> tuple[list[Effect], tuple[str, ...]]:
    """Splits off the effects whose numbers cannot be made, or not written into the robots.

    Args:
        effects: those that are to be considered.
        robots: one per condition, with their excursions.
        joints: names of the joints that the recordings measure.

    Returns:
        The others, and a note of each that was left out.
    """
    found, notes = [], []
    for effect in effects:
        problem = why_not(effect, robots, joints)
        if problem is None:
            found.append(effect)
        else:
            notes.append(
                f"{effect.name} was left out, as it cannot be built for {robots[0].source}: "
                f"{problem}. All other effects were considered."
            )
    return found, tuple(notes)


def why_not(effect: Effect, robots: Sequence[Robot], joints: Sequence[str]) -> str | None:
    """What goes wrong as an effect's starts are written into the robots; None where nothing does.

    Args:
        effect: one of ours, or a user's.
        robots: one per condition, with their excursions.
        joints: names of the joints that the recordings measure.
    """
    try:
        for term in candidate_terms([effect], robots, joints):
            structure = Structure((term,), tuple(robots))
            starts = [slot.parameter.starts for slot in structure.slots]
            tries = max(_ROWS, *map(len, starts)) if starts else 0
            values = np.array([np.resize(one, tries) for one in starts], dtype=float).T
            for robot in robots:
                trials = structure.trials(robot, values)
                for name, written in trials.fields.items():
                    if not np.isfinite(written).all():
                        return f"it makes {name} infinite or no number"
                flag = switched_off(trials)
                if flag is not None:
                    return (
                        f'the model\'s <flag {flag}="disable"/> switches off what it changes; '
                        "take that flag out of the model"
                    )
    except Exception as error:  # an effect may fail in any way, and is not worth the others
        return f"{type(error).__name__}: {one_line(error)}"
    return None


def switched_off(trials: Trials) -> str | None:
    """The flag of the model that takes every influence from what was written; None without one."""
    if trials.laws:
        return None
    changed = {
        name
        for name, written in trials.fields.items()
        if not np.array_equal(written, np.broadcast_to(trials.own(name), written.shape))
    }
    for flag, idle in _SWITCHED_OFF.items():
        bit = getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag.upper()}")
        if trials.robot.model.opt.disableflags & bit and changed and changed <= set(idle):
            return flag
    return None
