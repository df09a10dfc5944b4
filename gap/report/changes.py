"""What was written to the model: each number as it was and as it is, for console and report."""

from __future__ import annotations

from dataclasses import dataclass

from walkerkit.gap.report import wording
from walkerkit.gap.report.diagnosis import Change, Diagnosis, Estimate
from walkerkit.gap.report.quantity import number, scale

_DIGITS = 4
_NONE = "–"


@dataclass(frozen=True, kw_only=True)
class Row:
    """A number of the robot's files, as text.

    Attributes:
        place: the joint or body, with the model where several differ.
        field: element and attribute.
        was, now, change: the numbers, `–` for none; the change with its sign.
        unit: unit of the three.
    """

    place: str
    field: str
    was: str
    now: str
    change: str
    unit: str


def changes(diagnosis: Diagnosis) -> tuple[Row, ...]:
    """What the named effects have changed in the files, in the order of the effects."""
    rows: dict[tuple[str, str], Row] = {}
    for named in diagnosis.effects:
        for of in named.parameters:
            several = len({change.model for change in of.changes}) > 1
            for change in of.changes if of.differs else of.changes[:1]:
                place = change.place if of.differs else of.place
                site = wording.site(place) if place else ""
                if of.differs and several:
                    site = f"{site} ({wording.label(change.model)})"
                row = _row(of, change, site)
                rows[site, f"{of.field} {of.name}"] = row
    return tuple(rows.values())


def _row(of: Estimate, change: Change, site: str) -> Row:
    known = [abs(value) for value in (change.was, change.now) if value is not None]
    chosen = scale(max(known, default=0.0), of.unit)

    def text(value: float | None) -> str:
        return _NONE if value is None else number(value * chosen.factor, _DIGITS)

    difference = None if change.was is None or change.now is None else change.now - change.was
    sign = "+" if difference is not None and difference > 0 else ""
    return Row(
        place=site,
        field=wording.label(of.field),
        was=text(change.was),
        now=text(change.now),
        change=sign + text(difference),
        unit=chosen.unit,
    )
