"""The figures of the fleet's page, in the style of the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from walkerkit.gap.fleet.comparison import Row
from walkerkit.gap.fleet.fleet_wording import spot
from walkerkit.gap.report.figures import (
    BLACK,
    BLUE,
    VERMILLION,
    Specification,
    literal,
    specification,
)
from walkerkit.gap.report.quantity import scale
from walkerkit.gap.report.wording import label

if TYPE_CHECKING:
    from walkerkit.gap.fleet.fleet import Fleet

_MANY_DECADES = 6
_LINE = 24  # pixels of a robot
_HEAD = 64  # pixels between two parameters
_NORMAL_95 = 1.96
_SIZES = ("before", "after", "noise_floor")


def gaps(fleet: Fleet) -> Specification | None:
    """The gap of each robot before and after, over its noise floor; of one unit, the first's."""
    sizes = {one.robot: one.diagnosis["gap"] for one in fleet.outcomes if one.diagnosis is not None}
    first = next(iter(sizes.values()), {"unit": ""})["unit"]
    # The axis is logarithmic, and has no place for nothing.
    shown = {
        robot: size
        for robot, size in sizes.items()
        if size["unit"] == first and size["before"] and size["after"]
    }
    if len(shown) < 2:
        return None
    known = list(shown.values())
    unit = scale(max(size["before"] for size in known), first)
    names = [label(robot) for robot in shown]
    rows = list(range(len(names)))
    figure = go.Figure()
    for row, size in zip(rows, known, strict=True):
        ends = [size["before"] * unit.factor, size["after"] * unit.factor]
        figure.add_scatter(
            x=ends,
            y=[row, row],
            mode="lines",
            line={"color": "#999999", "width": 1},
            hoverinfo="skip",
            showlegend=False,
        )
    marks = (
        ("before", "before", {"color": VERMILLION, "symbol": "x", "size": 9}),
        ("after", "after", {"color": BLUE, "symbol": "circle", "size": 9}),
        (
            "noise_floor",
            "noise floor",
            {"color": BLACK, "symbol": "line-ns-open", "size": 12, "line": {"width": 2}},
        ),
    )
    for key, name, marker in marks:
        values = [size[key] * unit.factor if size[key] else None for size in known]
        figure.add_scatter(
            x=values, y=rows, mode="markers", name=name, marker=marker, hoverinfo="x"
        )
    _robots(figure, names)
    figure.update_xaxes(type="log", title=f"position error, rms [{unit.unit}]", fixedrange=True)
    shown_values = [v * unit.factor for size in known for v in map(size.get, _SIZES) if v]
    ticks = _ticks(min(shown_values), max(shown_values))
    figure.update_xaxes(tickvals=ticks, ticktext=[f"{tick:g}" for tick in ticks])
    return specification(figure, height=140 + _LINE * len(names), above=56)


def _ticks(smallest: float, largest: float) -> list[float]:
    """1, 2, 5, 10, ... over a logarithmic axis; the powers of ten alone where it is long."""
    powers = range(math.floor(math.log10(smallest)), math.ceil(math.log10(largest)) + 1)
    steps = (1, 2, 5) if len(powers) < _MANY_DECADES else (1,)
    return [float(f"{step}e{power}") for power in powers for step in steps]


def parameters(rows: Sequence[Row]) -> Specification | None:
    """Each parameter that at least two robots have, with 95 % intervals, robot by robot."""
    shown = [(row, name, of) for row in rows for name, of in row.parameters.items() if len(of) > 1]
    if not shown:
        return None
    heights = [len(of) * _LINE for _, _, of in shown]
    total = sum(heights) + _HEAD * (len(shown) - 1)
    figure = make_subplots(
        rows=len(shown),
        cols=1,
        row_heights=[float(height) for height in heights],
        vertical_spacing=_HEAD / total if len(shown) > 1 else 0.0,
        subplot_titles=[literal(f"{spot(row)}: {label(name)}") for row, name, _ in shown],
    )
    figure.update_annotations(x=0, xanchor="left", font_size=13)
    for place, (_, _, of) in enumerate(shown, start=1):
        unit_name = next(iter(of.values())).unit
        finite = [one.value for one in of.values() if math.isfinite(one.value)]
        unit = scale(max(map(abs, finite), default=0.0), unit_name)
        for free in (True, False):
            chosen = [
                (index, one)
                for index, one in enumerate(of.values())
                if one.at_bound != free and math.isfinite(one.value)
            ]
            errors = [_NORMAL_95 * (one.std or 0.0) * unit.factor for _, one in chosen]
            figure.add_scatter(
                x=[one.value * unit.factor for _, one in chosen],
                y=[index for index, _ in chosen],
                mode="markers",
                marker={"color": BLUE, "symbol": "circle" if free else "circle-open", "size": 8},
                error_x={"type": "data", "array": errors, "color": BLUE, "visible": free},
                hoverinfo="x",
                showlegend=False,
                row=place,
                col=1,
            )
        figure.update_xaxes(title=unit.unit, fixedrange=True, row=place, col=1)
        _robots(figure, [label(robot) for robot in of], row=place, col=1)
    return specification(figure, height=total + 100, above=40)


def _robots(figure: go.Figure, names: Sequence[str], **place: int) -> None:
    """The robots from top to bottom."""
    figure.update_yaxes(
        tickvals=list(range(len(names))),
        ticktext=[literal(name) for name in names],
        range=[len(names) - 0.4, -0.6],
        fixedrange=True,
        zeroline=False,
        **place,
    )
