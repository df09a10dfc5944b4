"""Simulated hardware: logs of a robot that differs from its model in known, hidden ways.

    late = HiddenEffect(effect="command_delay", joints=("*",), values={"delay": 0.008})
    recordings = run_hardware("leg.xml", [targets], hidden=[late], seed=0)

A rehearsal is worth something only where the "robot" is not the simulation over again. So MuJoCo
moves bare rigid bodies here, several times finer than the model's own step; controller, motor,
gear, friction and log are laws of their own in numpy (the `hardware_…` modules), applied as joint
efforts, and what is logged is late, noisy and quantised. Of the model it keeps bodies, inertia,
gravity, springs, joint limits and contacts but those of feet that stand on the ground.

The log has each joint's target as it was sent, `position` and `velocity` as the encoder reads them,
and `effort` as the drive believes it delivers it: after its own limits and lags, without a wrong
torque constant, bias, ripple, spring or friction; of a supply that varies its `voltage`; and of a
base that floats its pose and velocity.
Where a drive takes efforts or speeds, a computer beside the robot goes for the positions, and the
log has the `effort_target` or `velocity_target` that it sent.

Limits: every actuator must be a plain servo or motor of a hinge or slide joint; tendons, equality
constraints and all other contacts stay MuJoCo's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.drive import SCALAR_JOINTS
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware_base import WIDTH, base_readings, free_joint, home
from walkerkit.gap.rehearsal.hardware_companion import Companion
from walkerkit.gap.rehearsal.hardware_controller import Controller
from walkerkit.gap.rehearsal.hardware_drive import Drives, Source, load_rig, spec_of
from walkerkit.gap.rehearsal.hardware_friction import Friction
from walkerkit.gap.rehearsal.hardware_ground import Soil
from walkerkit.gap.rehearsal.hardware_imu import Imu, contacts, felt, imu_readings
from walkerkit.gap.rehearsal.hardware_log import Log, readings
from walkerkit.gap.rehearsal.hardware_motor import Motor, swing_of
from walkerkit.gap.rehearsal.hardware_mount import EFFECT as MOUNT
from walkerkit.gap.rehearsal.hardware_mount import Stand, mounted
from walkerkit.gap.rehearsal.hardware_transmission import Stops, Transmission
from walkerkit.gap.rehearsal.hardware_troubles import Troubles
from walkerkit.gap.rehearsal.hidden import HiddenEffect

Array = NDArray[np.float64]
BaseLog = Literal["pose", "imu", "truth"]

SETTLE: Final = 1.5
"""How long the robot holds the first target before the log begins, s."""

_LOGGED = ("position", "velocity", "effort")
_STIFF = 0.5  # b h/I of a damping that explicit steps no longer follow; at 2 they diverge
_LOST = 1e4  # rad/s: no joint of a walking robot comes back from there
_LOOK = 64  # steps from one look for it to the next
_OFF = (
    mujoco.mjtDisableBit.mjDSBL_ACTUATION
    # A reset in the middle of the log would hide that the robot went unstable.
    | mujoco.mjtDisableBit.mjDSBL_AUTORESET
)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Loads:
    """What the ground pushes feet up with, by the feet's names, (n_steps, n_sims, n_feet) N."""

    names: tuple[str, ...]
    loads: Array


def run_hardware(
    source: Source,
    targets: Sequence[ArrayLike],
    *,
    rate: float = 500.0,
    hidden: Sequence[HiddenEffect] = (),
    seed: int,
    substeps: int = 4,
    names: Sequence[str] | None = None,
    jitter: float = 0.0,
    reads_first: bool = False,
    base: BaseLog = "pose",
) -> list[Recording]:
    """Runs experiments on a robot with hidden effects and logs them.

    Args:
        source: the robot's MJCF, its spec, or what was compiled of it, which can have no mount.
        targets: one experiment each: where the joints should be, shape (T, n_joints), rad, one row
            for each sample and one column for each of the model's actuators, in their order.
        rate: samples a second; a row's target is sent at the row's time and held to the next.
        hidden: what the robot has and the model has not, one on top of the other.
        seed: of the noise; an experiment's noise does not depend on the others.
        substeps: steps of the simulated robot for each of the model's.
        names: the recordings' names; experiment_0, experiment_1 and so on by default.
        jitter: standard deviation of the rows' time stamps around the times at which they were
            taken, s; at most a tenth of the time between samples.
        reads_first: a row's effort was read before its target arrived, not after.
        base: what is logged of a base that floats: its `pose`, as motion capture has it; the
            readings of its `imu` and of foot sensors; or these with the `truth` beside them.

    Returns:
        A recording of each experiment, T samples from time 0.

    Raises:
        InputError: a model, experiment or effect that cannot be simulated.
        RuntimeError: the robot went unstable.
    """
    model, drives = _build(source, hidden)
    if int(substeps) != substeps or substeps < 1:
        raise InputError(f"substeps is {substeps}; it must be a whole number of at least 1")
    model.opt.timestep /= substeps
    stride = _stride(rate, model.opt.timestep)
    if not 0 <= jitter <= 0.1 / rate:
        raise InputError(
            f"jitter is {jitter} s; give at most {0.1 / rate:g} s, a tenth of the time between "
            "samples"
        )
    commands = [_checked(i, command, drives) for i, command in enumerate(targets)]
    names = [f"experiment_{i}" for i in range(len(commands))] if names is None else names
    if not commands or len(names) != len(commands):
        raise InputError(
            f"{len(commands)} experiments have {len(names)} names; give at least one experiment, "
            "and a name to each"
        )
    longest = max(map(len, commands))
    together = np.stack([np.pad(c, ((0, longest - len(c)), (0, 0)), "edge") for c in commands], 1)
    lead = math.ceil(SETTLE / model.opt.timestep)
    log = Log(
        drives, hidden, step=model.opt.timestep, stride=stride, start=lead, reads_first=reads_first
    )
    held = np.repeat(together, stride, axis=0)
    ends = lead, max(log.values(longest) - lead - len(held), 0)
    sent = np.pad(held, (ends, (0, 0), (0, 0)), "edge")
    seeds = [[seed, i] for i in range(len(commands))]
    *signals, states, swung, told, soil = _run(model, drives, hidden, sent, lead, stride, seeds)
    rows = log.rows(*signals, count=longest)
    poses = log.base_rows(states, count=longest)
    passive = _passive(model, drives)
    swings = log.base_rows(swung, count=longest)
    step = float(model.opt.timestep)
    unit = Imu.drawn(np.random.default_rng([seed, len(seeds)]))
    if poses.size and base != "pose":
        gravity = model.opt.gravity
        turned = log.base_rows(
            felt(states, step=step, stride=stride, gravity=gravity), count=longest
        )
        stood = log.base_rows(contacts(soil.loads, step=step), count=longest)
    recordings = []
    for i, (name, command) in enumerate(zip(names, commands, strict=True)):
        rng = np.random.default_rng(seeds[i])
        read = readings(rows[:, : len(command), i], rng)
        logged = command if told is None else told.rows(len(command))[:, i]
        columns = {
            f"{joint}/{signal}": values[:, j]
            for j, (joint, kind) in enumerate(zip(drives.joints, drives.kinds, strict=True))
            for signal, values in zip((f"{kind}_target", *_LOGGED), (logged, *read), strict=True)
        }
        columns |= _passive_columns(
            model, passive, swings[: len(command), i], np.random.default_rng([*seeds[i], 1])
        )
        if swing_of(hidden):
            columns["voltage"] = log.voltage(len(command), swing_of(hidden), rng)
        if poses.size and base != "imu":
            poses_of = poses[: len(command), i]
            columns |= base_readings(poses_of, rng, exact=base == "truth")
        if poses.size and base != "pose":
            columns |= imu_readings(turned[: len(command), i], unit, rate, rng)
            columns |= {
                f"{name}/contact": np.rint(stood[: len(command), i, k])
                for k, name in enumerate(soil.names)
            }
        time = np.arange(len(command)) / rate
        if jitter:
            time = time + np.clip(jitter * rng.standard_normal(len(time)), -0.4 / rate, 0.4 / rate)
        recordings.append(Recording(name=name, time=time, columns=columns))
    return recordings


def _build(source: Source, hidden: Sequence[HiddenEffect]) -> tuple[mujoco.MjModel, Drives]:
    """The bare rigid bodies and the drives, with what is hidden in either."""
    model, drives = load_rig(_on_its_mount(source, hidden))
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
            case "com_offset":
                bodies = [model.body(i).name for i in range(model.nbody)]
                shift = [effect.spread(axis, bodies) for axis in "xyz"]
                # In the body's frame; the inertia's own axes stay where they point.
                model.body_ipos += np.stack(shift, axis=1)
            case "base_tilt":
                model.opt.gravity = _tilted(effect) @ model.opt.gravity
            case _:
                drives.hide(effect)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model, drives


def _on_its_mount(source: Source, hidden: Sequence[HiddenEffect]) -> Source:
    """The robot on a stand, where one is hidden that gives way."""
    if not any(effect.effect == MOUNT for effect in hidden):
        return source
    if isinstance(source, mujoco.MjModel):
        raise InputError(f"{MOUNT} cannot be put under a compiled model; give its file or its spec")
    return mounted(spec_of(source))


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


def nearest_rate(rate: float, timestep: float) -> float:
    """The rate nearest to `rate` whose samples are whole numbers of simulated steps apart [Hz].

    Args:
        rate: wanted [Hz].
        timestep: of the model [s].
    """
    return 1.0 / (max(round(1.0 / (rate * timestep)), 1) * timestep)


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


def _run(
    model: mujoco.MjModel,
    drives: Drives,
    hidden: Sequence[HiddenEffect],
    sent: Array,
    start: int,
    stride: int,
    seeds: Sequence[Sequence[int]],
) -> tuple[Array, Array, Array, Array, Array, Companion | None, _Loads]:
    """Steps all experiments together.

    Args:
        model: the bare rigid bodies; rotors are taken out of it.
        drives: what moves them.
        hidden: what drives and bodies do not say.
        sent: where the joints should be, shape (n_steps, n_experiments, n_joints), rad.
        start: the step at which the log begins.
        stride: steps from one row of the log to the next.
        seeds: of each experiment.

    Returns:
        Positions and speeds as the encoders read them and reported efforts at each step, shape as
        `sent`; the state of a base that floats, shape (n_steps, n_experiments, 13), else (…, 0);
        positions and speeds of the joints that nothing drives, (n_steps, n_experiments, 2 n); the
        computer beside the robot, where there is one; and what its feet carry.
    """
    step, n_sims = float(model.opt.timestep), sent.shape[1]
    controller = Controller(drives, hidden, step=step, n_sims=n_sims)
    motor = Motor(drives, hidden, step=step, start=start)
    friction = Friction(model, drives, hidden, step=step, n_sims=n_sims)
    stops = Stops(model, drives, hidden)
    troubles = Troubles(drives, hidden, step=step, n_steps=len(sent), seeds=seeds)
    transmission = Transmission(model, drives, hidden, step=step, n_sims=n_sims)
    stand = Stand(model, hidden)
    soil = Soil(model, hidden, step=step, n_sims=n_sims)
    told = None
    if set(drives.kinds) != {"position"}:
        told = Companion(drives, hidden, step=step, start=start, stride=stride, shape=sent.shape)
    free = free_joint(model)
    _follow_damping(model, drives, step)
    # Only a persistent batch goes on from the velocities that the ground asks for.
    batch = mujoco.batch.Batch(model, n_sims, nthread=1, persistent=soil.any)
    stage = mujoco.mjtStage.mjSTAGE_VEL if soil.any else mujoco.mjtStage.mjSTAGE_NONE
    qpos, qvel, applied = batch.bind("qpos"), batch.bind("qvel"), batch.bind("qfrc_applied")
    qpos[:] = home(model)
    ranges = np.where(model.jnt_limited[:, None], model.jnt_range, [-np.inf, np.inf])
    lower, upper = ranges[model.dof_jntid[drives.dofs]].T
    qpos[:, drives.qpos] = np.clip((sent[0] - drives.offset) / drives.slope, lower, upper)
    position, speed, effort = np.empty((3, *sent.shape))
    base = np.empty((*sent.shape[:2], 0 if free is None else WIDTH))
    loads = np.zeros((*sent.shape[:2], len(soil.names)))
    passive = _passive(model, drives)
    at, its_dofs = model.jnt_qposadr[passive], model.jnt_dofadr[passive]
    swung = np.empty((*sent.shape[:2], 2 * len(passive)))
    if soil.any:
        soil.watch(batch)
    for k, target in enumerate(controller.arriving(sent, start=start)):
        q, qd = qpos[:, drives.qpos], qvel[:, drives.dofs]
        angle, rate = transmission.motor_side(q, qd)
        position[k], speed[k] = drives.read(angle, rate)
        swung[k] = np.hstack([qpos[:, at], qvel[:, its_dofs]])
        if free is not None:
            base[k, :, :7] = qpos[:, free[0] : free[0] + 7]
            base[k, :, 7:] = qvel[:, free[1] : free[1] + 6]
        if told is not None:
            target = told.arrived(k, sent[k], position[k], speed[k])
        effort[k] = motor.made(controller.asked(target, position[k], speed[k]), rate)
        shaft = motor.delivered(effort[k], angle)
        if transmission.any:
            # The losses of a drive with a rotor are before its teeth.
            turning = qvel.copy()
            turning[:, drives.dofs] = rate
            applied[:] = friction.effort(turning, angle, shaft)
        else:
            applied[:] = friction.effort(qvel, q, shaft)
        load = transmission.link_effort(shaft + applied[:, drives.dofs], q, qd) + drives.springs(q)
        if stops.any:
            load += stops.effort(q, qd)
        if troubles.any:
            load += troubles.effort(k, q)
        applied[:, drives.dofs] = load
        if stand.any:
            applied[:, stand.dofs] += stand.effort(qpos, qvel)
        if soil.any:
            soil.push(batch)
            loads[k] = soil.carried
        batch.step(stage=stage)
        if k % _LOOK == 0 or k == len(sent) - 1:
            lost = ~(np.abs(qvel).max(axis=1) < _LOST)
            if lost.any():
                raise RuntimeError(
                    f"experiment {int(np.argmax(lost))} went unstable before "
                    f"{k * step - SETTLE:.3f} s after its start; soften the model's gains, hide "
                    "less, or raise substeps"
                )
    return position, speed, effort, base, swung, told, _Loads(names=soil.names, loads=loads)


def _passive(model: mujoco.MjModel, drives: Drives) -> list[int]:
    """Joints that swing by themselves, and have encoders; those of closed loops have none."""
    return [
        joint
        for joint in range(model.njnt)
        if model.jnt_type[joint] in SCALAR_JOINTS
        and model.joint(joint).name
        and model.joint(joint).name not in drives.joints
        and not model.neq
    ]


def _passive_columns(
    model: mujoco.MjModel, passive: Sequence[int], states: Array, rng: np.random.Generator
) -> dict[str, Array]:
    """What a log has of these joints, of their (T, 2 n) positions and speeds."""
    q, qd = np.split(states, 2, axis=1)
    read = readings(np.stack([q, qd, 0 * q]), rng)
    return {
        f"{model.joint(joint).name}/{signal}": values[:, j]
        for j, joint in enumerate(passive)
        for signal, values in zip(_LOGGED[:2], read[:2], strict=True)
    }


def _follow_damping(model: mujoco.MjModel, drives: Drives, step: float) -> None:
    """Lets light joints with much damping be stepped, as MuJoCo's own damping is.

    All efforts here are explicit, f(v): I (v' − v) = h f(v). Where a damping b stops a joint within
    a step or so, that diverges. As of MuJoCo's own damping, it is then (I + h b)(v' − v) = h f(v),
    which is as exact for all that is slower. It takes an armature of h b, of the bodies alone.
    """
    drag = drives.damping[0].copy()
    drag[drives.dofs] += np.maximum(-drives.bias[2], 0.0)
    stiff = drag * step * model.dof_invweight0 > _STIFF
    model.dof_armature[stiff] += step * drag[stiff]
