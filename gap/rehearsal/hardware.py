"""Simulated hardware: logs of a robot that differs from its model in known, hidden ways.

    late = HiddenEffect(effect="command_delay", joints=("*",), values={"delay": 0.008})
    recordings = run_hardware("leg.xml", [targets], hidden=[late], seed=0)

A rehearsal is worth something only where the "robot" is not the simulation over again. So MuJoCo
moves bare rigid bodies here, several times finer than the model's own step; servo, delay, damping,
dry friction and encoder are laws of `walkerkit.gap.rehearsal.hardware_drive` in numpy, applied as
joint efforts, and what is logged is late, noisy and quantised. Of the model it keeps bodies,
inertia, gravity, springs, joint limits and contacts.

The log has each joint's `position_target` as it was sent, `position` and `velocity` as the encoder
reads them, and `effort` as the drive believes it delivers it: after its own limit, without a wrong
torque constant, bias, spring or friction.

Limits: every actuator must be a plain position servo of a hinge or slide joint (gear 1); a floating
base moves but is not logged; tendons and equality constraints stay MuJoCo's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware_drive import Bristles, Drives, load_rig
from walkerkit.gap.rehearsal.hidden import HiddenEffect

Array = NDArray[np.float64]

COUNTS: Final = 16384
"""Encoder counts of a turn (of 2π m on a slide joint)."""
POSITION_NOISE: Final = 1e-4
"""Of the position before it is quantised, rad (m for slide joints)."""
VELOCITY_NOISE: Final = 0.01
"""Of the velocity, rad/s."""
EFFORT_NOISE: Final = 0.02
"""Of the reported effort, N·m."""
SETTLE: Final = 1.5
"""How long the robot holds the first target before the log begins, s."""

_LOGGED = ("position_target", "position", "velocity", "effort")
_LOST = 1e4  # rad/s: no joint of a walking robot comes back from there
_OFF = (
    mujoco.mjtDisableBit.mjDSBL_ACTUATION
    # A reset in the middle of the log would hide that the robot went unstable.
    | mujoco.mjtDisableBit.mjDSBL_AUTORESET
)


def run_hardware(
    model_xml_path: str | Path,
    targets: Sequence[ArrayLike],
    *,
    rate: float = 500.0,
    hidden: Sequence[HiddenEffect] = (),
    seed: int,
    substeps: int = 4,
    names: Sequence[str] | None = None,
) -> list[Recording]:
    """Runs experiments on a robot with hidden effects and logs them.

    Args:
        model_xml_path: the robot's MJCF.
        targets: one experiment each: position targets, shape (T, n_joints), rad, one row for each
            sample and one column for each of the model's actuators, in their order.
        rate: samples a second; a row's target is sent at the row's time and held to the next.
        hidden: what the robot has and the model has not, one on top of the other.
        seed: of the noise; an experiment's noise does not depend on the others.
        substeps: steps of the simulated robot for each of the model's.
        names: the recordings' names; experiment_0, experiment_1 and so on by default.

    Returns:
        A recording of each experiment, T samples from time 0.

    Raises:
        InputError: a model, experiment or effect that cannot be simulated.
        RuntimeError: the robot went unstable.
    """
    model, drives = _build(model_xml_path, hidden)
    if int(substeps) != substeps or substeps < 1:
        raise InputError(f"substeps is {substeps}; it must be a whole number of at least 1")
    model.opt.timestep /= substeps
    stride = _stride(rate, model.opt.timestep)
    commands = [_checked(i, command, drives) for i, command in enumerate(targets)]
    names = [f"experiment_{i}" for i in range(len(commands))] if names is None else names
    if not commands or len(names) != len(commands):
        raise InputError(
            f"{len(commands)} experiments have {len(names)} names; give at least one experiment, "
            "and a name to each"
        )
    longest = max(map(len, commands))
    together = np.stack([np.pad(c, ((0, longest - len(c)), (0, 0)), "edge") for c in commands], 1)
    held = np.repeat(together, stride, axis=0)[: (longest - 1) * stride + 1]
    lead = math.ceil(SETTLE / model.opt.timestep)
    sent = np.concatenate([np.repeat(held[:1], lead, axis=0), held])
    q, qd, effort = _run(model, drives, sent)
    lag = drives.sensor_delay / model.opt.timestep
    signals = np.stack([_delayed(q, lag) + drives.offset, _delayed(qd, lag), effort])
    logged = signals[:, lead::stride]
    recordings = []
    for i, (name, command) in enumerate(zip(names, commands, strict=True)):
        readings = _measured(logged[:, : len(command), i], np.random.default_rng([seed, i]))
        columns = {
            f"{joint}/{signal}": values[:, j]
            for j, joint in enumerate(drives.joints)
            for signal, values in zip(_LOGGED, (command, *readings), strict=True)
        }
        recordings.append(
            Recording(name=name, time=np.arange(len(command)) / rate, columns=columns)
        )
    return recordings


def _build(path: str | Path, hidden: Sequence[HiddenEffect]) -> tuple[mujoco.MjModel, Drives]:
    """The bare rigid bodies and the drives, with what is hidden in either."""
    model, drives = load_rig(path)
    model.opt.disableflags |= _OFF
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    for law in (
        model.dof_damping,
        model.dof_dampingpoly,
        model.dof_frictionloss,
        model.actuator_damping,
        model.actuator_dampingpoly,
    ):
        law[:] = 0.0
    for effect in hidden:
        match effect.effect:
            case "armature":
                model.dof_armature[drives.dofs] += effect.spread("armature", drives.joints)
            case "payload":
                bodies = [model.body(i).name for i in range(model.nbody)]
                model.body_mass += effect.spread("mass", bodies)
            case "base_tilt":
                model.opt.gravity = _tilted(effect) @ model.opt.gravity
            case _:
                drives.hide(effect)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model, drives


def _tilted(effect: HiddenEffect) -> Array:
    """Rotation from the world to the base that was turned about x (roll), then y (pitch)."""
    (sr, sp), (cr, cp) = (
        [function(effect.value(angle)) for angle in ("roll", "pitch")]
        for function in (math.sin, math.cos)
    )
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    to_base: Array = (about_y @ about_x).T
    return to_base


def _stride(rate: float, timestep: float) -> int:
    """Simulated steps from one sample to the next."""
    steps = 1.0 / (rate * timestep) if rate > 0 else 0.0
    if round(steps) < 1 or not math.isclose(steps, round(steps), rel_tol=1e-6):
        raise InputError(
            f"rate is {rate} Hz; the time between samples must be a whole number of simulated "
            f"steps of {timestep:g} s, so give {1 / timestep:g} Hz over a whole number"
        )
    return round(steps)


def _checked(index: int, targets: ArrayLike, drives: Drives) -> Array:
    """An experiment's targets, shape (T, n_joints)."""
    command = np.array(targets, dtype=float)
    n = len(drives.joints)
    if command.ndim != 2 or command.shape[0] < 2 or command.shape[1] != n:
        raise InputError(
            f"experiment {index} has targets of shape {command.shape}; give at least two rows of "
            f"{n}, one for each of {', '.join(drives.joints)}"
        )
    if not np.all(np.isfinite(command)):
        row, column = np.argwhere(~np.isfinite(command))[0]
        raise InputError(
            f"experiment {index} has the target {command[row, column]} for "
            f"{drives.joints[column]!r} in row {row}; give finite numbers"
        )
    return command


def _delayed(signal: Array, lag: Array) -> Array:
    """A signal as it arrives late.

    Args:
        signal: shape (n_steps, n_experiments, n_joints).
        lag: of each joint, shape (n_joints,), steps; the fraction of a step is interpolated.

    Returns:
        The signal, shape as given; before its first sample it is taken to have been constant.
    """
    at = np.arange(len(signal))[:, None] - np.round(lag, 9)
    early = np.floor(at).astype(int)
    late_share = (at - early)[:, None, :]

    def take(index: NDArray[np.intp]) -> Array:
        inside = np.clip(index, 0, len(signal) - 1)[:, None, :]
        return np.take_along_axis(signal, inside, axis=0)

    delayed: Array = (1.0 - late_share) * take(early) + late_share * take(early + 1)
    return delayed


def _run(model: mujoco.MjModel, drives: Drives, sent: Array) -> tuple[Array, Array, Array]:
    """Steps all experiments together.

    Args:
        model: the bare rigid bodies.
        drives: what moves them.
        sent: targets as they are sent, shape (n_steps, n_experiments, n_joints), rad.

    Returns:
        True joint positions and velocities and commanded efforts at each step, shape as `sent`.
    """
    arriving = _delayed(sent, drives.command_delay / model.opt.timestep)
    n_sims = sent.shape[1]
    batch = mujoco.batch.Batch(model, n_sims, nthread=1)
    qpos, qvel, applied = batch.bind("qpos"), batch.bind("qvel"), batch.bind("qfrc_applied")
    qpos[:] = _start(model)
    ranges = np.where(model.jnt_limited[:, None], model.jnt_range, [-np.inf, np.inf])
    lower, upper = ranges[model.dof_jntid[drives.dofs]].T
    qpos[:, drives.qpos] = np.clip(sent[0] - drives.offset, lower, upper)
    bristles = Bristles(drives.frictionloss, 1.0 / model.dof_invweight0, model.opt.timestep, n_sims)
    q, qd, effort = np.empty((3, *sent.shape))
    for k, target in enumerate(arriving):
        q[k], qd[k] = qpos[:, drives.qpos], qvel[:, drives.dofs]
        effort[k] = drives.commanded(target, q[k], qd[k])
        applied[:] = drives.drag(qvel) + bristles.torque(qvel)
        applied[:, drives.dofs] += drives.delivered(effort[k], q[k])
        batch.step()
        if not np.abs(qvel).max() < _LOST:
            lost = int(np.argmax(~(np.abs(qvel).max(axis=1) < _LOST)))
            raise RuntimeError(
                f"experiment {lost} went unstable {k * model.opt.timestep - SETTLE:.3f} s after "
                "its start; soften the model's gains, hide less, or raise substeps"
            )
    return q, qd, effort


def _start(model: mujoco.MjModel) -> Array:
    """The keyframe `home` where there is one, for what no target says; shape (nq,)."""
    home = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, "home")
    start: Array = model.qpos0 if home < 0 else model.key_qpos[home]
    return start


def _measured(true: Array, rng: np.random.Generator) -> Array:
    """Position, velocity and effort as they are logged.

    Args:
        true: the three without noise, shape (3, T, n_joints).
        rng: source of the noise.
    """
    spread = np.array([POSITION_NOISE, VELOCITY_NOISE, EFFORT_NOISE])
    readings: Array = true + spread[:, None, None] * rng.standard_normal(true.shape)
    count = 2 * np.pi / COUNTS
    readings[0] = np.round(readings[0] / count) * count
    return readings
