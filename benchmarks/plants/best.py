"""The best model of a real log that is known beforehand, on which errors are planted.

    best = best_model("go2_leg", folder)       # fitted once, then read from the folder
    best.experiments                           # models and recordings, with their split

It is what the diagnosis makes of a model again and again, until it names nothing more: a model that
lacks something has more than what is planted to be named. It begins with what `gap.fit` makes of
the plain structure (`rivals.plain`), with what the log is known to show beside that, and with the
model as given; the better of the two is kept. What of it is on disk stays as it is, whichever code
comes later: delete the log's folder to have it made anew.
"""

from __future__ import annotations

import functools
import json
import math
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.rivals.logs import LOGS, write_experiments
from benchmarks.rivals.plain import MORE, plain
from walkerkit import gap
from walkerkit.gap.experiments.experiment import Experiment
from walkerkit.gap.simulation.mend import write_model
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import FILE, sidecar

_TOLD, _ROUNDS = "best.json", 3
_REPOSITORY = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, kw_only=True)
class Best:
    """The best model of a log.

    Attributes:
        log: the log's name.
        experiments: the log's, with the best model of each in place of the model as given.
        gaps: signal to what the best models leave on what is held out, as `gap.compare` has it.
        commit: of the code that fitted it.
    """

    log: str
    experiments: tuple[Experiment, ...]
    gaps: dict[str, float]
    commit: str


def best_model(name: str, folder: Path, *, rounds: int = _ROUNDS) -> Best:
    """The best model of a log.

    Args:
        name: of the log, one of `rivals.logs.LOGS`.
        folder: where best models are kept, each in a folder of its log.
        rounds: of diagnoses that it goes through, at most.

    Raises:
        FileNotFoundError: the log is not there.
    """
    log = next(log for log in LOGS if log.name == name)
    experiments, own = log.experiments(), folder / name
    if not (own / _TOLD).exists():
        start = time.perf_counter()
        own.mkdir(parents=True, exist_ok=True)
        problem = log.load()
        fitted = gap.fit(problem, plain(problem, *MORE.get(name, ())))
        plainly = _Found(
            robots=tuple(replace(robot, hold=problem.hold) for robot in fitted.robots),
            gaps={signal: size.after for signal, size in fitted.gap.signals.items()},
        )
        as_given = _Found(robots=problem.robots, gaps={"position": math.inf})
        each = [_diagnosed(experiments, one, rounds) for one in (plainly, as_given)]
        best = min(each, key=lambda one: one.gaps["position"])
        _written(experiments, best.robots, own)
        told = {
            "commit": commit(),
            "seconds": time.perf_counter() - start,
            "gaps": best.gaps,
            "plain_fit": [
                f"{one.effect} {of.place} {of.name} {of.value:.4g} ± {of.std or float('nan'):.2g}"
                for one in fitted.effects
                for of in one.parameters
            ],
            "begun": "plain fit" if best is each[0] else "as given",
            "named": best.named,
        }
        (own / _TOLD).write_text(json.dumps(told, indent=1, ensure_ascii=False), encoding="utf-8")
    told = json.loads((own / _TOLD).read_text(encoding="utf-8"))
    return Best(
        log=name,
        experiments=_of_files(experiments, own),
        gaps=told["gaps"],
        commit=told["commit"],
    )


@dataclass(frozen=True, kw_only=True)
class _Found:
    robots: tuple[Robot, ...]
    gaps: dict[str, float]
    named: tuple[str, ...] = ()


def _diagnosed(experiments: Sequence[Experiment], start: _Found, rounds: int) -> _Found:
    """What diagnoses make of some robots, one after the other, until nothing is named."""
    found = start
    for number in range(1, rounds + 1):
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            path = write_experiments(folder, _written(experiments, found.robots, folder))
            result = gap.diagnose(path, allow_outside=True)
        told = result.diagnosis
        if not told.effects:
            break
        found = _Found(
            robots=result.robots,
            gaps={s: size.after for s, size in told.gap.signals.items()},
            named=(*found.named, *(f"{number}: {one.effect}" for one in told.effects)),
        )
    return found


def _of_files(experiments: Sequence[Experiment], folder: Path) -> tuple[Experiment, ...]:
    """The experiments with the models of a folder, each called as it was."""
    return tuple(
        replace(one, model=str(folder / f"{Path(one.model).stem}.xml")) for one in experiments
    )


def _written(
    experiments: Sequence[Experiment], robots: Sequence[Robot], folder: Path
) -> tuple[Experiment, ...]:
    """Writes the models of experiments; returns the experiments with these."""
    found = _of_files(experiments, folder)
    files = {Path(one.model).name: robot for one, robot in zip(found, robots, strict=True)}
    for file, robot in files.items():
        write_model(robot, folder / file)
    (folder / FILE).write_text(json.dumps(sidecar(files, [])), encoding="utf-8")
    return found


@functools.cache
def commit() -> str:
    """The commit of this checkout, with a `+` where files of it have changed; "" outside of git.

    It is that of when a process first asks.
    """

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], cwd=_REPOSITORY, capture_output=True, text=True, check=False
        )
        return done.stdout.strip() if done.returncode == 0 else ""

    changed = git("status", "--porcelain", "--untracked-files=no")
    return git("rev-parse", "--short=12", "HEAD") + ("+" if changed else "")
