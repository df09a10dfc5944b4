"""The figures of the report, as plotly specifications that hold no numpy and no identifiers.

Okabe–Ito colours; every series also has a dash, a hatch or its number written on it. Names come
from the user's files and plotly reads tags in text, so that they are escaped here, and again by
whoever embeds the specification in a page.
"""

from __future__ import annotations

import html
import itertools
import json
import math
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from walkerkit.gap.report import wording
from walkerkit.gap.report.diagnosis import Diagnosis, GapSize, Location, Trace
from walkerkit.gap.report.quantity import number, percent, quantity, scale

FloatArray = NDArray[np.float64]
Specification = dict[str, Any]

BLACK, SKY, BLUE, VERMILLION, GREY = "#000000", "#56B4E9", "#0072B2", "#D55E00", "#767676"
POINTS = 2000  # of a trace; more than a screen has columns
_FONT = {"family": "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif", "size": 13}
_BLUES = [[0.0, "#FFFFFF"], [0.5, "#8FC3E4"], [1.0, "#00588A"]]  # monotone in lightness
_NAME_WIDTH, _STEP_WIDTH = 20, 46  # characters of a line that a phone has room for
_LEGEND = {"orientation": "h", "x": 0, "y": 1, "xanchor": "left", "yanchor": "bottom"}


def steps(diagnosis: Diagnosis) -> Specification:
    """The gap shrinking: as given, after each effect, and the two floors as lines."""
    gap = diagnosis.gap
    sizes = [("model as given", gap.position.before)]
    sizes += [(f"+ {wording.step(named)}", named.gap_after) for named in diagnosis.effects]
    written = [quantity(size, gap.position.unit) for _, size in sizes]
    if diagnosis.effects and written[-1] != quantity(gap.position.after, gap.position.unit):
        sizes.append(("all, fitted together", gap.position.after))
    floors = (("noise floor", gap.position.noise_floor), ("numerical floor", gap.numerical_floor))
    largest = max((size for _, size in (*sizes, *floors) if math.isfinite(size)), default=0.0)
    unit = scale(largest, gap.position.unit)
    figure = go.Figure(
        go.Bar(
            x=[size * unit.factor for _, size in sizes],
            y=[row + 0.05 for row in range(len(sizes))],
            orientation="h",
            width=0.4,
            text=[_with_change(size, sizes[0][1], gap.position.unit) for _, size in sizes],
            textposition="outside",
            cliponaxis=False,
            hoverinfo="skip",
            showlegend=False,
            marker={
                "color": [VERMILLION, *[BLUE] * (len(sizes) - 1)],
                "pattern": {"shape": ["/", *[""] * (len(sizes) - 1)], "size": 6},
            },
        )
    )
    ends = [-0.7, len(sizes) - 0.6]
    for (name, size), dash, color in zip(floors, ("dash", "dot"), (BLACK, GREY), strict=True):
        figure.add_scatter(
            x=[size * unit.factor] * 2,
            y=ends,
            mode="lines",
            name=f"{name} ({quantity(size, gap.position.unit)})",
            line={"color": color, "dash": dash, "width": 2},
            hoverinfo="skip",
        )
    for row, (name, _) in enumerate(sizes):
        figure.add_annotation(
            x=0,
            y=row - 0.22,
            text=_short(name, _STEP_WIDTH, 1),
            showarrow=False,
            xanchor="left",
            yanchor="bottom",
            bgcolor="#FFFFFF",  # over the lines of the floors
            borderpad=0,
        )
    figure.update_xaxes(title=f"position error, rms [{unit.unit}]", fixedrange=True)
    figure.update_xaxes(range=[0, 1.5 * largest * unit.factor or 1], zeroline=False)
    figure.update_yaxes(
        range=ends[::-1], fixedrange=True, showgrid=False, zeroline=False, showticklabels=False
    )
    return _specification(figure, height=110 + 56 * len(sizes), above=44)


def heat_map(
    locations: Sequence[Location], joints: Sequence[str], regimes: Sequence[str]
) -> Specification:
    """Share of the squared gap, joint by regime, with the lift in the hover."""
    cells = {(at.joint, at.regime): at for at in locations}
    grid = [[cells.get((joint, regime)) for regime in regimes] for joint in joints]
    top = max((at.share for at in locations), default=0.0) or 1.0
    figure = go.Figure(
        go.Heatmap(
            z=[[at and at.share for at in row] for row in grid],
            zmin=0,
            zmax=top,
            colorscale=_BLUES,
            showscale=False,
            xgap=1,
            ygap=1,
            hoverongaps=False,
            hovertext=[[at and _location_text(at) for at in row] for row in grid],
            hovertemplate="%{hovertext}<extra></extra>",
            text=[[_share(at) for at in row] for row in grid],
            texttemplate="%{text}",
            textfont={"size": 11},
        )
    )
    figure.update_xaxes(
        tickvals=list(range(len(regimes))),
        ticktext=[_short(wording.words(regime), _NAME_WIDTH, 2) for regime in regimes],
        tickangle=-90,
        showgrid=False,
        zeroline=False,
        fixedrange=True,
    )
    figure.update_yaxes(
        tickvals=list(range(len(joints))),
        ticktext=[_short(wording.site(joint), _NAME_WIDTH, 2) for joint in joints],
        range=[len(joints) - 0.5, -0.5],
        showgrid=False,
        zeroline=False,
        fixedrange=True,
    )
    return _specification(figure, height=190 + 34 * len(joints), above=8, below=110)


def comparison(mended: bool) -> Specification:
    """Axes and empty series for a `comparison_choice`: the signal, and the errors below it.

    Args:
        mended: whether there is a mended model to show beside the one that was given.
    """
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.6, 0.4], vertical_spacing=0.06
    )
    lines = {"as given": {"color": VERMILLION, "dash": "dot", "width": 1.8}}
    if mended:
        lines["mended"] = {"color": BLUE, "dash": "dash", "width": 1.8}
    for row, shown in (1, {"measured": {"color": BLACK, "width": 1.4}} | lines), (2, lines):
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
    return _specification(figure, height=580, above=72)


def comparison_choice(trace: Trace, size: GapSize | None, mended: bool) -> Specification:
    """One trace, as the two arguments of `Plotly.update`.

    Args:
        trace: what to show.
        size: its gap, for the band of the noise floor; None for no band.
        mended: as in `comparison`.
    """
    kept = decimated(trace)
    simulated = (trace.before, trace.after) if mended else (trace.before,)
    shown = [values[kept] for values in (trace.measured, *simulated)]
    errors = [values - shown[0] for values in shown[1:]]
    unit, error_unit = (scale(_largest(group), trace.unit) for group in (shown, errors))
    floor = 0.0 if size is None else size.noise_floor * error_unit.factor
    time = _rounded(trace.time[kept], digits=7)
    series = [_rounded(values * unit.factor) for values in shown]
    series += [_rounded(values * error_unit.factor) for values in errors]
    signal = _literal(wording.words(trace.signal))
    axes = [f"{axis}.autorange" for axis in ("xaxis", "xaxis2", "yaxis", "yaxis2")]
    return {
        "data": {"x": [time], "y": series},
        "layout": {
            "yaxis.title.text": f"{signal} [{_literal(unit.unit)}]",
            "yaxis2.title.text": f"error [{_literal(error_unit.unit)}]",
            "shapes[0].y0": -floor,
            "shapes[0].y1": floor,
            **dict.fromkeys(axes, True),
        },
    }


def decimated(trace: Trace, points: int = POINTS) -> NDArray[np.intp]:
    """Indices of about `points` samples, with the extremes of both errors among them."""
    if trace.time.size <= points:
        return np.arange(trace.time.size)
    edges = np.linspace(0, trace.time.size, points // 4 + 1).astype(np.intp)
    kept = [np.array([0, trace.time.size - 1], dtype=np.intp)]
    for simulated in (trace.before, trace.after):
        # A rollout that diverged has no error there, and its last finite sample is an extreme.
        error = np.nan_to_num(simulated - trace.measured, nan=0.0, posinf=0.0, neginf=0.0)
        for pick in (np.argmin, np.argmax):
            picked = [a + pick(error[a:b]) for a, b in itertools.pairwise(edges)]
            kept.append(np.array(picked, dtype=np.intp))
    return np.unique(np.concatenate(kept))


def _with_change(size: float, before: float, unit: str) -> str:
    text = quantity(size, unit)
    if size == before or not (before > 0 and math.isfinite(size) and math.isfinite(before)):
        return text
    change = size / before - 1
    return f"{text} ({'+' if change > 0 else ''}{percent(change)})"


def _location_text(at: Location) -> str:
    return (
        f"{_literal(wording.spot(at))}<br>{percent(at.share)} of the squared gap"
        f"<br>lift {number(at.lift)}: that many times its share of the samples"
    )


def _share(at: Location | None) -> str:
    return "" if at is None else _literal(percent(at.share).removesuffix(" %"))


def _short(name: str, width: int, lines: int) -> str:
    """A name on so many lines, broken at its underscores; the page has it in full elsewhere."""
    apart = name.replace("_", "_ ")
    wrapped = textwrap.wrap(apart, width, max_lines=lines, placeholder=" …")
    return "<br>".join(_literal(line.replace("_ ", "_")) for line in wrapped)


def _literal(text: str) -> str:
    """Text that plotly shows as it is; it would read tags, and mathematics between dollars."""
    return html.escape(text, quote=False).replace("$", "&#36;")


def _largest(group: Iterable[FloatArray]) -> float:
    finite = (values[np.isfinite(values)] for values in group)
    return max((float(np.abs(values).max(initial=0.0)) for values in finite), default=0.0)


def _rounded(values: FloatArray, digits: int = 5) -> list[float | None]:
    """Numbers to so many digits of their range, which no screen shows; None is a hole."""
    finite = values[np.isfinite(values)]
    size = float(np.ptp(finite)) if finite.size else 0.0
    places = digits - 1 - math.floor(math.log10(size)) if size > 0 else 9
    return [round(float(x), places) if math.isfinite(x) else None for x in values]


def _specification(figure: go.Figure, height: int, above: int, below: int = 48) -> Specification:
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
    specification: Specification = json.loads(figure.to_json())
    return specification
