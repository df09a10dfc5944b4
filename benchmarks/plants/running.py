"""One case from its name to its outcome."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.hidden.outcome import Hidden, Named, Outcome
from benchmarks.hidden.saying import alike, places, said
from benchmarks.plants.best import Best, best_model, commit
from benchmarks.plants.cases import AS_GIVEN, CONTROL, PlantedCase
from benchmarks.plants.kinds import KINDS, SIGN_FLIP, Planted, Setting
from benchmarks.plants.outcome import Compared, PlantedOutcome, shows
from benchmarks.rivals.logs import LOGS, write_experiments
from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.experiments.experiment import Experiment
from walkerkit.gap.report.diagnosis import Diagnosis, Estimate
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.mend import mend, write_model
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import FILE, sidecar, with_sidecar
from walkerkit.gap.simulation.trials import Trials


@dataclass(frozen=True, kw_only=True)
class Job:
    """A case, and where the best models are."""

    case: PlantedCase
    best: Path


def run_case(job: Job, *, effects: Sequence[str] | None = None) -> PlantedOutcome:
    """Plants an error, diagnoses, and sets the truth beside what was said.

    Args:
        job: the case.
        effects: what the workflow knows of; the whole catalogue by default.

    Returns:
        The outcome; one with the verdict `failed` where the workflow raises an error.
    """
    commit()  # before anything is run, while files change
    case, best = job.case, best_model(job.case.log, job.best)
    rng = np.random.default_rng(case.seed)
    experiments = best.experiments
    if case.alone:
        experiments = (experiments[int(rng.integers(len(experiments)))],)
    setting = Setting(
        robots=tuple(_robot(Path(experiment.model)) for experiment in experiments),
        recordings=tuple(r for experiment in experiments for r in experiment.recordings),
    )
    error = None
    if case.kind == AS_GIVEN:
        log = next(log for log in LOGS if log.name == case.log)
        experiments = log.experiments()
    elif case.kind != CONTROL:
        error = KINDS[case.kind](rng, setting)
        if error is None:
            return _of(case, best, _unasked(case, "impossible"), {}, {})
    table: tuple[Compared, ...] = ()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        path = write_experiments(folder, experiments)
        before = gaps(path) if case.alone or not error else dict(best.gaps)
        with_it = before
        if error is not None:
            (folder / "planted").mkdir()
            path = _with(error, setting, experiments, folder / "planted")
            with_it = {} if error.effect == SIGN_FLIP else gaps(path)
            if not shows(before, with_it):
                return _of(case, best, _unasked(case, "silent"), before, with_it)
        outcome, table = _asked(case, path, setting, error, effects)
    return _of(case, best, outcome, before, with_it, table)


def gaps(path: Path) -> dict[str, float]:
    """Signal to the held-out gap of the models of a manifest."""
    found = gap.compare(path, n_threads=1, allow_outside=True)
    return {signal: size.before for signal, size in found.gap.signals.items()}


def _asked(
    case: PlantedCase,
    path: Path,
    setting: Setting,
    error: Planted | None,
    effects: Sequence[str] | None,
) -> tuple[Outcome, tuple[Compared, ...]]:
    """What the workflow says of a manifest, and what it compared."""
    hidden = () if error is None else (_hidden(error, setting),)
    start = time.perf_counter()
    try:
        result = gap.diagnose(path, effects=effects, n_threads=1, allow_outside=True)
    except (ValueError, RuntimeError, ArithmeticError, LookupError) as raised:
        # One failure must not lose the other cases; it counts as a wrong answer.
        why = f"{type(raised).__name__}: {raised}"
        seconds = time.perf_counter() - start
        return replace(_unasked(case, "failed", why), hidden=hidden, seconds=seconds), ()
    found = result.diagnosis
    outcome = Outcome(
        case=case.name,
        tier=case.log,
        off="",
        verdict=found.verdict,
        hidden=hidden,
        named=(*_wired(found), *_named(found, setting, error)),
        before=found.gap.position.before,
        after=found.gap.position.after,
        seconds=found.seconds,
    )
    table = result.comparison[["structure", "elpd", "log_prior"]]
    return outcome, tuple((what, elpd, prior) for what, elpd, prior in table.to_numpy().tolist())


def _wired(found: Diagnosis) -> tuple[Named, ...]:
    """Errors of wiring as names, which are stated without a doubt."""
    return tuple(
        Named(
            effect=error.kind,
            places=tuple(sorted(error.joints)),
            confidence=1.0,
            doubt=(),
            alike=(),
        )
        for error in found.wiring
    )


def _named(found: Diagnosis, setting: Setting, error: Planted | None) -> tuple[Named, ...]:
    def true(effect: str, of: Estimate) -> float | None:
        if error is None or effect != error.effect:
            return None
        if EVERYWHERE not in (error.place, of.place) and of.place != error.place:
            return None
        # What was not planted of an effect, such as the other angle of a tilt, is not there.
        return error.truth.get(of.name, 0.0)

    return tuple(
        said(
            one,
            found.effects,
            setting.robot,
            setting.signals,
            lambda of, effect=one.effect: true(effect, of),
        )
        for one in found.effects
    )


def _hidden(error: Planted, setting: Setting) -> Hidden:
    on_body = error.effect in CATALOGUE and CATALOGUE[error.effect].kind == "body"
    joints = () if on_body or error.place == EVERYWHERE else (error.place,)
    bodies = (error.place,) if on_body else ()
    shown = joints or ((EVERYWHERE,) if not on_body else ())
    return Hidden(
        effect=error.effect,
        places=places(joints, bodies, setting.robot),
        alike=alike(error.effect, shown, bodies, setting.robot, setting.signals),
        text=error.text,
    )


def _with(
    error: Planted, setting: Setting, experiments: Sequence[Experiment], folder: Path
) -> Path:
    """Writes the models and logs with an error; returns the manifest."""
    robots: dict[str, Robot] = {}
    for robot, experiment in zip(setting.robots, experiments, strict=True):
        trials = Trials(robot, 1)
        error.robot(trials)
        file = Path(experiment.model).name
        robots[file] = mend(trials)
        write_model(robots[file], folder / file)
    (folder / FILE).write_text(json.dumps(sidecar(robots, [])), encoding="utf-8")
    planted = [
        replace(
            one,
            model=str(folder / Path(one.model).name),
            recordings=tuple(error.recording(recording) for recording in one.recordings),
        )
        for one in experiments
    ]
    return write_experiments(folder, planted)


def _robot(path: Path) -> Robot:
    return with_sidecar(load_robot(path), path)


def _unasked(case: PlantedCase, verdict: str, why: str = "") -> Outcome:
    return Outcome(
        case=case.name, tier=case.log, off="", verdict=verdict, hidden=(), named=(), error=why
    )


def _of(
    case: PlantedCase,
    best: Best,
    outcome: Outcome,
    before: dict[str, float],
    with_it: dict[str, float],
    table: tuple[Compared, ...] = (),
) -> PlantedOutcome:
    return PlantedOutcome(
        case=case.name,
        log=case.log,
        kind=case.kind,
        half=case.half,
        best=before,
        planted=with_it,
        commit=commit(),
        best_commit=best.commit,
        outcome=outcome,
        table=table,
    )
