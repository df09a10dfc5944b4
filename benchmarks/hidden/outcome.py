"""What came of a case: the truth beside what was said, as plain data that a line of JSON holds."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass


@dataclass(frozen=True, kw_only=True)
class Value:
    """A number that was estimated, beside the hidden one.

    Attributes:
        name: e.g. `kp`.
        place: joint or body, or `*`.
        true: what was hidden.
        value: the estimate.
        std: its standard error; None where the workflow gives none.
    """

    name: str
    place: str
    true: float
    value: float
    std: float | None


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """An effect that was hidden.

    Attributes:
        effect: its name.
        places: all joints or bodies that have it; all joints for the whole robot.
        alike: effects that make exactly the same logs, as the catalogue documents.
        text: for people.
    """

    effect: str
    places: tuple[str, ...]
    alike: tuple[str, ...]
    text: str


@dataclass(frozen=True, kw_only=True)
class Named:
    """An effect that was named.

    Attributes:
        effect: its name.
        places: all joints or bodies where it was named; all joints for the whole robot.
        confidence: as stated.
        doubt: effects that it is said to be indistinguishable from.
        alike: effects that make exactly the same logs, as the catalogue documents.
        values: its numbers of which the truth is known.
    """

    effect: str
    places: tuple[str, ...]
    confidence: float
    doubt: tuple[str, ...]
    alike: tuple[str, ...]
    values: tuple[Value, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A case's result.

    Attributes:
        case: its name.
        tier: its tier.
        off: what else was not as in the model.
        beside: effects that the robot has beside what is hidden, neither right nor wrong.
        verdict: as stated; `failed` where the workflow raised an error, `impossible` where the case
            could not be made.
        hidden: the truth.
        named: what was named, in order.
        before, after: gap on held-out recordings.
        oracle: that gap after a fit of the hidden structure, or None where there was none.
        seconds: wall time of the diagnosis.
        error: what the workflow raised.
    """

    case: str
    tier: str
    off: str
    verdict: str
    hidden: tuple[Hidden, ...]
    named: tuple[Named, ...]
    before: float = 0.0
    after: float = 0.0
    oracle: float | None = None
    seconds: float = 0.0
    error: str = ""
    beside: tuple[str, ...] = ()

    def to_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self), ensure_ascii=False)

    @classmethod
    def from_json(cls, line: str) -> Outcome:
        """What `to_json` wrote."""
        data = json.loads(line)
        data["hidden"] = tuple(
            Hidden(**{**h, "places": tuple(h["places"]), "alike": tuple(h["alike"])})
            for h in data["hidden"]
        )
        data["named"] = tuple(
            Named(
                **{
                    **n,
                    "places": tuple(n["places"]),
                    "doubt": tuple(n["doubt"]),
                    "alike": tuple(n["alike"]),
                    "values": tuple(Value(**v) for v in n["values"]),
                }
            )
            for n in data["named"]
        )
        data["beside"] = tuple(data.get("beside", ()))
        return cls(**data)
