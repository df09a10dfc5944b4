"""What two robots differ in, as changes of the attributes of the file that one of them is from.

    document = Document(path)
    patch(document, given, mended)            # ValueError where the file cannot say it
    document.texts()

An attribute is written at the element itself, so that it holds whatever its default class says.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.deliver.drives import patch_drives
from walkerkit.gap.deliver.markup import Document, Node
from walkerkit.gap.deliver.numerals import numerals, whole
from walkerkit.gap.simulation.mount import MOUNTS
from walkerkit.gap.simulation.robot import Robot

_JOINT = {  # attribute to the field of mjModel, and what it is indexed by
    "frictionloss": ("dof_frictionloss", "dof"),
    "armature": ("dof_armature", "dof"),
    "solreffriction": ("dof_solref", "dof"),
    "solimpfriction": ("dof_solimp", "dof"),
    "range": ("jnt_range", "id"),
    "solreflimit": ("jnt_solref", "id"),
    "solimplimit": ("jnt_solimp", "id"),
    "ref": ("qpos0", "qpos"),
    "springref": ("qpos_spring", "qpos"),
}
_POLYNOMIALS = {  # attribute to the fields of its first and of its other coefficients
    "damping": ("dof_damping", "dof_dampingpoly", "dof"),
    "stiffness": ("jnt_stiffness", "jnt_stiffnesspoly", "id"),
}
_ANGLES = ("range", "ref", "springref")
_CONTACT = ("friction", "solref", "solimp")
INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast")
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


class Elements:
    """The elements of a file that the compiled model numbers.

    Args:
        document: the file.
        model: what it compiles to.
    """

    def __init__(self, document: Document, model: mujoco.MjModel):
        self._document = document
        self._model = model
        root = document.root
        self._worlds = root.inside("worldbody")
        bodies: list[Node] = []
        for world in self._worlds:
            _bodies(world, bodies)
        self._bodies = bodies
        self._actuators = self._section("actuator")
        self._pairs = [
            node for section in root.inside("contact") for node in section.inside("pair")
        ]

    def body(self, number: int) -> Node:
        """The element of a body."""
        name = self._model.body(number).name
        found = [node for node in self._bodies if name and node.get("name") == name]
        if len(found) == 1:
            return found[0]
        if len(self._bodies) != self._model.nbody - 1:
            raise ValueError(f"body {name or number!r} is not written out as a body of its own")
        node = self._bodies[number - 1]
        if (node.get("name") or "") != name:
            raise ValueError(f"body {name or number!r} is not where it is expected")
        return node

    def joint(self, number: int) -> Node:
        """The element of a joint."""
        return self._of_body("joint", number, int(self._model.jnt_bodyid[number]))

    def geom(self, number: int) -> Node:
        """The element of a geom."""
        return self._of_body("geom", number, int(self._model.geom_bodyid[number]))

    def pair(self, number: int) -> Node:
        """The element of a contact pair."""
        if len(self._pairs) != self._model.npair:
            raise ValueError("contact pairs are not all written out")
        return self._pairs[number]

    def actuator(self, number: int) -> Node:
        """The element of an actuator."""
        name = self._model.actuator(number).name
        found = [node for node in self._actuators if name and node.get("name") == name]
        if len(found) == 1:
            return found[0]
        if len(self._actuators) != self._model.nactuator:
            raise ValueError(f"actuator {name or number!r} is not written out")
        return self._actuators[number]

    def option(self) -> Node | None:
        """The last `<option>`, whose attributes hold."""
        found = self._document.root.inside("option")
        return found[-1] if found else None

    def keys(self) -> list[Node]:
        """The keyframes, in order."""
        return [
            node for one in self._document.root.inside("keyframe") for node in one.inside("key")
        ]

    def _section(self, tag: str) -> list[Node]:
        return [
            node
            for section in self._document.root.inside(tag)
            for child in section.children
            for node in ([child] if child.tag != "include" else child.children)
        ]

    def _of_body(self, kind: str, number: int, body: int) -> Node:
        model = self._model
        name = getattr(model, kind)(number).name
        tags = ("joint", "freejoint") if kind == "joint" else (kind,)
        owners = self._worlds if body == 0 else [self.body(body)]
        nodes = [node for owner in owners for node in owner.inside(*tags)]
        found = [node for node in nodes if name and node.get("name") == name]
        if len(found) == 1:
            return found[0]
        of_body = model.jnt_bodyid if kind == "joint" else model.geom_bodyid
        numbers = np.flatnonzero(of_body == body)
        if len(nodes) != len(numbers):
            raise ValueError(f"{kind} {name or number!r} is not written out as one of its own")
        return nodes[int(np.flatnonzero(numbers == number)[0])]


def _bodies(node: Node, found: list[Node]) -> None:
    for child in node.children:
        if child.tag == "body":
            found.append(child)
            _bodies(child, found)
        elif child.tag in ("frame", "include"):
            _bodies(child, found)


def patch(document: Document, given: Robot, mended: Robot) -> None:
    """Writes into a document what was mended.

    Args:
        document: the file that `given` was read from; changed.
        given: the robot as it was.
        mended: the same with what was found.

    Raises:
        ValueError: the file cannot say it: an element is not written out in it, or MJCF has no
            attribute for what changed.
    """
    elements = Elements(document, given.model)
    added = {name for name in mended.joints if name not in given.joints}
    kept = [j for j in range(mended.model.njnt) if mended.model.joint(j).name not in added]
    if len(kept) != given.model.njnt:
        raise ValueError("the mended model has other joints")
    for old, new in enumerate(kept):
        if given.model.jnt_type[old] in _SCALAR:
            for attribute, text in joint_changes(given, old, mended, new):
                document.set(elements.joint(old), attribute, text)
    if added & {*MOUNTS}:
        carried = elements.body(int(mended.model.jnt_bodyid[mended.joints[MOUNTS[0]].id]))
        # Each is put before all that is there.
        for name in reversed(MOUNTS):
            document.insert_into(carried, whole_joint(mended, mended.joints[name].id, name))
    for name in (name for name in mended.joints if name in added and name not in MOUNTS):
        motor = name.removesuffix("_play")
        after = elements.joint(given.joints[motor].id)
        document.insert_after(after, whole_joint(mended, mended.joints[name].id, name))
    if added:
        _patch_keys(document, elements, mended)
    _patch_inertias(document, elements, given.model, mended.model)
    _patch_contacts(document, elements, given.model, mended.model)
    _patch_places(document, elements, given, mended)
    _patch_option(document, elements, given.model, mended.model)
    patch_drives(document, elements.actuator, given.model, mended.model)


def joint_changes(given: Robot, old: int, mended: Robot, new: int) -> Iterable[tuple[str, str]]:
    """The attributes of a joint that differ, as MJCF writes them.

    Args:
        given: the robot as it was.
        old: the joint's id there.
        mended: the other robot.
        new: its id there.
    """
    before, after = given.model, mended.model
    at, there = _addresses(before, old), _addresses(after, new)
    degrees = _degrees(given, old)
    if before.jnt_limited[old] != after.jnt_limited[new]:
        yield "limited", "true" if after.jnt_limited[new] else "false"
    for attribute, (name, index) in _JOINT.items():
        wanted = np.atleast_1d(getattr(after, name)[there[index]])
        if not np.array_equal(np.atleast_1d(getattr(before, name)[at[index]]), wanted):
            unit = degrees if attribute in _ANGLES else 1.0
            yield attribute, numerals(wanted * unit)
    for attribute, (first, others, index) in _POLYNOMIALS.items():
        wanted = _polynomial(after, first, others, there[index])
        if not np.array_equal(_polynomial(before, first, others, at[index]), wanted):
            yield (
                attribute,
                numerals(wanted[: max(1, int(np.max(np.nonzero(wanted), initial=0)) + 1)]),
            )


def whole_joint(robot: Robot, joint: int, name: str) -> str:
    """A joint with all of its attributes, whatever the defaults around it are."""
    model, at = robot.model, _addresses(robot.model, joint)
    degrees = _degrees(robot, joint)
    slide = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    written = {
        "name": name,
        "type": "slide" if slide else "hinge",
        "pos": whole(model.jnt_pos[joint]),
        "axis": whole(model.jnt_axis[joint]),
        "limited": "true" if model.jnt_limited[joint] else "false",
        "actuatorfrclimited": "false",
        "margin": "0",
        "springdamper": "0 0",
    }
    for attribute, (field, index) in _JOINT.items():
        unit = degrees if attribute in _ANGLES else 1.0
        written[attribute] = numerals(np.atleast_1d(getattr(model, field)[at[index]]) * unit)
    for attribute, (first, _, index) in _POLYNOMIALS.items():
        written[attribute] = numerals(np.atleast_1d(getattr(model, first)[at[index]]))
    text = " ".join(f'{key}="{value}"' for key, value in written.items())
    return f"<joint {text}/>"


def _addresses(model: mujoco.MjModel, joint: int) -> dict[str, int]:
    return {
        "id": joint,
        "dof": int(model.jnt_dofadr[joint]),
        "qpos": int(model.jnt_qposadr[joint]),
    }


def _degrees(robot: Robot, joint: int) -> float:
    """The unit of the file's angles, over a radian."""
    hinge = robot.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
    return 180 / np.pi if hinge and robot.spec.compiler.degree else 1.0


def _polynomial(model: mujoco.MjModel, first: str, others: str, index: int) -> NDArray[Any]:
    return np.concatenate([[getattr(model, first)[index]], getattr(model, others)[index]])


def _patch_keys(document: Document, elements: Elements, mended: Robot) -> None:
    """Keyframes of a model with more joints."""
    for node, key in zip(elements.keys(), mended.spec.keys, strict=True):
        for attribute, values in (("qpos", key.qpos), ("qvel", key.qvel)):
            if node.get(attribute) is not None:
                document.set(node, attribute, whole(np.asarray(values)))


def _patch_inertias(
    document: Document, elements: Elements, before: mujoco.MjModel, after: mujoco.MjModel
) -> None:
    # The mass of a body stays where it was when its geoms move, from which it may follow.
    emptied = {*before.geom_bodyid[_moved(before, after)]}
    for body in range(1, before.nbody):
        mass, place = after.body_mass[body], after.body_ipos[body]
        heavier = mass != before.body_mass[body]
        moved = not np.array_equal(place, before.body_ipos[body])
        if not (heavier or moved or body in emptied):
            continue
        node = elements.body(body)
        inertial = node.inside("inertial", through=("include",))
        if not inertial:
            document.insert_into(
                node,
                f'<inertial pos="{numerals(place)}" quat="{whole(after.body_iquat[body])}" '
                f'mass="{numerals([mass])}" diaginertia="{whole(after.body_inertia[body])}"/>',
            )
            continue
        if heavier:
            document.set(inertial[0], "mass", numerals([mass]))
        if moved:
            document.set(inertial[0], "pos", numerals(place))


def _patch_contacts(
    document: Document, elements: Elements, before: mujoco.MjModel, after: mujoco.MjModel
) -> None:
    for kind, find in (("geom", elements.geom), ("pair", elements.pair)):
        for attribute in _CONTACT:
            own, wanted = (getattr(model, f"{kind}_{attribute}") for model in (before, after))
            for number in np.flatnonzero((own != wanted).any(axis=1)):
                document.set(find(int(number)), attribute, numerals(wanted[number]))


def _patch_places(document: Document, elements: Elements, given: Robot, mended: Robot) -> None:
    """Geoms that have moved in their bodies."""
    before, after = given.model, mended.model
    moved = _moved(before, after)
    if not moved.size:
        return
    spec = given.spec.copy()
    spec.compile()  # gives the elements of the copy the ids of the compiled model
    own = {geom.id: geom for geom in spec.geoms}
    for number in map(int, moved):
        node, geom = elements.geom(number), own[number]
        if geom.frame is not None:
            raise ValueError(f"geom {geom.name or number!r} is placed by a frame around it")
        shift = after.geom_pos[number] - before.geom_pos[number]
        if np.isfinite(geom.fromto).all():
            document.set(node, "fromto", whole(geom.fromto + np.tile(shift, 2)))
        else:
            document.set(node, "pos", whole(geom.pos + shift))


def _moved(before: mujoco.MjModel, after: mujoco.MjModel) -> NDArray[np.intp]:
    """The geoms that are elsewhere in their bodies."""
    return np.flatnonzero((before.geom_pos != after.geom_pos).any(axis=1))


def _patch_option(
    document: Document, elements: Elements, before: mujoco.MjModel, after: mujoco.MjModel
) -> None:
    old, new = before.opt, after.opt
    written: dict[str, str] = {}
    if not np.array_equal(old.gravity, new.gravity):
        written["gravity"] = numerals(new.gravity)
    if old.timestep != new.timestep:
        written["timestep"] = whole([new.timestep])
    if old.integrator != new.integrator:
        written["integrator"] = INTEGRATORS[int(new.integrator)]
    if not written:
        return
    node = elements.option()
    if node is None:
        text = " ".join(f'{name}="{value}"' for name, value in written.items())
        document.insert_into(document.root, f"<option {text}/>")
        return
    for name, value in written.items():
        document.set(node, name, value)


def differences(
    one: mujoco.MjModel, other: mujoco.MjModel, *, ignored: Sequence[str] = ()
) -> list[str]:
    """The fields in which two compiled models differ by more than the digits of a file.

    Args:
        one: a model.
        other: another one.
        ignored: fields that are not compared.
    """
    found = []
    for name in dir(one):
        if name.startswith("_") or name in ignored:
            continue
        mine = getattr(one, name)
        if not isinstance(mine, np.ndarray) or mine.dtype.kind not in "fiub":
            continue
        theirs = getattr(other, name)
        if np.array_equal(mine, theirs):
            continue
        if mine.shape != theirs.shape or not np.allclose(mine, theirs, rtol=1e-5, atol=1e-7):
            found.append(name)
    for name in ("timestep", "gravity", "integrator"):
        if not np.allclose(getattr(one.opt, name), getattr(other.opt, name), rtol=1e-6, atol=1e-7):
            found.append(f"option {name}")
    return found
