"""Effects hidden in MuJoCo's own robots: under torque, on velocities, along slides, through gears.

    python -m benchmarks native_rigs [--quick]
    python -m benchmarks.native_rigs --draw 3 --only "leg: late commands"

The tiers of `hidden_effects` are servos around positions, on hardware with motor laws of its own.
Here the machine is MuJoCo itself at a quarter of a millisecond, whose models step by 2 to 2.5 ms.
Each draw has other sizes, motions and noise.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import Row
from benchmarks.native.machine import log
from benchmarks.native.scenarios import SCENARIOS, Scenario
from walkerkit import gap
from walkerkit.gap.effects import EVERYWHERE
from walkerkit.gap.effects.equivalences import equivalences
from walkerkit.gap.fleet import engine as engines
from walkerkit.gap.report.diagnosis import NamedEffect
from walkerkit.gap.simulation.load_robot import load_robot

DRAWS = 2
QUICK = ("leg: nothing", "leg: late commands", "wheel: bristles", "gantry: load")
"""Those of a quick run, of one draw."""

_SURE = 0.9  # from where on a name is stated for sure
_OWN_STEP = "timestep"  # which every model here has too long, and may be told so


@dataclass(frozen=True, kw_only=True)
class Found:
    """What came of a scenario.

    Attributes:
        scenario: its name and draw.
        hidden: the effect; empty for nothing.
        verdict: as stated.
        names: what was named first, and what that cannot be told from; none for nothing.
        place: whether the first name is at the hidden effect's joint or body, and nowhere else.
        sure: names stated for sure.
        sure_and_wrong: whether one of these neither is the hidden effect nor leaves the same log as
            that, whatever is commanded, as the catalogue documents.
        error: of the first name's value, relative; None where it has none to hold it against.
        gap: before and after, held out.
        seconds: wall time of the diagnosis.
    """

    scenario: str
    hidden: str
    verdict: str
    names: tuple[str, ...]
    place: bool
    sure: tuple[str, ...]
    sure_and_wrong: bool
    error: float | None
    gap: tuple[float, float]
    seconds: float

    @property
    def right(self) -> bool:
        """Whether the hidden effect is in the first name's set, or nothing is named of nothing."""
        return self.hidden in self.names if self.hidden else not self.names

    def __str__(self) -> str:
        mark = "right" if self.right and not self.sure_and_wrong else "WRONG"
        off = "" if self.error is None else f", off by {self.error:.1%}"
        return (
            f"{self.scenario} {self.seconds:5.0f} s  {mark}  hidden {self.hidden or 'nothing'}: "
            f"{self.verdict}, named {' or '.join(self.names) or 'nothing'}"
            f"{' (sure: ' + ', '.join(self.sure) + ')' if self.sure else ''}{off}; "
            f"gap {self.gap[0]:.3g} to {self.gap[1]:.3g}"
        )


def run(*, quick: bool) -> list[Row]:
    """Runs all scenarios, or a few."""
    chosen = [s for s in SCENARIOS if s.name in QUICK] if quick else SCENARIOS
    draws = range(1 if quick else DRAWS)
    return rows(list(found([(one, draw) for one in chosen for draw in draws])))


def found(chosen: Sequence[tuple[Scenario, int]]) -> Iterator[Found]:
    """Runs scenarios in some draws side by side, and prints a line for each."""
    for done in engines.run(diagnosed, list(chosen)):
        if done.failure is not None:
            raise RuntimeError(f"{chosen[done.index][0].name}: {done.failure.message}")
        print(done.value, flush=True)
        yield done.value


def diagnosed(chosen: tuple[Scenario, int]) -> Found:
    """Logs the machine of a scenario in a draw, and diagnoses the logs."""
    scenario, draw = chosen
    rng = np.random.default_rng([draw, *scenario.name.encode()])
    hidden = scenario.make(rng)
    motions = scenario.robot.motions(scenario.seconds, rng)
    recordings = log(scenario.robot, hidden.machine, motions, scenario.signals, rng)
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "model.xml"
        model.write_text(scenario.robot.xml)
        result = gap.diagnose(model, recordings, n_threads=1).diagnosis
        robot = load_robot(model)
    named = [one for one in result.effects if one.effect != _OWN_STEP]
    sure = [one for one in named if one.confidence >= _SURE]
    alike = {
        one.effect: equivalences(
            one.effect, scenario.signals, robot=robot, joints=one.joints, bodies=one.bodies
        )
        for one in sure
    }
    return Found(
        scenario=f"{scenario.name} ({draw})",
        hidden=scenario.effect,
        verdict=result.verdict,
        names=(named[0].effect, *named[0].indistinguishable_from) if named else (),
        place=bool(named) and _place(named[0]) == (scenario.place or EVERYWHERE),
        sure=tuple(alike),
        sure_and_wrong=any(scenario.effect not in (name, *alike[name]) for name in alike),
        error=_error(scenario, hidden.value, named),
        gap=(result.gap.position.before, result.gap.position.after),
        seconds=result.seconds,
    )


def _place(one: NamedEffect) -> str:
    return ", ".join((*one.joints, *one.bodies)) or EVERYWHERE


def _error(scenario: Scenario, true: float | None, named: Sequence[NamedEffect]) -> float | None:
    """By which part the first number of the first name is off there, if that is the hidden one."""
    if not named or named[0].effect != scenario.effect or true is None:
        return None
    there = [one for one in named[0].parameters if one.place in (scenario.place, EVERYWHERE)]
    return abs(there[0].value - true) / abs(true) if there else None


def rows(every: Sequence[Found]) -> list[Row]:
    """The table of what came of some scenarios."""
    something = [one for one in every if one.hidden]
    nothing = [one for one in every if not one.hidden]
    errors = [one.error for one in something if one.error is not None]
    seconds = [one.seconds for one in every]
    return [
        Row(
            what="hidden effect in the first name's set",
            result=_share(sum(one.right for one in something), len(something)),
            required="95 %",
        ),
        Row(
            what="at its joint or body",
            result=_share(sum(one.place for one in something), len(something)),
        ),
        Row(
            what="error of the values, median and largest",
            result=f"{np.median(errors):.1%}, {max(errors):.1%} ({len(errors)})" if errors else "-",
        ),
        Row(
            what="sure of a wrong name",
            result=_share(sum(one.sure_and_wrong for one in every), len(every)),
            required="at most 5 %",
        ),
        Row(
            what="named where nothing is hidden but a finer timestep",
            result=_share(sum(not one.right for one in nothing), len(nothing)),
            required="0",
        ),
        Row(
            what="seconds a case, median and largest",
            result=f"{np.median(seconds):.0f}, {max(seconds):.0f}",
        ),
    ]


def _share(count: int, total: int) -> str:
    return f"{count} of {total}"


def main() -> None:
    """Runs what the command line asks for and prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.native_rigs")
    parser.add_argument("--draw", type=int, metavar="N", help="this one only, of any number")
    names = ", ".join(f"“{one.name}”" for one in SCENARIOS)
    parser.add_argument("--only", metavar="NAME", action="append", help=f"of {names}")
    asked = parser.parse_args()
    chosen = [one for one in SCENARIOS if asked.only is None or one.name in asked.only]
    if not chosen:
        parser.error(f"no scenario is called {asked.only[0]!r}; there are {names}")
    draws = range(DRAWS) if asked.draw is None else [asked.draw]
    table = Table("what", "measured", "required")
    for row in rows(list(found([(one, draw) for one in chosen for draw in draws]))):
        table.add_row(row.what, row.result, row.required)
    Console().print(table)


if __name__ == "__main__":
    main()
