"""Small line plots as SVG text, drawn in no time: the pictures of the site are many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import ArrayLike

WIDTH, HEIGHT = 340, 130  # of a panel
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 8, 8, 22
_MOST_POINTS = 250
_COLORS = {"before": "#9e9e9e", "after": "#1565c0", "difference": "#c62828"}
_WORDS = {"before": "as it is", "after": "with the effect", "difference": "difference"}


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One pair of axes.

    Attributes:
        label: of the y axis, with its unit.
        x: (n,) values of the x axis.
        lines: what each line is (`before`, `after` or `difference`), and its (n,) values.
    """

    label: str
    x: ArrayLike
    lines: Sequence[tuple[str, ArrayLike]]


def drawing(
    title: str,
    panels: Sequence[Sequence[Panel]],
    x_label: str = "time [s]",
    words: Mapping[str, str] = _WORDS,
) -> str:
    """Rows of panels with a title and a legend above them, as an SVG file.

    Args:
        title: above the panels.
        panels: rows of them.
        x_label: of all x axes.
        words: what each line is called.
    """
    width, height = WIDTH * len(panels[0]), HEIGHT * len(panels) + 40
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="10">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        f'<text x="{_LEFT}" y="14" font-weight="bold">{escape(title)}</text>',
        *_legend(width, words),
    ]
    for r, row in enumerate(panels):
        for c, panel in enumerate(row):
            parts.append(f'<g transform="translate({c * WIDTH} {r * HEIGHT + 22})">')
            parts.extend(_panel(panel))
            parts.append("</g>")
    parts += [f'<text x="{width / 2}" y="{height - 6}" text-anchor="middle">{x_label}</text>']
    return "\n".join([*parts, "</svg>", ""])


def _legend(width: int, words: Mapping[str, str]) -> list[str]:
    spans = [
        f'<tspan fill="{_COLORS[kind]}">{escape(word)}</tspan>' for kind, word in words.items()
    ]
    return [f'<text x="{width - 8}" y="14" text-anchor="end">{" · ".join(spans)}</text>']


def _panel(panel: Panel) -> list[str]:
    x = np.asarray(panel.x, float)
    lines = [(kind, np.asarray(values, float)) for kind, values in panel.lines]
    low = min(float(values.min()) for _, values in lines)
    high = max(float(values.max()) for _, values in lines)
    if high - low < 1e-12:
        low, high = low - 1, high + 1
    across, down = WIDTH - _LEFT - _RIGHT, HEIGHT - _TOP - _BOTTOM
    every = max(1, len(x) // _MOST_POINTS)
    right = _LEFT + (x - x[0]) / (x[-1] - x[0]) * across
    drawn = [f'<rect x="{_LEFT}" y="{_TOP}" width="{across}" height="{down}" fill="none" ']
    drawn[0] += 'stroke="#cccccc"/>'
    for kind, values in lines:
        height = _TOP + (high - values) / (high - low) * down
        points = " ".join(
            f"{px:.0f},{py:.1f}" for px, py in zip(right[::every], height[::every], strict=True)
        )
        drawn.append(
            f'<polyline points="{points}" fill="none" stroke="{_COLORS[kind]}" stroke-width="1.3"/>'
        )
    middle = _TOP + down / 2
    for value, at in ((high, _TOP + 8), (low, _TOP + down)):
        told = 0.0 if abs(value) < 1e-3 * (high - low) else value
        drawn.append(f'<text x="{_LEFT - 4}" y="{at}" text-anchor="end">{told:.3g}</text>')
    for value, at, anchor in ((x[0], _LEFT, "start"), (x[-1], _LEFT + across, "end")):
        drawn.append(
            f'<text x="{at}" y="{_TOP + down + 12}" text-anchor="{anchor}">{value:.3g}</text>'
        )
    drawn.append(
        f'<text transform="translate(12 {middle}) rotate(-90)" text-anchor="middle">'
        f"{escape(panel.label)}</text>"
    )
    return drawn
