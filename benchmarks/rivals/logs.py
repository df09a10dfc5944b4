"""The logs of real hardware, with the split and the figure that the examples have.

    log = LOGS[0]
    problem = log.load()                                    # a gap.Problem
    log.figure(problem, gap.replay(problem).gap, "after")   # one number, or one per joint

They are looked for where the examples look: below WALKERKIT_DATA.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from walkerkit import gap
from walkerkit.gap.report.gaps import Gap
from walkerkit.gap.search.problem import Problem

_EXAMPLES = str(Path(__file__).resolve().parents[2] / "examples")
Figure = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class RealLog:
    """One set of recordings.

    Attributes:
        name: of its example, and of its folder.
        what: what the figure is.
        load: the problem, with the example's split.
        figure: the figure of a gap, after something was done about it.
        percent: the figure is relative.
    """

    name: str
    what: str
    load: Callable[[], Problem]
    figure: Callable[[Problem, Gap], Figure]
    percent: bool = False

    def diagnose(self) -> gap.Result:
        """What walkerkit makes of it unaided, as the example has it."""
        with tempfile.TemporaryDirectory() as folder:
            result: gap.Result = _example(self.name).main(Path(folder))
        return result

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


def _xl330() -> Problem:
    with tempfile.TemporaryDirectory() as temporary:
        manifest = _example("xl330").manifest(folder("xl330"), Path(temporary) / "xl330.toml")
        return gap.load(manifest)


def _double_pendulum() -> Problem:
    data = folder("double_pendulum")
    held_out = [data / name for name in _example("double_pendulum").HELD_OUT]
    return gap.load(data / "double_pendulum.xml", sorted(data.glob("*.csv")), held_out=held_out)


def _emps() -> Problem:
    data = folder("emps")
    recordings = [data / "identification.csv", data / "pulses.csv"]
    # The loop runs at the rate of the log; held, its targets would saw at twice the rate.
    return gap.load(data / "emps.xml", recordings, held_out=recordings[1:], hold="linear")


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
        load=_emps,
        figure=_relative_effort,
        percent=True,
    ),
    RealLog(
        name="double_pendulum",
        what="position RMS of shoulder / elbow over 0.5 s windows",
        load=_double_pendulum,
        figure=_joints,
    ),
    RealLog(
        name="xl330",
        what="position RMS over whole rollouts of sin_sin",
        load=_xl330,
        figure=_position,
    ),
)
