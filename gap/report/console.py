"""A diagnosis in a terminal: errors of wiring if any, a verdict, tables, numbered notes.

    rich.print(render(diagnosis))
    text = as_text(diagnosis, width=80)

Nothing is said by colour alone, so that plain text loses nothing. Lines break between words, and
never within a name or between a number and its unit.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from typing import Literal

import pandas as pd
from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from walkerkit.gap.report import wording
from walkerkit.gap.report.changes import changes
from walkerkit.gap.report.diagnosis import Diagnosis, Hint, NamedEffect
from walkerkit.gap.report.quantity import percent, quantity

_TOP = 3  # locations shown
_STRUCTURES = 10  # of a comparison
_BETWEEN = 2  # characters, columns
VERDICT_STYLES = {
    "explained": "bold green",
    "no_gap": "bold green",
    "partly_explained": "bold yellow",
    "unexplained": "bold red",
}


class Paragraph:
    """Text that breaks between words alone.

    Args:
        text: what it says; spaces and line breaks in a row are one.
        style: rich's.
        head: what it begins with, in a style of its own.
        head_style: that style.
    """

    def __init__(self, text: str, style: str = "", *, head: str = "", head_style: str = ""):
        self._words = [word for word in re.split(r"[ \n]+", f"{head} {text}") if word]
        self._style, self._head, self._head_style = style, len(head), head_style

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Lines no longer than there is room, but for words that are."""
        lines = textwrap.wrap(
            wording.tight(" ".join(self._words)),
            options.max_width,
            break_long_words=False,
            break_on_hyphens=False,
        )
        text = Text("\n".join(lines).replace("\N{NO-BREAK SPACE}", " "), style=self._style)
        text.stylize(self._head_style, 0, self._head)
        text.no_wrap, text.overflow = True, "ignore"
        yield text

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        """From its longest word to all of it in a line."""
        longest = max(map(len, self._words), default=0)
        return Measurement(longest, len(" ".join(self._words))).with_maximum(options.max_width)


class Rows:
    """A table that breaks no name: its rows stand under each other where it has no room.

    Args:
        *columns: their names.
        right: those of numbers, which do not break at all.
    """

    def __init__(self, *columns: str, right: tuple[str, ...] = ()):
        self._columns, self._right = columns, right
        self._rows: list[tuple[str, ...]] = []

    def add(self, *cells: str) -> None:
        """Adds a row of plain text; names are not markup, and cells that are missing are empty."""
        self._rows.append((*cells, *[""] * (len(self._columns) - len(cells))))

    @property
    def row_count(self) -> int:
        """How many rows it has."""
        return len(self._rows)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The table, or its rows one after the other."""
        least = [self._least(k) for k in range(len(self._columns))]
        if sum(least) + _BETWEEN * (len(least) - 1) > options.max_width:
            yield from self._apart()
            return
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
        for name, width in zip(self._columns, least, strict=True):
            justify: Literal["left", "right"] = "right" if name in self._right else "left"
            table.add_column(name, justify=justify, min_width=width)
        for cells in self._rows:
            table.add_row(*(Text(cell) for cell in cells))
        yield table

    def _least(self, column: int) -> int:
        """The width that a column needs; what a table is of is a name, to be copied whole."""
        name = self._columns[column]
        cells = [row[column] for row in self._rows]
        if not column or name in self._right:
            return max(map(cell_len, (name, *cells)))
        return max(cell_len(word) for cell in (name, *cells) for word in cell.split() or [""])

    def _apart(self) -> RenderResult:
        for first, *others in self._rows:
            yield Paragraph(first)
            for name, cell in zip(self._columns[1:], others, strict=True):
                if cell:
                    yield Padding(Paragraph(f"{name}: {cell}"), (0, 0, 0, 2))


def comparison_table(comparison: pd.DataFrame) -> RenderableType:
    """The most probable structures of a search as a table: see docs/decision.md."""
    numbers = ("elpd", "difference", "weight")
    table = Rows("structure", *numbers, right=numbers)
    for row in comparison.head(_STRUCTURES).to_dict("records"):
        table.add(
            row["structure"],
            f"{row['elpd']:.1f}",
            f"{row['difference']:.1f} ± {row['se']:.1f}",
            percent(row["weight"]),
        )
    return Group(heading("Structures that were compared, the most probable first"), table)


def render(diagnosis: Diagnosis) -> RenderableType:
    """The diagnosis as something that `rich` prints."""
    verdict = Paragraph(
        wording.verdict_sentence(diagnosis),
        head=f"{wording.title(diagnosis)}.",
        head_style=VERDICT_STYLES[diagnosis.verdict],
    )
    parts: list[RenderableType] = [
        Group(Paragraph(f"Wiring: {sentence}", "bold"), "")
        for sentence in wording.wiring(diagnosis)
    ]
    parts.append(verdict)
    if wording.unknown(diagnosis):
        parts.append(Paragraph(wording.unknown(diagnosis)))
    if diagnosis.locations and diagnosis.verdict != "no_gap":
        parts += [heading("Where"), _locations(diagnosis)]
    if diagnosis.effects:
        parts += [heading("Effects, the surest first"), _effects(diagnosis)]
        parts += [Paragraph(warning) for warning in wording.warnings(diagnosis)]
    written = _changes(diagnosis)
    if written.row_count:
        parts += [heading("What changes in the model"), written]
    doubts = [*wording.doubts(diagnosis), wording.advice(diagnosis)]
    if doubts[0]:
        parts.append(heading("What cannot be told apart, and what would tell"))
    parts += [Paragraph(doubt) for doubt in doubts if doubt]
    parts += [heading("Gap"), _sizes(diagnosis), Paragraph(wording.basis(diagnosis))]
    if diagnosis.hints:
        parts += [heading("Stopgaps, which explain nothing"), *map(_hint, diagnosis.hints)]
    if diagnosis.notes:
        parts += [heading("Notes"), numbered(diagnosis.notes)]
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


def _locations(diagnosis: Diagnosis) -> Rows:
    signal = diagnosis.locations[0].signal
    part = "of the gap" if signal == "position" else f"of the {wording.words(signal)} gap"
    table = Rows("joint", "regime", part, "lift", right=(part, "lift"))
    for at in diagnosis.locations[:_TOP]:
        share, lift = percent(at.share), f"{at.lift:.1f}×"
        table.add(wording.site(at.joint), wording.words(at.regime), share, lift)
    return table


def _effects(diagnosis: Diagnosis) -> Rows:
    table = Rows("effect", "parameter", "value")
    unit = diagnosis.gap.position.unit
    for named in diagnosis.effects:
        sure, after = wording.sure(named.confidence), quantity(named.gap_after, unit)
        table.add(wording.label(named.effect), f"{sure} sure", f"gap after: {after}")
        for place, name, value, its_unit in _parameters(named):
            table.add(f"  {place}", name, f"{value} {its_unit}".rstrip())
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


def _changes(diagnosis: Diagnosis) -> Rows:
    numbers = ("was", "is", "change")
    table = Rows("joint", "field", *numbers, "unit", right=numbers)
    for row in changes(diagnosis):
        table.add(row.place, row.field, row.was, row.now, row.change, row.unit)
    return table


def _hint(hint: Hint) -> Paragraph:
    written = f" It goes to {wording.label(hint.file)} beside the model." if hint.file else ""
    title, statement = wording.label(hint.title), wording.label(hint.statement)
    return Paragraph(f"{title}: {statement}. With it, {wording.hint_gap(hint)}.{written}")


def _sizes(diagnosis: Diagnosis) -> Rows:
    columns = wording.size_columns(diagnosis)
    table = Rows("signal", *columns, right=columns)
    for name, size in wording.signals(diagnosis.gap).items():
        table.add(wording.words(name), *wording.size_cells(diagnosis, size))
    return table


def numbered(notes: Sequence[str]) -> RenderableType:
    """Notes with their numbers."""
    table = Table.grid(padding=(0, 1))
    for index, note in enumerate(notes, start=1):
        table.add_row(Text(f"{index}."), Paragraph(" ".join(map(wording.label, note.split()))))
    return table
