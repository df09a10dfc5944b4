"""The first answer: the plain fit that every practitioner tries, as soon as it is there.

    answer = first_answer(problem, fit, seconds)
    print(answer.sentence)

Damping, dry friction, armature, servo gains and a delay at every joint, fitted to a few stretches;
what else is missing is looked for beside that. The final answer takes its place.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass

from walkerkit.gap.report.gaps import Gap
from walkerkit.gap.report.quantity import quantity
from walkerkit.gap.report.replayed import replay_half, unit_of
from walkerkit.gap.search.decision import LEAST_GAIN
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit
from walkerkit.gap.simulation.mend import mend

FILE = "first_answer.json"


@dataclass(frozen=True, kw_only=True)
class FirstAnswer:
    """The held-out gap that a plain fit leaves.

    Attributes:
        effects: names of what was fitted.
        signals: of each that counts, its root-mean-square error with the model as given, with the
            fit, and its unit.
        values: effect to place to name to value.
        seconds: since the start.
    """

    effects: tuple[str, ...]
    signals: dict[str, tuple[float, float, str]]
    values: dict[str, dict[str, dict[str, float]]]
    seconds: float

    @property
    def sentence(self) -> str:
        """For the terminal."""
        gaps = " and ".join(
            f"of {name} from {quantity(before, unit)} to {quantity(after, unit)}"
            for name, (before, after, unit) in self.signals.items()
        )
        return (
            f"First answer after {self.seconds:.0f} s: a plain fit of {', '.join(self.effects)} "
            f"takes the held-out gap {gaps}. Looking for what else is missing."
        )

    def notes(self, gap: Gap) -> tuple[str, ...]:
        """That it left less than what is told, which has only what is known.

        Empty where it did not, or what is told leaves no gap.

        Args:
            gap: with what is told.
        """
        _, left, unit = self.signals["position"]
        told = gap.position.after
        if not gap.held_out or gap.position_at_floor or told <= math.exp(LEAST_GAIN) * left:
            return ()
        return (
            f"The plain fit of the first answer left {quantity(left, unit)} of the position, what "
            f"is told leaves {quantity(told, unit)}: which of its other numbers are right these "
            "recordings do not tell, and more of them may. For the smaller gap alone, call "
            f"gap.fit(gap.load(model, recordings), {[*self.effects]}) of walkerkit.",
        )

    def to_json(self) -> str:
        """For a file."""
        return json.dumps(asdict(self), indent=2, ensure_ascii=False) + "\n"


def first_answer(problem: Problem, one: Fit, seconds: float) -> FirstAnswer:
    """Measures what a plain fit leaves of what is held out.

    Args:
        problem: what is to be explained.
        one: the fit.
        seconds: since the start.
    """
    trials = [one.structure.trials(robot, one.values[None]) for robot in problem.robots]
    before = replay_half(problem, "held", problem.robots)
    after = replay_half(problem, "held", [mend(trial) for trial in trials])
    signals = {}
    for name in dict.fromkeys(channel.quantity for channel in problem.channels):
        own = [channel for channel in problem.channels if channel.quantity == name]
        signals[name] = before.rms(own), after.rms(own), unit_of(problem, own)
    values: dict[str, dict[str, dict[str, float]]] = {}
    for slot, value in zip(one.structure.slots, one.values, strict=True):
        of_place = values.setdefault(slot.term.effect.name, {}).setdefault(slot.place, {})
        of_place[slot.parameter.name] = float(value)
    return FirstAnswer(
        effects=tuple(values),
        signals=signals,
        values=values,
        seconds=seconds,
    )
