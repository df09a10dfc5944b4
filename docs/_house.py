"""The picture of the house: its floors, what is on each, and which way imports go, as SVG text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from xml.sax.saxutils import escape

WIDTH = 760
_BOX, _FLOOR, _MARGIN, _GAP = 26, 58, 16, 12
_LETTER = 6.6  # of a label, wide


def house(layers: Sequence[Sequence[str]], graph: Mapping[str, Iterable[str]]) -> str:
    """Draws layers as floors, the lowest at the bottom, with a line for each pair of parts.

    Args:
        layers: names of the parts of each, from the ground up: folders or modules.
        graph: module to the modules that it imports.

    Returns:
        The SVG file. A line is the wider, the more modules of the part above import that below.
    """
    every = [part for parts in layers for part in parts]
    height = _FLOOR * len(layers) + 2 * _MARGIN
    places: dict[str, tuple[float, float, float]] = {}  # to the middle, top and width of its box
    for floor, parts in enumerate(layers):
        top = height - _MARGIN - _FLOOR * (floor + 1) + (_FLOOR - _BOX) / 2
        widths = [_LETTER * len(part) + 16 for part in parts]
        left = (WIDTH - sum(widths) - _GAP * (len(parts) - 1)) / 2
        for part, width in zip(parts, widths, strict=True):
            places[part] = left + width / 2, top, width
            left += width + _GAP
    imports = Counter(
        (above, below)
        for module, imported in graph.items()
        for other in imported
        if (above := _part(module, every)) != (below := _part(other, every))
    )
    lines = [
        f'<path d="{_curve(places[a], places[b])}" stroke="#1565c0" stroke-opacity="0.35" '
        f'stroke-width="{min(4.0, 0.8 + 0.12 * count):.1f}" fill="none"/>'
        for (a, b), count in sorted(imports.items())
    ]
    boxes = [
        f'<rect x="{middle - width / 2:.0f}" y="{top:.0f}" width="{width:.0f}" height="{_BOX}" '
        'rx="4" fill="#e0f2f1" stroke="#00695c"/>'
        f'<text x="{middle:.0f}" y="{top + 17:.0f}" text-anchor="middle">{escape(part)}</text>'
        for part, (middle, top, width) in places.items()
    ]
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        'font-family="monospace" font-size="11">'
    )
    ground = f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>'
    return "\n".join([head, ground, *lines, *boxes, "</svg>", ""])


def _curve(above: tuple[float, float, float], below: tuple[float, float, float]) -> str:
    """From one box to another; the farther it is, the wider around what is between."""
    (x, top, _), (to_x, to_top, _) = above, below
    floors = max(0.0, (to_top - top) / _FLOOR - 1)
    side = x + to_x + (1 if to_x >= x else -1) * 36 * floors
    start, end = top + _BOX, to_top
    return f"M {x:.0f} {start:.0f} Q {side / 2:.0f} {(start + end) / 2:.0f} {to_x:.0f} {end:.0f}"


def _part(module: str, parts: Sequence[str]) -> str:
    """The part that a module is of, which is the longest name that fits."""
    return max((p for p in parts if module == p or module.startswith(f"{p}.")), key=len)
