"""A fleet in a terminal: what is common, a line for each robot, the parameters side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.console import Console, Group, RenderableType
from rich.text import Text

from walkerkit.gap.bar import stages
from walkerkit.gap.fleet import fleet_wording
from walkerkit.gap.fleet.comparison import Row
from walkerkit.gap.report.console import VERDICT_STYLES, Paragraph, Rows, heading, plain
from walkerkit.gap.report.quantity import quantity
from walkerkit.gap.report.wording import estimate, label

if TYPE_CHECKING:
    from walkerkit.gap.fleet.fleet import Ended, Fleet, Outcome


def render(fleet: Fleet) -> RenderableType:
    """The fleet as something that `rich` prints."""
    parts: list[RenderableType] = [Paragraph(fleet_wording.sentence(fleet)), heading("Robots")]
    parts.append(_robots(fleet))
    if fleet.comparison.rows:
        parts += [heading("Effects"), _effects(fleet)]
        if any(row.possible for row in fleet.comparison.rows):
            parts.append(
                Text("(+n?): the recordings of n more robots cannot tell what they have from it.")
            )
    if fleet.failed:
        parts.append(heading("Failed"))
        parts += [Text(f"{label(one.robot)}: {_why(one)}") for one in fleet.failed]
    return Group(*parts)


def as_text(fleet: Fleet, width: int = 100) -> str:
    """The same as plain text, `width` characters in a line."""
    return plain(render(fleet), width)


def line(outcome: Outcome, number: int, total: int) -> Text:
    """What a robot's diagnosis came to, in one line."""
    verdict = fleet_wording.verdict(outcome)
    text = Text(f"{number}/{total} {label(outcome.robot)}: ")
    if outcome.diagnosis is None:
        return text.append(verdict, "bold red").append(f": {_why(outcome)}")
    text.append(verdict, VERDICT_STYLES[outcome.diagnosis["verdict"]])
    before, after, _ = fleet_wording.gaps(outcome)
    named = dict.fromkeys(one["effect"] for one in outcome.diagnosis["effects"])
    text.append(
        f", {', '.join(map(label, named))}: {before} to {after}" if named else f": {before}"
    )
    kept = ", kept from an earlier run with the same input" if outcome.kept else ""
    return text.append(f" ({outcome.diagnosis['seconds']:.1f} s{kept})")


def as_they_end(bar: Any, console: Console, *, lines: bool) -> Ended:
    """What shows on a bar how many robots are done, and prints a line of each where it is to."""
    progress = stages(bar)
    progress("diagnosing", 0.0)
    above = bar.console if bar.console.is_terminal else console  # the bar

    def ended(outcome: Outcome, number: int, total: int) -> None:
        progress(f"{number} of {total} robots", number / total)
        if lines:
            above.print(line(outcome, number, total), soft_wrap=True)

    return ended


def _why(outcome: Outcome) -> str:
    return "" if outcome.failure is None else label(outcome.failure.message)


def _robots(fleet: Fleet) -> Rows:
    table = Rows(
        *("robot", "verdict", "before", "after", "noise floor", "its own"),
        right=("before", "after", "noise floor"),
    )
    for one in fleet.outcomes:
        own = ", ".join(fleet_wording.spot(row) for row in fleet.comparison.own(one.robot))
        table.add(label(one.robot), fleet_wording.verdict(one), *fleet_wording.gaps(one), own)
    return table


def _effects(fleet: Fleet) -> Rows:
    table = Rows("effect", "robots", "parameter", "median", "of each", right=("median",))
    for kind, title in fleet_wording.KINDS.items():
        rows = fleet.comparison.of(kind)
        if rows:
            table.add(title)
        for row in rows:
            first = [f"  {fleet_wording.spot(row)}", fleet_wording.count(row)]
            for name, median, values in _parameters(row) or [("", "", ", ".join(row.robots))]:
                table.add(*first, label(name), median, values)
                first = ["", ""]
    return table


def _parameters(row: Row) -> list[tuple[str, str, str]]:
    found = []
    for name, of in row.parameters.items():
        unit = next(iter(of.values())).unit
        values = []
        for robot, one in of.items():
            value, its_unit, warning = estimate(one)
            warned = f" ({warning})" if warning else ""
            values.append(f"{label(robot)} {value} {its_unit}".rstrip() + warned)
        middle = row.middle(name)
        median = quantity(middle, unit) if len(of) > 1 and middle == middle else ""
        found.append((name, median, "; ".join(values)))
    return found
