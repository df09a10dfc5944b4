"""A policy's gap as one HTML file that needs no network, in the style of a robot's report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import plotly.graph_objects as go

from walkerkit.gap.policy import policy_wording
from walkerkit.gap.report.figures import (
    BLACK,
    BLUE,
    GREY,
    VERMILLION,
    Specification,
    literal,
    specification,
)
from walkerkit.gap.report.html import write_html
from walkerkit.gap.report.wording import label

if TYPE_CHECKING:
    from walkerkit.gap.policy.outcome import Outcome
    from walkerkit.gap.policy.policy_gap import PolicyGap

_LINE = 44  # pixels of a robot
_SPREAD = 0.22  # of a line, over which the episodes are laid out
_AXES = {"return": "return of an episode", "falls": "seconds until the end"}


def write_page(found: PolicyGap, path: Path) -> None:
    """Writes the page.

    Args:
        found: what the effects do to the policy.
        path: the HTML file; an existing one is replaced.

    Raises:
        OSError: the file cannot be written.
    """
    unit = "" if found.tracking is None else found.tracking[1]
    write_html(
        path,
        "policy.html.j2",
        package="walkerkit.gap.policy",
        answer=label(policy_wording.answer(found)),
        next_step=label(policy_wording.next_step(found)),
        parts=[
            tuple(map(label, policy_wording.part_cells(found, part)))
            for part in found.judgement.parts
        ],
        rivals=[
            tuple(map(label, policy_wording.rival_cells(found, one)))
            for one in found.judgement.rivals
        ],
        columns=policy_wording.COLUMNS,
        robots=[tuple(map(label, policy_wording.cells(one, unit))) for one in found.outcomes],
        tracked="" if found.tracking is None else label(found.tracking[0]),
        notes=[label(note) for note in found.notes],
        figures={"episodes": _episodes(found)},
    )


def _episodes(found: PolicyGap) -> Specification:
    """Every episode of every robot, those that fell marked, and their means."""
    figure = go.Figure()
    title = _AXES.get(found.measure, "")
    if found.measure == "tracking" and found.tracking is not None:
        title = f"rms of {found.tracking[0]} [{found.tracking[1]}]"
    for fell, name, colour, symbol in (
        (False, "stayed on its feet", BLUE, "circle-open"),
        (True, "fell", VERMILLION, "x"),
    ):
        places = [
            (_size(found, outcome)[k], row + _offset(k, len(outcome.episodes)))
            for row, outcome in enumerate(found.outcomes)
            for k, one in enumerate(outcome.episodes)
            if one.fell == fell
        ]
        figure.add_scatter(
            x=[x for x, _ in places],
            y=[y for _, y in places],
            mode="markers",
            name=name,
            marker={"color": colour, "symbol": symbol, "size": 7},
            hoverinfo="x",
        )
    means = [sum(_size(found, one)) / len(one.episodes) for one in found.outcomes]
    figure.add_scatter(
        x=means,
        y=[*range(len(means))],
        mode="markers",
        name="mean",
        marker={
            "color": BLACK,
            "symbol": "line-ns-open",
            "size": 18,
            "line": {"width": 2, "color": BLACK},
        },
        hoverinfo="x",
    )
    figure.add_vline(x=means[0], line={"color": GREY, "dash": "dot", "width": 1})
    figure.update_xaxes(title=literal(title), fixedrange=True, rangemode="tozero")
    figure.update_yaxes(
        tickvals=[*range(len(means))],
        ticktext=[literal(one.name) for one in found.outcomes],
        range=[len(means) - 0.4, -0.6],
        fixedrange=True,
        zeroline=False,
    )
    return specification(figure, height=140 + _LINE * len(means), above=56)


def _size(found: PolicyGap, outcome: Outcome) -> list[float]:
    """What is drawn of each episode."""
    if found.measure == "falls":
        return [one.seconds for one in outcome.episodes]
    if found.measure == "tracking":
        return [one.tracking or 0.0 for one in outcome.episodes]
    return [one.total for one in outcome.episodes]


def _offset(k: int, n: int) -> float:
    """Where in its line an episode is."""
    return _SPREAD * (2 * k / max(1, n - 1) - 1)
