"""Robot files, read so that they can be attached to any arena.

PyMJCF resolves neither units nor compiler settings, and refuses to attach a model whose settings
differ from the arena's. So a file that is not plain (degrees, another Euler sequence, inertia taken
from geoms, URDF, attributes that PyMJCF does not know…) goes through MuJoCo's own reader and
writer, which settle all of that; others are taken to the last digit.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_PLAIN: dict[str, tuple[str, ...] | None] = {
    "angle": ("radian",),
    "autolimits": None,
    "meshdir": None,
    "texturedir": None,
    "assetdir": None,
    "coordinate": ("local",),
    "eulerseq": ("xyz",),
}
"""Compiler settings that PyMJCF can attach, with the values that arenas agree to."""
_FREE = 7  # numbers of a free joint's position


@dataclass(frozen=True, kw_only=True)
class RobotFile:
    """A robot, ready to be attached.

    Attributes:
        root: its PyMJCF model, without the free joint, the keyframes and the scene of the file.
        root_body: the body that floats, or the first one.
        floating: the file gave that body a free joint.
        keyframes: by name, positions of the joints (without the free joint) in the model's order.
        poses: by name, position [m] and quaternion of the root body, of a floating robot.
        left_out: sensors that measure against the world, which no attached model can name.
    """

    root: Any
    root_body: Any
    floating: bool
    keyframes: dict[str, FloatArray] = field(default_factory=dict)
    poses: dict[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


def read_robot(path: str | Path) -> RobotFile:
    """Reads an MJCF or URDF file.

    Args:
        path: the file; assets are looked for as MuJoCo does.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: MuJoCo cannot read it, or it has no body.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; give the path of an MJCF or URDF file")
    root = _plain(path) or _settled(path)
    bodies = root.worldbody.body
    if not bodies:
        raise ValueError(f"{path}: the model has no body, so there is no robot to walk")
    body, free = next(
        ((b, f) for b in bodies if (f := _free_joint(b)) is not None), (bodies[0], None)
    )
    return _robot(root, body, free)


def _plain(path: Path) -> Any | None:
    """The file as PyMJCF reads it, or None where that would not do."""
    if path.suffix.lower() == ".urdf":
        return None
    try:
        root = mjcf.from_path(str(path), escape_separators=True)
    except Exception:  # whatever its parser trips over, MuJoCo's own is asked next
        return None
    for name, value in root.compiler.get_attributes().items():
        accepted = _PLAIN.get(name, ())
        if accepted is not None and value not in accepted:
            return None
    return root if root.compiler.angle == "radian" else None


def _settled(path: Path) -> Any:
    """The file as MuJoCo reads it and writes it again."""
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()
        text = spec.to_xml()
    except ValueError as error:
        raise ValueError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    root = mjcf.from_xml_string(text, model_dir=str(path.parent), escape_separators=True)
    for name in list(root.compiler.get_attributes()):
        if name not in _PLAIN:
            delattr(root.compiler, name)
    return root


def _free_joint(body: Any) -> Any | None:
    if body.freejoint is not None:
        return body.freejoint
    return next((joint for joint in body.joint if joint.type == "free"), None)


def _robot(root: Any, body: Any, free: Any | None) -> RobotFile:
    keyframes: dict[str, FloatArray] = {}
    poses: dict[str, tuple[FloatArray, FloatArray]] = {}
    model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
    if free is not None:
        base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body.full_identifier)
        first = int(model.jnt_qposadr[model.body_jntadr[base]])
        rest = np.delete(np.arange(model.nq), np.arange(first, first + _FREE))
    else:
        first, rest = 0, np.arange(model.nq)
    every = {"": model.qpos0}
    every.update({model.key(i).name: model.key_qpos[i] for i in range(model.nkey)})
    for name, qpos in every.items():
        keyframes[name] = qpos[rest].copy()
        if free is not None:
            poses[name] = qpos[first : first + 3].copy(), qpos[first + 3 : first + _FREE].copy()
    for key in list(root.keyframe.key):
        # It has the size of the whole model, and would not compile beside anything that moves.
        key.remove()
    if free is not None:
        free.remove()
        # Where it stands is the arena's to say; the file's pose is kept in `poses`.
        body.pos = [0, 0, 0]
        for attribute in ("quat", "axisangle", "euler", "xyaxes", "zaxis"):
            setattr(body, attribute, None)
        # What is fixed to the file's world would be carried about by a robot that floats.
        for kind in ("geom", "light", "camera", "site"):
            for element in list(getattr(root.worldbody, kind)):
                element.remove()
    # Within an arena the file's world is a frame of its own, so nothing can refer to it any more.
    left_out = [
        sensor
        for sensor in root.find_all("sensor")
        if "world" in (getattr(sensor, "objname", None), getattr(sensor, "refname", None))
    ]
    names = tuple(str(sensor.name) for sensor in left_out)
    for sensor in left_out:
        sensor.remove()
    if root.option.cone not in (None, "elliptic"):
        root.option.cone = None  # dm_control's arenas are elliptic, and PyMJCF would not merge them
    return RobotFile(
        root=root,
        root_body=body,
        floating=free is not None,
        keyframes=keyframes,
        poses=poses,
        left_out=names,
    )
