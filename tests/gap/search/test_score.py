"""How well a fit predicts what it has not seen, against fits that really have not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.gap.search.test_fit import noisy, objective, pendulum, run, sized, structure
from walkerkit.gap.search.fit import evaluate, fit
from walkerkit.gap.search.score import Scores, Scoring
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
    scores = Scoring(one, found, slopes, np.full(1, FLOOR)).scores(slopes.residual, np.arange(2))
    seen = one.block_squares(slopes.residual)
    of_block = one.recording_of_block
    assert set(of_block) == {0, 1}
    for squares, part, tolerance in (
        (scores.squares, one.folds, 0.02),
        (scores.elsewhere, of_block, 0.05),
    ):
        for each in range(part.max() + 1):
            blocks = part == each
            trust = np.where(blocks, 0.0, 1.0)[:, None]
            others = one.trusting(trust)
            (without,) = fit(others, evaluate(others, [(tried, found.values)]), iterations=5)
            right = one.block_squares(one.residuals([without.case])[0][0])
            assert squares[blocks] == pytest.approx(right[blocks], rel=tolerance)
        assert squares.sum() > seen.sum()
    both = scores.elpd_nearby(scores) + replace(scores, squares=scores.elsewhere).elpd_nearby(
        scores
    )
    assert scores.elpd(scores) == pytest.approx(0.5 * both)


def test_where_there_is_one_recording_no_other_predicts_it(recordings):
    whole = recordings[1]
    parts = [whole.between(0.0, 3.0), whole.between(3.0, 6.0)]
    one = objective(sized(pendulum(), *parts), parts, floor=FLOOR)
    assert set(one.recording_of_block) == {0}
    assert one.folds.max() > 0
    tried = structure([sized(pendulum(), *parts)], viscous_friction=["hip"])
    (found,) = fit(one, evaluate(one, [(tried, np.array([0.25]))]), iterations=5)
    slopes = linearised(one, found)
    scores = Scoring(one, found, slopes, np.full(1, FLOOR)).scores(slopes.residual, np.arange(1))
    assert scores.elsewhere is scores.squares


def test_what_slopes_elsewhere_led_to_is_left_out_as_from_where_a_fit_ends(recordings):
    """Far from its optimum a residual pulls in all parts together, which is no part's own."""
    robot = sized(pendulum(), *recordings)
    one = objective(robot, recordings, floor=FLOOR)
    tried = structure([robot], viscous_friction=["hip"])
    (found,) = fit(one, evaluate(one, [(tried, np.array([0.25]))]), iterations=5)
    slopes = linearised(one, found)
    scoring = Scoring(one, found, slopes, np.full(1, FLOOR))
    kept, along = np.arange(1), slopes.jacobian[0]

    def scores(far: float) -> Scores:
        return scoring.scores(slopes.residual + far * along, kept)

    far = 0.1
    more, there, less = scores(far), scores(0.0), scores(-far)
    # The step that leaves a part out is the same, so that squares bend as those of the slopes.
    bend = 2 * one.block_squares(far * along)
    assert more.squares + less.squares - 2 * there.squares == pytest.approx(bend, rel=1e-3)
    assert more.elsewhere + less.elsewhere - 2 * there.elsewhere == pytest.approx(bend, rel=1e-3)
