"""What a model may be wrong by before anything was measured: robots that an experiment must suit.

    doubted = variants(robot, joints)
    doubted.trials              # the model itself first, then eight that differ from it
    doubted.names[1]            # "ground friction −40 %, payload −5 %, gains −20 %, no delay"

Four things are in doubt (`UNCERTAINTY`), each at one of its ends: of the sixteen combinations, the
half in which every three of them occur in all combinations (a 2⁴⁻¹ factorial design of resolution
IV; Box, Hunter, Hunter, Statistics for Experimenters, 2005). The payload is on the base.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]

UNCERTAINTY: Final = MappingProxyType(
    {
        "ground friction": (-0.4, 0.25),  # of the model's
        "payload": (-0.05, 0.15),  # of the robot's mass
        "gains": (-0.2, 0.2),  # of the servos' stiffness and damping
        "delay": (0.0, 0.01),  # s, of the targets on their way to the drives
    }
)
"""What is in doubt, from one end to the other."""


@dataclass(frozen=True, kw_only=True)
class Variants:
    """Robots that differ.

    Attributes:
        trials: one row each; the first is the model itself.
        names: what differs, in words.
    """

    trials: Trials
    names: tuple[str, ...]


def variants(robot: Robot, base: Base, joints: Sequence[Joint]) -> Variants:
    """The model, and the corners of what is in doubt of it.

    Args:
        robot: a robot that floats.
        base: its base.
        joints: those that are sent positions.
    """
    signs = [(a, b, c, a * b * c) for a, b, c in itertools.product((-1, 1), repeat=3)]
    ends = np.array(
        [
            [0.0] * len(UNCERTAINTY),
            *(
                [UNCERTAINTY[name][sign > 0] for name, sign in zip(UNCERTAINTY, row, strict=True)]
                for row in signs
            ),
        ]
    )
    friction, payload, gains, delay = ends.T
    trials = Trials(robot, len(ends))
    mass = float(robot.model.body_subtreemass[base.id])
    trials.field("body_mass")[:, base.id] += np.maximum(
        payload * mass, -0.5 * robot.model.body_mass[base.id]
    )
    slides = CATALOGUE["ground_friction"]
    for site in slides.sites(robot, ()):
        least = float(slides.fields["friction"].read(robot, site, robot) or 0.0)
        slides.apply(trials, site, friction[:, None] * least)
    for name, size in (("position_gain", "stiffness"), ("velocity_gain", "damping")):
        for joint in joints:
            if CATALOGUE[name].sites(robot, (joint.name,)):
                change = gains[:, None] * gain(robot, joint, size)
                CATALOGUE[name].apply(trials, joint.name, change)
    for joint in joints:
        trials.command_delay[joint.name] += delay
    return Variants(trials=trials, names=("the model", *map(_named, ends[1:])))


def gain(robot: Robot, joint: Joint, size: str) -> float:
    """A gain of a joint's position servo [N·m/rad, N·m·s/rad; N/m, N·s/m]."""
    known = robot.number(joint.name, size)
    drive = joint.drive("position")
    if known is not None or drive is None:
        return known or 0.0
    return float(getattr(drive, size))


def _named(row: FloatArray) -> str:
    told = []
    for name, value in zip(UNCERTAINTY, row, strict=True):
        if name == "delay":
            told.append(f"{1e3 * value:.0f} ms late" if value else "no delay")
        else:
            told.append(f"{name} {'−' if value < 0 else '+'}{abs(value):.0%}")
    return ", ".join(told)
