"""How well a fit predicts what it has not seen, against fits that really have not."""

from __future__ import annotations

import numpy as np
import pytest

from tests.gap.search.test_fit import noisy, objective, pendulum, run, sized, structure
from walkerkit.gap.search.fit import evaluate, fit
from walkerkit.gap.search.score import Scoring
from walkerkit.gap.search.slopes import linearised

FLOOR = 1e-3


@pytest.fixture(scope="module")
def recordings():
    robot, rng = pendulum(), np.random.default_rng(3)
    return [
        noisy(run(robot, seconds, name, amplitude, dof_damping=0.3), rng)
        for name, seconds, amplitude in [("short", 1.5, 0.3), ("long", 6.0, 0.5)]
    ]


def test_a_fold_is_a_part_of_one_recording_and_a_tenth_of_all_at_most(recordings):
    one = objective(sized(pendulum(), *recordings), recordings)
    recording_of = np.concatenate(
        [np.full(np.sum(r.segment_of_row == k), k) for r in one.replays for k in (0, 1)]
    )
    fold = one.folds[one.block]
    for k in range(fold.max() + 1):
        rows = np.flatnonzero(fold == k)
        assert len(set(recording_of[rows])) == 1
        assert (np.diff(rows) == 1).all()
        assert len(set(one.block[rows])) <= max(1, np.ceil(0.1 * len(one.folds)))
    assert set(fold) == set(range(fold.max() + 1))


def test_what_is_left_out_is_predicted_as_by_a_fit_without_it(recordings):
    robot = sized(pendulum(), *recordings)
    one = objective(robot, recordings, floor=FLOOR)
    tried = structure([robot], viscous_friction=["hip"], torque_bias=["hip"])
    (found,) = fit(one, evaluate(one, [(tried, np.array([0.25, 0.0]))]), iterations=5)
    slopes = linearised(one, found)
    scoring = Scoring(one, found, slopes, np.full(1, FLOOR))
    squares = scoring.scores(slopes.residual, np.arange(2)).squares
    seen = one.block_squares(slopes.residual)
    for fold in range(one.folds.max() + 1):
        blocks = one.folds == fold
        trust = np.where(blocks, 0.0, 1.0)[:, None]
        others = one.trusting(trust)
        (without,) = fit(others, evaluate(others, [(tried, found.values)]), iterations=5)
        right = one.block_squares(one.residuals([without.case])[0][0])
        assert squares[blocks] == pytest.approx(right[blocks], rel=0.02)
    assert squares.sum() > seen.sum()
