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
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware_base import base_readings
from walkerkit.gap.rehearsal.hardware_drive import Drives, Source, load_rig, spec_of
from walkerkit.gap.rehearsal.hardware_imu import Imu, contacts, felt, imu_readings
from walkerkit.gap.rehearsal.hardware_log import Log, readings
from walkerkit.gap.rehearsal.hardware_motor import swing_of
from walkerkit.gap.rehearsal.hardware_mount import EFFECT as MOUNT
from walkerkit.gap.rehearsal.hardware_mount import mounted
from walkerkit.gap.rehearsal.hardware_run import SETTLE, Ran, passive, run
from walkerkit.gap.rehearsal.hidden import HiddenEffect

Array = NDArray[np.float64]
BaseLog = Literal["pose", "imu", "truth"]

_LOGGED = ("position", "velocity", "effort")
_OFF = (
    mujoco.mjtDisableBit.mjDSBL_ACTUATION
    # A reset in the middle of the log would hide that the robot went unstable.
    | mujoco.mjtDisableBit.mjDSBL_AUTORESET
)


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
    _check_substeps(substeps)
    model.opt.timestep /= substeps
    stride = _stride(rate, model.opt.timestep)
    _check_jitter(jitter, rate)
    commands = [_checked(i, command, drives) for i, command in enumerate(targets)]
    names = _names(names, len(commands))
    lead = math.ceil(SETTLE / model.opt.timestep)
    log = Log(
        drives, hidden, step=model.opt.timestep, stride=stride, start=lead, reads_first=reads_first
    )
    seeds = [[seed, i] for i in range(len(commands))]
    sent = _sent(commands, log, lead, stride)
    ran = run(model, drives, hidden, sent, start=lead, stride=stride, seeds=seeds)
    writer = _Writer(
        model, drives, hidden, log, ran, commands, rate=rate, stride=stride, base=base, seed=seed
    )
    return [writer.recording(i, name, jitter) for i, name in enumerate(names)]


class _Writer:
    """Writes the log of a run, with the noise of each experiment's sensors."""

    def __init__(
        self,
        model: mujoco.MjModel,
        drives: Drives,
        hidden: Sequence[HiddenEffect],
        log: Log,
        ran: Ran,
        commands: Sequence[Array],
        *,
        rate: float,
        stride: int,
        base: BaseLog,
        seed: int,
    ) -> None:
        self._model, self._drives, self._log, self._ran = model, drives, log, ran
        self._commands, self._rate, self._base, self._seed = commands, rate, base, seed
        self._unit = Imu.drawn(np.random.default_rng([seed, len(commands)]))
        count = max(map(len, commands))
        self._swing, self._passive = swing_of(hidden), passive(model, drives)
        self._rows = log.rows(ran.position, ran.speed, ran.effort, count=count)
        self._poses = log.base_rows(ran.base, count=count)
        self._swings = log.base_rows(ran.swung, count=count)
        self._is_sensed = bool(self._poses.size) and base != "pose"
        if self._is_sensed:
            step = float(model.opt.timestep)
            turned = felt(ran.base, step=step, stride=stride, gravity=model.opt.gravity)
            self._turned = log.base_rows(turned, count=count)
            self._stood = log.base_rows(contacts(ran.loads, step=step), count=count)

    def recording(self, i: int, name: str, jitter: float) -> Recording:
        """The log of experiment i."""
        command, rng = self._commands[i], np.random.default_rng([self._seed, i])
        count, other = len(command), np.random.default_rng([self._seed, i, 1])
        columns = self._of_joints(i, command, rng)
        swings = self._swings[:count, i]
        columns |= _passive_columns(self._model, self._passive, swings, other)
        if self._swing:
            columns["voltage"] = self._log.voltage(count, self._swing, rng)
        columns |= self._of_base(i, count, rng)
        time = np.arange(count) / self._rate
        if jitter:
            most = 0.4 / self._rate
            time = time + np.clip(jitter * rng.standard_normal(count), -most, most)
        return Recording(name=name, time=time, columns=columns)

    def _of_joints(self, i: int, command: Array, rng: np.random.Generator) -> dict[str, Array]:
        """The columns of the joints that are driven."""
        drives, told, count = self._drives, self._ran.told, len(command)
        read = readings(self._rows[:, :count, i], rng)
        logged = command if told is None else told.rows(count)[:, i]
        return {
            f"{joint}/{signal}": values[:, j]
            for j, (joint, kind) in enumerate(zip(drives.joints, drives.kinds, strict=True))
            for signal, values in zip((f"{kind}_target", *_LOGGED), (logged, *read), strict=True)
        }

    def _of_base(self, i: int, count: int, rng: np.random.Generator) -> dict[str, Array]:
        """The columns of a base that floats, if it does."""
        columns: dict[str, Array] = {}
        if self._poses.size and self._base != "imu":
            exact = self._base == "truth"
            columns |= base_readings(self._poses[:count, i], rng, exact=exact)
        if self._is_sensed:
            columns |= imu_readings(self._turned[:count, i], self._unit, self._rate, rng)
            columns |= {
                f"{name}/contact": np.rint(self._stood[:count, i, k])
                for k, name in enumerate(self._ran.feet)
            }
        return columns


def _check_substeps(substeps: int) -> None:
    """Raises InputError where the simulated robot's steps are no part of the model's."""
    if int(substeps) != substeps or substeps < 1:
        raise InputError(f"substeps is {substeps}; it must be a whole number of at least 1")


def _check_jitter(jitter: float, rate: float) -> None:
    """Raises InputError where time stamps would jitter too far."""
    if not 0 <= jitter <= 0.1 / rate:
        raise InputError(
            f"jitter is {jitter} s; give at most {0.1 / rate:g} s, a tenth of the time between "
            "samples"
        )


def _names(names: Sequence[str] | None, n: int) -> Sequence[str]:
    """The names of n experiments, as given or numbered."""
    names = [f"experiment_{i}" for i in range(n)] if names is None else names
    if not n or len(names) != n:
        raise InputError(
            f"{n} experiments have {len(names)} names; give at least one experiment, "
            "and a name to each"
        )
    return names


def _sent(commands: Sequence[Array], log: Log, lead: int, stride: int) -> Array:
    """Targets at each simulated step, held before and after the log as they begin and end."""
    longest = max(map(len, commands))
    together = np.stack([np.pad(c, ((0, longest - len(c)), (0, 0)), "edge") for c in commands], 1)
    held = np.repeat(together, stride, axis=0)
    ends = lead, max(log.values(longest) - lead - len(held), 0)
    return np.pad(held, (ends, (0, 0), (0, 0)), "edge")


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
