"""A policy's gap in a terminal: the answer, what each effect takes, how it did on each robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from walkerkit.gap.policy import wording
from walkerkit.gap.report.console import add_row, heading, plain, table_of
from walkerkit.gap.report.wording import label

if TYPE_CHECKING:
    from walkerkit.gap.policy.policy_gap import PolicyGap


def render(found: PolicyGap) -> RenderableType:
    """The policy's gap as something that `rich` prints."""
    unit = "" if found.tracking is None else found.tracking[1]
    numbers = ("part of the loss", "alone", "regained")
    parts = table_of("effect", *numbers, "verdict", right=numbers)
    for part in found.judgement.parts:
        add_row(parts, *map(label, wording.part_cells(found, part)))
    shown: list[RenderableType] = [
        Text(wording.answer(found), style="bold"),
        Text(wording.next_step(found)),
        heading("What each effect takes"),
        parts,
    ]
    if found.judgement.rivals:
        rivals = table_of("rival", "loss", "verdict", right=("loss",))
        for one in found.judgement.rivals:
            add_row(rivals, *map(label, wording.rival_cells(found, one)))
        shown += [heading("What it may be instead"), rivals]
    robots = table_of(*wording.COLUMNS, right=wording.COLUMNS[1:])
    for outcome in found.outcomes:
        add_row(robots, *map(label, wording.cells(outcome, unit)))
    shown += [heading("How the policy did"), robots]
    if found.tracking is not None:
        shown.append(Text(f"Tracking is the rms of {found.tracking[0]}."))
    if found.notes:
        notes = Table.grid(padding=(0, 1))
        for index, note in enumerate(found.notes, start=1):
            add_row(notes, f"{index}.", label(note))
        shown += [heading("Notes"), notes]
    return Group(*shown)


def as_text(found: PolicyGap, width: int = 120) -> str:
    """The same as plain text, `width` characters in a line."""
    return plain(render(found), width)
