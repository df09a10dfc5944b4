"""What a robot is mounted on, where that gives way."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from types import MappingProxyType

import numpy as np

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import EVERYWHERE, Effect, FloatArray, Parameter
from walkerkit.gap.effects.play import spring_damping
from walkerkit.gap.simulation.gear_play import stiffest
from walkerkit.gap.simulation.mount import carrier, made_mount, mounts, with_mount
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_RESONANCES = (25.0, 12.0, 6.0)  # Hz; of the whole robot on its mount
_TYPICAL, _SOFTEST = 12.0, 2.0  # Hz


def _made(name: str, robot: Robot, site: str, given: Robot) -> float | None:
    return made_mount(robot)[name]


class MountCompliance(Effect):
    """The stand, the clamp or the mount of the trunk gives way, and rings."""

    name = "mount_compliance"
    part = "play"
    equation = (
        "M = −K φ − 2 ζ √(K I) φ̇ about the world's x and y through the carrying body, 1/K: "
        "compliance [rad/(N·m)], ζ: damping_ratio [1], I: what is carried"
    )
    symptom = "ringing of all joints after fast moves of one"
    added_as = "two joints under the robot, with stiffness and damping"
    source = "MuJoCo XML reference, joint/stiffness; Spong, J. Dyn. Sys. Meas. Control 109, 1987"
    kind = "robot"
    fields = MappingProxyType(
        {
            "compliance": fields.Field(
                path="joint[mount_roll, mount_pitch]/stiffness",
                read=partial(_made, "compliance"),
            ),
            "damping_ratio": fields.Field(
                path="joint[mount_roll, mount_pitch]/damping",
                read=partial(_made, "damping_ratio"),
            ),
        }
    )

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """The robot as a whole, where one body carries it and no mount is modelled yet."""
        return () if carrier(robot) is None or mounts(robot) else (EVERYWHERE,)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Compliance, and its damping over the critical one."""
        inertia = _carried(robot)
        least = 4 * stiffest(float(robot.model.opt.timestep), inertia)

        def compliance(frequency: float) -> float:
            return max(least, 1 / (inertia * (2 * np.pi * frequency) ** 2))

        return (
            Parameter(
                name="compliance",
                unit="rad/(N·m)",
                lower=0.0,
                upper=max(compliance(_SOFTEST), 2 * least),
                scale=compliance(_TYPICAL),
                starts=tuple(compliance(frequency) for frequency in _RESONANCES),
                inverse=("stiffness", "N·m/rad"),
            ),
            spring_damping(len(_RESONANCES)),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the mount's compliance; its damping is what it is where there is one."""
        mount, soft = trials.mount(), values[:, 0] > 0
        mount["compliance"] += values[:, 0]
        mount["damping_ratio"][soft] = values[soft, 1]


def _carried(robot: Robot) -> float:
    """Inertia of the robot in its reference pose about a level axis through what carries it."""
    mounted = robot.made.get("mounted", lambda: with_mount(robot))
    return float(max(mounted.model.dof_M0[joint.dof] for joint in mounts(mounted)))
