"""Sums of squares by algebra, against those of residuals that are made."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gap.search.test_fit import EFFORT, POSITION, pendulum, run, structure
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.foretold import Foretold
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Replay

CHANNELS = (POSITION, EFFORT)
STEPS = np.array([[0.0, 0.0], [0.3, -0.2], [-4.0, 7.0]])


VALUES = np.array([0.3, 0.002])


@pytest.fixture(scope="module")
def walked():
    """A robot, and what it did in finer steps, with more friction in it."""
    robot = pendulum()
    spec = robot.spec.copy()
    spec.option.timestep /= 4
    return robot, run(robot_from_spec(spec, "finer.xml"), dof_damping=0.4)


def objective(robot, recording, **options):
    replay = Replay(robot, whole(recording), CHANNELS)
    return Objective([replay], CHANNELS, np.full(2, 1e-5), **options)


@pytest.fixture(params=["as given", "beside half the timestep", "over jumps", "of another error"])
def linear(request, walked):
    """Recordings, a fit to them and its slopes, with and without a numerical error of its own.

    Slopes of another error are less that of their own fit, where the recordings know that of
    another by now.
    """
    robot, recording = walked
    options = {"jumps": request.param == "over jumps"}
    one = objective(robot, recording, **options)
    tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
    (fit,) = evaluate(one, [(tried, VALUES)])
    if request.param == "as given":
        return one, fit, linearised(one, fit)
    finer = {"half": objective(robot.refined(2), recording, **options)}
    one.refine(finer, fit.case)
    slopes = linearised(one, fit)
    assert np.abs(slopes.jacobian - slopes.uncorrected[1]).max() > 0.1  # the error follows
    if request.param == "of another error":
        one.refine(finer, replace(fit, values=np.array([1.0, 0.05])).case)
    assert one.numerical.changes.any()
    return one, fit, slopes


def foretold_residual(one, slopes, step):
    """As simulated along straight lines, with the numerical error taken out."""
    residual, jacobian = slopes.uncorrected
    found = (residual + np.tensordot(step, jacobian, 1))[None]
    one.numerical.take_out(found, one.error_weights(one.mean_square(found)))
    return found[0]


@pytest.mark.parametrize("step", STEPS)
def test_squares_are_those_of_the_residual_where_a_step_leads(linear, step):
    one, _, slopes = linear
    foretold = Foretold(one, slopes)
    residual = foretold_residual(one, slopes, step)
    far = foretold.far(step)
    (found,) = foretold.squares(far[None, None])
    np.testing.assert_allclose(found, one.block_squares(residual), rtol=1e-6)
    np.testing.assert_allclose(foretold.mean_square(far), one.mean_square(residual), rtol=1e-6)
    assert foretold.score(step) == pytest.approx(float(one.score(one.mean_square(residual))))


def test_a_small_step_goes_along_the_slopes_with_the_error_following(linear):
    one, _, slopes = linear
    foretold = Foretold(one, slopes)
    far = foretold.far(np.zeros(2))
    blocks = one.block_counts().shape[0]
    steps = np.linspace(-1.0, 2.0, 2 * blocks).reshape(blocks, 2)
    moved = foretold_residual(one, slopes, np.zeros(2))
    moved += np.einsum("rk,krc->rc", steps[one.block], slopes.jacobian)
    (found,) = foretold.squares((far + steps @ foretold.along)[None])
    np.testing.assert_allclose(found, one.block_squares(moved), rtol=1e-6)


def test_what_changes_one_channel_alone_leaves_the_other(walked):
    robot, recording = walked
    one = objective(robot, recording)
    tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
    (fit,) = evaluate(one, [(tried, VALUES)])
    slopes = linearised(one, fit)
    for jacobian in (slopes.jacobian, slopes.uncorrected[1]):
        jacobian[0, :, 1] = jacobian[1, :, 0] = 0.0
    foretold, step = Foretold(one, slopes), np.array([0.3, -0.2])
    expected = one.block_squares(foretold_residual(one, slopes, step))
    (found,) = foretold.squares(foretold.far(step)[None, None])
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_products_are_those_of_the_slopes(linear):
    one, fit, slopes = linear
    foretold, weights = Foretold(one, slopes), one.weights(fit.mean_square)
    part = np.arange(one.block_counts().shape[0]) // 2
    found = foretold.along @ foretold.products(weights, part) @ foretold.along.T
    for k, normal in enumerate(found):
        own = slopes.jacobian[:, part[one.block] == k]
        np.testing.assert_allclose(normal, np.einsum("irc,jrc,c->ij", own, own, weights), rtol=1e-6)


@pytest.mark.parametrize("step", STEPS)
def test_slopes_that_keep_no_numerical_error_say_all(linear, step):
    one, _, slopes = linear
    slopes = replace(slopes, uncorrected=None)
    foretold = Foretold(one, slopes)
    residual = slopes.residual + np.tensordot(step, slopes.jacobian, 1)
    far = foretold.far(step)
    (found,) = foretold.squares(far[None, None])
    np.testing.assert_allclose(found, one.block_squares(residual), rtol=1e-6)
    assert foretold.along @ far == pytest.approx(step)
