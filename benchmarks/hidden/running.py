"""One case from its number to its outcome."""

from __future__ import annotations

import functools
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from benchmarks.hidden.cases import SIGNALS, Case
from benchmarks.hidden.clutter import clutter
from benchmarks.hidden.outcome import Hidden, Outcome
from benchmarks.hidden.rigs import experiments, rate_of, reads_first, write_rig
from benchmarks.hidden.saying import Truth, alike, places, said
from benchmarks.hidden.truths import truth
from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.effects.equivalences import spelled_out, wholes
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.rehearse import draw_loud
from walkerkit.gap.report.diagnosis import Estimate
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Robot

JITTER: Final = 5e-5
"""Of the logs' time stamps, s."""

_TARGETS = 3  # different sets of experiments for each rig
_COARSE: Final = {"pendulum": 5.0, "leg": 8.0}  # factors on the timestep where that is hidden
_NUDGED: Final = 2.0  # where it is merely another one


def run_case(case: Case, *, effects: Sequence[str] | None = None, shorter: float = 1.0) -> Outcome:
    """Records a case's robot, diagnoses the logs, and sets the truth beside what was said.

    Args:
        case: the case.
        effects: what the workflow knows of; the whole catalogue by default.
        shorter: by which the time of the experiments is divided.

    Returns:
        The outcome; one with the verdict `failed` where the workflow raises an error, and
        `impossible` where what is to be hidden does not show on this rig and these channels.
    """
    with tempfile.TemporaryDirectory() as folder:
        return _run(case, Path(folder), effects or list(CATALOGUE), shorter * case.shorter)


def _run(case: Case, folder: Path, known: Sequence[str], shorter: float) -> Outcome:
    rng = np.random.default_rng(case.seed)
    model = _given(case, folder)
    try:
        recordings, hidden = _recorded(case, folder, rng, shorter)
    except gap.InputError as error:
        return without_answer(case, "impossible", str(error))
    seen = [_with(recording, SIGNALS[case.channels]) for recording in recordings]
    robot = load_robot(model)
    truths = tuple(_hidden(one, robot, case) for one in hidden)
    if "timestep" in case.hide:
        text = f"timestep of {robot.model.opt.timestep:g} s"
        everywhere = places((), (), robot)
        truths = (Hidden(effect="timestep", places=everywhere, alike=(), text=text),)
    if case.removed:
        # With what leaves the same log, alone, together with another, or with one of its sizes
        # at zero: a directional efficiency of the same factor both ways is a torque constant.
        same = {name for one in truths for name in (one.effect, *one.alike)}
        pairs = {name for one in truths for name in chain.from_iterable(spelled_out(one.effect))}
        gone = {*same, *pairs, *chain.from_iterable(map(wholes, same))}
        known = [name for name in known if name not in gone]
    start = time.perf_counter()
    try:
        found = gap.diagnose(model, seen, effects=known, n_threads=1).diagnosis
        oracle = None
        told = case.off != "clutter"  # there the structure is more than what is hidden
        if told and hidden and all(one.effect in known for one in hidden):
            oracle = _oracle(model, seen, hidden, case.beside)
    except (ValueError, RuntimeError, ArithmeticError, LookupError) as error:
        # One failure must not lose the other cases; it counts as a wrong answer.
        seconds = time.perf_counter() - start
        why = f"{type(error).__name__}: {error}"
        return replace(without_answer(case, "failed", why), hidden=truths, seconds=seconds)
    return Outcome(
        case=case.name,
        tier=case.tier,
        off=case.off,
        beside=case.beside,
        verdict=found.verdict,
        hidden=truths,
        named=tuple(
            said(one, found.effects, robot, SIGNALS[case.channels], _truth(one.effect, hidden))
            for one in found.effects
        ),
        before=found.gap.position.before,
        after=found.gap.position.after,
        oracle=oracle,
        seconds=found.seconds,
    )


def without_answer(case: Case, verdict: str, why: str) -> Outcome:
    """The outcome of a case that came to nothing, and why."""
    return Outcome(
        case=case.name,
        tier=case.tier,
        off=case.off,
        beside=case.beside,
        verdict=verdict,
        hidden=(),
        named=(),
        error=why,
    )


def _given(case: Case, folder: Path) -> Path:
    """The model that the workflow gets."""
    coarser = 1.0
    if "timestep" in case.hide:
        coarser = _COARSE[case.rig]
    elif case.off == "timestep":
        coarser = _NUDGED
    euler = mujoco.mjtIntegrator.mjINT_EULER if case.off == "integrator" else None
    return write_rig(case.rig, folder, coarser=coarser, integrator=euler, robot=case.robot)


def _recorded(
    case: Case, folder: Path, rng: np.random.Generator, shorter: float
) -> tuple[Sequence[Recording], tuple[HiddenEffect, ...]]:
    """The logs and what is hidden in them."""
    rate = rate_of(case.rig, case.robot)
    nuisance = rng if case.off == "nuisance" else None
    real = write_rig(case.rig, folder, file="real.xml", nuisance=nuisance, robot=case.robot)
    # What is hidden is drawn for the robot as it should be, and shows on that.
    meant, beside = real, tuple[HiddenEffect, ...]()
    if case.off == "clutter":
        real, beside = clutter(meant, folder, rng, rate=rate, file="cluttered.xml")
    substeps = 8 if case.off == "substeps" else 4
    seed = case.seed % _TARGETS
    targets = experiments(case.rig, meant, seed=seed, shorter=shorter, rate=rate)
    sent = list(targets.values())
    noise = case.seed

    def run(hidden: Sequence[HiddenEffect]) -> list[Recording]:
        return run_hardware(
            real,
            sent,
            rate=rate,
            hidden=(*beside, *hidden),
            seed=noise,
            substeps=substeps,
            names=list(targets),
            jitter=JITTER,
            base=case.base,
            reads_first=reads_first(case.rig, case.robot),
        )

    names = [name for name in case.hide if name != "timestep"]
    if not names:
        return run(()), ()
    nominal = _nominal(case.rig, case.robot, seed, shorter)
    hidden = []
    for name in names:
        where = None if case.body is None else [case.body]
        if case.single:
            every = nominal[0].joints
            where = [every[int(rng.integers(len(every)))]]
        signals = [s for s in SIGNALS[case.channels] if s in ("position", "effort")]
        one, _ = draw_loud(
            meant,
            sent,
            rng,
            [name],
            nominal=nominal,
            seed=seed,
            places=where,
            signals=signals,
            rate=rate,
        )
        hidden.append(one)
    return run(hidden), tuple(hidden)


@functools.cache
def _nominal(rig: str, robot: int | None, seed: int, shorter: float) -> tuple[Recording, ...]:
    """Logs of a rig with nothing hidden."""
    rate = rate_of(rig, robot)
    with tempfile.TemporaryDirectory() as folder:
        path = write_rig(rig, Path(folder), robot=robot)
        targets = experiments(rig, path, seed=seed, shorter=shorter, rate=rate)
        return tuple(
            run_hardware(path, list(targets.values()), rate=rate, seed=seed, names=list(targets))
        )


def _with(recording: Recording, signals: Sequence[str]) -> Recording:
    """The recording with some signals only."""
    return Recording(
        name=recording.name,
        time=recording.time,
        columns={
            column: values
            for column, values in recording.columns.items()
            if column.rpartition("/")[2] in (*signals, "voltage", "contact")
            or column.startswith("base/")
        },
    )


def _oracle(
    model: Path,
    recordings: Sequence[Recording],
    hidden: Sequence[HiddenEffect],
    beside: Sequence[str],
) -> float | None:
    """The held-out gap of a fit that is told the structure; None where it cannot be fitted."""
    structure: dict[str, Any] = dict.fromkeys(beside, EVERYWHERE)
    structure |= {one.effect: one.places or EVERYWHERE for one in hidden}
    structure = {
        name: EVERYWHERE if tuple(where) == (EVERYWHERE,) else where
        for name, where in structure.items()
    }
    problem = gap.load(model, recordings, n_threads=1)
    return gap.fit(problem, structure).gap.position.after


def _hidden(one: HiddenEffect, robot: Robot, case: Case) -> Hidden:
    joints = one.joints if one.kind.on == "joints" else ()
    return Hidden(
        effect=one.effect,
        places=places(joints, one.bodies, robot),
        alike=alike(one.effect, joints, one.bodies, robot, SIGNALS[case.channels]),
        text=one.describe(),
    )


def _truth(effect: str, hidden: Sequence[HiddenEffect]) -> Truth:
    """What the numbers of a named effect should be."""

    def true(of: Estimate) -> float | None:
        same = (one for one in hidden if one.effect == effect)
        return next((truth(one, of.place).get(of.name) for one in same), None)

    return true
