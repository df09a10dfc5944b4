"""Draws what a rehearsal robot hides: an effect, its place, and a size that matters.

    rng = np.random.default_rng(7)
    hidden = draw_hidden("leg.xml", rng)                                # any effect
    hidden = draw_hidden("leg.xml", rng, effects=["coulomb_friction"])  # this one, somewhere
    nominal = run_hardware("leg.xml", targets, seed=0)
    hidden = draw_hidden("leg.xml", rng, peak_effort=peak_effort(nominal))

Sizes are what one meets on real robots, in proportion to the model: friction and bias to the
drives' effort limit, gains and viscosity to the servos', inertia and payload to the bodies'.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware_drive import Drives, load_rig
from walkerkit.gap.rehearsal.hidden import HIDEABLE, HiddenEffect

Array = NDArray[np.float64]

_DELAYS = ("command_delay", "sensor_delay")
_FELT: Final = 0.25  # least share of the greatest lever for a body worth loading
_SWING: Final = 0.5  # rad: the error that takes all effort of a servo without a limit


def draw_hidden(
    model_xml_path: str | Path,
    rng: np.random.Generator,
    effects: Sequence[str] | None = None,
    *,
    peak_effort: Mapping[str, float] | None = None,
) -> HiddenEffect:
    """Draws an effect for simulated hardware.

    Half the time a joint effect sits in one joint, else in all of them, each with its own size. A
    delay is shared by all joints, a payload sits on one body.

    Args:
        model_xml_path: the robot's MJCF.
        rng: source of the draw.
        effects: names to choose from, each as likely as the others; by default all of `HIDEABLE`,
            `effort_limit` only where `peak_effort` is known.
        peak_effort: the largest effort of each joint in the experiments, N·m; see `peak_effort`.

    Returns:
        The effect.

    Raises:
        InputError: an unusable model or name, or an effort limit without its peak efforts.
    """
    if effects is None:
        effects = [name for name in HIDEABLE if name != "effort_limit" or peak_effort is not None]
    for name in effects:
        if name not in HIDEABLE:
            raise InputError(
                f"effect {name!r} cannot be hidden{closest(name, HIDEABLE)}; choose from "
                f"{', '.join(HIDEABLE)}"
            )
    if not effects:
        raise InputError("effects is empty; name at least one, or None for all")
    effect = effects[int(rng.integers(len(effects)))]
    model, drives = load_rig(model_xml_path)
    if effect == "base_tilt":
        size, direction = rng.uniform(0.05, 0.15), rng.uniform(-np.pi, np.pi)
        values = {"roll": size * np.cos(direction), "pitch": size * np.sin(direction)}
        return HiddenEffect(effect=effect, values=values)
    if effect == "payload":
        return _payload(model, rng)
    if effect in _DELAYS:
        values = {"delay": rng.uniform(0.004, 0.016)}
        return HiddenEffect(effect=effect, joints=("*",), values=values)
    sizes = _sizes(effect, model, drives, rng, peak_effort)
    joints = drives.joints
    if len(joints) > 1 and rng.uniform() < 0.5:
        joints = (joints[int(rng.integers(len(joints)))],)
    values = {
        f"{joint}/{parameter}": float(size[drives.joints.index(joint)])
        for joint in joints
        for parameter, size in sizes.items()
    }
    return HiddenEffect(effect=effect, joints=joints, values=values)


def peak_effort(recordings: Sequence[Recording]) -> dict[str, float]:
    """The largest effort that each joint's drive reports, N·m.

    Args:
        recordings: experiments of a robot with nothing hidden.

    Returns:
        Joint to effort.
    """
    peaks: dict[str, float] = {}
    for recording in recordings:
        for column, values in recording.columns.items():
            joint, _, signal = column.rpartition("/")
            if signal == "effort":
                peaks[joint] = max(peaks.get(joint, 0.0), float(np.abs(values).max()))
    return peaks


def _sizes(
    effect: str,
    model: mujoco.MjModel,
    drives: Drives,
    rng: np.random.Generator,
    peaks: Mapping[str, float] | None,
) -> dict[str, Array]:
    """A size of each of the effect's parameters at each joint, shape (n_joints,)."""
    n = len(drives.joints)
    kp, inertia = drives.gain, model.dof_M0[drives.dofs]
    kd = np.where(drives.bias[2] < 0, -drives.bias[2], 2 * np.sqrt(kp * inertia))
    strongest = np.abs(drives.effort_range).max(axis=0)
    strongest = np.where(np.isfinite(strongest), strongest, kp * _SWING)
    sign = rng.choice([-1.0, 1.0], n)

    def share(low: float, high: float) -> Array:
        return rng.uniform(low, high, n)

    match effect:
        case "viscous_friction":
            return {"damping": share(0.05, 0.2) * kd}
        case "coulomb_friction":
            return {"frictionloss": share(0.01, 0.05) * strongest}
        case "armature":
            return {"armature": share(0.15, 0.6) * inertia.mean()}
        case "position_gain":
            return {"delta_kp": sign * share(0.15, 0.35) * kp}
        case "velocity_gain":
            # A servo without velocity gain has none to lose.
            return {"delta_kd": np.where(drives.bias[2] < 0, sign, 1) * share(0.25, 0.6) * kd}
        case "torque_constant":
            return {"alpha": sign * share(0.1, 0.25)}
        case "effort_limit":
            return {"forcerange": share(0.4, 0.75) * _peaks(drives, peaks)}
        case "encoder_offset":
            return {"offset": sign * share(0.03, 0.1)}
        case "torque_bias":
            return {"bias": sign * share(0.017, 0.067) * strongest}
        case "parallel_spring":
            ids = model.dof_jntid[drives.dofs]
            lower, upper = np.where(model.jnt_limited[ids], model.jnt_range[ids].T, 0.0)
            return {
                "stiffness": share(0.017, 0.083) * kp,
                "springref": lower + share(0.1, 0.9) * (upper - lower),
            }
    raise ValueError(f"{effect} has no size at a joint")


def _peaks(drives: Drives, peaks: Mapping[str, float] | None) -> Array:
    if peaks is None or not set(drives.joints) <= set(peaks):
        raise InputError(
            f"effort_limit is drawn in proportion to the peak effort of {', '.join(drives.joints)}"
            f", and peak_effort has {', '.join(peaks or {}) or 'none'}; give "
            "peak_effort=peak_effort(recordings of the robot with nothing hidden)"
        )
    return np.array([peaks[joint] for joint in drives.joints])


def _payload(model: mujoco.MjModel, rng: np.random.Generator) -> HiddenEffect:
    """A payload on a body whose centre of mass the joints move."""
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
        raise InputError("the model has no named body that its joints move; name one for a payload")
    moving = float(model.body_mass[felt > 0].sum())
    values = {"mass": rng.uniform(0.05, 0.2) * moving}
    body = model.body(named[int(rng.integers(len(named)))]).name
    return HiddenEffect(effect="payload", bodies=(body,), values=values)
