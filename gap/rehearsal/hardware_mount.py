"""What the rehearsal robot stands or hangs on, where that gives way: a stand of its own.

    model = mounted(spec, effect)                      # the rigid bodies on a stand
    stand = Stand(model, hidden)
    applied[:, stand.dofs] += stand.effort(qpos, qvel)

The stand is a body of little weight under all that is mounted, on two hinges that nothing drives; a
spring and an oil that drags hold it upright. Only a robot with one body on the world has one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hidden import HiddenEffect

Array = NDArray[np.float64]

EFFECT: Final = "mount_compliance"
SHARE: Final = 0.05
"""Inertia of the stand, of that of what it carries."""
HINGES: Final = {"stand_roll": "1 0 0", "stand_pitch": "0 1 0"}
"""Name to axis of the stand's joints."""

_BARE = dict.fromkeys(("armature", "damping", "frictionloss", "stiffness"), "0")
_LIGHT = 1e-6  # kg and kg·m²


def can_be_mounted(spec: mujoco.MjSpec) -> bool:
    """Whether a robot can be put on a stand: it has one body on the world, and does not float."""
    jointed = [body for body in spec.worldbody.bodies if _moves(body)]
    floats = any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints)
    return len(jointed) == 1 and bool(jointed[0].name) and not floats


def mounted(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The robot on a stand.

    Args:
        spec: the robot, which is left as it is.

    Raises:
        InputError: it floats, or is several.
    """
    if not can_be_mounted(spec):
        raise InputError(
            f"{EFFECT} cannot be hidden under {spec.modelname!r}: it takes a robot that does not "
            "float, with one body on the world that has a name; hide something else"
        )
    carried = mujoco.MjModel.from_xml_string(_on_a_stand(spec, _LIGHT, _LIGHT), spec.assets)
    inertia = [float(carried.dof_M0[dof]) for dof in _dofs(carried)]
    own = SHARE * max(inertia)
    return mujoco.MjModel.from_xml_string(_on_a_stand(spec, _LIGHT, own), spec.assets)


def _on_a_stand(spec: mujoco.MjSpec, mass: float, inertia: float) -> str:
    """MJCF of the robot on a stand."""
    own = spec.copy()
    # Files are found from anywhere.
    folder = own.modelfiledir
    own.meshdir, own.texturedir = (f"{folder}/{part}" for part in (own.meshdir, own.texturedir))
    own.compile()
    root = ElementTree.fromstring(own.to_xml())
    world = root.find("worldbody")
    if world is None:
        raise InputError(f"{spec.modelname!r} has no bodies")
    names = {body.name for body in spec.worldbody.bodies if _moves(body)}
    (at,) = (k for k, one in enumerate(world) if one.get("name") in names)
    robot = world[at]
    stand = ElementTree.Element("body", name="stand", pos=robot.get("pos", "0 0 0"))
    for name, axis in HINGES.items():
        joint = {"name": name, "type": "hinge", "axis": axis, "limited": "false", **_BARE}
        ElementTree.SubElement(stand, "joint", joint)
    turning = " ".join(f"{inertia:.9g}" for _ in range(3))
    ElementTree.SubElement(stand, "inertial", pos="0 0 0", mass=f"{mass:g}", diaginertia=turning)
    world.remove(robot)
    robot.set("pos", "0 0 0")
    stand.append(robot)
    world.insert(at, stand)
    for key in root.iter("key"):
        for field in ("qpos", "qvel"):
            if key.get(field):
                key.set(field, f"0 0 {key.get(field)}")
    return ElementTree.tostring(root, encoding="unicode")


class Stand:
    """A spring and a damper on each hinge of a stand."""

    def __init__(self, model: mujoco.MjModel, hidden: Sequence[HiddenEffect]) -> None:
        """A stand.

        Args:
            model: the robot; on a stand where one gives way.
            hidden: effects; those that are no stand's are left alone.
        """
        found = [effect for effect in hidden if effect.effect == EFFECT]
        self.any = bool(found)
        """There is one."""
        self.dofs = np.array(_dofs(model) if found else [], dtype=np.intp)
        self._qpos = np.array(
            [model.joint(name).qposadr[0] for name in HINGES] if found else [], dtype=np.intp
        )
        # Springs under one another would be softer; there is one.
        self._stiffness = sum(effect.value("stiffness") for effect in found)
        ratio = sum(effect.value("damping_ratio") for effect in found)
        self._damping = 2 * ratio * np.sqrt(self._stiffness * model.dof_M0[self.dofs])

    def effort(self, qpos: Array, qvel: Array) -> Array:
        """Of its spring and its oil, (n_sims, 2) N·m.

        Args:
            qpos: positions of all, shape (n_sims, nq), rad.
            qvel: velocities of all, shape (n_sims, nv), rad/s.
        """
        held: Array = -self._stiffness * qpos[:, self._qpos] - self._damping * qvel[:, self.dofs]
        return held


def _dofs(model: mujoco.MjModel) -> list[int]:
    return [int(model.joint(name).dofadr[0]) for name in HINGES]


def _moves(body: mujoco.MjsBody) -> bool:
    return bool(list(body.joints)) or any(map(_moves, body.bodies))
