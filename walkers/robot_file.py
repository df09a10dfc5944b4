"""Robot files, read so that they can be attached to any arena.

    robot = read_robot("go1.xml")
    robot.root, robot.floating, robot.keyframes["home"]

PyMJCF resolves neither units nor compiler settings nor frames, and refuses to attach a model whose
settings differ from the arena's. So MuJoCo itself reads the file, compiles it and writes it again,
which settles all of that; what belongs to the file's scene and not to the robot is left out.

Limits: PyMJCF takes what dm_control's schema has, so plugins stay outside. In names
it keeps the slash for itself: a slash of the file becomes a backslash.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from walkerkit.actuators.messages import closest, listed
from walkerkit.walkers.settling import leave_out, settled, stated_integrator, written

FloatArray = NDArray[np.float64]

_COMPILER = ("angle", "autolimits", "meshdir", "texturedir", "assetdir")
"""Compiler settings that arenas agree to; the others are settled in what MuJoCo writes."""
_UNNAMED = "MuJoCo Model"  # what MuJoCo calls a model without a name
_FREE, _BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
_LOSSES = ("damping", "armature", "frictionloss")
_WIDTH = {_FREE: 7, _BALL: 4}  # numbers of a joint's position, where not one


@dataclass(frozen=True, kw_only=True)
class RobotFile:
    """A robot, ready to be attached.

    Attributes:
        root: its PyMJCF model, without free joint, keyframes and scene.
        root_body: the body that was asked for, or the one that carries the robot.
        floating: it is to get a free joint in an arena.
        places: of its hinge and slide joints with a name, in kinematic order: where the position of
            each is among the positions of all joints.
        keyframes: by name, positions of all joints [rad; m; quaternions of balls] in kinematic
            order. One without a name goes by its number; "" is the reference pose.
        poses: by the same names, position [m] and quaternion of the body that carries it. Empty
            where the file fixes it to its world and it stays fixed.
        free_joint: what the file's free joint has besides its freedom: `damping`, `armature` and
            `frictionloss`, where not zero.
        left_out: what of the file does not come along and has a name, as "kind name".
        integrator: the integrator that the file states, as it states it; None where it says
            nothing.
    """

    root: Any
    root_body: Any
    floating: bool
    free_joint: Mapping[str, float] = field(default_factory=dict)
    places: Mapping[str, int] = field(default_factory=dict)
    keyframes: Mapping[str, FloatArray] = field(default_factory=dict)
    poses: Mapping[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    integrator: str | None = None


def read_robot(
    path: str | Path, *, root_body: str | None = None, floating: bool | None = None
) -> RobotFile:
    """Reads an MJCF or URDF file.

    The robot is the tree of bodies with most hinges and slides. Where it floats, all else in the
    file's world is scene, and left out; where it is fixed, only what no arena can take: other free
    bodies, and mocap bodies. What refers to the file's world, such as a sensor, is left out, too.

    Args:
        path: the file; assets are looked for as MuJoCo does.
        root_body: name of the robot's root body, where that is another.
        floating: whether it is to get a free joint in an arena; by default as in the file.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: MuJoCo or PyMJCF cannot read it, or it has no such body.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; give the path of an MJCF or URDF file")
    with _refusals("MuJoCo", path):
        spec, model = settled(path)
    chosen = _root_body(path, model, root_body)
    top = int(model.body_rootid[chosen])
    free = _free_joint(model, top)
    floats = free is not None if floating is None else floating
    alone = floats or free is not None
    scene = _scene(model, top, alone=alone)
    joints = _joints_of(model, free, scene)
    bodies = {body.id: body for body in spec.bodies}
    for body in (chosen, top):
        bodies[body].name = bodies[body].name or "root_body"
    name = escaped(bodies[chosen].name)
    free_joints = [joint for joint in spec.joints if joint.id == free]
    left_out = leave_out(spec, [bodies[body] for body in sorted(scene)], world=alone)
    if alone:
        # Where it stands is the arena's to say; the file's word on it is kept in `poses`.
        for joint in free_joints:
            spec.delete(joint)
        _put_at_origin(bodies[top])
    _check_attachable(path, spec)
    spec.modelname = spec.modelname.replace("/", "_")
    with _refusals("MuJoCo", path):
        text = written(spec)
    root = _attachable(path, text)
    states = _states(model)
    columns = [column for joint in joints for column in _columns(model, joint)]
    return RobotFile(
        root=root,
        root_body=root.find("body", name),
        floating=floats,
        free_joint={} if free is None else _losses(model, free),
        places=_places(model, joints),
        keyframes={key: qpos[columns] for key, qpos in states.items()},
        poses=_poses(model, top, free, states) if alone else {},
        left_out=left_out,
        integrator=stated_integrator(path),
    )


def _scene(model: mujoco.MjModel, top: int, *, alone: bool) -> set[int]:
    """The trees of bodies that are not to come along: all but the robot's, where it is alone."""
    return {
        body
        for body in _trees(model)
        if body != top and (alone or model.body_mocapid[body] >= 0 or _is_free(model, body))
    }


def _joints_of(model: mujoco.MjModel, free: int | None, scene: Collection[int]) -> list[int]:
    """The joints that come along, in kinematic order."""
    return [
        joint
        for joint in range(model.njnt)
        if joint != free and model.body_rootid[model.jnt_bodyid[joint]] not in scene
    ]


def _check_attachable(path: Path, spec: mujoco.MjSpec) -> None:
    """Raises ValueError where PyMJCF would attach something wrongly."""
    for flex in spec.flexes:
        raise ValueError(
            f"{path}: the flexible body {flex.name!r} cannot be attached to an arena: PyMJCF does "
            "not rename what it refers to; take it out of the file"
        )


@contextlib.contextmanager
def _refusals(who: str, path: Path) -> Iterator[None]:
    """Says of which file the errors within are."""
    try:
        yield
    except Exception as error:
        # PyMJCF raises whatever its parser trips over.
        raise ValueError(f"{path}: {who} cannot read it: {' '.join(str(error).split())}") from error


def _attachable(path: Path, text: str) -> Any:
    """The model in PyMJCF, without what an arena has an opinion of its own on."""
    with _refusals("PyMJCF", path):
        root = mjcf.from_xml_string(text, model_dir=str(path.parent), escape_separators=True)
    for name in list(root.compiler.get_attributes()):
        if name not in _COMPILER:
            delattr(root.compiler, name)
    for element in (root.visual, root.statistic, root.size):
        element.remove()
    if root.model == _UNNAMED:
        root.model = path.stem
    return root


# What the compiled model tells.


def _trees(model: mujoco.MjModel) -> list[int]:
    """The bodies that stand in the world."""
    return [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]


def _root_body(path: Path, model: mujoco.MjModel, name: str | None) -> int:
    """The body of that name, or the root of the tree with most hinges and slides."""
    trees = [body for body in _trees(model) if model.body_mocapid[body] < 0]
    if not trees:
        raise ValueError(f"{path}: the model has no body, so there is no robot to walk")
    if name is None:
        scalar = [joint for joint in range(model.njnt) if model.jnt_type[joint] not in _WIDTH]
        of_tree = np.bincount(model.body_rootid[model.jnt_bodyid[scalar]], minlength=model.nbody)
        return max(trees, key=lambda body: (of_tree[body], _is_free(model, body)))
    names = [model.body(body).name for body in range(1, model.nbody)]
    if name not in names:
        raise ValueError(
            f"{path}: there is no body {name!r}{closest(name, names)}; use one of {listed(names)}"
        )
    return names.index(name) + 1


def _free_joint(model: mujoco.MjModel, body: int) -> int | None:
    first = int(model.body_jntadr[body])
    return first if first >= 0 and model.jnt_type[first] == _FREE else None


def _is_free(model: mujoco.MjModel, body: int) -> bool:
    return _free_joint(model, body) is not None


def _losses(model: mujoco.MjModel, joint: int) -> dict[str, float]:
    """What a joint's freedom is hampered by."""
    dof = int(model.jnt_dofadr[joint])
    fields = {name: getattr(model, f"dof_{name}") for name in _LOSSES}
    return {name: float(values[dof]) for name, values in fields.items() if values[dof]}


def _columns(model: mujoco.MjModel, joint: int) -> range:
    """Where the position of a joint is in `qpos`."""
    first = int(model.jnt_qposadr[joint])
    return range(first, first + _WIDTH.get(int(model.jnt_type[joint]), 1))


def _places(model: mujoco.MjModel, joints: list[int]) -> dict[str, int]:
    places, place = {}, 0
    for joint in joints:
        name, width = model.joint(joint).name, len(_columns(model, joint))
        if name and model.jnt_type[joint] not in _WIDTH:
            places[escaped(name)] = place
        place += width
    return places


def _states(model: mujoco.MjModel) -> dict[str, FloatArray]:
    """Positions of the whole file: the reference ("") and each keyframe."""
    keys = {model.key(i).name or str(i): model.key_qpos[i].copy() for i in range(model.nkey)}
    return {"": model.qpos0.copy(), **keys}


def _poses(
    model: mujoco.MjModel, top: int, free: int | None, states: Mapping[str, FloatArray]
) -> dict[str, tuple[FloatArray, FloatArray]]:
    if free is None:
        pose = model.body_pos[top].copy(), model.body_quat[top].copy()
        return dict.fromkeys(states, pose)
    columns = list(_columns(model, free))
    return {key: (qpos[columns[:3]], qpos[columns[3:]]) for key, qpos in states.items()}


def _put_at_origin(body: Any) -> None:
    body.pos, body.quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def escaped(name: str) -> str:
    """A name as PyMJCF has it."""
    return name.replace("\\", "\\\\").replace("/", "\\")
