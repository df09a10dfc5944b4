"""The demonstration over many seeds: how often it names what was hidden, and how often in vain.

Each seed is run with a drawn effect hidden and with nothing hidden. Simulated hardware shares no
law with the workflow; see `walkerkit.gap.rehearsal.hardware`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks import Row
from walkerkit.gap.rehearsal import demo
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.hideable import HIDEABLE
from walkerkit.gap.report.diagnosis import NamedEffect
from walkerkit.gap.report.result import Result

SEEDS, QUICK_SEEDS = 20, 3
_ESTIMATES = {  # a hidden parameter to the one that the catalogue fits
    "delta_kp": "kp",
    "delta_kd": "kd",
    "alpha": "strength",
    "forcerange": "limit",
    "offset": "ref",
}
_TURNED = ("base_tilt",)  # the base is turned on the hardware, gravity in the model


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run with something hidden.

    Attributes:
        first: the first effect named is the hidden one.
        in_doubt: the hidden one is among those that the first cannot be told from.
        places: it is named at the joints or bodies that have it, and no others.
        error: largest relative error of its values, where the place is right.
        more: effects named besides.
        seconds: wall time.
    """

    first: bool
    in_doubt: bool
    places: bool
    error: float
    more: int
    seconds: float


def run(*, quick: bool) -> list[Row]:
    """Runs the demonstration for every seed, hiding something and hiding nothing."""
    seeds = range(QUICK_SEEDS if quick else SEEDS)
    trials = [_hidden(seed) for seed in seeds]
    alarms, quiet_seconds = zip(*(_nothing(seed) for seed in seeds), strict=True)
    count = len(seeds)
    errors = [trial.error for trial in trials if np.isfinite(trial.error)]
    return [
        Row(
            what="hidden effect named first",
            result=f"{sum(t.first for t in trials)} of {count}",
            reference=f"{1 / len(HIDEABLE):.0%} by chance",
        ),
        Row(
            what="named first, or said to be indistinguishable from it",
            result=f"{sum(t.first or t.in_doubt for t in trials)} of {count}",
        ),
        Row(
            what="and at the right joints or body",
            result=f"{sum(t.first and t.places for t in trials)} of {count}",
        ),
        Row(
            what="relative error of the values, median and largest",
            result=f"{np.median(errors):.1%}, {max(errors):.1%}" if errors else "none named",
        ),
        Row(
            what="effects named besides the hidden one",
            result=f"{sum(trial.more for trial in trials)} in {count} runs",
        ),
        Row(
            what="false alarms with nothing hidden",
            result=f"{sum(alarms)} of {count}",
        ),
        Row(
            what="seconds a run, median and largest, something hidden",
            result=_seconds([trial.seconds for trial in trials]),
            reference=f"nothing hidden: {_seconds(quiet_seconds)}",
        ),
    ]


def _hidden(seed: int) -> Trial:
    start = time.perf_counter()
    result, rehearsal = demo.run(seed=seed)
    seconds = time.perf_counter() - start
    (hidden,) = rehearsal.hidden
    effects = result.diagnosis.effects
    first = bool(effects) and effects[0].effect == hidden.effect
    trial = Trial(
        first=first,
        in_doubt=bool(effects) and hidden.effect in effects[0].indistinguishable_from,
        places=first and _places(result, effects[0]) == _hidden_places(result, hidden),
        error=_error(effects[0], hidden) if first else float("nan"),
        more=len(effects) - first,
        seconds=seconds,
    )
    verdict = "right" if trial.first else "in doubt" if trial.in_doubt else "WRONG"
    if trial.first and not trial.places:
        verdict = "other place"
    print(
        f"seed {seed:2} {seconds:5.1f} s  {verdict:11}  hidden {hidden.describe()}; "
        f"{result.diagnosis.verdict}, named {_described(effects)}",
        flush=True,
    )
    return trial


def _nothing(seed: int) -> tuple[bool, float]:
    start = time.perf_counter()
    result, _ = demo.run(seed=seed, hide=["none"])
    seconds = time.perf_counter() - start
    effects = result.diagnosis.effects
    print(
        f"seed {seed:2} {seconds:5.1f} s  {'FALSE ALARM' if effects else 'right':11}  hidden "
        f"nothing; {result.diagnosis.verdict}, named {_described(effects)}",
        flush=True,
    )
    return bool(effects), seconds


def _places(result: Result, named: NamedEffect) -> set[str]:
    places = named.joints or named.bodies
    return set(result.problem.joints) if places == ("*",) else set(places)


def _hidden_places(result: Result, hidden: HiddenEffect) -> set[str]:
    """Where it is; an effect of the world is everywhere."""
    return set(result.problem.joints) if hidden.places in ((), ("*",)) else set(hidden.places)


def _error(named: NamedEffect, hidden: HiddenEffect) -> float:
    """Largest relative error of the parameters at places that have the effect."""
    errors = []
    for parameter in HIDEABLE[hidden.effect].parameters:
        for of in named.parameters:
            if of.name != _ESTIMATES.get(parameter.name, parameter.name):
                continue
            if of.place not in hidden.places and of.place != "*":
                continue
            true = hidden.value(parameter.name, None if of.place == "*" else of.place)
            true *= -1 if hidden.effect in _TURNED else 1
            errors.append(abs(of.value - true) / abs(true) if true else abs(of.value))
    return max(errors, default=float("nan"))


def _described(effects: Sequence[NamedEffect]) -> str:
    parts = []
    for named in effects:
        values = ", ".join(f"{of.name} {of.value:.3g} ({of.place})" for of in named.parameters)
        others = named.indistinguishable_from
        doubt = f" or {' or '.join(others)}" if others else ""
        parts.append(f"{named.effect}{doubt} [{named.confidence:.2f}]: {values}")
    return "; ".join(parts) or "nothing"


def _seconds(values: Sequence[float]) -> str:
    return f"{np.median(values):.0f} s, {max(values):.0f} s"
