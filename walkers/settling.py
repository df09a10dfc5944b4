"""MuJoCo's own reader and writer, which settle what PyMJCF leaves open.

    spec, model = settled(path)
    leave_out(spec, scene, world=True)
    text = written(spec)

Units, frames, inertias and settings of the compiler are then as MuJoCo compiles them, and nothing
is lost in the digits.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from walkerkit.walkers.xml_digits import xml_digits

_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_STATED = re.compile(
    r"<include\b[^>]*?\bfile\s*=\s*[\"']([^\"']*)[\"']"
    r"|<option\b[^>]*?\bintegrator\s*=\s*[\"'](\w+)[\"']"
)
"""The file that is included, or the integrator."""
_DIGITS = 17  # those of a double
_KINDS = {
    "body": "bodies",
    "geom": "geoms",
    "site": "sites",
    "camera": "cameras",
    "light": "lights",
    "tendon": "tendons",
    "actuator": "actuators",
    "sensor": "sensors",
    "equality": "equalities",
    "exclude": "excludes",
    "pair": "pairs",
}


def settled(path: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """A file as MuJoCo compiles it, without frames and without settings that undo an edit.

    Args:
        path: an MJCF or URDF file.

    Returns:
        The spec, whose elements have the ids of the model beside it.

    Raises:
        ValueError: MuJoCo cannot read it.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    if b"<robot" in path.read_bytes():
        # By default the links of fixed joints lose their bodies, and so does the base its mass.
        spec.compiler.fusestatic = False
    model = spec.compile()
    compiler = spec.compiler
    if max(compiler.settotalmass, compiler.boundmass, compiler.boundinertia) > 0:
        # They would be lost, or do something else to what is left of a scene.
        for body in spec.bodies:
            if body.id:
                state_inertia(body, model)
        compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        compiler.settotalmass, compiler.boundmass, compiler.boundinertia = -1, 0, 0
        model = spec.compile()
    if spec.frames:
        spec = mujoco.MjSpec.from_string(written(spec))
        spec.modelfiledir = str(path.parent)
        _dissolve_frames(spec)
        model = spec.compile()
    return spec, model


def stated_integrator(path: Path) -> str | None:
    """The integrator that a file states, which MuJoCo's writer leaves out where it is the default.

    Args:
        path: an MJCF or URDF file that MuJoCo has read; files that it includes count as well.

    Returns:
        The last one that is stated, None where none is.
    """
    # MuJoCo's parser takes what others call malformed.
    text = _COMMENT.sub("", path.read_text(encoding="utf-8", errors="replace"))
    found = None
    for included, integrator in _STATED.findall(text):
        # Of files that are found by other rules MuJoCo knows, and nothing is assumed here.
        if integrator:
            found = integrator
        elif (path.parent / included).is_file():
            found = stated_integrator(path.parent / included) or found
    return found


def state_inertia(body: Any, model: mujoco.MjModel) -> None:
    """Has a body of a spec say the mass and inertia that it has in the compiled model.

    Args:
        body: with the id that it has in the model.
        model: compiled from its spec.
    """
    body.explicitinertial = True
    body.fullinertia = np.full(6, np.nan)
    body.mass = model.body_mass[body.id]
    body.ipos, body.iquat = model.body_ipos[body.id], model.body_iquat[body.id]
    body.inertia = model.body_inertia[body.id]


def written(spec: mujoco.MjSpec) -> str:
    """The XML of a spec, exact to the last bit.

    Raises:
        ValueError: it does not compile.
    """
    with warnings.catch_warnings():
        # The first compilation has given them.
        warnings.simplefilter("ignore", UserWarning)
        spec.compile()
        with xml_digits(_DIGITS):
            return spec.to_xml()  # type: ignore[no-any-return]


def leave_out(spec: mujoco.MjSpec, bodies: Iterable[Any], *, world: bool) -> tuple[str, ...]:
    """Deletes bodies and all that refers to them or to the world.

    Args:
        spec: what to delete from.
        bodies: bodies of the spec.
        world: delete what is fixed to the world, too: its geoms, sites, cameras and lights.

    Returns:
        What has gone and had a name, as "kind name".
    """
    before = _named(spec)
    for key in list(spec.keys):
        spec.delete(key)  # it has the size of the whole model
    for element in _of_the_world(spec):
        spec.delete(element)
    for equality in spec.equalities:
        if equality.name2 == "world":
            equality.name2 = ""  # says the same
    for body in bodies:
        spec.delete(body)
    if world:
        base = spec.worldbody
        for element in (*base.geoms, *base.sites, *base.cameras, *base.lights):
            spec.delete(element)
    # Of what refers to a deleted element, pairs of geoms are all that MuJoCo does not delete.
    geoms = {geom.name for geom in spec.geoms}
    for pair in list(spec.pairs):
        if not {pair.geomname1, pair.geomname2} <= geoms:
            spec.delete(pair)
    after = _named(spec)
    return tuple(one for one in before if one not in after)


def _of_the_world(spec: mujoco.MjSpec) -> list[Any]:
    """What names the world; in an arena, nothing has that name any more."""
    return [
        *(s for s in spec.sensors if "world" in (s.objname, s.refname)),
        *(e for e in spec.excludes if "world" in (e.bodyname1, e.bodyname2)),
        *(e for e in spec.equalities if e.name1 == "world"),
    ]


def _named(spec: mujoco.MjSpec) -> list[str]:
    return [
        f"{kind} {element.name}"
        for kind, elements in _KINDS.items()
        for element in getattr(spec, elements)
        if element.name
    ]


def _dissolve_frames(spec: mujoco.MjSpec) -> None:
    """Moves what stands in frames to where they put it; orientations are quaternions by now."""
    for element in (*spec.bodies, *spec.geoms, *spec.sites, *spec.cameras, *spec.lights):
        frame = element.frame
        while frame is not None:
            element.pos = frame.pos + _rotated(element.pos, frame.quat)
            if isinstance(element, mujoco.MjsLight):
                element.dir = _rotated(element.dir, frame.quat)
            else:
                turned = np.zeros(4)
                mujoco.mju_mulQuat(turned, frame.quat, element.quat)
                element.quat = turned
            frame = frame.frame
    for frame in spec.frames:
        # One that does nothing is not written.
        frame.name = frame.childclass = ""
        frame.pos, frame.quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


def _rotated(vector: Any, quaternion: Any) -> Any:
    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, vector, quaternion)
    return turned
