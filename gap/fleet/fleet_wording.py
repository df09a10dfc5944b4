"""What a comparison of robots says, in words that the console and the page share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from walkerkit.gap.fleet.comparison import Row, Shared
from walkerkit.gap.report import wording
from walkerkit.gap.report.quantity import quantity

if TYPE_CHECKING:
    from walkerkit.gap.fleet.fleet import Fleet, Outcome

KINDS: Mapping[Shared, str] = {
    "all": "Common to all",
    "most": "Common to most",
    "some": "Of some",
    "own": "One unit's own",
}
FAILED = "Failed"
_FEW = 6  # that a sentence lists


def verdict(outcome: Outcome) -> str:
    """The verdict of a robot in a word or two."""
    if outcome.diagnosis is None:
        return FAILED
    return wording.TITLES[outcome.diagnosis["verdict"]]


def gaps(outcome: Outcome) -> tuple[str, str, str]:
    """The position gap before and after, and its noise floor; empty where a robot failed."""
    if outcome.diagnosis is None:
        return "", "", ""
    gap: Mapping[str, Any] = outcome.diagnosis["gap"]
    before, after, floor = (
        quantity(float("nan") if gap[key] is None else gap[key], gap["unit"])
        for key in ("before", "after", "noise_floor")
    )
    return before, after, floor


def spot(row: Row) -> str:
    """An effect and its place: `coulomb_friction at knee`."""
    if row.place == wording.EVERYWHERE:
        return f"{wording.label(row.effect)} of the whole robot"
    kind = "of body" if row.body else "at"
    return f"{wording.label(row.effect)} {kind} {wording.label(row.place)}"


def count(row: Row) -> str:
    """How many of those that could have an effect have it: `3 of 4`, `2 (+1?) of 4`."""
    perhaps = f" (+{len(row.possible)}?)" if row.possible else ""
    return f"{len(row.robots)}{perhaps} of {len(row.compared)}"


def sentence(fleet: Fleet) -> str:
    """What robots have in common, and what sets some apart."""
    robots = fleet.comparison.robots
    if not robots:
        return "No robot could be diagnosed."
    if len(robots) == 1:
        return (
            f"Only {wording.label(robots[0])} was diagnosed: there is nothing to compare it with."
        )
    if not fleet.comparison.rows:
        return f"Nothing was named for any of the {len(robots)} robots that were diagnosed."
    parts = []
    for who, rows in (("All", fleet.comparison.of("all")), ("Most", fleet.comparison.of("most"))):
        if rows:
            parts.append(f"{who} robots have {_listed([spot(row) for row in rows])}.")
    if not parts:
        parts.append("No effect is common to most robots.")
    for robot in robots:
        rows = fleet.comparison.own(robot)
        if rows:
            alone = _listed([spot(row) for row in rows])
            parts.append(f"{wording.label(robot)} alone has {alone}.")
    shown = parts[:_FEW]
    if len(parts) > _FEW:
        shown.append(f"{len(parts) - _FEW} more have something of their own.")
    return " ".join(shown)


def _listed(names: list[str]) -> str:
    if len(names) > _FEW:
        names = [*names[: _FEW - 1], f"{len(names) - _FEW + 1} more"]
    return wording.listed(names)
