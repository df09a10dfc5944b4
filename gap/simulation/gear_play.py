"""Play between motors and links: a gap, a spring, or a gap and then a spring.

    robot = with_play(robot, ["knee"])
    robot.joints["knee"].play.name                 # "knee_play"

The joint keeps its name, its actuators and its losses, and becomes the motor's side as seen through
the gear. A second joint of the same body on the same axis, `<joint>_play`, takes the link along:
with a range that is the gap, with a stiffness that is the gear's, or with a range whose stops give
way like a spring. All of it is plain MJCF, integrated by MuJoCo.

Limits: a rotor needs an inertia, which is the joint's armature; springs that a step h cannot follow
are as stiff as it can (√(K/I) = 1/h, I the inertia of rotor against link).
"""

from __future__ import annotations

import copy
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType
from typing import Any, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.simulation.base import find_base
from walkerkit.gap.simulation.robot import Joint, Play, Robot, scalar_joints
from walkerkit.gap.simulation.start import rest
from walkerkit.gap.simulation.trials import Trials, model_field

FloatArray = NDArray[np.float64]

SUFFIX = "_play"
_WIDE = 1e3  # rad; half a range that is none
_HARD = 0.95  # impedance of the stops of a gap; harder ones ring, softer ones widen it under load
_SOFT = 0.01  # that of stops which give way: what it is above 0 acts like a mass at the stop
_STEPS = 2  # a stop's time constant; MuJoCo allows no shorter one
_STIFFEST = 1.0  # √(K/I) h
_PLACEHOLDER = 0.1  # of a joint's inertia, where the model has no rotor; variants have their own
_SLIGHT = 0.5  # rad/s²; a load that accelerates the link by less may be an error of measurement
_SMALLEST = 1e-12
_SHUT = 1e12  # times what the link weighs, a play does not move
_TILT = 1e-12  # of a slide joint's axis
_WIDTH = 0.001  # rad; stops have one impedance, however far they give way
# Of models, which are never written to, a copy that is, and its data.
_SCRATCH: weakref.WeakKeyDictionary[mujoco.MjModel, tuple[mujoco.MjModel, mujoco.MjData]] = (
    weakref.WeakKeyDictionary()
)

_COPIED = (
    *("type", "pos", "axis", "ref", "align", "stiffness", "springref", "springdamper", "damping"),
    *("limited", "range", "margin", "solref_limit", "solimp_limit", "actfrclimited"),
    *("actfrcrange", "armature", "frictionloss", "solref_friction", "solimp_friction"),
    *("group", "actgravcomp"),
)
PLAIN: Mapping[str, Any] = MappingProxyType(
    {
        "ref": 0.0,
        "springref": 0.0,
        "margin": 0.0,
        "armature": 0.0,
        "frictionloss": 0.0,
        "actgravcomp": False,
        "actfrclimited": False,
    }
)
"""What a joint has of its own that nothing drives and nothing rubs."""


def with_play(robot: Robot, joints: Sequence[str]) -> Robot:
    """The robot with play at some joints, free until `set_play` gives it a size or a spring.

    Args:
        robot: the robot.
        joints: names of joints.

    Returns:
        A robot with a joint more for each, directly after it.

    Raises:
        ValueError: a name is taken.
    """
    spec = robot.spec.copy()
    # From the last to the first, so that addresses before it stay right.
    for name in sorted(joints, key=lambda name: -robot.joints[name].id):
        if name + SUFFIX in robot.joints:
            raise ValueError(f"{robot.source}: there is a joint {name + SUFFIX!r} already")
        joint = robot.joints[name]
        element = spec.joint(name)
        if element.armature == 0:
            element.armature = _PLACEHOLDER * float(robot.model.dof_M0[joint.dof])
        _insert(spec, element)
        for key in spec.keys:
            key.qpos = with_zero(key.qpos, joint.qpos + 1)
            key.qvel = with_zero(key.qvel, joint.dof + 1)
    model = spec.compile()
    found = scalar_joints(model)
    return replace(
        robot,
        spec=spec,
        model=model,
        base=find_base(model, robot.source),
        joints={
            name: replace(joint, drives=robot.joints[name].drives, inputs=robot.joints[name].inputs)
            if name in robot.joints
            else joint
            for name, joint in found.items()
        },
    )


def with_zero(values: Any, at: int) -> list[float]:
    """Values of a keyframe with one more; a keyframe that has none keeps none."""
    kept = [float(value) for value in values]
    return [*kept[:at], 0.0, *kept[at:]] if kept else kept


def _insert(spec: mujoco.MjSpec, motor: Any) -> None:
    """Puts the play directly after the motor's joint."""
    siblings = list(motor.parent.joints)
    following = siblings[[joint.name for joint in siblings].index(motor.name) + 1 :]
    # A body moves by its joints in their order, and a new one is the last: each passes on to the
    # next what it is, and the first becomes the play. Whatever refers to a joint does so by name.
    chain = [*following, motor.parent.add_joint()]
    for source, target in reversed([*pairwise(chain)]):
        become(source, target)
        passed, source.name = source.name, ""
        target.name = passed
    play = chain[0]
    become(motor, play)
    for key, value in PLAIN.items():
        setattr(play, key, value)
    for key in ("stiffness", "damping", "springdamper", "actfrcrange"):
        getattr(play, key)[:] = 0
    play.solref_limit = [_STEPS * spec.option.timestep, 1.0]
    play.solimp_limit = [_HARD, _HARD, _WIDTH, 0.5, 2.0]
    in_degrees = spec.compiler.degree and play.type == mujoco.mjtJoint.mjJNT_HINGE
    wide = _WIDE / (np.pi / 180 if in_degrees else 1.0)
    play.limited, play.range = True, [-wide, wide]
    play.name = motor.name + SUFFIX
    if play.type == mujoco.mjtJoint.mjJNT_SLIDE:
        play.axis = _hardly_tilted(play.axis)


def _hardly_tilted(axis: FloatArray) -> FloatArray:
    """An axis that lies along no axis of its body's frame.

    MuJoCo takes slide joints along these for independent of each other, two along the same as well
    (`body_simple`), and the play would not move the link with the motor.
    """
    tilted = np.array(axis)
    tilted[np.argmin(np.abs(tilted))] += _TILT * np.linalg.norm(tilted)
    return tilted


def become(source: Any, target: Any) -> None:
    """Makes a joint of a spec what another one is, but for its name."""
    for key in _COPIED:
        value = getattr(source, key)
        setattr(target, key, value.copy() if isinstance(value, np.ndarray) else value)
    target.userdata = list(source.userdata)
    if source.frame is not None:
        target.set_frame(source.frame)


def set_play(
    trials: Trials, joint: str, values: Mapping[str, FloatArray], rotor: FloatArray
) -> None:
    """Writes a play's size and springs to the model's fields.

    Args:
        trials: variants of a robot with play there.
        joint: name of the motor's joint.
        values: what `Trials.play` has, (n,) each.
        rotor: (n,) inertia of the rotor [kg·m²; kg].
    """
    motor, model = trials.robot.joints[joint], trials.robot.model
    play = motor.play
    if play is None:
        raise ValueError(f"joint {joint!r} has no play; make some by `with_play`")
    if (rotor != model.dof_armature[motor.dof]).any():
        trials.field("dof_armature")[:, motor.dof] = rotor
    # Where nothing parts, the rotor is the joint's, and whatever it is the play stays shut.
    shut = ~((values["width"] > 0) | (values["compliance"] > 0))
    mobility = _link_mobility(model, motor, play)
    if shut.any():
        trials.field("dof_armature")[shut, play.dof] = _SHUT / mobility
    inertia = 1 / (1 / np.maximum(rotor, _SMALLEST) + mobility)
    sprung = values["compliance"] > 0
    least = stiffest(model.opt.timestep, inertia)
    stiffness = np.where(sprung, 1 / np.maximum(values["compliance"], least), 0.0)
    damping = 2 * values["damping_ratio"] * np.sqrt(stiffness * inertia)
    gap = values["width"] > 0
    trials.field("jnt_limited")[:, play.id] = gap
    trials.field("jnt_range")[:, play.id] = values["width"][:, None] * [-0.5, 0.5]
    trials.field("jnt_stiffness")[:, play.id] = np.where(gap, 0.0, stiffness)
    trials.field("dof_damping")[:, play.dof] = np.where(gap, 0.0, damping)
    both = gap & sprung
    if both.any():
        # A stop pushes back by (k r + b v) / R, with R (1 − d)/d of what an effort accelerates
        # (MuJoCo, Computation: Constraint model); its k and b are solref's over d.
        own = np.stack([stiffness, damping], axis=1) * ((1 - _SOFT) / inertia)[:, None]
        trials.field("jnt_solref")[both, play.id] = -own[both]
        trials.field("jnt_solimp")[both, play.id, :2] = _SOFT


def made_play(robot: Robot, joint: str) -> dict[str, float | None]:
    """What a robot's model says of the play at a joint, as `set_play` has written it.

    Args:
        robot: the robot.
        joint: name of the motor's joint.

    Returns:
        `width` [rad; m] and `compliance` [rad/(N·m); m/N], 0 where there is none, and the spring's
        `damping_ratio` [1], None without a spring.
    """
    motor, model = robot.joints[joint], robot.model
    play = motor.play
    found: dict[str, float | None] = {"width": 0.0, "compliance": 0.0, "damping_ratio": None}
    if play is None:
        return found
    stiffness, damping = float(model.jnt_stiffness[play.id]), float(model.dof_damping[play.dof])
    rotor = max(float(model.dof_armature[motor.dof]), _SMALLEST)
    inertia = 1 / (1 / rotor + _link_mobility(model, motor, play))
    if model.jnt_limited[play.id]:
        found["width"] = float(np.ptp(model.jnt_range[play.id]))
        if model.jnt_solref[play.id, 0] < 0:
            pushes = -model.jnt_solref[play.id] * inertia / (1 - model.jnt_solimp[play.id, 0])
            stiffness, damping = (float(number) for number in pushes)
    if stiffness > 0:
        found["compliance"] = 1 / stiffness
        found["damping_ratio"] = damping / (2 * np.sqrt(stiffness * inertia))
    return found


Number = TypeVar("Number", float, FloatArray)


def stiffest(step: float, inertia: Number) -> Number:
    """The compliance of the stiffest spring that a timestep can follow [rad/(N·m); m/N].

    Args:
        step: the timestep [s].
        inertia: of rotor against link [kg·m²; kg].
    """
    return (step / _STIFFEST) ** 2 / inertia


def loads(
    trials: Trials,
    played: Sequence[Joint],
    joints: Sequence[Joint],
    state: Sequence[FloatArray],
    driven: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """What passes through the plays of some joints towards their links.

    It is what moves the links as measured; of a robot that floats, whose ground carries it with
    forces that nobody knows, it is what the motors make.

    Args:
        trials: the variants.
        played: joints with play.
        joints: joints that are measured.
        state: their positions, velocities and accelerations, (n_segments, n_joints) each.
        driven: controls (n_segments, nu) and efforts applied beside them (n_segments, nv).

    Returns:
        (n, n_segments, n_played) efforts [N·m; N].
    """
    known: dict[bytes, FloatArray] = {}
    found = []
    given = trials.robot.model
    if given not in _SCRATCH:
        _SCRATCH[given] = copy.copy(given), mujoco.MjData(given)
    model, data = _SCRATCH[given]
    for row in range(trials.n):
        own = {name: values[row] for name, values in trials.fields.items()}
        key = b"".join(values.tobytes() for values in own.values())
        if key not in known:
            for name, value in own.items():
                model_field(model, name)[...] = value
            floats = trials.robot.base is not None
            known[key] = _loads(model, data, floats, played, joints, state, driven)
        found.append(known[key])
    for name in trials.fields:
        model_field(model, name)[...] = model_field(given, name)
    return np.stack(found)


def _loads(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    floats: bool,
    played: Sequence[Joint],
    joints: Sequence[Joint],
    state: Sequence[FloatArray],
    driven: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """(n_segments, n_played) as `loads`, of one variant."""
    rest(model, data)
    at, dofs = [joint.qpos for joint in joints], [joint.dof for joint in joints]
    plays = [joint.play.dof for joint in played if joint.play]
    found = []
    motors = [joint.dof for joint in played]
    for qpos, qvel, qacc, ctrl, applied in zip(*state, *driven, strict=True):
        data.qpos[at], data.qvel[dofs], data.qacc[dofs] = qpos, qvel, qacc
        if floats:
            data.ctrl[:] = ctrl
            mujoco.mj_forward(model, data)
            found.append(data.qfrc_actuator[motors] + applied[motors])
        else:
            mujoco.mj_inverse(model, data)
            found.append(data.qfrc_inverse[plays])
    return np.stack(found)


def bend(
    state: FloatArray,
    trials: Trials,
    fields: Mapping[str, NDArray[Any]],
    played: Sequence[Joint],
    loads: FloatArray,
) -> None:
    """Has simulations start with the plays where the loads put them, and encoders as measured.

    Args:
        state: (n, n_segments, nstate) rows of mjSTATE_INTEGRATION, written to.
        trials: the variants.
        fields: of which each variant has its own, (n, *shape).
        played: joints with play.
        loads: (n, n_segments, n_played) what passes through them [N·m; N].
    """
    model = trials.robot.model
    first = int(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_QPOS.value - 1))
    for k, joint in enumerate(played):
        if joint.play is not None:
            bent = _deflection(model, fields, joint, joint.play, loads[..., k])
            state[..., first + joint.play.qpos] = bent
            state[..., first + joint.qpos] -= trials.load_side[joint.name][:, None] * bent


def _deflection(
    model: mujoco.MjModel,
    fields: Mapping[str, NDArray[Any]],
    joint: Joint,
    play: Play,
    load: FloatArray,
) -> FloatArray:
    """Where a play rests under a load: (n, n_segments), on the stop that pushes, springs bent."""

    def field(name: str) -> FloatArray:
        own = fields.get(name)
        values = np.asarray(getattr(model, name)[None] if own is None else own)
        return values.astype(np.float64)

    stiffness = field("jnt_stiffness")[:, play.id, None]
    neutral = field("qpos_spring")[:, play.qpos, None]
    bent = np.where(stiffness > 0, neutral - load / np.maximum(stiffness, _SMALLEST), 0.0)
    limited = field("jnt_limited")[:, play.id, None] != 0
    mobility = _link_mobility(model, joint, play)
    low, high = np.moveaxis(field("jnt_range")[:, play.id, None], -1, 0)
    solref, impedance = field("jnt_solref")[:, play.id], field("jnt_solimp")[:, play.id, 0, None]
    rotor = field("dof_armature")[:, joint.dof, None]
    stop = -solref[:, :1] / ((1 - impedance) * (1 / np.maximum(rotor, _SMALLEST) + mobility))
    given = np.where(stop > 0, -load / np.maximum(stop, _SMALLEST), 0.0)
    # Which stop pushes is not known where hardly anything does.
    side = np.clip(load * mobility / _SLIGHT, -1.0, 1.0)
    pressed = 0.5 * (low + high) - 0.5 * side * (high - low) + given
    stopped = np.where(stiffness > 0, np.clip(bent, low, high), pressed)
    return np.where(limited, stopped, bent)


def _link_mobility(model: mujoco.MjModel, joint: Joint, play: Play) -> float:
    """What an effort accelerates at a joint if its rotor is taken off [1/(kg·m²); 1/kg].

    At the reference pose, with the other joints free: the play's own mobility is the sum of this
    and of the rotor's.
    """
    both = float(model.dof_invweight0[play.dof])
    return both - 1 / float(model.dof_armature[joint.dof])
