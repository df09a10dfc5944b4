"""A fleet as one HTML file that needs no network, in the style of a robot's report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from walkerkit.gap.fleet import fleet_figures, fleet_wording
from walkerkit.gap.fleet.comparison import Row
from walkerkit.gap.report.html import write_html
from walkerkit.gap.report.output import REPORT
from walkerkit.gap.report.quantity import quantity
from walkerkit.gap.report.wording import VALUES, WARNINGS, estimate, label

if TYPE_CHECKING:
    from walkerkit.gap.fleet.fleet import Fleet

_HAS, _COULD, _HAS_NOT, _CANNOT = "●", "?", "·", "–"
_SAYS = {
    _HAS: "has it",
    _COULD: "could have it",
    _HAS_NOT: "does not have it",
    _CANNOT: "lacks the joint",
}


def write_page(fleet: Fleet, path: str | Path, *, title: str) -> None:
    """Writes the page.

    Args:
        fleet: the robots.
        path: the HTML file, beside the folders of the robots; an existing one is replaced.
        title: heading of the page.

    Raises:
        OSError: the file cannot be written.
    """
    drawn = {
        "gaps": fleet_figures.gaps(fleet),
        "parameters": fleet_figures.parameters(fleet.comparison.rows),
    }
    rows = [cells for row in fleet.comparison.rows for cells in _parameters(fleet, row)]
    write_html(
        path,
        "fleet.html.j2",
        package="walkerkit.gap.fleet",
        title=label(title),
        sentence=fleet_wording.sentence(fleet),
        headline=_headline(fleet),
        robots=[_robot(fleet, index) for index in range(len(fleet.outcomes))],
        names=[label(robot) for robot in fleet.comparison.robots],
        groups=_groups(fleet),
        parameters=rows,
        values=VALUES,
        warnings=[meaning for warning, meaning in WARNINGS.items() if warning in _warned(rows)],
        legend=[f"{mark} {says}" for mark, says in _SAYS.items()],
        figures={name: figure for name, figure in drawn.items() if figure is not None},
    )


def _headline(fleet: Fleet) -> list[tuple[str, str]]:
    verdicts = [fleet_wording.verdict(one) for one in fleet.outcomes]
    counts = {name: verdicts.count(name) for name in dict.fromkeys(verdicts)}
    return [("robots", str(len(verdicts))), *((name, str(n)) for name, n in counts.items())]


def _robot(fleet: Fleet, index: int) -> dict[str, Any]:
    one = fleet.outcomes[index]
    named = [] if one.diagnosis is None else [of["effect"] for of in one.diagnosis["effects"]]
    return {
        "name": label(one.robot),
        "href": "" if one.diagnosis is None else f"{quote(one.robot, safe='')}/{REPORT}",
        "verdict": fleet_wording.verdict(one),
        "gaps": fleet_wording.gaps(one),
        "named": ", ".join(label(name) for name in dict.fromkeys(named)),
        "own": [fleet_wording.spot(row) for row in fleet.comparison.own(one.robot)],
        "failure": "" if one.failure is None else label(one.failure.message),
    }


def _groups(fleet: Fleet) -> list[dict[str, Any]]:
    """Who has what, by how many have it."""
    groups = []
    for kind, title in fleet_wording.KINDS.items():
        rows = [
            {
                "name": fleet_wording.spot(row),
                "count": fleet_wording.count(row),
                "marks": [
                    (mark, f"{label(robot)} {_SAYS[mark]}")
                    for robot in fleet.comparison.robots
                    for mark in [_mark(row, robot)]
                ],
            }
            for row in fleet.comparison.of(kind)
        ]
        if rows:
            groups.append({"title": title, "rows": rows})
    return groups


def _mark(row: Row, robot: str) -> str:
    if robot in row.robots:
        return _HAS
    if robot in row.possible:
        return _COULD
    return _HAS_NOT if robot in row.compared else _CANNOT


def _parameters(fleet: Fleet, row: Row) -> list[dict[str, Any]]:
    found = []
    for name, of in row.parameters.items():
        cells = []
        for robot in fleet.comparison.robots:
            value, unit, warning = estimate(of[robot]) if robot in of else ("", "", "")
            cells.append((f"{value} {unit}".strip(), warning))
        middle = row.middle(name)
        unit = next(iter(of.values())).unit
        found.append(
            {
                "effect": fleet_wording.spot(row),
                "name": label(name),
                "median": quantity(middle, unit) if len(of) > 1 and middle == middle else "",
                "cells": cells,
            }
        )
    return found


def _warned(rows: list[dict[str, Any]]) -> set[str]:
    return {warning for row in rows for _, warning in row["cells"]}
