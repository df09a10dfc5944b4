"""Drivetrain laws as one Python file for a trainer: the library's own code, on other arrays.

    text = law_code(robot, "jax")          # or "torch"

The file needs nothing of this package. Its laws are the bodies of `DrivetrainLaw.apply`, so that a
trainer simulates what was diagnosed; numbers that these prepare once are written out.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import LAWS, CommandDelay, DrivetrainLaw, QuadraticDrag
from walkerkit.gap.simulation.interpolate import made_delay
from walkerkit.gap.simulation.robot import Robot

Arrays = Literal["jax", "torch"]
FloatArray = NDArray[np.float64]

_ROOM = 2  # times as long a delay as was found can be drawn
_HEADS = {
    "jax": """import jax.numpy as xp
from mujoco import mjx

LEAST_DRY = 1e-9  # MJX takes a friction of 0 for one without bounds, which holds the joint


def array(values):
    return xp.asarray(values, dtype=float)


def zeros(shape):
    return xp.zeros(shape)


def as_index(whole):
    return whole.astype(int)


def take(history, age):
    return xp.take_along_axis(history, xp.minimum(age, history.shape[-1] - 1), axis=-1)
""",
    "torch": '''import torch

DEVICE = "cuda" if torch.cuda.is_available() else "cpu"
DTYPE = torch.float32
LEAST_DRY = 0.0


def array(values):
    return torch.as_tensor(values, dtype=DTYPE, device=DEVICE)


def zeros(shape):
    return torch.zeros(shape, dtype=DTYPE, device=DEVICE)


def as_index(whole):
    return whole.long()


def take(history, age):
    return torch.take_along_dim(history, age.clamp(max=history.shape[-1] - 1), dim=-1)


class xp:
    """The functions that the laws use, for tensors and numbers alike."""

    nan, inf = float("nan"), float("inf")
    abs, ceil, exp, floor, sign, sin = (
        torch.abs, torch.ceil, torch.exp, torch.floor, torch.sign, torch.sin
    )
    isnan, isfinite, zeros_like, concatenate, where = (
        torch.isnan, torch.isfinite, torch.zeros_like, torch.cat, torch.where
    )

    @staticmethod
    def maximum(one, other):
        return torch.maximum(*xp._tensors(one, other))

    @staticmethod
    def minimum(one, other):
        return torch.minimum(*xp._tensors(one, other))

    @staticmethod
    def _tensors(*values):
        known = next(value for value in values if isinstance(value, torch.Tensor))
        return [torch.as_tensor(v, dtype=known.dtype, device=known.device) for v in values]
''',
}


@dataclass(frozen=True, kw_only=True)
class Driven:
    """A robot's driven joints as the exported file has them.

    Attributes:
        joints: their names.
        numbers: the file's constants, (n_joints,) each, or pairs and triples of such.
        laws: law to its parameters as prepared, (n_joints,) each.
        memory: law to the depth of each thing that it remembers; None for a single number.
    """

    joints: tuple[str, ...]
    numbers: Mapping[str, object]
    laws: Mapping[str, Mapping[str, FloatArray]]
    memory: Mapping[str, Mapping[str, int | None]]


def all_laws(robot: Robot, *, delays: bool, drag: bool) -> dict[str, dict[str, dict[str, float]]]:
    """The laws of a robot, with what a trainer's physics does not do among them.

    Args:
        robot: the robot.
        delays: actuators' own delays become laws.
        drag: so does drag that grows with the square of speed.

    Returns:
        Joint to law to its parameters.
    """
    found = {joint: {n: dict(p) for n, p in laws.items()} for joint, laws in robot.laws.items()}
    model = robot.model
    for name, joint in robot.joints.items():
        if delays and joint.drives:
            step = float(model.opt.timestep)
            delay = float(made_delay(model.actuator_delay[joint.drives[0].actuator], step))
            if delay:
                own = found.setdefault(name, {}).setdefault(CommandDelay.name, {"delay": 0.0})
                own["delay"] += delay
        second = float(model.dof_dampingpoly[joint.dof, 0])
        if drag and second and joint.drives:
            found.setdefault(name, {})[QuadraticDrag.name] = {"drag": second}
    return {joint: laws for joint, laws in found.items() if laws}


def driven(robot: Robot, laws: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Driven:
    """The numbers of the file.

    Args:
        robot: the robot.
        laws: joint to law to its parameters.
    """
    joints = tuple(name for name, joint in robot.joints.items() if joint.drives)
    dt = float(robot.model.opt.timestep)
    prepared: dict[str, Mapping[str, FloatArray]] = {}
    memory: dict[str, Mapping[str, int | None]] = {}
    for name, law in LAWS.items():
        if not any(name in of for of in laws.values()):
            continue
        given = {
            parameter: np.array(
                [
                    laws.get(j, {}).get(name, law.neutral).get(parameter, law.neutral[parameter])
                    for j in joints
                ]
            )
            for parameter in law.parameter_names()
        }
        prepared[name] = law.prepared(given, dt)
        depth = law.depth(given, dt) if law.state else None
        memory[name] = dict.fromkeys(law.state, depth if depth is None else _ROOM * depth)
    return Driven(joints=joints, numbers=_numbers(robot, joints), laws=prepared, memory=memory)


def _numbers(robot: Robot, joints: tuple[str, ...]) -> dict[str, object]:
    """What the robot's actuators make of targets."""
    model = robot.model
    drives = [robot.joints[name].drives[0] for name in joints]
    ids = [drive.actuator for drive in drives]
    gear = model.actuator_gear[ids, 0]
    # In the actuators' own order of signs, at the joints.
    bias = model.actuator_biasprm[ids, :3] * np.stack([gear, gear**2, gear**2], axis=1)
    bias[model.actuator_biastype[ids] == 0] = 0.0
    effort = np.sort(model.actuator_forcerange[ids] * gear[:, None], axis=1)
    effort[model.actuator_forcelimited[ids] == 0] = [-np.inf, np.inf]
    ctrl = model.actuator_ctrlrange[ids].copy()
    ctrl[model.actuator_ctrllimited[ids] == 0] = [-np.inf, np.inf]
    position = np.array([drive.kind == "position" for drive in drives])
    return {
        "stiffness": np.where(position, -bias[:, 1], 0.0),
        "damping": -bias[:, 2],
        "limit": effort[:, 1],
        "dry": model.dof_frictionloss[[robot.joints[name].dof for name in joints]],
        "slope": np.array([drive.slope for drive in drives]),
        "offset": np.array([drive.offset for drive in drives]),
        "gain": model.actuator_gainprm[ids, 0] * gear,
        "bias": (bias[:, 0], bias[:, 1], bias[:, 2]),
        "ctrl_range": (ctrl[:, 0], ctrl[:, 1]),
        "effort_range": (effort[:, 0], effort[:, 1]),
    }


def law_code(
    robot: Robot,
    laws: Mapping[str, Mapping[str, Mapping[str, float]]],
    arrays: Arrays,
    *,
    use: str = "",
) -> str:
    """The file.

    Args:
        robot: the robot.
        laws: joint to law to its parameters.
        arrays: whose arrays it works on.
        use: a comment on how it is used, lines without their signs.
    """
    found = driven(robot, laws)
    more = _of_the_model(robot, found) if arrays == "jax" else {}
    chosen = [LAWS[name] for name in found.laws]
    constants: dict[str, float] = {}
    bodies = [_function(law, constants) for law in chosen]
    lines = [f"{name} = {value!r}" for name, value in sorted(constants.items())]
    lines += [
        f"JOINTS = {found.joints!r}",
        f"ACTUATORS = {[int(robot.joints[j].drives[0].ctrl) for j in found.joints]!r}",
        f"IDS = {[robot.joints[j].drives[0].actuator for j in found.joints]!r}  # of actuators",
        f"QPOS = {[robot.joints[j].qpos for j in found.joints]!r}",
        f"DOFS = {[robot.joints[j].dof for j in found.joints]!r}",
        f"PLAYS = {_plays(robot, found)!r}  # column, and what gives way behind it: qpos, dof",
        f"DT = {float(robot.model.opt.timestep)!r}",
        "ROBOT = {",
        *(f"    {name!r}: {_written(value)}," for name, value in found.numbers.items()),
        "}",
        *(f"{name} = {_written(value)}" for name, value in more.items()),
        "LAWS = [",
        *(
            f"    ({law.name!r}, {law.name}, {law.stage!r}, {dict(found.memory[law.name])!r}),"
            for law in chosen
        ),
        "]",
        "PARAMETERS = {",
        *(
            f"    {name!r}: {{{', '.join(f'{key!r}: {_written(v)}' for key, v in p.items())}}},"
            for name, p in found.laws.items()
        ),
        "}",
    ]
    head = f'"""Drivetrain laws that MuJoCo does not have, made by walkerkit.\n\n{use}\n"""\n\n'
    parts = [head + _HEADS[arrays], _asset("runtime.py.txt"), *bodies, "\n".join(lines) + "\n"]
    parts += [_asset("main.py.txt"), *([_asset("mjx.py.txt")] if arrays == "jax" else [])]
    return "\n\n".join(parts)


def _plays(robot: Robot, found: Driven) -> list[tuple[int, int, int]]:
    """Columns of the joints whose play a law reads, with its address in qpos and its dof."""
    if not any(LAWS[name].reads_play for name in found.laws):
        return []
    plays = [(column, robot.joints[name].play) for column, name in enumerate(found.joints)]
    return [(column, play.qpos, play.dof) for column, play in plays if play is not None]


def _of_the_model(robot: Robot, found: Driven) -> dict[str, object]:
    """How MJX's model has the joints' numbers, and what its implicit steps do not know of them."""
    drives = [robot.joints[name].drives[0] for name in found.joints]
    ids = [drive.actuator for drive in drives]
    drag = found.laws.get(QuadraticDrag.name, {}).get("drag", np.zeros(len(found.joints)))
    fast = robot.model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return {
        "AFFINE": (robot.model.actuator_biastype[ids] != 0).astype(float),
        "SERVOS": np.array([float(drive.kind == "position") for drive in drives]),
        "DRAG": drag,
        "IMPLICIT_SERVOS": float(fast),
    }


def _asset(name: str) -> str:
    return resources.files("walkerkit.gap.deliver").joinpath("assets", name).read_text("utf-8")


def _written(value: object) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(map(_written, value))})"
    numbers = ", ".join(
        repr(float(v)) if np.isfinite(v) else f'float("{float(v)}")'
        for v in np.atleast_1d(np.asarray(value, dtype=float))
    )
    return f"array([{numbers}])"


def _function(law: type[DrivetrainLaw], constants: dict[str, float]) -> str:
    """A law's `apply` as a function, with the module's constants that it uses added to these."""
    source = textwrap.dedent(inspect.getsource(law.apply))
    (tree,) = ast.parse(source).body
    if not isinstance(tree, ast.FunctionDef):
        raise TypeError(f"{law.__name__}.apply is no plain function")
    known = vars(inspect.getmodule(law))
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(known.get(node.id), int | float):
            constants[node.id] = known[node.id]
    body = "\n".join(ast.unparse(line) for line in tree.body[1:])
    body = re.sub(r"\bnp\.", "xp.", body)
    body = re.sub(r"\b[A-Z]\w+\.lagged\(", "lagged(", body)
    body = re.sub(
        r"\b[A-Z]\w+\.neutral\['(\w+)'\]", lambda found: repr(law.neutral[found[1]]), body
    )
    title = (law.__doc__ or "").strip().splitlines()[0]
    text = textwrap.indent(body, "    ")
    return f'def {law.name}(step, p, state):\n    """{title}"""\n{text}\n'
