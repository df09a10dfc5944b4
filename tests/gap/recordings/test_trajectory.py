"""Trajectories as targets over time: through their points, by what the points determine."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.gap.ingest.bag import trajectory_of
from walkerkit.gap.recordings.trajectory import Course, targets_of

TIME = (0.5, 1.0, 2.5)


def motion(time: Any) -> list[Any]:
    """Of the fifth degree: what a quintic through any points of it is."""
    curve = np.polynomial.Polynomial([0.1, -0.4, 0.3, 0.2, -0.1, 0.02])
    return [curve.deriv(n)(np.asarray(time)) if n else curve(np.asarray(time)) for n in range(3)]


def message(**fields: Any) -> Any:
    """Of hip and knee; the knee does twice what the hip does."""
    points = [{name: np.outer(f, (1, 2))[n] for name, f in fields.items()} for n in range(3)]
    return trajectory_of(0, list(zip(TIME, points, strict=True)))


def test_positions_alone_are_joined_by_lines() -> None:
    told = targets_of(message(positions=[0.0, 1.0, -0.5]))
    assert list(told["knee"]) == ["position"]
    course = told["knee"]["position"]
    at = np.array([0.0, 0.5, 0.75, 1.0, 2.0, 2.5, 9.0])
    np.testing.assert_allclose(course.at(at), [0, 0, 1, 2, 0, -1, -1], atol=1e-12)
    # The first point is for later: it is approached from where the target was.
    np.testing.assert_allclose(course.begun(-1.0).at(at[:3]), [-1, 0, 1], atol=1e-12)
    assert course.begun(np.nan) is course


def test_velocities_and_accelerations_shape_the_way() -> None:
    position, velocity, acceleration = motion(TIME)
    told = targets_of(message(positions=position, velocities=velocity, accelerations=acceleration))[
        "knee"
    ]
    at = np.linspace(0.5, 2.5, 50)
    wanted = motion(at)
    np.testing.assert_allclose(told["position"].at(at), 2 * wanted[0], atol=1e-9)
    np.testing.assert_allclose(told["velocity"].at(at), 2 * wanted[1], atol=1e-9)
    cubic = targets_of(message(positions=position, velocities=velocity))["hip"]
    np.testing.assert_allclose(cubic["position"].at(np.array(TIME)), position, atol=1e-12)
    np.testing.assert_allclose(cubic["velocity"].at(np.array(TIME)), velocity, atol=1e-12)
    assert np.abs(cubic["position"].at(at) - wanted[0]).max() > 1e-3


def test_velocities_and_efforts_alone_are_joined_by_lines() -> None:
    told = targets_of(message(velocities=[0.0, 1.0, 2.0], effort=[3.0, 1.0, 1.0]))["hip"]
    at = np.array([0.75, 2.5])
    np.testing.assert_allclose(told["velocity"].at(at), [0.5, 2.0])
    np.testing.assert_allclose(told["effort"].at(at), [2.0, 1.0])


def test_what_is_no_number_is_known_not_to_be_one() -> None:
    told = targets_of(message(positions=[0.0, np.nan, 1.0], velocities=[1.0, 1.0, 1.0]))["hip"]
    assert not told["position"].known
    np.testing.assert_array_equal(told["velocity"].at(np.array(TIME)), 1.0)
    # Positions may do without.
    told = targets_of(message(positions=[0.0, 1.0, 2.0], velocities=[1.0, np.inf, 1.0]))["hip"]
    np.testing.assert_allclose(told["position"].at(np.array(TIME)), [0, 1, 2])
    assert not told["velocity"].known


def test_a_point_for_at_once_is_held() -> None:
    course = Course(time=(0.0,), points=((0.3, 0.7),))
    assert not course.moves
    assert course.begun(1.0) is course
    np.testing.assert_array_equal(course.at(np.array([0.0, 5.0])), 0.3)


def test_times_have_to_increase() -> None:
    back = trajectory_of(0, [(1.0, {"positions": [0, 0]}), (0.5, {"positions": [1, 1]})])
    with pytest.raises(ValueError, match=r"points at 1, 0\.5 s from its start"):
        targets_of(back)
