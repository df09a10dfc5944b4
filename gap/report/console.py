"""A diagnosis in a terminal: errors of wiring if any, a verdict, tables, numbered notes.

    rich.print(render(diagnosis))
    text = as_text(diagnosis, width=80)

Nothing is said by colour alone, so that plain text loses nothing.
"""

from __future__ import annotations

import io
from typing import Literal

import pandas as pd
from rich import box
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from walkerkit.gap.report import wording
from walkerkit.gap.report.changes import changes
from walkerkit.gap.report.diagnosis import Diagnosis, Hint, NamedEffect
from walkerkit.gap.report.quantity import percent, quantity

_TOP = 3  # locations shown
_STRUCTURES = 10  # of a comparison
VERDICT_STYLES = {
    "explained": "bold green",
    "no_gap": "bold green",
    "partly_explained": "bold yellow",
    "unexplained": "bold red",
}


def comparison_table(comparison: pd.DataFrame) -> RenderableType:
    """The most probable structures of a search as a table: see docs/decision.md."""
    table = Table("structure", box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for column in ("elpd", "difference", "weight"):
        table.add_column(column, justify="right", no_wrap=True)
    for row in comparison.head(_STRUCTURES).to_dict("records"):
        table.add_row(
            row["structure"],
            f"{row['elpd']:.1f}",
            f"{row['difference']:.1f} ± {row['se']:.1f}",
            percent(row["weight"]),
        )
    return Group(heading("Structures that were compared, the most probable first"), table)


def render(diagnosis: Diagnosis) -> RenderableType:
    """The diagnosis as something that `rich` prints."""
    verdict = Text.assemble(
        (f"{wording.title(diagnosis)}. ", VERDICT_STYLES[diagnosis.verdict]),
        wording.verdict_sentence(diagnosis),
    )
    parts: list[RenderableType] = [
        Text(f"Wiring: {sentence}\n", style="bold") for sentence in wording.wiring(diagnosis)
    ]
    parts.append(verdict)
    if wording.unknown(diagnosis):
        parts.append(Text(wording.unknown(diagnosis)))
    if diagnosis.locations and diagnosis.verdict != "no_gap":
        parts += [heading("Where"), _locations(diagnosis)]
    if diagnosis.effects:
        parts += [heading("Effects, the surest first"), _effects(diagnosis)]
        parts += [Text(warning) for warning in wording.warnings(diagnosis)]
    written = _changes(diagnosis)
    if written.row_count:
        parts += [heading("What changes in the model"), written]
    doubts = [*wording.doubts(diagnosis), wording.advice(diagnosis)]
    if doubts[0]:
        parts.append(heading("What cannot be told apart, and what would tell"))
    parts += [Text(doubt) for doubt in doubts if doubt]
    parts += [heading("Gap"), _sizes(diagnosis), Text(wording.basis(diagnosis))]
    if diagnosis.hints:
        parts += [heading("Stopgaps, which explain nothing"), *map(_hint, diagnosis.hints)]
    if diagnosis.notes:
        parts += [heading("Notes"), _notes(diagnosis)]
    return Group(*parts)


def as_text(diagnosis: Diagnosis, width: int = 100) -> str:
    """The same as plain text.

    Args:
        diagnosis: the result.
        width: characters in a line.

    Returns:
        Lines without trailing spaces, the same in every terminal.
    """
    return plain(render(diagnosis), width)


def plain(rendered: RenderableType, width: int) -> str:
    """Something that `rich` prints, as lines without trailing spaces."""
    out = io.StringIO()
    Console(
        file=out,
        width=width,
        color_system=None,
        force_terminal=False,
        force_jupyter=False,
        legacy_windows=False,
    ).print(rendered)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def heading(text: str) -> Text:
    """The heading of a part."""
    return Text(f"\n{text}", style="bold")


def table_of(*columns: str, right: tuple[str, ...] = ()) -> Table:
    """An empty table; the columns in `right` are numbers."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    for name in columns:
        justify: Literal["left", "right"] = "right" if name in right else "left"
        # What a table is of is a name, to be copied whole.
        whole = name == columns[0]
        least = min(len(name), 6)
        table.add_column(name, justify=justify, overflow="fold", min_width=least, no_wrap=whole)
    return table


def add_row(table: Table, *cells: str) -> None:
    """Adds a row of plain text; names are not markup."""
    table.add_row(*(Text(cell) for cell in cells))


def _locations(diagnosis: Diagnosis) -> Table:
    signal = diagnosis.locations[0].signal
    part = "of the gap" if signal == "position" else f"of the {wording.words(signal)} gap"
    table = table_of("joint", "regime", part, "lift", right=(part, "lift"))
    for at in diagnosis.locations[:_TOP]:
        share, lift = percent(at.share), f"{at.lift:.1f}×"
        add_row(table, wording.site(at.joint), wording.words(at.regime), share, lift)
    return table


def _effects(diagnosis: Diagnosis) -> Table:
    table = table_of("effect", "parameter", "value")
    unit = diagnosis.gap.position.unit
    for named in diagnosis.effects:
        sure, after = wording.sure(named.confidence), quantity(named.gap_after, unit)
        add_row(table, wording.label(named.effect), f"{sure} sure", f"gap after: {after}")
        for place, name, value, its_unit in _parameters(named):
            add_row(table, f"  {place}", name, f"{value} {its_unit}".rstrip())
    return table


def _parameters(named: NamedEffect) -> list[tuple[str, str, str, str]]:
    rows = []
    for of in named.parameters:
        value, unit, warning = wording.estimate(of)
        place = f"body {of.place}" if of.place in named.bodies else of.place
        text = f"{value} ({warning})" if warning else value
        rows.append((wording.site(place), wording.label(of.name), text, unit))
    sites = wording.listed([wording.site(name) for name in named.joints or named.bodies])
    return rows or [(sites, "", "", "")]


def _changes(diagnosis: Diagnosis) -> Table:
    numbers = ("was", "is", "change")
    table = table_of("joint", "field", *numbers, "unit", right=numbers)
    for row in changes(diagnosis):
        add_row(table, row.place, row.field, row.was, row.now, row.change, row.unit)
    return table


def _hint(hint: Hint) -> Text:
    written = f" It goes to {wording.label(hint.file)} beside the model." if hint.file else ""
    title, statement = wording.label(hint.title), wording.label(hint.statement)
    return Text(f"{title}: {statement}. With it, {wording.hint_gap(hint)}.{written}")


def _sizes(diagnosis: Diagnosis) -> Table:
    columns = wording.size_columns(diagnosis)
    table = table_of("signal", *columns, right=columns)
    for name, size in wording.signals(diagnosis.gap).items():
        add_row(table, wording.words(name), *wording.size_cells(diagnosis, size))
    return table


def _notes(diagnosis: Diagnosis) -> Table:
    table = Table.grid(padding=(0, 1))
    for index, note in enumerate(diagnosis.notes, start=1):
        add_row(table, f"{index}.", " ".join(wording.label(line) for line in note.split()))
    return table
