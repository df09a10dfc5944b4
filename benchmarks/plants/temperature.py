"""The temperature that suits the plants: on one half the best one, on the other what it gives.

    python -m benchmarks.plants.temperature planted

A table of structures gives each name the weight of all that have it, for any temperature: elpd / T
and the prior odds are kept with each outcome. The best T gives the names that were planted the
largest log probability, in the mean of the plants that show (a plant that no structure has counts
as the least one). Weights are those of all blocks; the bootstrap over blocks, which smears them, is
left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.plants.outcome import FILE, PlantedOutcome, kept
from benchmarks.plants.scoring import told
from walkerkit.gap.search.decision import TEMPERATURE

TEMPERATURES = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)
_LEAST = 0.01
"""The probability of a name that no structure has, as of one that nobody thought of."""


def probability(one: PlantedOutcome, temperature: float) -> float:
    """The weight of the structures that have what was planted, or what leaves the same log."""
    elpd, prior = (np.array([row[k] for row in one.table]) for k in (1, 2))
    logs = elpd / temperature + prior
    weights: NDArray[np.float64] = np.exp(logs - logs.max())
    names = {name for hidden in one.outcome.hidden for name in (hidden.effect, *hidden.alike)}
    has = [not names.isdisjoint(_effects(structure)) for structure, *_ in one.table]
    return float(weights[has].sum() / weights.sum())


def _effects(structure: str) -> list[str]:
    """Names of the effects of a structure as the table describes it."""
    return [part.partition(" (")[0] for part in structure.split(" + ")]


def log_score(outcomes: Sequence[PlantedOutcome], temperature: float) -> float:
    """The mean log probability of what was planted."""
    found = [max(_LEAST, probability(one, temperature)) for one in outcomes]
    return float(np.mean(np.log(found)))


def main() -> None:
    """Prints the log score of both halves at several temperatures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.plants.temperature")
    parser.add_argument("folder", type=Path, help="that of `benchmarks planted`")
    outcomes = [one for one in kept(parser.parse_args().folder / FILE) if one.table]
    halves = {half: told(outcomes, half) for half in ("to fit", "to tell")}
    table = Table("T", *(f"{half} ({len(some)})" for half, some in halves.items()))
    for temperature in TEMPERATURES:
        now = " (as it is)" if temperature == TEMPERATURE else ""
        scores = (f"{log_score(some, temperature):.3f}" for some in halves.values() if some)
        table.add_row(f"{temperature:g}{now}", *scores)
    Console().print(table)


if __name__ == "__main__":
    main()
