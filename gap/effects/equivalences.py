"""Effects that no recording of certain channels can tell apart, and why.

    equivalences("command_delay", {"position", "velocity"})
    # {"sensor_delay": "Without effort, a late command and a late log shift the same curves…"}

Two effects are exactly equivalent where every size of the one has a size of the other that makes
the same log, whatever was commanded. The search finds by itself that they fit equally well; the
table here knows the reason, and what else to record. Derivations are beside the entries.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from walkerkit.gap.effects.effect import EVERYWHERE
from walkerkit.gap.simulation.branches import descends
from walkerkit.gap.simulation.robot import Joint, Robot

Condition = Callable[[Robot, Sequence[str]], bool]

_PARALLEL = 1e-6


@dataclass(frozen=True, kw_only=True)
class Equivalence:
    """Two effects that make the same log.

    Attributes:
        effects: their names.
        parted_by: signals that tell them apart where one of them is recorded.
        holds: whether they are equivalent at some joints of a robot.
        usual: they are on most robots, and count as equivalent where no robot is given.
        beside: an effect that has to be in the explanation already.
        unless: effects that tell them apart where they are in the explanation.
        whole: the second effect is the first and that beside it together.
        reason: why, in a sentence.
    """

    effects: tuple[str, str]
    parted_by: frozenset[str] = frozenset()
    holds: Condition
    usual: bool = False
    beside: str | None = None
    unless: frozenset[str] = frozenset()
    whole: bool = False
    reason: str


def equivalences(
    effect: str,
    signals: Collection[str],
    *,
    robot: Robot | None = None,
    joints: Sequence[str] = (),
    bodies: Collection[str] = (),
    beside: Collection[str] = (),
) -> dict[str, str]:
    """What an effect cannot be told from, whatever is commanded.

    Args:
        effect: its name in the catalogue.
        signals: what was recorded of the joints: `position`, `velocity`, `effort`.
        robot: the robot; None leaves out what holds on special robots only.
        joints: the joints that have the effect, or `("*",)`; of an effect of bodies none.
        bodies: the bodies that have it, where it is one of bodies.
        beside: the other effects that explain the recordings, of those at all of these joints.

    Returns:
        Name of each exactly equivalent effect to the reason, a sentence.
    """
    found = {}
    if robot is not None and bodies:
        joints = carriers(robot, bodies)
    for entry in _TABLE:
        if effect not in entry.effects or not entry.parted_by.isdisjoint(signals):
            continue
        if entry.beside is not None and entry.beside not in beside:
            continue
        if not entry.unless.isdisjoint(beside):
            continue
        (other,) = (name for name in entry.effects if name != effect)
        if entry.usual if robot is None else entry.holds(robot, joints):
            found[other] = entry.reason
    return found


def spelled_out(effect: str, *, beside: Collection[str] = ()) -> dict[tuple[str, str], str]:
    """The pairs of effects that together leave the same log as one.

    Args:
        effect: its name in the catalogue.
        beside: the other effects that explain the recordings; a pair with one of them is none.

    Returns:
        Names of each pair to the reason, a sentence.
    """
    found = {}
    for entry in _TABLE:
        part, whole = entry.effects
        if whole == effect and entry.whole and entry.beside is not None:
            first, second = sorted((part, entry.beside))
            if first not in beside and second not in beside:
                found[first, second] = entry.reason
    return found


def wholes(effect: str) -> tuple[str, ...]:
    """The effects that leave the same log as one together with another, and so as it alone.

    Args:
        effect: its name in the catalogue.

    Returns:
        Their names; with the other's size at zero each of them is this effect.
    """
    entries = (entry for entry in _TABLE if entry.whole and entry.effects[0] == effect)
    return tuple(dict.fromkeys(entry.effects[1] for entry in entries))


def _anywhere(robot: Robot, joints: Sequence[str]) -> bool:
    return True


def _of_all_joints(robot: Robot, joints: Sequence[str]) -> bool:
    return tuple(joints) == (EVERYWHERE,) or len(robot.joints) == 1


def _driven_to_positions(robot: Robot, joints: Sequence[str]) -> bool:
    """Whether the drives' damping acts on speed alone, and not on a velocity target's error."""
    drives = [drive for name in _listed(robot, joints) for drive in robot.joints[name].drives]
    return bool(drives) and all(drive.kind == "position" for drive in drives)


def _driven_by_gain_alone(robot: Robot, joints: Sequence[str]) -> bool:
    """Whether the drive's effort is kp (u − q) and nothing else, with no limit of its own."""
    model = robot.model
    return _driven_to_positions(robot, joints) and all(
        drive.damping == 0
        and not drive.in_python
        and not model.actuator_forcelimited[drive.actuator]
        and not (drive.in_joint_units and model.actuator_biasprm[drive.actuator, 0] != 0)
        for name in _listed(robot, joints)
        for drive in robot.joints[name].drives
    )


def _turns_all_in_gravity(robot: Robot, joints: Sequence[str]) -> bool:
    """Whether a joint carries the whole robot like a tilted base would, past no spring."""
    model, names = robot.model, _listed(robot, joints)
    if len(names) != 1 or model.nv != len(robot.joints):
        return False
    root = robot.joints[names[0]]
    return (
        not root.slide
        and model.jnt_stiffness[root.id] == 0
        and all(
            descends(model, int(model.jnt_bodyid[other.id]), int(model.jnt_bodyid[root.id]))
            and other.dof >= root.dof
            for other in robot.joints.values()
        )
        and not _gravity_leaves_alone(robot, root)
    )


def _turns_the_last_body(robot: Robot, joints: Sequence[str]) -> bool:
    """Whether a joint carries one body and no other joint, on a robot that moves in a plane.

    There the inertia about one axis is all that counts, which turning the body leaves as it is.
    """
    model, names = robot.model, _listed(robot, joints)
    if len(names) != 1 or model.nv != len(robot.joints):
        return False
    last = robot.joints[names[0]]
    carrier = int(model.jnt_bodyid[last.id])
    moving = [body for body in range(1, model.nbody) if descends(model, body, carrier)]
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return (
        model.jnt_stiffness[last.id] == 0
        and sum(bool(model.body_mass[body] > 0) for body in moving) == 1
        and sum(int(model.body_jntnum[body]) for body in moving) == 1
        and all(
            not joint.slide
            and np.linalg.norm(np.cross(data.xaxis[joint.id], data.xaxis[last.id])) <= _PARALLEL
            for joint in robot.joints.values()
        )
        # By itself it shows where it is in gravity alone.
        and (model.nv > 1 or not _gravity_leaves_alone(robot, last))
    )


def _turns_the_only_body(robot: Robot, joints: Sequence[str]) -> bool:
    return robot.model.nv == 1 and _turns_the_last_body(robot, joints)


def _moves_across_gravity(robot: Robot, joints: Sequence[str]) -> bool:
    """Whether the only joint's motion neither lifts nor lowers anything."""
    return robot.model.nv == 1 and all(
        _gravity_leaves_alone(robot, joint) for joint in robot.joints.values()
    )


def _moves_across_gravity_without_dry_friction(robot: Robot, joints: Sequence[str]) -> bool:
    model = robot.model
    return (
        _moves_across_gravity(robot, joints)
        and not model.dof_frictionloss.any()
        and not (model.jnt_stiffness * model.qpos_spring).any()
    )


def _rubs_dry(robot: Robot, joints: Sequence[str]) -> bool:
    """Whether the model has dry friction of its own at all of the joints."""
    dofs = [robot.joints[name].dof for name in _listed(robot, joints)]
    return bool(dofs) and bool((robot.model.dof_frictionloss[dofs] > 0).all())


def carriers(robot: Robot, bodies: Collection[str]) -> tuple[str, ...]:
    """The joints that move some bodies and not what these hang from, in the robot's order."""
    model = robot.model
    welded = {int(model.body_weldid[model.body(name).id]) for name in bodies}
    return tuple(
        name for name, joint in robot.joints.items() if int(model.jnt_bodyid[joint.id]) in welded
    )


def _listed(robot: Robot, joints: Sequence[str]) -> list[str]:
    """The joints by name, also where all are meant."""
    everything = not joints or tuple(joints) == (EVERYWHERE,)
    return list(robot.joints) if everything else [name for name in joints if name in robot.joints]


def _gravity_leaves_alone(robot: Robot, joint: Joint) -> bool:
    """Whether gravity makes no effort at a joint of the first body, wherever it is."""
    data = mujoco.MjData(robot.model)
    mujoco.mj_kinematics(robot.model, data)
    axis, gravity = data.xaxis[joint.id], robot.model.opt.gravity
    left = axis @ gravity if joint.slide else np.linalg.norm(np.cross(axis, gravity))
    return bool(abs(left) <= _PARALLEL)


CHANGES_THE_DRIVES_EFFORT = frozenset(
    {
        *("load_dependent_friction", "directional_efficiency", "backlash"),
        *("effort_limit", "torque_speed_limit", "torque_ripple"),
        *("strength_drift", "supply_voltage", "supply_sag"),
        *("actuator_lag", "loop_delay", "velocity_filter"),
    }
)
"""Beside these the damping of a drive is not that of its joint."""

_TABLE: tuple[Equivalence, ...] = (
    # From rest the motion answers u(t − d) with q(t − d), which is what a log that is late by d
    # shows; the effort is logged as it is made.
    Equivalence(
        effects=("command_delay", "sensor_delay"),
        parted_by=frozenset({"effort"}),
        holds=_of_all_joints,
        usual=True,
        reason=(
            "Without effort, a late command and a late log shift the same curves; a log of the "
            "effort, or a push from outside, would show which it is."
        ),
    ),
    # −b q̇ in the joint and −Δkd q̇ from the drive are one torque; only the drive's is in its log.
    Equivalence(
        effects=("viscous_friction", "velocity_gain"),
        parted_by=frozenset({"effort"}),
        holds=_driven_to_positions,
        usual=True,
        unless=CHANGES_THE_DRIVES_EFFORT,
        reason=(
            "Without effort, a torque against the speed is the same from the joint and from the "
            "drive (also as back-EMF of a motor driven by voltage), as long as the drive is below "
            "its limit; a log of the effort shows only the drive's."
        ),
    ),
    # (1 + α) kp (u − q) = (kp + Δkp)(u − q) with Δkp = α kp.
    Equivalence(
        effects=("position_gain", "torque_constant"),
        parted_by=frozenset({"effort"}),
        holds=_driven_by_gain_alone,
        reason=(
            "This drive has a position gain only, so that a stronger motor and a higher gain make "
            "the same torque; a log of the effort shows what the drive believes it makes."
        ),
    ),
    # (1 + α) (kp (u − q) − kd q̇) and any damping are (kp + Δkp)(u − q) and any damping.
    *(
        Equivalence(
            effects=("position_gain", "torque_constant"),
            parted_by=frozenset({"effort"}),
            holds=_driven_to_positions,
            usual=True,
            beside=damping,
            reason=(
                "Where damping is wrong, too, a stronger motor and a higher gain make the same "
                "torque, as long as the drive is below its limit; a log of the effort shows what "
                "the drive believes it makes."
            ),
        )
        for damping in ("velocity_gain", "viscous_friction")
    ),
    # Gravity in the frame of the root joint's body is turned by q − q₀ instead of q, which turning
    # gravity itself about the joint's axis does too.
    Equivalence(
        effects=("encoder_offset", "base_tilt"),
        holds=_turns_all_in_gravity,
        reason=(
            "A wrong zero of the joint that carries everything, and a base that is tilted about "
            "its axis, turn the robot in gravity alike; a level or an inertial sensor on the base "
            "would show which it is."
        ),
    ),
    # Turning a body's centre of mass about the axis keeps its distance, and with it the inertia.
    Equivalence(
        effects=("com_offset", "encoder_offset"),
        holds=_turns_the_last_body,
        reason=(
            "A centre of mass of the last link that lies elsewhere at the same distance from the "
            "axis, on a robot that moves in a plane, swings as it would with a wrong zero of the "
            "encoder; a stop at a known angle would show which it is."
        ),
    ),
    Equivalence(
        effects=("com_offset", "base_tilt"),
        holds=_turns_the_only_body,
        reason=(
            "On a single joint, a centre of mass that lies elsewhere at the same distance from the "
            "axis feels gravity as it would with a tilted base; a level on the base would show "
            "which it is."
        ),
    ),
    # Iₐ q̈ and Δm l² q̈ (Δm q̈ on a slide) are one torque where Δm meets no gravity.
    Equivalence(
        effects=("armature", "payload"),
        holds=_moves_across_gravity,
        reason=(
            "The only joint moves across gravity, so that a mass adds nothing but inertia, as a "
            "rotor does; weigh the load, or turn the axis so that it is lifted."
        ),
    ),
    # In m = a q: I m̈ + b ṁ + k m = a (kp (u − m) − kd ṁ); the drive reports what is in brackets.
    Equivalence(
        effects=("encoder_gain", "torque_constant"),
        holds=_moves_across_gravity_without_dry_friction,
        reason=(
            "Where nothing but inertia, damping and a spring that rests at zero is moved, turning "
            "less far than the encoder says is the same as turning too strong; measure an angle "
            "from outside, or turn the axis so that the link is lifted."
        ),
    ),
    # F⁺ for q̇ > 0 and −F⁻ for q̇ < 0 are ½(F⁺ + F⁻) sgn q̇ + ½(F⁺ − F⁻), at rest as well; bristles
    # carry the mean as rigid friction does.
    *(
        Equivalence(
            effects=(alone, "asymmetric_friction"),
            beside=beside,
            whole=whole,
            holds=holds,
            usual=beside is not None,
            reason=(
                "Dry friction that differs between the directions is the same as its mean and a "
                "constant torque; moving the joint by hand with the motor off would show which it "
                "is."
            ),
        )
        for alone, beside, whole, holds in (
            ("torque_bias", "coulomb_friction", True, _anywhere),
            ("coulomb_friction", "torque_bias", True, _anywhere),
            ("torque_bias", "presliding_friction", False, _anywhere),
            ("torque_bias", None, False, _rubs_dry),
        )
    ),
    # η₁ τ driving and η₂ τ driven are ½(η₁ + η₂) τ − ½(η₂ − η₁) |τ| sgn q̇.
    *(
        Equivalence(
            effects=(alone, "directional_efficiency"),
            beside=beside,
            whole=True,
            holds=_anywhere,
            usual=True,
            reason=(
                "A gear that is worth less when it drives is the same as friction in proportion to "
                "the load and another torque constant; a known load that is held at rest would "
                "show the constant by itself."
            ),
        )
        for alone, beside in (
            ("load_dependent_friction", "torque_constant"),
            ("torque_constant", "load_dependent_friction"),
        )
    ),
)
