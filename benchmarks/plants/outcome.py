"""What came of a planted error, as plain data that a line of JSON holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.hidden.outcome import Outcome

FILE = "planted.jsonl"
SHOWS = 1.2
"""From where on a plant shows: by so much it raises the held-out gap of some signal."""


Compared = tuple[str, float, float]


@dataclass(frozen=True, kw_only=True)
class PlantedOutcome:
    """A case's result.

    Attributes:
        case: its name.
        log: name of the log.
        kind: of the error.
        half: `to fit`, `to tell` or "".
        best: signal to the held-out gap of the best model.
        planted: the same with the error, before the diagnosis; empty for a flipped sign, which the
            comparison mends before it measures.
        commit: of the code that diagnosed.
        best_commit: of the code that fitted the best model.
        outcome: what was said of it beside the truth; its verdict is `impossible` where the log
            cannot have the error, and `silent` where the error does not show and nothing was asked.
        table: of every structure that was compared what it has, its elpd and its log prior odds.
    """

    case: str
    log: str
    kind: str
    half: str
    best: Mapping[str, float]
    planted: Mapping[str, float]
    commit: str
    best_commit: str
    outcome: Outcome
    table: tuple[Compared, ...] = ()

    @property
    def shows(self) -> bool:
        """Whether the error raises the held-out gap of some signal by a fifth or more."""
        return shows(self.best, self.planted)

    def to_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self), ensure_ascii=False)

    @classmethod
    def from_json(cls, line: str) -> PlantedOutcome:
        """What `to_json` wrote."""
        data = json.loads(line)
        table = tuple((what, elpd, prior) for what, elpd, prior in data.get("table", ()))
        outcome = Outcome.from_json(json.dumps(data["outcome"]))
        return cls(**{**data, "outcome": outcome, "table": table})


def kept(file: Path) -> list[PlantedOutcome]:
    """The outcomes of a file, a line each."""
    return [*map(PlantedOutcome.from_json, file.read_text(encoding="utf-8").splitlines())]


def shows(best: Mapping[str, float], planted: Mapping[str, float]) -> bool:
    """Whether gaps by signal are larger by a fifth or more at one of the signals.

    Args:
        best: without the error.
        planted: with it; where it is empty the error is one that cannot be overlooked.
    """
    return not planted or any(planted[name] >= SHOWS * best[name] for name in planted)
