"""`actuators.py` for Isaac Lab: actuator configs of the mended robot.

Names of the configs and of their fields are those of Isaac Lab 2.3 (`isaaclab.actuators`), in which
friction is an effort [N·m; N]. The robot's USD is made of the model.xml beside.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from walkerkit.actuators.drivetrain import CommandDelay, TorqueSpeedLimit
from walkerkit.gap.deliver.law_code import driven
from walkerkit.gap.deliver.mjlab import (
    at,
    braking,
    delays,
    laid_out,
    lost_in_steps,
    rounded_off,
    start,
    steps,
)
from walkerkit.gap.simulation.robot import Robot

Laws = Mapping[str, Mapping[str, Mapping[str, float]]]
_HEAD = '''"""Actuators of the diagnosed robot for Isaac Lab 2.3, made by walkerkit.

    ./isaaclab.sh -p scripts/tools/convert_mjcf.py model.xml robot.usd --import-sites{fix}

    from actuators import ACTUATORS, START

    ArticulationCfg(
        spawn=UsdFileCfg(usd_path="robot.usd"),
        init_state=ArticulationCfg.InitialStateCfg(**START),
        actuators=ACTUATORS,
    )

Delays are in physics steps of {dt:g} s: simulate with SimulationCfg(dt={dt:g}, gravity={gravity}).
With another timestep, DELAYS says how long they are.
"""

from isaaclab.actuators import {kinds}

START = {start}
DELAYS = {delays}  # of commands [s]
ACTUATORS = {{
{actuators}
}}
'''


def config(robot: Robot, laws: Laws) -> tuple[str, Laws, tuple[str, ...]]:
    """The file, the laws that it does not have, and what a user should know.

    Args:
        robot: the robot.
        laws: joint to law to its parameters.
    """
    found, notes, model = driven(robot, laws), list[str](), robot.model
    dt, numbers, rounded = float(model.opt.timestep), found.numbers, dict[str, list[str]]()
    left: dict[str, Mapping[str, Mapping[str, float]]] = {}
    groups: dict[tuple[str, tuple[tuple[str, Any], ...]], list[str]] = {}
    for number, joint in enumerate(found.joints):
        own, dof = dict(laws.get(joint, {})), robot.joints[joint].dof
        dry = float(model.dof_frictionloss[dof])
        fields: dict[str, Any] = {
            "stiffness": at(numbers["stiffness"], number),
            "damping": at(numbers["damping"], number),
            "effort_limit": at(numbers["limit"], number),
            "armature": float(model.dof_armature[dof]),
            "friction": dry,
            "dynamic_friction": dry,
            "viscous_friction": float(model.dof_damping[dof]),
        }
        kind, rest = "IdealPDActuatorCfg", dict(own)
        limit, delay = own.get(TorqueSpeedLimit.name), own.get(CommandDelay.name)
        if limit is not None:
            kind = "DCMotorCfg"
            fields |= rest.pop(TorqueSpeedLimit.name)
            fields["effort_limit"] = braking(fields)
            if delay is not None:
                notes.append(
                    f"no config has both a torque–speed limit and a delay: that of {joint}, "
                    f"{1e3 * delay['delay']:.3g} ms, is in drivetrain.py."
                )
        elif delay is not None:
            kind = "DelayedPDActuatorCfg"
            lag = steps(rest.pop(CommandDelay.name)["delay"], dt, joint, rounded)
            fields |= {"min_delay": lag, "max_delay": lag}
        if rest:
            left[joint] = rest
        if fields["effort_limit"] == np.inf:
            del fields["effort_limit"]
        groups.setdefault((kind, tuple(fields.items())), []).append(joint)
    lines = []
    for (kind, of), names in groups.items():
        shown = {"joint_names_expr": names, **dict(of)}
        inside = "".join(f"\n        {key}={laid_out(one, 8)}," for key, one in shown.items())
        lines.append(f"    {names[0]!r}: {kind}({inside}\n    ),")
    text = _HEAD.format(
        dt=dt,
        fix=" --fix-base" if robot.base is None else "",
        gravity=tuple(map(rounded_off, model.opt.gravity)),
        kinds=", ".join(sorted({kind for kind, _ in groups})),
        start=laid_out(start(robot)),
        delays=laid_out(delays(laws)),
        actuators="\n".join(lines),
    )
    return text, left, (*lost_in_steps(rounded), *notes)
