"""A policy's gap in a terminal: the answer, what each effect takes, how it did on each robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group, RenderableType

from walkerkit.gap.policy import policy_wording
from walkerkit.gap.report.console import Paragraph, Rows, heading, numbered, plain
from walkerkit.gap.report.wording import label

if TYPE_CHECKING:
    from walkerkit.gap.policy.policy_gap import PolicyGap


def render(found: PolicyGap) -> RenderableType:
    """The policy's gap as something that `rich` prints."""
    unit = "" if found.tracking is None else found.tracking[1]
    numbers = ("part of the loss", "alone", "regained")
    parts = Rows("effect", *numbers, "verdict", right=numbers)
    for part in found.judgement.parts:
        parts.add(*map(label, policy_wording.part_cells(found, part)))
    shown: list[RenderableType] = [
        Paragraph(policy_wording.answer(found), "bold"),
        Paragraph(policy_wording.next_step(found)),
        heading("What each effect takes"),
        parts,
    ]
    if found.judgement.rivals:
        rivals = Rows("rival", "loss", "verdict", right=("loss",))
        for one in found.judgement.rivals:
            rivals.add(*map(label, policy_wording.rival_cells(found, one)))
        shown += [heading("What it may be instead"), rivals]
    robots = Rows(*policy_wording.COLUMNS, right=policy_wording.COLUMNS[1:])
    for outcome in found.outcomes:
        robots.add(*map(label, policy_wording.cells(outcome, unit)))
    shown += [heading("How the policy did"), robots]
    if found.tracking is not None:
        shown.append(Paragraph(f"Tracking is the rms of {found.tracking[0]}."))
    if found.notes:
        shown += [heading("Notes"), numbered(found.notes)]
    return Group(*shown)


def as_text(found: PolicyGap, width: int = 120) -> str:
    """The same as plain text, `width` characters in a line."""
    return plain(render(found), width)
