"""Slopes of residuals that jump where a foot touches down a step earlier or later."""

from types import SimpleNamespace

import numpy as np
import pytest

from walkerkit.gap.search.slopes import _without_jumps

BLOCK = np.repeat([0, 1, 2], 4)


def objective():
    def squares(residual):
        return np.stack([np.bincount(BLOCK, weights=column**2) for column in residual.T], axis=1)

    return SimpleNamespace(block=BLOCK, floor=np.array([1.0, 0.1]), block_squares=squares)


@pytest.mark.parametrize("jumping", [0, 1])
def test_of_two_sides_that_differ_in_a_block_the_smaller_is_the_slope_there(jumping):
    rng = np.random.default_rng(0)
    smooth = rng.normal(1.0, 0.1, (1, 12, 2))
    sides = [smooth.copy(), smooth.copy()]
    sides[jumping][0, 6:8] += 50.0  # a foot landed a step earlier, late in the second block
    found = _without_jumps(objective(), *sides)
    np.testing.assert_allclose(found, smooth)


def test_of_two_sides_that_bend_their_mean_is_the_slope():
    one, other = np.full((2, 12, 2), 1.2), np.full((2, 12, 2), 0.8)
    np.testing.assert_allclose(_without_jumps(objective(), one, other), 1.0)


def test_a_side_that_diverged_is_the_smaller_one():
    # `linearised_each` has zeros for it: a number that runs away to one side is left where it is.
    one, other = np.zeros((1, 12, 2)), np.ones((1, 12, 2))
    np.testing.assert_allclose(_without_jumps(objective(), one, other), 0.0)
