"""The map as a table: numbers, shades, and which way round it is."""

from __future__ import annotations

import math

import pytest

from walkerkit.gap.report.gaps import GapMap, Location
from walkerkit.gap.report.heat import LEVELS, heat_map
from walkerkit.gap.report.regimes import EVERYWHERE


def at(joint: str, regime: str, rms: float, share: float = 0.1, lift: float = 1.0) -> Location:
    return Location(joint=joint, regime=regime, share=share, lift=lift, rms=rms)


BEFORE = (
    at("hip", EVERYWHERE, 0.002),
    at("hip", "high_speed", 0.004),
    at("knee", EVERYWHERE, 0.009, share=0.8),
    at("knee", "high_speed", 0.03, share=0.7, lift=3.2),
    at("knee", "late", 0.005),
)
AFTER = tuple(at(c.joint, c.regime, 0.0005) for c in BEFORE)
MAP = GapMap(signal="position", unit="rad", before=BEFORE, after=AFTER)


def test_every_cell_has_its_number_and_says_what_it_is() -> None:
    shown = heat_map(MAP, 0.0004, mended=True)
    assert shown is not None
    assert (shown.signal, shown.unit) == ("position", "mrad")
    before, after = shown.heats
    assert before.head == after.head == ("hip", "knee")
    rows = {name: [cell.text for cell in cells] for name, cells in before.rows}
    assert rows == {
        "high speed": ["4.0", "30"],
        "late": ["·", "5.0"],
        "all of it": ["2.0", "9.0"],
    }
    fastest = before.rows[0][1][1]
    assert fastest.says == "knee (high speed): 30 mrad, 70 % of the squared gap, lift 3.2"
    assert before.rows[1][1][0].says == ""


def test_shades_grow_with_the_gap_and_start_at_the_floor() -> None:
    shown = heat_map(MAP, 0.0004, mended=True)
    assert shown is not None
    before, after = shown.heats
    level = {name: [cell.level for cell in cells] for name, cells in before.rows}
    assert level["high speed"][1] == LEVELS - 1
    assert level["all of it"][0] < level["high speed"][0] < level["all of it"][1]
    assert {cell.level for _, cells in after.rows for cell in cells} == {0}
    assert [float(edge) for edge in shown.legend] == sorted(float(edge) for edge in shown.legend)
    assert shown.legend[-1] == "30"


def test_what_is_near_its_floor_is_never_dark() -> None:
    shown = heat_map(MAP, 0.015, mended=False)
    assert shown is not None
    assert max(cell.level for _, cells in shown.heats[0].rows for cell in cells) <= 2


def test_many_joints_are_rows_so_that_a_phone_shows_a_whole_one() -> None:
    cells = tuple(at(f"joint_{k}", EVERYWHERE, 0.001 * (k + 1)) for k in range(12))
    shown = heat_map(GapMap(signal="effort", unit="N·m", before=cells, after=()), 0.0, mended=False)
    assert shown is not None
    (heat,) = shown.heats
    assert heat.head == ("all of it",)
    assert len(heat.rows) == 12


@pytest.mark.parametrize("cells", [(), (at("hip", EVERYWHERE, math.nan),)])
def test_without_numbers_there_is_no_map(cells: tuple[Location, ...]) -> None:
    of = GapMap(signal="position", unit="rad", before=cells, after=())
    assert heat_map(of, 0.001, mended=False) is None
