"""Commands: checked once, unchangeable afterwards."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.actuators.robots import WORDS
from walkerkit.actuators import ActuatorCmd
from walkerkit.actuators.command import TARGETS

NAMES = [f"{word}_target" for word in WORDS]


def test_names():
    assert list(TARGETS) == NAMES
    assert ActuatorCmd().shape is None


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [[1, 2, 3], (1.0, 2.0), np.zeros((4, 3), np.float32)])
def test_arrays_are_copies_of_doubles(name, value):
    cmd = ActuatorCmd(**{name: value})
    target = getattr(cmd, name)
    assert target.dtype == np.float64
    assert target.shape == cmd.shape == np.shape(value)
    np.testing.assert_array_equal(target, value)
    assert all(getattr(cmd, other) is None for other in NAMES if other != name)


def test_cannot_be_changed():
    mine = np.zeros(3)
    cmd = ActuatorCmd(position_target=mine)
    mine[:] = 7.0
    assert (cmd.position_target == 0).all()
    with pytest.raises(ValueError, match="read-only"):
        cmd.position_target[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        cmd.position_target = mine


@settings(derandomize=True, max_examples=40, deadline=None)
@given(
    hnp.arrays(float, hnp.array_shapes(max_dims=2, max_side=4), elements=st.floats(-1e300, 1e300)),
    st.sampled_from(NAMES),
    st.sampled_from([np.nan, np.inf, -np.inf]),
    st.data(),
)
def test_the_place_of_what_is_not_finite_is_named(array, name, bad, data):
    ActuatorCmd(**{name: array})
    place = tuple(data.draw(st.integers(0, size - 1)) for size in array.shape)
    array[place] = bad
    with pytest.raises(ValueError) as error:
        ActuatorCmd(**{name: array})
    where = place[0] if len(place) == 1 else place
    assert f"{name}[{where}] is {bad}" in str(error.value)
    assert "policy or the log" in str(error.value)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [0.5, np.float64(0.5), np.array(1.0)])
def test_scalars_are_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} should be an array with one number per joint"):
        ActuatorCmd(**{name: value})


@pytest.mark.parametrize("value", ["hip", ["a", "b"], [[1.0], [1.0, 2.0]], {"hip": 1.0}])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(TypeError, match="velocity_target should be an array of numbers"):
        ActuatorCmd(velocity_target=value)


def test_shapes_that_differ_are_refused():
    with pytest.raises(ValueError) as error:
        ActuatorCmd(position_target=np.zeros(3), effort_target=np.zeros((1, 3)))
    for part in ("effort_target has shape (1, 3)", "position_target has (3,)"):
        assert part in str(error.value)


def test_select():
    cmd = ActuatorCmd(position_target=[1.0, 2.0, 3.0], effort_target=[4.0, 5.0, 6.0])
    part = cmd.select(np.array([2, 0]))
    assert part.position_target.tolist() == [3.0, 1.0]
    assert part.effort_target.tolist() == [6.0, 4.0]
    assert part.velocity_target is None
    batch = ActuatorCmd(velocity_target=np.arange(6.0).reshape(2, 3))
    assert batch.select(slice(1, 3)).velocity_target.tolist() == [[1.0, 2.0], [4.0, 5.0]]
