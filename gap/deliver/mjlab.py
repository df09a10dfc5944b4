"""`robot.py` for mjlab: the robot as an `EntityCfg` over the mended MJCF.

Names of the configs and of their fields are those of mjlab 1.6 (`mjlab.actuator`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from walkerkit.actuators.drivetrain import CommandDelay, TorqueSpeedLimit
from walkerkit.gap.deliver.law_code import driven
from walkerkit.gap.deliver.patch import INTEGRATORS
from walkerkit.gap.deliver.suited import planes, thick
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import rest

Laws = Mapping[str, Mapping[str, Mapping[str, float]]]
_HEAD = '''"""The diagnosed robot for mjlab, made by walkerkit.

    from robot import ROBOT, SIMULATION    # mjlab's EntityCfg and SimulationCfg

mjlab takes nothing of the simulation from the robot's file: SIMULATION has what differs from its
defaults. Delays are in physics steps of {dt:g} s; with another timestep, DELAYS says how long.
"""

from pathlib import Path

import mujoco
from mjlab.actuator import {kinds}
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg
from mjlab.sim import MujocoCfg, SimulationCfg

REPLACED = {replaced!r}  # joints whose XML actuators a config takes the place of
DELAYS = {delays}  # of commands [s]


def spec():
    model = mujoco.MjSpec.from_file(str(Path(__file__).with_name("model.xml")))
    for actuator in list(model.actuators):
        if actuator.target in REPLACED:
            model.delete(actuator){planes}
    return model


ROBOT = EntityCfg(
    spec_fn=spec,
    init_state=EntityCfg.InitialStateCfg(
{start}
    ),
    articulation=EntityArticulationInfoCfg(
        actuators=(
{actuators}
        ),
    ),
)
SIMULATION = SimulationCfg(
    mujoco=MujocoCfg(
{options}
    ),
)
'''
_PLANES = """
    for geom in list(model.worldbody.geoms):  # the ground is the scene's
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
            model.delete(geom)"""
_WIDTH = 100
_INTEGRATORS = ("euler", "implicitfast")
_DEFAULTS = {
    "cone": "pyramidal",
    "impratio": 1.0,
    "solver": "newton",
    "iterations": 100,
    "tolerance": 1e-8,
    "ls_iterations": 50,
    "ls_tolerance": 0.01,
    "disableflags": (),
    "enableflags": (),
}
"""Of mjlab's MujocoCfg."""


def config(robot: Robot, laws: Laws) -> tuple[str, Laws, tuple[str, ...]]:
    """The file, the laws that it does not have, and what a user should know.

    Args:
        robot: the robot.
        laws: joint to law to its parameters.
    """
    made = _Actuators(robot, laws)
    options, notes = _options(robot.model)
    on_ground = robot.base is not None and bool(planes(robot.spec))
    text = _HEAD.format(
        dt=float(robot.model.opt.timestep),
        kinds=", ".join(sorted({kind for kind, _ in made.groups})),
        replaced=tuple(made.replaced),
        delays=laid_out(delays(laws)),
        planes=_PLANES if on_ground else "",
        start=_assigned(start(robot), 8),
        actuators=made.written(),
        options=_assigned(options, 8),
    )
    notes += lost_in_steps(made.rounded)
    if on_ground:
        notes.append("the ground of model.xml is left out: mjlab's scene has its own.")
    if made.replaced:
        notes.append(
            f"the damping of {', '.join(made.replaced)} is explicit in mjlab's DcMotorActuatorCfg "
            "and implicit in model.xml: fast motions differ by what the timestep makes of that."
        )
    if made.left:
        notes.append(
            f"laws of {', '.join(made.left)} are in drivetrain.py, to be called before each step."
        )
    return text, made.left, tuple(notes)


class _Actuators:
    """The configs of a robot's actuators, joints with the same one together.

    Attributes:
        groups: config and its fields, to the joints that have it.
        left: joint to laws that no config has.
        replaced: joints whose element in the XML a config takes the place of.
        rounded: as `steps` has it.
    """

    def __init__(self, robot: Robot, laws: Laws):
        self.groups: dict[tuple[str, tuple[tuple[str, Any], ...]], list[str]] = {}
        self.left: dict[str, Mapping[str, Mapping[str, float]]] = {}
        self.replaced: list[str] = []
        self.rounded: dict[str, list[str]] = {}
        found, dt = driven(robot, laws), float(robot.model.opt.timestep)
        for number, joint in enumerate(found.joints):
            own, drive = dict(laws.get(joint, {})), robot.joints[joint].drives[0]
            beside = {*own} - {CommandDelay.name, TorqueSpeedLimit.name}
            late = own.get(CommandDelay.name, {}).get("delay", 0.0)
            lag = steps(late, dt, joint, self.rounded)
            fields: dict[str, Any] = {"delay_min_lag": lag, "delay_max_lag": lag} if lag else {}
            limit = own.get(TorqueSpeedLimit.name)
            if limit is not None and not beside and drive.kind == "position":
                kind, gains = "DcMotorActuatorCfg", found.numbers
                fields |= {
                    "stiffness": at(gains["stiffness"], number),
                    "damping": at(gains["damping"], number),
                    "effort_limit": at(gains["limit"], number),
                    **limit,
                }
                fields["effort_limit"] = braking(fields)
                self.replaced.append(joint)
            else:
                kind = "XmlActuatorCfg"  # which tells by itself only what plain elements take
                if beside or limit is not None:
                    self.left[joint], fields = own, {}
                fields = {"command_field": drive.kind, **fields}
            self.groups.setdefault((kind, tuple(fields.items())), []).append(joint)

    def written(self) -> str:
        """As calls, twelve spaces in."""
        return "\n".join(
            written(kind, "target_names_expr", names, dict(of))
            for (kind, of), names in self.groups.items()
        )


def braking(fields: Mapping[str, Any]) -> float:
    """The limit of a DC motor's effort: faster than its speed without load, it only brakes.

    Both trainers let the line go on down to the limit there, walkerkit's law to the stall torque.
    """
    return float(min(fields["effort_limit"], fields["saturation_effort"]))


def delays(laws: Laws) -> dict[str, float]:
    """Of each joint's commands [s]."""
    late = {joint: of[CommandDelay.name] for joint, of in laws.items() if CommandDelay.name in of}
    return {joint: rounded_off(of["delay"]) for joint, of in late.items()}


def start(robot: Robot) -> dict[str, Any]:
    """Where the robot begins: at its first keyframe, or as its file has it."""
    model, qpos = robot.model, rest(robot.model).qpos
    pose = {name: rounded_off(qpos[joint.qpos]) for name, joint in robot.joints.items()}
    if robot.base is not None:
        place = qpos[robot.base.qpos : robot.base.qpos + 7]
    else:
        roots = np.flatnonzero(model.body_parentid[1:] == 0)[:1] + 1
        place = np.concatenate([model.body_pos[roots], model.body_quat[roots]], axis=1).ravel()
    pos, rot = (tuple(map(rounded_off, part)) for part in (place[:3], place[3:]))
    return {"pos": pos, "rot": rot, "joint_pos": pose}


def _options(model: mujoco.MjModel) -> tuple[dict[str, Any], list[str]]:
    """What of a model's options MujocoCfg has to be given, and what it cannot have."""
    option, notes = model.opt, list[str]()
    integrator = INTEGRATORS[int(option.integrator)].lower()
    if integrator not in _INTEGRATORS:
        notes.append(f"mjlab has no integrator {integrator!r}: SIMULATION has 'implicitfast'.")
        integrator = "implicitfast"
    given: dict[str, Any] = {
        "cone": ("pyramidal", "elliptic")[int(option.cone)],
        "impratio": rounded_off(option.impratio),
        "solver": ("pgs", "cg", "newton")[int(option.solver)],
        "iterations": int(option.iterations),
        "tolerance": rounded_off(option.tolerance),
        "ls_iterations": int(option.ls_iterations),
        "ls_tolerance": rounded_off(option.ls_tolerance),
        "disableflags": _flags(mujoco.mjtDisableBit, int(option.disableflags)),
        "enableflags": _flags(mujoco.mjtEnableBit, int(option.enableflags)),
    }
    if thick(model):
        given["disableflags"] = (*given["disableflags"], "multiccd", "nativeccd")
        notes.append(
            "SIMULATION switches multiccd and nativeccd off, since mjlab loads no boxes or meshes "
            "that touch with a margin otherwise."
        )
    return {
        "timestep": rounded_off(option.timestep),
        "integrator": integrator,
        "gravity": tuple(map(rounded_off, option.gravity)),
        **{name: value for name, value in given.items() if value != _DEFAULTS[name]},
    }, notes


def _flags(kind: Any, bits: int) -> tuple[str, ...]:
    """Names of the flags that are set, as in XML."""
    return tuple(
        name.partition("_")[2].lower()
        for name, flag in kind.__members__.items()
        if bits & int(flag) and not name.startswith("mjN")
    )


def _assigned(fields: Mapping[str, Any], indent: int) -> str:
    space = " " * indent
    return "\n".join(f"{space}{name}={laid_out(value, indent)}," for name, value in fields.items())


def laid_out(value: object, indent: int = 0) -> str:
    """A value as Python has it; what is long goes on in lines that begin further in."""
    text, space = repr(value), "\n" + " " * (indent + 4)
    if len(text) + indent < _WIDTH or not isinstance(value, dict | list | tuple):
        return text
    if isinstance(value, dict):
        pieces = [f"{key!r}: {laid_out(own, indent + 4)}," for key, own in value.items()]
    else:
        pieces = [f"{laid_out(one, indent + 4)}," for one in value]
    lines = [""]
    for piece in pieces:
        if not lines[-1] or len(lines[-1]) + len(piece) + indent + 5 > _WIDTH:
            lines.append(piece)
        else:
            lines[-1] += f" {piece}"
    return text[0] + space.join(lines) + space[:-4] + text[-1]


def rounded_off(value: float) -> float:
    """A number in six digits."""
    return float(f"{value:.6g}")


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
    body = [f"{names_field}={laid_out(tuple(names), 16)}"]
    for name, value in fields.items():
        text = 'float("inf")' if value == np.inf else repr(value)
        body.append(f"{name}={text}")
    inside = "".join(f"\n                {one}," for one in body)
    return f"            {kind}({inside}\n            ),"
