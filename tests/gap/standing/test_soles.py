"""What a robot stands on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.gap.standing.robots import write_four_legs, write_two_legs
from walkerkit.gap import InputError
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.standing.soles import Area, put_down, soles_at


def test_how_far_inside_of_an_area_points_are() -> None:
    area = Area(np.array([[0, 0], [4, 0], [4, 2], [0, 2], [1, 1]], dtype=float))
    np.testing.assert_allclose(area.centre, [2, 1])
    assert area.depth == pytest.approx(1.0)
    found = area.margin(np.array([[2, 1], [0.5, 1], [2, 2], [5, 1]], dtype=float))
    np.testing.assert_allclose(found, [1.0, 0.5, 0.0, -1.0], atol=1e-9)


@pytest.mark.parametrize("points", [[[0, 0]], [[0, 0], [1, 0]], [[0, 0], [1, 0], [2, 0]]])
def test_what_spans_no_area_has_no_inside(points: list[list[float]]) -> None:
    area = Area(np.array(points, dtype=float))
    assert area.depth == 0
    assert area.margin(np.zeros((1, 2)))[0] < 0


def test_feet_are_what_touches_the_ground_in_the_keyframe(tmp_path: Path) -> None:
    robot = load_robot(write_four_legs(tmp_path))
    assert robot.base is not None
    soles = soles_at(robot, put_down(robot, robot.base))
    assert [sole.name for sole in soles] == ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]
    assert [len(sole.points) for sole in soles] == [1, 1, 1, 1]
    flat = load_robot(write_two_legs(tmp_path))
    assert flat.base is not None
    both = soles_at(flat, put_down(flat, flat.base))
    assert [(sole.name, len(sole.points)) for sole in both] == [("left_sole", 4), ("right_sole", 4)]


@pytest.mark.parametrize(("height", "how"), [(0.7, "0.242 m above"), (0.3, "0.158 m deep in")])
def test_a_keyframe_away_from_the_ground_is_refused_with_the_height_that_mends_it(
    height: float, how: str, tmp_path: Path
) -> None:
    robot = load_robot(write_two_legs(tmp_path, height=height))
    assert robot.base is not None
    with pytest.raises(InputError) as refused:
        put_down(robot, robot.base)
    told = str(refused.value)
    for word in ("keyframe 'home'", how, "does not stand", f"in place of {height:g}"):
        assert word in told
    better = float(told.partition("with ")[2].split()[0])
    mended = load_robot(write_two_legs(tmp_path, height=better))
    assert mended.base is not None
    assert put_down(mended, mended.base)[2] == pytest.approx(better, abs=1e-3)
