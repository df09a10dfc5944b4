"""The logs of real hardware, with the split and the figure that the examples have.

    log = LOGS[0]
    log.experiments()                              # models and recordings, with their split
    problem = log.load()                           # a gap.Problem
    log.figure(problem, gap.replay(problem).gap)   # one number, or one per joint

They are looked for where the examples look: below WALKERKIT_DATA.
"""

from __future__ import annotations

import importlib
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from walkerkit import gap
from walkerkit.gap.experiments.experiment import Experiment, load_experiments, load_manifest
from walkerkit.gap.report.gaps import Gap
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.commands import Hold

_EXAMPLES = str(Path(__file__).resolve().parents[2] / "examples")
Figure = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class RealLog:
    """One set of recordings.

    Attributes:
        name: of its folder, and of its example where there is one.
        what: what the figure is.
        experiments: models and recordings, with the example's split.
        figure: the figure of a gap, after something was done about it.
        percent: the figure is relative.
        hold: what the targets are between their samples, where that is known.
    """

    name: str
    what: str
    experiments: Callable[[], tuple[Experiment, ...]]
    figure: Callable[[Problem, Gap], Figure]
    percent: bool = False
    hold: Hold | None = None

    def load(self) -> Problem:
        """The problem, with the example's split."""
        experiments = self.experiments()
        with tempfile.TemporaryDirectory() as folder:
            path = write_experiments(Path(folder), experiments)
            return gap.load(path, hold=self.hold, allow_outside=True)

    def diagnose(self) -> gap.Result:
        """What walkerkit makes of it unaided."""
        experiments = self.experiments()
        with tempfile.TemporaryDirectory() as folder:
            path = write_experiments(Path(folder), experiments)
            return gap.diagnose(path, allow_outside=True)

    def said(self, figure: Figure) -> str:
        """The figure as text."""
        if self.percent:
            return " / ".join(f"{value:.2%}" for value in figure)
        return " / ".join(f"{value:.4f}" for value in figure) + " rad"


def _example(name: str) -> ModuleType:
    if _EXAMPLES not in sys.path:
        sys.path.append(_EXAMPLES)
    return importlib.import_module(name)


def folder(name: str) -> Path:
    """The folder of a data set.

    Raises:
        FileNotFoundError: it is not there.
    """
    try:
        found: Path = _example("_data").folder(name)
    except SystemExit as missing:
        raise FileNotFoundError(str(missing)) from None
    return found.resolve()


def write_experiments(folder: Path, experiments: Sequence[Experiment]) -> Path:
    """Writes recordings and a manifest of experiments whose models are where they are.

    Args:
        folder: where.
        experiments: models and recordings; names of recordings are unique.

    Returns:
        Path of the manifest.
    """
    parts = []
    for experiment in experiments:
        files: dict[bool, list[str]] = {True: [], False: []}
        for recording in experiment.recordings:
            file = f"{recording.name.replace('/', '_')}.csv"
            recording.save(folder / file)
            files[recording.name in experiment.held_out].append(file)
        parts.append(
            f"[[experiment]]\nmodel = {json.dumps(str(experiment.model))}\n"
            f"recordings = {json.dumps(files[False])}\nheld_out = {json.dumps(files[True])}\n"
        )
    path = folder / "experiments.toml"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def _xl330() -> tuple[Experiment, ...]:
    with tempfile.TemporaryDirectory() as temporary:
        return load_manifest(
            _example("xl330").manifest(folder("xl330"), Path(temporary) / "x.toml")
        )


def _of_one_model(
    name: str, recordings: str, held_out: Sequence[str]
) -> Callable[[], tuple[Experiment, ...]]:
    """A model that is called as its folder, and its recordings."""

    def experiments() -> tuple[Experiment, ...]:
        data = folder(name)
        model, *_ = sorted(data.glob("*.xml"))
        files = sorted(data.glob(recordings))
        return load_experiments(model, files, held_out=[data / one for one in held_out])

    return experiments


def _position(problem: Problem, of: Gap) -> Figure:
    return (of.position.after,)


def _joints(problem: Problem, of: Gap) -> Figure:
    return tuple(of.joints[joint].after for joint in problem.joints)


def _relative_effort(problem: Problem, of: Gap) -> Figure:
    (replay,) = problem.held.told
    column = [channel.signal for channel in replay.channels].index("effort")
    return (of.signals["effort"].after / float(np.sqrt(np.mean(replay.measured[:, column] ** 2))),)


LOGS = (
    RealLog(
        name="emps",
        what="relative effort error on pulses.csv",
        experiments=_of_one_model("emps", "*.csv", ["pulses.csv"]),
        figure=_relative_effort,
        percent=True,
        # The loop runs at the rate of the log; held, its targets would saw at twice the rate.
        hold="linear",
    ),
    RealLog(
        name="double_pendulum",
        what="position RMS of shoulder / elbow over 0.5 s windows",
        experiments=_of_one_model(
            "double_pendulum", "*.csv", ["20230629-144003.csv", "20230629-144115.csv"]
        ),
        figure=_joints,
    ),
    RealLog(
        name="xl330",
        what="position RMS over whole rollouts of sin_sin",
        experiments=_xl330,
        figure=_position,
    ),
    RealLog(
        name="go2_leg",
        what="position RMS over a whole rollout of leg_part3.csv",
        experiments=_of_one_model("go2_leg", "*.csv", ["leg_part3.csv"]),
        figure=_position,
    ),
)
