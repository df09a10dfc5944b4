"""The figures of the report, as plotly specifications that hold no numpy and no identifiers.

Okabe–Ito colours; every series also has a dash, a hatch or its number written on it. Names come
from the user's files and plotly reads tags in text, so that they are escaped here, and again by
whoever embeds the specification in a page.
"""

from __future__ import annotations

import html
import json
import math
import textwrap
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from walkerkit.gap.report import wording
from walkerkit.gap.report.diagnosis import Diagnosis
from walkerkit.gap.report.quantity import percent, quantity, scale

Specification = dict[str, Any]

BLACK, SKY, BLUE, VERMILLION, GREY = "#000000", "#56B4E9", "#0072B2", "#D55E00", "#767676"
_FONT = {"family": "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif", "size": 13}
_STEP_WIDTH = 42  # characters of a line that a phone has room for
_LEGEND = {"orientation": "h", "x": 0, "y": 1, "xanchor": "left", "yanchor": "bottom"}
_BAR = 0.4  # of a step's height


def waterfall(diagnosis: Diagnosis) -> Specification:
    """The gap shrinking: as given, what each effect takes away, and the floors as lines.

    It is the gap of the position, or of the signal that shrank where position hides the change.
    """
    signal, size = wording.telling(diagnosis.gap)
    steps = _steps(diagnosis, signal)
    floors = [
        ("noise floor", size.noise_floor, "dash", BLACK),
        ("numerical floor", size.numerical_floor, "dot", GREY),
    ]
    sizes = [after for _, _, after in steps]
    known = (x for x in (*sizes, *(floor for _, floor, _, _ in floors)) if math.isfinite(x))
    largest = max(known, default=0.0)
    unit = scale(largest, size.unit)
    rows = [row + 0.05 for row in range(len(steps))]
    figure = go.Figure(
        go.Bar(
            x=[after * unit.factor for after in sizes],
            y=rows,
            orientation="h",
            width=_BAR,
            hoverinfo="skip",
            showlegend=False,
            marker={
                "color": [VERMILLION, *[BLUE] * (len(steps) - 1)],
                "pattern": {"shape": ["/", *[""] * (len(steps) - 1)], "size": 6},
            },
        )
    )
    _add_changes(figure, steps, rows, unit.factor)
    ends = [-0.7, len(steps) - 0.6]
    for name, floor, dash, color in floors:
        figure.add_scatter(
            x=[floor * unit.factor] * 2,
            y=ends,
            mode="lines",
            name=f"{name}, {quantity(floor, size.unit)}",
            line={"color": color, "dash": dash, "width": 2},
            hoverinfo="skip",
        )
    for row, (name, before, after) in enumerate(steps):
        _label(figure, 0, row - 0.22, _short(name), anchor="bottom")
        shown = [x for x in (before, after) if math.isfinite(x)]
        end = max(shown, default=0.0) * unit.factor
        text = _with_change(after, size.before, size.unit)
        _label(figure, end, row + 0.05, f" {literal(text)}", anchor="middle")
    title = f"{wording.words(signal)} error, rms [{unit.unit}]"
    figure.update_xaxes(title=title, fixedrange=True)
    figure.update_xaxes(range=[0, 1.8 * largest * unit.factor or 1], zeroline=False)
    figure.update_yaxes(
        range=ends[::-1], fixedrange=True, showgrid=False, zeroline=False, showticklabels=False
    )
    figure.update_layout(barmode="overlay")
    return specification(figure, height=120 + 56 * len(steps), above=56)


def _add_changes(
    figure: go.Figure,
    steps: list[tuple[str, float, float]],
    rows: list[float],
    factor: float,
) -> None:
    """Adds bars of what each step takes away or adds."""
    for name, sign, color, shape in (
        ("taken away", 1, SKY, "\\"),
        ("added", -1, VERMILLION, "x"),
    ):
        changes = [
            (row, min(before, after), abs(before - after))
            for row, (_, before, after) in zip(rows, steps, strict=True)
            if math.isfinite(before - after) and sign * (before - after) > 0
        ]
        if changes:
            figure.add_bar(
                x=[change * factor for _, _, change in changes],
                base=[start * factor for _, start, _ in changes],
                y=[row for row, _, _ in changes],
                orientation="h",
                width=_BAR,
                name=name,
                hoverinfo="skip",
                marker={
                    "color": "#FFFFFF",
                    "line": {"color": color, "width": 1},
                    "pattern": {"shape": shape, "fgcolor": color, "size": 5, "solidity": 0.25},
                },
            )


def _steps(diagnosis: Diagnosis, signal: str) -> list[tuple[str, float, float]]:
    """What was done, the gap before it and after it; the first is the model as it was given."""
    size = wording.signals(diagnosis.gap)[signal]
    found = [("model as given", size.before, size.before)]
    for named in diagnosis.effects:
        known = {"position": named.gap_after, **named.gaps_after}
        if signal in known:
            found.append((f"+ {wording.step(named)}", found[-1][2], known[signal]))
    last = found[-1][2]
    if diagnosis.effects and quantity(last, size.unit) != quantity(size.after, size.unit):
        found.append(("all, fitted together", last, size.after))
    return found


def comparison(mended: bool) -> Specification:
    """Axes and empty series: the signal, and the errors below it; the page fills them in.

    Args:
        mended: whether there is a mended model to show beside the one that was given.
    """
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.6, 0.4], vertical_spacing=0.06
    )
    lines = {"as given": {"color": VERMILLION, "dash": "dot", "width": 1.8}}
    if mended:
        lines["mended"] = {"color": BLUE, "dash": "dash", "width": 1.8}
    signals = {
        "measured": {"color": BLACK, "width": 1.4},
        "commanded": {"color": GREY, "dash": "longdashdot", "width": 1},
    }
    for row, shown in (1, signals | lines), (2, lines):
        for name, line in shown.items():
            figure.add_scatter(
                x=[], y=[], mode="lines", name=name, line=line, showlegend=row == 1, row=row, col=1
            )
    figure.add_shape(
        type="rect",
        xref="paper",
        yref="y2",
        x0=0,
        x1=1,
        y0=0,
        y1=0,
        fillcolor=GREY,
        opacity=0.25,
        line_width=0,
        layer="below",
    )
    figure.update_xaxes(title="time [s]", row=2, col=1)
    figure.update_layout(hovermode="x unified", dragmode="zoom")
    return specification(figure, height=580, above=84)


def _label(figure: go.Figure, x: float, y: float, text: str, *, anchor: str) -> None:
    figure.add_annotation(
        x=x,
        y=y,
        text=text,
        showarrow=False,
        xanchor="left",
        yanchor=anchor,
        bgcolor="#FFFFFF",  # over the lines of the floors
        borderpad=0,
    )


def _with_change(size: float, before: float, unit: str) -> str:
    text = quantity(size, unit)
    if size == before or not (before > 0 and math.isfinite(size) and math.isfinite(before)):
        return text
    change = size / before - 1
    return f"{text} ({'+' if change > 0 else ''}{percent(change)})"


def _short(name: str) -> str:
    """A name on one line, broken at its underscores; the page has it in full elsewhere."""
    apart = name.replace("_", "_ ")
    (line, *_) = textwrap.wrap(apart, _STEP_WIDTH, max_lines=1, placeholder=" …")
    return literal(line.replace("_ ", "_"))


def literal(text: str) -> str:
    """Text that plotly shows as it is; it would read tags, and mathematics between dollars."""
    return html.escape(text, quote=False).replace("$", "&#36;")


def specification(figure: go.Figure, height: int, above: int, below: int = 48) -> Specification:
    """A finished figure in the style of the report; height and margins in pixels."""
    figure.update_layout(
        template="none",
        height=height,
        font=_FONT,
        margin={"l": 8, "r": 16, "t": above, "b": below},
        legend=_LEGEND,
        modebar={"bgcolor": "rgba(0,0,0,0)", "color": GREY, "activecolor": BLACK},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
    )
    axis = {"automargin": True, "gridcolor": "#E4E4E4", "linecolor": "#999999"}
    figure.update_xaxes(**axis, title={"font": _FONT, "standoff": 10})
    figure.update_yaxes(**axis, title={"font": _FONT, "standoff": 10})
    made: Specification = json.loads(figure.to_json())
    return made
