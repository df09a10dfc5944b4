"""A robot as a trainer can take it: without what this would ignore, or would not load.

suits = suited(robot, "mjx")          # suits.robot, suits.laws, suits.lost
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import LAWS
from walkerkit.gap.deliver.law_code import all_laws
from walkerkit.gap.deliver.trainers import Trainer
from walkerkit.gap.errors import InputError, some
from walkerkit.gap.simulation.robot import Robot

Laws = Mapping[str, Mapping[str, Mapping[str, float]]]
_SOLVED = 1e-9  # dry friction that makes MJX and Warp solve for more of it
_Geom = mujoco.mjtGeom
_NOT_IN_MJX = frozenset(
    {
        (_Geom.mjGEOM_HFIELD, _Geom.mjGEOM_ELLIPSOID),
        (_Geom.mjGEOM_HFIELD, _Geom.mjGEOM_CYLINDER),
        (_Geom.mjGEOM_ELLIPSOID, _Geom.mjGEOM_BOX),
        (_Geom.mjGEOM_ELLIPSOID, _Geom.mjGEOM_MESH),
        (_Geom.mjGEOM_CYLINDER, _Geom.mjGEOM_BOX),
        (_Geom.mjGEOM_CYLINDER, _Geom.mjGEOM_MESH),
    }
)
"""Shapes that MJX 3.17 (`mjx/_src/collision_driver.py`) cannot have collide; it refuses to load
them."""


@dataclass(frozen=True, kw_only=True)
class Suited:
    """A robot as a trainer can take it.

    Attributes:
        robot: without what the trainer ignores or does not load.
        laws: joint to law to its parameters, with what was taken.
        lost: what it lacks now, a line each.
        apart: pairs of bodies that do not touch now.
    """

    robot: Robot
    laws: Laws
    lost: tuple[str, ...]
    apart: tuple[tuple[str, str], ...]


def suited(robot: Robot, trainer: Trainer) -> Suited:
    """A robot whose model has nothing that a trainer ignores, and its laws with what was taken.

    Args:
        robot: the mended robot.
        trainer: for whom.
    """
    ignores_drag = trainer in ("mjx", "isaaclab")
    # A law of the drive sees the effort of targets that have arrived.
    ignores_delay = trainer != "warp" or bool(robot.laws)
    laws = all_laws(robot, delays=ignores_delay, drag=ignores_drag)
    spec = robot.spec.copy()
    spec.compile()
    for actuator in spec.actuators:
        if ignores_delay and actuator.delay:
            actuator.delay, actuator.nsample, actuator.interp = 0.0, 0, 0
    for joint in spec.joints:
        if ignores_drag:
            joint.damping[1:] = 0.0
        of_joint = any(LAWS[law].stage == "joint" for law in laws.get(joint.name, {}))
        if of_joint and joint.frictionloss == 0:
            joint.frictionloss = _SOLVED
    if trainer == "isaaclab" and robot.base is not None:
        for plane in planes(spec):  # the ground is the scene's
            spec.delete(plane)
    apart = _kept_apart(robot.model) if trainer == "mjx" else {}
    for first, second in apart:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    lost: tuple[str, ...] = ()
    if apart:
        shapes = some(sorted({f"{one} and {other}" for one, other in apart.values()}))
        pairs = some([f"{first} and {second}" for first, second in apart])
        lost = (f"contacts of {pairs}: MJX has none between {shapes}; these bodies do not touch.",)
    without = replace(robot, spec=spec, model=spec.compile())
    return Suited(robot=without, laws=laws, lost=lost, apart=tuple(apart))


def check(robot: Robot, trainer: Trainer, folder: Path) -> None:
    """Refuses what a trainer would ignore without a word, and what it would not load.

    Raises:
        InputError: it would, with what to do.
    """
    model = robot.model
    ignored = []
    if trainer == "mjx":
        _check_contacts(model, folder)
        if model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICIT:
            ignored.append("integrator `implicit`, which it does not have")
        if np.any(model.jnt_stiffnesspoly):
            ignored.append("springs of joints that are not linear")
        if np.any(model.tendon_dampingpoly) or np.any(model.tendon_stiffnesspoly):
            ignored.append("springs and dampers of tendons that are not linear")
        if np.any(model.sensor_history[:, 0] > 0):
            ignored.append("delays of sensors")
        passive = [
            name
            for name, joint in robot.joints.items()
            if model.dof_dampingpoly[joint.dof].any()
            and (not joint.drives or model.dof_dampingpoly[joint.dof, 1])
        ]
        if passive:
            ignored.append(f"damping that is not linear, of {', '.join(passive)}")
        of_others = {d.actuator for joint in robot.joints.values() for d in joint.drives[:1]}
        if any(model.actuator_delay[a] > 0 for a in {*range(model.nactuator)} - of_others):
            ignored.append("delays of actuators that are not a joint's own")
    if ignored:
        raise InputError(
            f"{folder}: {trainer} would not simulate {'; '.join(ignored)}, and would not say so. "
            "Take them out of the model, or export to warp."
        )


def _check_contacts(model: mujoco.MjModel, folder: Path) -> None:
    """Refuses contacts that MJX cannot load and that no <exclude> takes away."""
    pairs = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
    explicit = [
        pair
        for pair in pairs
        if _shapes(model, sorted(pair, key=model.geom_type.item)) in _NOT_IN_MJX
    ]
    if explicit:
        first, second = (model.geom(geom).name for geom in explicit[0])
        raise InputError(
            f"{folder}: mjx does not load the <pair> of geoms {first!r} and {second!r}, since it "
            "cannot have their shapes collide. Take the <pair> out, or export to warp."
        )
    for names in _kept_apart(model):
        if not all(names):
            raise InputError(
                f"{folder}: mjx does not load contacts between shapes of {max(names)!r} and of a "
                "body without a name. Give each <body> a name, or export to warp."
            )


def _shapes(model: mujoco.MjModel, pair: Sequence[int]) -> tuple[mujoco.mjtGeom, ...]:
    return tuple(_Geom(int(model.geom_type[geom])) for geom in pair)


def damps_at_its_limit(robot: Robot) -> bool:
    """Whether servos have limits, and damp in implicit steps."""
    model = robot.model
    drives = [drive.actuator for joint in robot.joints.values() for drive in joint.drives]
    limited = model.actuator_forcelimited[drives].astype(bool)
    damped = model.actuator_biasprm[drives, 2] != 0
    fast = model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return bool(fast and (limited & damped).any())


def colliding(model: mujoco.MjModel) -> Iterator[tuple[int, int]]:
    """Pairs of geoms that can touch by what they say themselves, the lower kind of shape first."""
    weld, parent = model.body_weldid, model.body_parentid
    kinds, partners = model.geom_contype, model.geom_conaffinity
    filters = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
    for first, second in zip(*np.triu_indices(model.ngeom, 1), strict=True):
        one, other = sorted((model.geom_bodyid[first], model.geom_bodyid[second]))
        above = [weld[parent[weld[body]]] for body in (one, other)]
        related = filters and weld[one] and weld[other]
        if (
            weld[one] == weld[other]
            or (related and (weld[one] == above[1] or weld[other] == above[0]))
            or (one << 16) + other in model.exclude_signature
            or not (kinds[first] & partners[second] | kinds[second] & partners[first])
        ):
            continue
        pair = sorted((int(first), int(second)), key=lambda geom: int(model.geom_type[geom]))
        yield pair[0], pair[1]


def _kept_apart(model: mujoco.MjModel) -> dict[tuple[str, str], tuple[str, str]]:
    """Bodies with shapes that MJX cannot have collide, to the first two of these."""
    found: dict[tuple[str, str], tuple[str, str]] = {}
    for pair in colliding(model):
        shapes = _shapes(model, pair)
        if shapes in _NOT_IN_MJX:
            one, other = sorted(int(model.geom_bodyid[geom]) for geom in pair)
            names = (model.body(one).name, model.body(other).name)
            of = tuple(shape.name.removeprefix("mjGEOM_").lower() for shape in shapes)
            found.setdefault(names, (of[0], of[1]))
    return found


def planes(spec: mujoco.MjSpec) -> list[mujoco.MjsGeom]:
    """The planes of the world, on which a robot may stand."""
    return [geom for geom in spec.worldbody.geoms if geom.type == _Geom.mjGEOM_PLANE]


def thick(model: mujoco.MjModel) -> bool:
    """Whether boxes or meshes with a margin can touch each other."""
    flat: NDArray[np.bool_] = np.isin(model.geom_type, (_Geom.mjGEOM_BOX, _Geom.mjGEOM_MESH))
    return any(
        flat[first] and flat[second] and model.geom_margin[[first, second]].any()
        for first, second in colliding(model)
    )
