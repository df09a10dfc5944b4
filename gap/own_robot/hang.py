"""A robot that floats, hung up by its trunk for experiments on its joints.

    made = hung("go2_servo.xml")
    made.text.write(Path("go2_hung.xml"))

The free joint goes, and keyframes lose its numbers. Where the model has a ground, the trunk is
raised until no link can reach it. MuJoCo lets neighbouring bodies overlap unless the first of them
is fixed to the world, as the trunk then is: a hip would collide with the trunk that it is mounted
in, so these pairs are excluded. All other bytes of the file stay.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from walkerkit.gap.errors import refusal
from walkerkit.gap.own_robot.mjcf_text import Element, MjcfText
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Robot

_CLEARANCE = 0.05  # m, that stays below the longest leg


@dataclass(frozen=True, kw_only=True)
class Hung:
    """A model that hangs.

    Attributes:
        text: the changed text, to be written.
        body: what it hangs by.
        height: of that [m].
        excluded: pairs of bodies that no longer collide.
    """

    text: MjcfText
    body: str
    height: float
    excluded: tuple[tuple[str, str], ...]


def hung(model: str | Path, *, height: float | None = None, allow_outside: bool = False) -> Hung:
    """Hangs a robot up.

    Args:
        model: an MJCF file of a robot that floats.
        height: of its trunk [m]; by default as it is, or as high as it takes above a ground.
        allow_outside: the model's files may lie outside of its folder.

    Raises:
        InputError: it does not float, or its text does not show by what.
    """
    robot = load_robot(model, allow_outside=allow_outside)
    if robot.path is None:
        raise refusal(
            f"{model}: a callable has no text to change; a walker that it returns hangs anyway, "
            "where nothing tells the pose of its base. Give an MJCF file."
        )
    if robot.base is None:
        raise refusal(f"{model}: no robot floats in it, so it hangs or is mounted already.")
    text = MjcfText.read(robot.path)
    joint = _free_joint(robot, text)
    body = joint.parents[-1]
    place = _height(robot, robot.base) if height is None else height
    text.remove(joint)
    where = [*map(float, body.attributes.get("pos", "0 0 0").split())]
    if place != where[2]:
        text.change(body, attributes={"pos": f"{where[0]:g} {where[1]:g} {place:g}"})
    _trim_keyframes(robot.model, robot.base, text)
    pairs = tuple(_mounted(robot, robot.base))
    if pairs:
        text.add("contact", [f'<exclude body1="{a}" body2="{b}"/>' for a, b in pairs])
    return Hung(text=text, body=robot.base.body, height=place, excluded=pairs)


def _free_joint(robot: Robot, text: MjcfText) -> Element:
    """The element of the joint by which the robot floats."""
    found = [
        element
        for element in text.elements
        if element.parents
        and element.parents[-1].tag == "body"
        and (
            element.tag == "freejoint"
            or (element.tag == "joint" and element.attributes.get("type") == "free")
        )
    ]
    base = robot.base
    named = [e for e in found if base and e.parents[-1].attributes.get("name") == base.body]
    own = named or found
    if len(own) != 1:
        raise refusal(
            f"{robot.source}: {len(own)} elements may be the free joint of the robot. Give its "
            "body a name and a <freejoint/> of its own."
        )
    return own[0]


def _height(robot: Robot, base: Base) -> float:
    """As high as the trunk is, or as it takes where something to stand on is below it [m]."""
    model = robot.model
    given = float(model.body_pos[base.id, 2])
    grounds = [
        geom
        for geom in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[geom]] == 0
        and (model.geom_contype[geom] or model.geom_conaffinity[geom])
    ]
    if not grounds or robot.notes:  # a note tells of a ground that the model itself lacks
        return given
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    planes = [
        float(data.geom_xpos[geom, 2])
        + (0.0 if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE else model.geom_rbound[geom])
        for geom in grounds
    ]
    needed = max(planes) + _reach(model, base) + _CLEARANCE
    return max(given, float(np.ceil(100 * needed) / 100))


def _reach(model: mujoco.MjModel, base: Base) -> float:
    """How far from the trunk its links can be at most [m]."""
    farthest = 0.0
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if model.body_rootid[body] != base.id:
            continue
        length = float(np.linalg.norm(model.geom_pos[geom])) + float(model.geom_rbound[geom])
        while body != base.id:
            length += float(np.linalg.norm(model.body_pos[body]))
            joints = np.flatnonzero(model.jnt_bodyid == body)
            length += 2 * sum(float(np.linalg.norm(model.jnt_pos[j])) for j in joints)
            body = int(model.body_parentid[body])
        farthest = max(farthest, length)
    return farthest


def _trim_keyframes(model: mujoco.MjModel, base: Base, text: MjcfText) -> None:
    """Takes the free joint's numbers out of the keyframes."""
    spans = {"qpos": (base.qpos, 7, model.nq), "qvel": (base.dof, 6, model.nv)}
    for element in text.elements:
        if element.tag != "key":
            continue
        changed: dict[str, str | None] = {}
        for name, (first, count, size) in spans.items():
            numbers = element.attributes.get(name, "").split()
            if len(numbers) == size:
                changed[name] = " ".join(numbers[:first] + numbers[first + count :])
        if changed:
            text.change(element, attributes=changed)


def _mounted(robot: Robot, base: Base) -> Iterator[tuple[str, str]]:
    """Pairs of parts of the trunk and what is mounted on them by joints, where both collide."""
    model = robot.model
    collides = {
        int(model.geom_bodyid[geom])
        for geom in range(model.ngeom)
        if model.geom_contype[geom] or model.geom_conaffinity[geom]
    }
    fixed = [b for b in range(1, model.nbody) if model.body_weldid[b] == base.id]
    first = {b for b in range(1, model.nbody) if model.body_parentid[b] in fixed} - {*fixed}
    for child in sorted(first):
        rigid = [b for b in range(1, model.nbody) if model.body_weldid[b] == child]
        for part in fixed:
            for neighbour in rigid:
                if part in collides and neighbour in collides:
                    names = model.body(part).name, model.body(neighbour).name
                    if not all(names):
                        raise refusal(
                            f"{robot.source}: body {part if not names[0] else neighbour} has no "
                            "name, and has to be excluded from collisions. Name it."
                        )
                    yield names
