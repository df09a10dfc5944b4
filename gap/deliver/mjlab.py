"""`robot.py` for mjlab: the robot as an `EntityCfg` over the mended MJCF.

Names of the configs and of their fields are those of mjlab 1.6 (`mjlab.actuator`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from walkerkit.actuators.drivetrain import CommandDelay, TorqueSpeedLimit
from walkerkit.gap.deliver.law_code import driven
from walkerkit.gap.deliver.patch import INTEGRATORS
from walkerkit.gap.simulation.robot import Robot

Laws = Mapping[str, Mapping[str, Mapping[str, float]]]
_HEAD = '''"""The diagnosed robot for mjlab, made by walkerkit.

    from robot import ROBOT          # an mjlab.entity.EntityCfg

Delays are in physics steps of {dt:g} s. What is of the simulation mjlab does not take from the
robot's file, so give it to MujocoCfg: timestep={dt:g}, integrator={integrator!r},
gravity={gravity}.
"""

from pathlib import Path

import mujoco
from mjlab.actuator import DcMotorActuatorCfg, XmlActuatorCfg
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg

REPLACED = {replaced!r}  # joints whose XML actuators a config takes the place of


def spec():
    model = mujoco.MjSpec.from_file(str(Path(__file__).with_name("model.xml")))
    for actuator in list(model.actuators):
        if actuator.target in REPLACED:
            model.delete(actuator)
    return model


ROBOT = EntityCfg(
    spec_fn=spec,
    articulation=EntityArticulationInfoCfg(
        actuators=(
{actuators}
        ),
    ),
)
'''


def config(robot: Robot, laws: Laws) -> tuple[str, Laws, tuple[str, ...]]:
    """The file, the laws that it does not have, and what a user should know.

    Args:
        robot: the robot.
        laws: joint to law to its parameters.
    """
    found, rounded = driven(robot, laws), dict[str, list[str]]()
    dt = float(robot.model.opt.timestep)
    groups: dict[tuple[str, tuple[tuple[str, Any], ...]], list[str]] = {}
    left: dict[str, Mapping[str, Mapping[str, float]]] = {}
    replaced: list[str] = []
    for number, joint in enumerate(found.joints):
        own = dict(laws.get(joint, {}))
        beside = {*own} - {CommandDelay.name, TorqueSpeedLimit.name}
        delayed = not beside
        lag = steps(own.get(CommandDelay.name, {}).get("delay", 0.0), dt, joint, rounded)
        fields: dict[str, Any] = {"delay_min_lag": lag, "delay_max_lag": lag} if lag else {}
        kind = "XmlActuatorCfg"
        limit = own.get(TorqueSpeedLimit.name)
        if limit is not None and delayed and robot.joints[joint].drives[0].kind == "position":
            kind, replaced = "DcMotorActuatorCfg", [*replaced, joint]
            gains = found.numbers
            fields |= {
                "stiffness": at(gains["STIFFNESS"], number),
                "damping": at(gains["DAMPING"], number),
                "effort_limit": at(gains["LIMIT"], number),
                **limit,
            }
        elif own and (beside or limit is not None):
            left[joint], fields = own, {}
        if kind == "XmlActuatorCfg":  # which tells by itself only what plain elements take
            fields = {"command_field": robot.joints[joint].drives[0].kind, **fields}
        groups.setdefault((kind, tuple(fields.items())), []).append(joint)
    lines = [
        written(kind, "target_names_expr", names, dict(of)) for (kind, of), names in groups.items()
    ]
    option = robot.model.opt
    text = _HEAD.format(
        dt=dt,
        integrator=INTEGRATORS[int(option.integrator)].lower(),
        gravity=tuple(float(f"{g:.6g}") for g in option.gravity),
        replaced=tuple(replaced),
        actuators="\n".join(lines),
    )
    notes = lost_in_steps(rounded)
    if left:
        notes.append(
            f"laws of {', '.join(left)} are in drivetrain.py, to be called before each step."
        )
    return text, left, tuple(notes)


def steps(delay: float, dt: float, joint: str, rounded: dict[str, list[str]]) -> int:
    """A delay in whole steps.

    Args:
        delay: of the joint's commands [s].
        dt: of a step [s].
        joint: its name.
        rounded: what steps lose, to the joints that lose it; added to.
    """
    whole = round(delay / dt)
    if abs(whole * dt - delay) > 1e-3 * dt:
        says = f"{1e3 * delay:.3g} ms, becomes {whole} steps of {1e3 * dt:g} ms."
        rounded.setdefault(says, []).append(joint)
    return whole


def lost_in_steps(rounded: Mapping[str, list[str]]) -> list[str]:
    """What `steps` has lost, a note for all joints with the same delay."""
    return [f"the delay of {', '.join(joints)}, {says}" for says, joints in rounded.items()]


def at(values: object, number: int) -> float:
    """One of a joint's numbers."""
    return float(np.asarray(values, dtype=float)[number])


def written(kind: str, names_field: str, names: list[str], fields: Mapping[str, Any]) -> str:
    """A config as a call, twelve spaces in."""
    quoted = ", ".join(map(repr, names))
    body = [f"{names_field}=({quoted},)"]
    for name, value in fields.items():
        text = 'float("inf")' if value == np.inf else repr(value)
        body.append(f"{name}={text}")
    inside = "".join(f"\n                {one}," for one in body)
    return f"            {kind}({inside}\n            ),"
