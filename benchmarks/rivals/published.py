"""What the makers of the logs published of their machines, as effects of the catalogue.

    robots = published("double_pendulum", problem)
    gap.replay(problem, robots).gap

Nothing is fitted here; the numbers are the makers' own:

- emps: Janot, Gautier and Brunot, "Data set and reference models of EMPS", 2019: viscous and
  Coulomb friction and a constant force, beside the mass that the model has;
- double_pendulum: the makers' design C.1 (DFKI, "dual purpose acrobot and pendubot platform"),
  whose friction b q̇ + cf atan(100 q̇) is taken as damping b and frictionloss cf π/2, and whose
  rotors of 6.29e-5 kg·m² turn six times as fast;
- xl330: BAM's M1 (Coulomb and viscous friction, armature, and 0.018 rad that are added to what
  the encoder reads), with the back-EMF kt²/R of its motor as a velocity gain; kt/R is in the model;
- go2_leg: the makers' fit of damping, frictionloss and armature (issue 8 of their repository), less
  what their model has already.

Which recordings they come from is the makers' choice; it may have been those that are held out
here as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

import numpy as np

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_GO2 = ("FL_hip_joint", "FL_thigh_joint", "FL_calf_joint")


def _beyond(own: float, *published: float) -> dict[str, float]:
    """What each joint of the leg has beyond what its model has."""
    return {joint: value - own for joint, value in zip(_GO2, published, strict=True)}


PUBLISHED: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "emps": {
        "viscous_friction": {"carriage": 203.5034},
        "coulomb_friction": {"carriage": 20.3935},
        "torque_bias": {"carriage": 3.1648},
    },
    "double_pendulum": {
        "viscous_friction": {"shoulder": 0.001, "elbow": 0.001},
        "coulomb_friction": {"shoulder": 0.16 * pi / 2, "elbow": 0.12 * pi / 2},
        "armature": {"shoulder": 36 * 6.29e-5, "elbow": 36 * 6.29e-5},
    },
    "xl330": {
        "velocity_gain": {"servo": 0.323**2 / 4.76},
        "viscous_friction": {"servo": 0.0105},
        "coulomb_friction": {"servo": 0.007},
        "armature": {"servo": 0.0016},
        "encoder_offset": {"servo": -0.018},
    },
    "go2_leg": {
        "viscous_friction": _beyond(0.6, 0.20, 0.17, 0.35),
        "coulomb_friction": _beyond(0.2, 0.17, 0.17, 0.71),
        "armature": _beyond(0.01, 0.008, 0.017, 0.043),
    },
}
"""Log to effect to joint to its one number, in the effect's unit."""


def count(name: str) -> int:
    """How many numbers the makers of a log give."""
    return sum(len(by_joint) for by_joint in PUBLISHED[name].values())


def published(name: str, problem: Problem) -> tuple[Robot, ...]:
    """The robots of a problem with the makers' numbers.

    Args:
        name: of the log, one of `PUBLISHED`.
        problem: what `gap.load` returned for it.

    Returns:
        One robot per experiment.
    """
    return tuple(mend(_with(robot, PUBLISHED[name])) for robot in problem.robots)


def _with(robot: Robot, effects: Mapping[str, Mapping[str, float]]) -> Trials:
    trials = Trials(robot, 1)
    for effect, by_joint in effects.items():
        for joint, value in by_joint.items():
            CATALOGUE[effect].apply(trials, joint, np.array([[value]]))
    return trials
