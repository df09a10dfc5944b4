"""Rehearsals: experiments on simulated hardware with something hidden in it.

The hardware (`walkerkit.gap.rehearsal.hardware`) shares no law with the workflow: its own servo,
friction with bristles, four times finer steps, quantised encoders, noise.

    rehearsal = rehearse("leg.xml", ["coulomb_friction"], seed=7)
    rehearsal.recordings, rehearsal.hidden

The experiments are positions to go to: servos are sent them; beside motors a computer closes the
loop, and the efforts that it sends are logged.

Limits: every actuator is a plain servo or motor of a joint. What stands under a robot can be hidden
only where that floats, and has spheres for feet and a level plane. A timestep is no robot's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import BaseLog, nearest_rate, run_hardware
from walkerkit.gap.rehearsal.hardware_drive import Drives, Source
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.hidden_draw import draw_hidden, loudness
from walkerkit.gap.rehearsal.hideable import GROUND, HIDEABLE, NOT_THE_ROBOTS
from walkerkit.gap.search.buildable import why_not
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Measurement, Robot
from walkerkit.gap.simulation.sidecar import FILE, with_sidecar
from walkerkit.gap.workflow import compare
from walkerkit.tasks.excitation import BATTERY
from walkerkit.walkers.batch import without_warnings

FloatArray = NDArray[np.float64]

EXPERIMENTS = ("chirp", "slow_triangle", "steps")  # the last one is held out
SECONDS, RATE = 10.0, 500.0
LONGEST = 3600.0  # s
_ROOM = 0.35  # part of a joint's range that the targets use, around its home
_STANDING_ROOM = 0.1  # the same of a robot that would fall
_DEFAULT_ROOM = 0.5  # rad, where a joint has no range
_SPEED = 6.0  # rad/s
LOUD = 5.0  # standard deviations of the noise, by which a log has to show what is hidden
_DRAWS, _GROWTHS, _GROWTH = 8, 4, 1.5
_SUBSTEPS = (4, 16, 64)  # of the simulated robot in one of the model's, until it is stable


@dataclass(frozen=True, kw_only=True)
class Rehearsal:
    """Recordings of simulated hardware.

    Attributes:
        recordings: one per experiment.
        hidden: what was hidden; empty for nothing.
    """

    recordings: tuple[Recording, ...]
    hidden: tuple[HiddenEffect, ...]


def rehearse(
    model: str | Path,
    hide: Sequence[str] | None = None,
    *,
    seed: int = 0,
    seconds: float = SECONDS,
    allow_outside: bool = False,
    imu: bool = False,
) -> Rehearsal:
    """Draws what to hide, and records the experiments.

    Args:
        model: robot with plain servos or motors: an MJCF file, or `package.module:callable`. A
            walker of a callable hangs in the air unless the ground is to be hidden.
        hide: names of effects, each drawn with its joints and size; `["none"]` for nothing; by
            default one drawn from all but those of the ground.
        seed: of the draw, the experiments and the noise.
        seconds: length of each experiment.
        allow_outside: the model's meshes and included files may lie outside of its folder.
        imu: of a robot that floats, the recordings have what an inertial unit (with bias and noise)
            and foot sensors read, in place of its pose.

    Returns:
        The recordings and what is hidden in them.

    Raises:
        InputError: an effect that cannot be hidden, or a model that cannot be simulated.
    """
    names = [] if hide is None else [name for name in hide if name != "none"]
    _check_hideable(names)
    _check_seconds(seconds)
    rng = np.random.default_rng(seed)
    floating = imu or any(name in GROUND for name in names)
    robot = load_robot(model, floating=floating, allow_outside=allow_outside)
    drives = _checked_drives(robot, model, names, imu=imu)
    rate = nearest_rate(RATE, robot.model.opt.timestep)
    sent = _targets(robot, np.arange(0.0, seconds, 1 / rate), rng)
    # Efforts are what was sent, and replays of them restart every half second.
    by_effort = "effort" in drives.kinds
    shows = partial(_in_the_gap, model, allow_outside) if by_effort else None
    with without_warnings():  # what diverges is said below, or tried otherwise
        nominal, substeps = _stable(robot, sent, seed, rate)
        hidden, recordings = [], nominal
        for choice in [None] if hide is None else [[name] for name in names]:
            effect, recordings = draw_loud(
                robot.spec,
                sent,
                rng,
                choice,
                nominal=nominal,
                seed=seed,
                substeps=substeps,
                rate=rate,
                shows=shows,
            )
            hidden.append(effect)
        if len(hidden) > 1 or imu:
            run = partial(run_hardware, robot.spec, sent, seed=seed, rate=rate, substeps=substeps)
            recordings = _with_all(run, hidden, model, names, base="imu" if imu else "pose")
    return Rehearsal(recordings=tuple(recordings), hidden=tuple(hidden))


def _check_seconds(seconds: float) -> None:
    """Raises InputError where experiments would be too short or too long."""
    if not 1 <= seconds <= LONGEST:
        raise InputError(
            f"seconds is {seconds:g}; an experiment takes at least 1 s and at most {LONGEST:g} s."
        )


def _in_the_gap(model: str | Path, allow_outside: bool, found: Sequence[Recording]) -> bool:
    """Whether the gap of some recordings stands out from the noise of a joint."""
    joints = compare(model, found, allow_outside=allow_outside).gap.joints.values()
    return any(size.before > LOUD * size.noise_floor for size in joints)


def _with_all(
    run: Callable[..., list[Recording]],
    hidden: Sequence[HiddenEffect],
    model: str | Path,
    names: Sequence[str],
    *,
    base: BaseLog,
) -> list[Recording]:
    """The experiments with all that is hidden together."""
    try:
        return run(hidden=hidden, names=EXPERIMENTS, base=base)
    except RuntimeError:
        raise InputError(
            f"{model}: with {' and '.join(names)} together the robot goes unstable. Hide "
            "fewer of them, or draw others with another --seed."
        ) from None


def _checked_drives(robot: Robot, model: str | Path, names: Sequence[str], *, imu: bool) -> Drives:
    """The drives of a robot that can be rehearsed with.

    Raises:
        InputError: its hardware would lack something, or one of these effects or the inertial unit
            cannot be had.
    """
    _check_as_given(robot)
    for name in names:
        problem = why_not(CATALOGUE[name], [robot], list(robot.joints))
        if problem is not None:
            raise InputError(f"{model}: {name} can be hidden but not found in it: {problem}.")
    if (
        robot.programs
        or robot.laws
        or any(d.late for j in robot.joints.values() for d in j.commanded)
    ):
        raise InputError(
            f"{model}: the walker has laws or delays that run in Python, which rehearsed hardware "
            "would lack. Give one with MuJoCo's actuators alone, or record the walker itself with "
            "gap.record."
        )
    if imu and robot.base is None:
        raise InputError(
            f"{model}: it has no free joint, so that no inertial unit moves. Give a robot that "
            "floats, or leave imu out."
        )
    try:
        return Drives(robot.model)
    except InputError as error:
        raise InputError(f"{model}: {error}") from None


def _targets(robot: Robot, time: FloatArray, rng: np.random.Generator) -> list[FloatArray]:
    """The targets of each experiment, (T, n_joints)."""
    lower, upper = _room(robot)
    return [
        BATTERY[name](time, lower=lower, upper=upper, rng=rng, max_velocity=_SPEED)
        for name in EXPERIMENTS
    ]


def _stable(
    robot: Robot, sent: Sequence[FloatArray], seed: int, rate: float
) -> tuple[list[Recording], int]:
    """The experiments with nothing hidden, in steps that are short enough; and how many they are.

    Raises:
        InputError: the robot goes unstable whatever the step.
    """
    for substeps in _SUBSTEPS:
        try:
            found = run_hardware(
                robot.model, sent, rate=rate, seed=seed, names=EXPERIMENTS, substeps=substeps
            )
        except RuntimeError:
            continue
        return found, substeps
    step = robot.model.opt.timestep
    raise InputError(
        f"{robot.source}: with nothing hidden the rehearsed robot goes unstable at its timestep of "
        f"{step:g} s and at {step / _SUBSTEPS[-1]:.2g} s: its gains are too stiff for its inertia, "
        "or it runs into something. Lower kp, or give the joints the armature of their motors."
    )


def _check_as_given(robot: Robot) -> None:
    """Raises InputError where a file beside the model mends what the hardware would not have."""
    if robot.path is None:
        return
    mended = with_sidecar(robot, robot.path)
    if mended.laws or any(one != Measurement() for one in mended.measurement.values()):
        raise InputError(
            f"{robot.path}: {FILE} beside it adds laws or a measurement to this model, which "
            "rehearsed hardware would lack. Rehearse with the model as it was before it was "
            f"mended, or move {FILE} away."
        )


def _check_hideable(names: Sequence[str]) -> None:
    """Raises InputError where a rehearsal cannot hide one of these effects, and says why."""
    known = (*HIDEABLE, *GROUND)
    for name in names:
        if name in NOT_THE_ROBOTS:
            raise InputError(f"effect {name!r} cannot be hidden: {NOT_THE_ROBOTS[name]}.")
        if name not in known:
            raise InputError(
                f"effect {name!r} cannot be hidden{closest(name, known)}; choose from none, "
                f"{', '.join(known)}."
            )


def draw_loud(
    model: Source,
    targets: Sequence[FloatArray],
    rng: np.random.Generator,
    effects: Sequence[str] | None = None,
    *,
    nominal: Sequence[Recording],
    seed: int,
    places: Sequence[str] | None = None,
    signals: Sequence[str] = ("position", "effort"),
    substeps: int = 4,
    rate: float = RATE,
    shows: Callable[[Sequence[Recording]], bool] | None = None,
) -> tuple[HiddenEffect, list[Recording]]:
    """Draws an effect that shows in the last experiment, so that finding it can be asked for.

    What does not show well above the noise, at each of its joints, is made stronger, what makes the
    robot unstable weaker, and what stays too weak or too strong is drawn again.

    Args:
        model: MJCF file of a robot with plain servos or motors, its spec, or what was compiled.
        targets: the experiments, as for `run_hardware`.
        rng: source of the draw.
        effects: names to choose from, as for `draw_hidden`.
        nominal: the experiments with nothing hidden, with their names.
        seed: of the noise, that of `nominal`.
        places: the joints or the body that have it, as for `draw_hidden`; drawn by default.
        signals: where it has to show, in one of them.
        substeps: as for `run_hardware`.
        rate: samples a second.
        shows: says besides whether it shows in the experiments.

    Returns:
        The effect and the experiments with it.

    Raises:
        InputError: none of the effects can be made to show.
    """
    names, unstable = [recording.name for recording in nominal], 0
    run = partial(
        run_hardware, model, targets, rate=rate, seed=seed, names=names, substeps=substeps
    )
    for _ in range(_DRAWS):
        hidden = draw_hidden(model, rng, effects, nominal=nominal, places=places)
        for _ in range(_GROWTHS):
            try:
                found = run(hidden=[hidden])
            except RuntimeError:
                unstable += 1
                hidden = hidden.stronger(1 / _GROWTH**2)
                continue
            louder = _louder(hidden, loudness(nominal[-1:], found[-1:], signals))
            if louder is None and (shows is None or shows(found)):
                return hidden, found
            hidden = hidden.stronger(_GROWTH) if louder is None else louder
    why = "none shows in the last experiment; let it move more, or"
    if unstable == _DRAWS * _GROWTHS:
        why = "the robot goes unstable with it;"
    raise InputError(f"{', '.join(effects or HIDEABLE)}: {why} hide something else.")


def _louder(hidden: HiddenEffect, loud: Mapping[str, float]) -> HiddenEffect | None:
    """An effect made stronger where it is quiet; None where it shows as it is."""
    own = [joint for joint in hidden.joints if joint != "*"]
    quiet = [joint for joint in own or loud if loud[joint] < LOUD]
    # An effect of all or of a body may show at some joints only.
    if not quiet or (not own and len(quiet) < len(loud)):
        return None
    return hidden.stronger(_GROWTH, quiet if own else None)


def _room(robot: Robot) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest targets of the joints that have actuators, in the actuators' order."""
    model = robot.model
    home = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, home, 0)
    part = _ROOM if robot.base is None else _STANDING_ROOM
    lower, upper = [], []
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        middle = float(home.qpos[model.jnt_qposadr[joint]])
        low, high = middle - _DEFAULT_ROOM, middle + _DEFAULT_ROOM
        if model.jnt_limited[joint]:
            first, last = map(float, model.jnt_range[joint])
            width = part * (last - first)
            middle = min(max(middle, first), last)  # a home of zeros may lie outside
            low, high = max(first, middle - width / 2), min(last, middle + width / 2)
        lower.append(low)
        upper.append(high)
    return np.array(lower), np.array(upper)
