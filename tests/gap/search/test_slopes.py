"""Slopes: of robots that walk, where the smallest move makes residuals jump; and from near by."""

import numpy as np
import pytest

from tests.gap.search.test_fit import EFFORT, POSITION, pendulum, run, structure
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.slopes import linearised, near_slopes
from walkerkit.gap.search.structure import Case
from walkerkit.gap.simulation.replay import Replay

CHANNELS = (POSITION, EFFORT)
VALUES = np.array([[0.2, 0.01], [0.5, 0.05]])


@pytest.fixture(scope="module")
def walked():
    """A robot, and what it did with more friction in it."""
    robot = pendulum()
    return robot, run(robot, dof_damping=0.4)


def objective(robot, recording, *, jumps):
    replay = Replay(robot, whole(recording), CHANNELS)
    return Objective([replay], CHANNELS, np.full(2, 1e-5), jumps=jumps)


def refined(robot, recording, case, *, jumps):
    one = objective(robot, recording, jumps=jumps)
    one.refine({"half": objective(robot.refined(2), recording, jumps=jumps)}, case)
    assert one.numerical.changes.any()
    return one


def cases(robot):
    tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
    return [Case(structure=tried, values=row[None]) for row in VALUES]


def test_slopes_over_jumps_are_those_of_moves_far_to_both_sides(walked):
    robot, recording = walked
    one = objective(robot, recording, jumps=True)
    first, _ = cases(robot)
    scale = first.structure.scale
    (start,) = evaluate(one, [(first.structure, VALUES[0])])
    found = linearised(one, start).jacobian
    for k, far in enumerate(0.3 * np.diag(scale)):
        there, back = one.residuals(
            [Case(structure=first.structure, values=VALUES[:1] + side * far) for side in (1, -1)]
        )
        expected = (there[0] - back[0]) / 0.6
        np.testing.assert_allclose(found[k], expected, atol=1e-12 + 1e-9 * np.abs(expected).max())
    near = linearised(objective(robot, recording, jumps=False), start).jacobian
    assert not np.allclose(found, near, rtol=1e-3, atol=1e-3 * np.abs(near).max())


def test_over_jumps_all_values_have_their_own_numerical_error(walked):
    robot, recording = walked
    both = cases(robot)
    (expected,) = refined(robot, recording, both[1], jumps=True).residuals([both[1]])
    elsewhere = refined(robot, recording, both[0], jumps=True)
    together = Case(structure=both[0].structure, values=VALUES)
    (of_two,) = elsewhere.residuals([together])
    np.testing.assert_array_equal(of_two[1], expected[0])
    (one_for_all,) = refined(robot, recording, both[0], jumps=False).residuals([together])
    np.testing.assert_array_equal(one_for_all[0], of_two[0])
    assert not np.array_equal(one_for_all[1], of_two[1])


def test_and_so_have_slopes(walked):
    robot, recording = walked
    first, second = cases(robot)
    here, there = (refined(robot, recording, case, jumps=True) for case in (second, first))
    (start,) = evaluate(here, [(second.structure, VALUES[1])])
    expected, found = (linearised(one, start) for one in (here, there))
    np.testing.assert_array_equal(found.residual, expected.residual)
    np.testing.assert_array_equal(found.jacobian, expected.jacobian)


def test_slopes_near_by_are_not_those_of_what_a_new_effect_extends(walked):
    robot, recording = walked
    one = objective(robot, recording, jumps=False)
    rigid = structure([robot], viscous_friction=["hip"], coulomb_friction=["hip"])
    bristles = structure(
        [robot], viscous_friction=["hip"], coulomb_friction=["hip"], presliding_friction=["hip"]
    )
    before, after = evaluate(
        one, [(rigid, np.array([0.2, 0.05])), (bristles, np.array([0.2, 0.05, 0.05, 0.05]))]
    )
    near, there = linearised(one, before), linearised(one, after)
    (found,) = near_slopes(one, near, [after])
    viscous, coulomb, frictionloss, _ = found.jacobian
    np.testing.assert_array_equal(viscous, near.jacobian[0])
    np.testing.assert_allclose(coulomb, there.jacobian[1], atol=1e-9 * np.abs(coulomb).max())
    # Bristles carry all dry friction alike.
    np.testing.assert_allclose(coulomb, frictionloss, atol=1e-6 * np.abs(coulomb).max())
    assert np.abs(coulomb - near.jacobian[1]).max() > 0.1 * np.abs(coulomb).max()
