"""Draws what a rehearsal robot hides: an effect, its place, and a size that matters.

    rng = np.random.default_rng(7)
    hidden = draw_hidden("leg.xml", rng, effects=["coulomb_friction"])     # this one, somewhere
    nominal = run_hardware("leg.xml", targets, seed=0)
    hidden = draw_hidden("leg.xml", rng, nominal=nominal)                  # any effect
    loudness(nominal, run_hardware("leg.xml", targets, hidden=[hidden], seed=0))

Sizes are what one meets on real robots; see `walkerkit.gap.rehearsal.hidden_sizes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware_drive import Drives, Source, load_rig, spec_of
from walkerkit.gap.rehearsal.hardware_ground import feet_and_legs
from walkerkit.gap.rehearsal.hardware_log import COUNTS, EFFORT_NOISE, POSITION_NOISE
from walkerkit.gap.rehearsal.hardware_mount import EFFECT as MOUNT
from walkerkit.gap.rehearsal.hardware_mount import HINGES, can_be_mounted, mounted
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.hidden_sizes import ASKED, Usual, joint_sizes
from walkerkit.gap.rehearsal.hideable import GROUND, HIDEABLE, NAMELESS

Array = NDArray[np.float64]

_ROTORS = ("backlash", "series_elasticity")
_SERVOS: Final = (
    "position_gain",
    "velocity_gain",
    "integral_action",
    "controller_deadband",
    "setpoint_filter",
    "slew_limit",
    "velocity_filter",
)
_FELT: Final = 0.25  # least share of the greatest lever for a body worth loading
_SHAKES: Final = (5.0, 12.0)  # Hz, of a robot on its mount
_SHAKES_OUT: Final = (0.05, 0.2)  # of the critical damping
_SKEW: Final = (0.0005, 0.0015)
_SLIPPERY: Final = (0.25, 0.45)  # as of wet tiles
_ELSEWHERE: Final = (0.008, 0.02)  # m, of a foot on its leg
_SINK: Final = (0.003, 0.01)  # m, of each of four feet that carry a robot
_KNOWN = {**HIDEABLE, **GROUND, **NAMELESS}
_NOISE = {
    "position": float(np.hypot(POSITION_NOISE, 2 * np.pi / COUNTS / np.sqrt(12))),
    "effort": EFFORT_NOISE,
}


def draw_hidden(
    source: Source,
    rng: np.random.Generator,
    effects: Sequence[str] | None = None,
    *,
    nominal: Sequence[Recording] | None = None,
    places: Sequence[str] | None = None,
) -> HiddenEffect:
    """Draws an effect for simulated hardware.

    Half the time a joint effect sits in one joint, else in all of them, each with its own size. A
    shared one, a delay for example, is in all with one value; a payload sits on one body. The
    ground is drawn only by name.

    Args:
        source: the robot's MJCF, its spec, or what was compiled of it, which can have no mount.
        rng: source of the draw.
        effects: names to choose from, each as likely as the others; by default all of `HIDEABLE`
            that this robot can have.
        nominal: experiments of the robot with nothing hidden, without which no limit can be drawn.
        places: the joints that have a joint effect, or the body that has a body's; drawn by
            default.

    Returns:
        The effect.

    Raises:
        InputError: an unusable model or name, or an effect that this robot cannot have.
    """
    model, drives = load_rig(source)
    rotors = [
        n for n, dof in zip(drives.joints, drives.dofs, strict=True) if model.dof_armature[dof]
    ]
    possible = _possible(source, drives, effects, rotors=bool(rotors), limits=nominal is not None)
    effect = possible[int(rng.integers(len(possible)))]
    usual = None if nominal is None else Usual.of(nominal, drives.joints)
    elsewhere = _beside_joints(effect, source, model, rng, places)
    if elsewhere is not None:
        return elsewhere
    sizes = joint_sizes(effect, model, drives, usual, rng)
    if _KNOWN[effect].shared:
        values = {parameter: float(size[0]) for parameter, size in sizes.items()}
        return HiddenEffect(effect=effect, joints=("*",), values=values)
    given, places = places, tuple(places or (rotors if effect in _ROTORS else drives.joints))
    if given is None and len(places) > 1 and rng.uniform() < 0.5:
        places = (places[int(rng.integers(len(places)))],)
    return HiddenEffect(
        effect=effect,
        joints=places,
        values={
            f"{joint}/{parameter}": float(size[drives.joints.index(joint)])
            for joint in places
            for parameter, size in sizes.items()
        },
    )


def _possible(
    source: Source,
    drives: Drives,
    effects: Sequence[str] | None,
    *,
    rotors: bool,
    limits: bool,
) -> list[str]:
    """Those of some effects, or of all, that a robot can have.

    Args:
        source: the robot.
        drives: its drives.
        effects: names to choose from; None for all of `HIDEABLE`.
        rotors: whether joints have an armature.
        limits: whether limits can be drawn.

    Raises:
        InputError: an unknown name, or it can have none.
    """
    for name in effects or ():
        if name not in _KNOWN:
            raise InputError(
                f"effect {name!r} cannot be hidden{closest(name, HIDEABLE)}; choose from "
                f"{', '.join(HIDEABLE)}"
            )
    servos = set(drives.kinds) == {"position"}
    possible = [
        name
        for name in (HIDEABLE if effects is None else effects)
        if (name not in ASKED or limits)
        and (name not in _ROTORS or rotors)
        and (name not in _SERVOS or servos)
        and (name != "supply_sag" or np.isfinite(drives.effort_range[1]).all())
        and (name != MOUNT or _is_mounted(source))
    ]
    if not possible:
        raise InputError(
            f"of {', '.join(effects or ()) or 'no effects'} this robot can have none; name others. "
            f"{', '.join(ASKED)} need nominal=recordings of the robot with nothing hidden, "
            f"{' and '.join(_ROTORS)} joints with an armature, supply_sag drives with a limit, "
            f"{', '.join(_SERVOS)} a robot of position servos, "
            f"{MOUNT} the file of a robot with one body on the world"
        )
    return possible


def _beside_joints(
    effect: str,
    source: Source,
    model: mujoco.MjModel,
    rng: np.random.Generator,
    places: Sequence[str] | None,
) -> HiddenEffect | None:
    """An effect of the base, the clock, a body or the ground; None for one of joints."""
    match effect:
        case "base_tilt":
            size, direction = rng.uniform(0.05, 0.15), rng.uniform(-np.pi, np.pi)
            values = {"roll": size * np.cos(direction), "pitch": size * np.sin(direction)}
            return HiddenEffect(effect=effect, values=values)
        case "mount_compliance" if not isinstance(source, mujoco.MjModel):
            on_stand = mounted(spec_of(source))
            inertia = max(on_stand.dof_M0[on_stand.joint(n).dofadr[0]] for n in HINGES)
            rate = 2 * np.pi * rng.uniform(*_SHAKES)
            return HiddenEffect(
                effect=effect,
                values={
                    "stiffness": float(inertia) * rate**2,
                    "damping_ratio": rng.uniform(*_SHAKES_OUT),
                },
            )
        case "clock_skew":
            return HiddenEffect(
                effect=effect, values={"skew": rng.choice([-1.0, 1.0]) * rng.uniform(*_SKEW)}
            )
        case "payload" | "com_offset":
            return _on_a_body(effect, model, rng, places)
        case "foot_offset":
            return _of_a_foot(model, rng, places)
        case "ground_friction":
            return HiddenEffect(effect=effect, values={"friction": rng.uniform(*_SLIPPERY)})
        case "ground_compliance":
            weight = float(np.linalg.norm(model.opt.gravity) * model.body_mass.sum())
            return HiddenEffect(
                effect=effect, values={"stiffness": 0.25 * weight / rng.uniform(*_SINK)}
            )
    return None


def _is_mounted(source: Source) -> bool:
    return not isinstance(source, mujoco.MjModel) and can_be_mounted(spec_of(source))


def _of_a_foot(
    model: mujoco.MjModel, rng: np.random.Generator, places: Sequence[str] | None
) -> HiddenEffect:
    """A foot that is elsewhere on its leg, mostly along it, as one of another length is."""
    legs = list(dict.fromkeys(leg for _, leg in feet_and_legs(model)))
    if not legs:
        raise InputError(
            "foot_offset is hidden, and the robot has no feet: give it a free joint, spheres to "
            "stand on and a level plane."
        )
    leg = places[0] if places else legs[int(rng.integers(len(legs)))]
    direction = rng.standard_normal(3) + np.array([0.0, 0.0, 2 * rng.choice([-1.0, 1.0])])
    shift = rng.uniform(*_ELSEWHERE) * direction / np.linalg.norm(direction)
    return HiddenEffect(
        effect="foot_offset", bodies=(leg,), values=dict(zip("xyz", map(float, shift), strict=True))
    )


def loudness(
    nominal: Sequence[Recording],
    other: Sequence[Recording],
    signals: Sequence[str] = ("position", "effort"),
) -> dict[str, float]:
    """How far logs of a robot differ from those with nothing hidden in it, in standard deviations.

    Args:
        nominal: experiments with nothing hidden.
        other: the same experiments with the same seed, with something hidden.
        signals: those that count.

    Returns:
        Joint to the root mean square of the difference over the noise, of the recording and signal
        where that is largest.
    """
    most: dict[str, float] = {}
    for one, two in zip(nominal, other, strict=True):
        for column, values in one.columns.items():
            joint, _, signal = column.rpartition("/")
            if signal in signals:
                apart = float(np.sqrt(np.mean((values - two.columns[column]) ** 2)))
                most[joint] = max(most.get(joint, 0.0), apart / _NOISE[signal])
    return most


def _on_a_body(
    effect: str, model: mujoco.MjModel, rng: np.random.Generator, places: Sequence[str] | None
) -> HiddenEffect:
    """A payload or a moved centre of mass, on a body whose mass the joints move."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_fwdPosition(model, data)
    felt = np.zeros(model.nbody)
    for body in range(1, model.nbody):
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian, None, body)
        felt[body] = np.abs(jacobian).max()
    named = [b for b in range(model.nbody) if model.body(b).name and felt[b] > _FELT * felt.max()]
    if not named:
        raise InputError(
            f"the model has no named body that its joints move; name one for a {effect}"
        )
    body = model.body(places[0] if places else named[int(rng.integers(len(named)))])
    if effect == "payload":
        moving = float(model.body_mass[felt > 0].sum())
        values = {"mass": rng.uniform(0.05, 0.2) * moving}
    else:
        gyration = float(np.sqrt(0.5 * body.inertia.sum() / body.mass[0]))
        direction = rng.standard_normal(3)
        shift = rng.uniform(0.2, 0.5) * gyration * direction / np.linalg.norm(direction)
        values = dict(zip("xyz", map(float, shift), strict=True))
    return HiddenEffect(effect=effect, bodies=(body.name,), values=values)
