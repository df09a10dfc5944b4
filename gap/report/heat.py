"""The map of a gap as a table whose cells are shaded by how far they are above the floor.

Plain HTML rather than a plot: it prints, wraps on a phone, is read aloud, and every cell has its
number written in it, so that the shade says nothing that the number does not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from walkerkit.gap.report import wording
from walkerkit.gap.report.gaps import GapMap, Location
from walkerkit.gap.report.quantity import Scale, number, percent, scale
from walkerkit.gap.report.regimes import EVERYWHERE, REGIMES

LEVELS = 6
_AT_FLOOR = 1.5  # a gap within this factor of its floor has the lightest shade
_DARK = 8  # times that, at least, has the darkest: what is near its floor looks like it
_MOST_COLUMNS = 8  # more joints than that are the rows, so that a phone shows a whole line
_BESIDE = 6  # columns of two maps that fit beside each other
_LONG = 8  # characters of a column's head that fit without turning it


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One joint in one regime.

    Attributes:
        text: the gap there; a dot where the regime never occurs.
        level: its shade, 0 to `LEVELS` − 1.
        says: the same in words, with share and lift; empty where there is nothing.
    """

    text: str
    level: int
    says: str


@dataclass(frozen=True, kw_only=True)
class Heat:
    """One map before or after.

    Attributes:
        title: whose gap it is.
        head: names of the columns.
        turned: the names stand upright.
        rows: name and cells of each row.
    """

    title: str
    head: tuple[str, ...]
    turned: bool
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]


@dataclass(frozen=True, kw_only=True)
class HeatMap:
    """The maps of one signal, in one unit and one set of shades.

    Attributes:
        signal: its name in words.
        unit: what the numbers are in.
        heats: before, and after where anything was added.
        wide: they have no room beside each other.
        legend: the largest gap of each level.
    """

    signal: str
    unit: str
    heats: tuple[Heat, ...]
    wide: bool
    legend: tuple[str, ...]


def heat_map(of: GapMap, floor: float, *, mended: bool) -> HeatMap | None:
    """A map to show.

    Args:
        of: the map.
        floor: the gap that no model can be below, in the map's unit.
        mended: whether to show what remains, too.

    Returns:
        The tables; None where there is no gap at all.
    """
    shown = [("Model as given", of.before)]
    if mended:
        shown.append(("What remains", of.after))
    cells = [at for _, some in shown for at in some if math.isfinite(at.rms)]
    if not cells:
        return None
    joints = list(dict.fromkeys(at.joint for at in cells))
    present = {at.regime for at in cells}
    regimes = [name for name in (*REGIMES, EVERYWHERE) if name in present]
    top = max(at.rms for at in cells)
    unit = scale(top, of.unit)
    edges = _edges(floor, top)
    heats = tuple(_heat(title, some, joints, regimes, unit, edges) for title, some in shown)
    return HeatMap(
        signal=wording.words(of.signal),
        unit=unit.unit,
        heats=heats,
        wide=len(heats[0].head) > _BESIDE,
        legend=tuple(number(edge * unit.factor) for edge in edges),
    )


def _edges(floor: float, top: float) -> list[float]:
    """The largest gap of each level, evenly in their logarithm."""
    low = _AT_FLOOR * floor
    if low <= 0:
        low = top / 2**LEVELS
    top = max(top, _DARK * low)
    return [low * (top / low) ** (k / (LEVELS - 1)) for k in range(LEVELS)]


def _heat(
    title: str,
    cells: Sequence[Location],
    joints: Sequence[str],
    regimes: Sequence[str],
    unit: Scale,
    edges: Sequence[float],
) -> Heat:
    found = {(at.joint, at.regime): at for at in cells}
    rows_are_joints = len(joints) > _MOST_COLUMNS
    head = [_regime(name) for name in regimes]
    side = [wording.label(name) for name in joints]
    grid = [[_cell(found.get((j, r)), unit, edges) for r in regimes] for j in joints]
    if not rows_are_joints:
        head, side, grid = side, head, [list(column) for column in zip(*grid, strict=True)]
    return Heat(
        title=title,
        head=tuple(head),
        turned=max(map(len, head)) > _LONG or len(head) > _MOST_COLUMNS // 2,
        rows=tuple((name, tuple(cells)) for name, cells in zip(side, grid, strict=True)),
    )


def _cell(at: Location | None, unit: Scale, edges: Sequence[float]) -> Cell:
    if at is None or not math.isfinite(at.rms):
        return Cell(text="·", level=0, says="")
    level = next((k for k, edge in enumerate(edges) if at.rms <= edge), LEVELS - 1)
    return Cell(
        text=number(at.rms * unit.factor),
        level=level,
        says=(
            f"{wording.spot(at)}: {number(at.rms * unit.factor)} {unit.unit}, "
            f"{percent(at.share)} of the squared gap, lift {number(at.lift)}"
        ),
    )


def _regime(name: str) -> str:
    return "all of it" if name == EVERYWHERE else wording.words(name)
