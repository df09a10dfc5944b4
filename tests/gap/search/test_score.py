"""How well a fit predicts what it has not seen, against fits that really have not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.gap.search.test_fit import noisy, objective, pendulum, run, sized, structure
from walkerkit.gap.search.decision import TAILS
from walkerkit.gap.search.fit import evaluate, fit
from walkerkit.gap.search.foretold import Foretold
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.score import Scores, Scoring, Wildness, memory_of
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit

FLOOR = 1e-3


@pytest.fixture(scope="module")
def recordings():
    robot, rng = pendulum(), np.random.default_rng(3)
    return [
        noisy(run(robot, seconds, name, amplitude, dof_damping=0.3), rng)
        for name, seconds, amplitude in [("short", 1.5, 0.3), ("long", 6.0, 0.5)]
    ]


def scored(one: Objective, found: Fit, *step: float) -> Scores:
    """A fit with all its numbers; after a step of the first of them, in scales."""
    slopes = linearised(one, found)
    foretold, n = Foretold(one, slopes), len(found.values)
    far = foretold.far(np.pad(step, (0, n - len(step))))
    scoring = Scoring(one, found, foretold, np.full(1, FLOOR))
    (scores,) = scoring.scores([(far, np.arange(n))], memory_of(one, slopes.residual))
    return scores


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
    scores = scored(one, found)
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
    scores = scored(one, found)
    np.testing.assert_array_equal(scores.elsewhere, scores.squares)


def test_what_slopes_elsewhere_led_to_is_left_out_as_from_where_a_fit_ends(recordings):
    """Far from its optimum a residual pulls in all parts together, which is no part's own."""
    robot = sized(pendulum(), *recordings)
    one = objective(robot, recordings, floor=FLOOR)
    tried = structure([robot], viscous_friction=["hip"])
    (found,) = fit(one, evaluate(one, [(tried, np.array([0.25]))]), iterations=5)
    slopes = linearised(one, found)
    far = 0.1
    more, there, less = (scored(one, found, step) for step in (far, 0.0, -far))
    # The step that leaves a part out is the same, so that squares bend as those of the slopes.
    bend = 2 * one.block_squares(far * slopes.jacobian[0])
    assert more.squares + less.squares - 2 * there.squares == pytest.approx(bend, rel=1e-3)
    assert more.elsewhere + less.elsewhere - 2 * there.elsewhere == pytest.approx(bend, rel=1e-3)


def spread(one: Objective, size: float, rng: np.random.Generator) -> np.ndarray:
    """(rows, n_scored) white noise."""
    return size * rng.normal(size=one.measured.shape)


def autocorrelated(one: Objective, rho: float, rng: np.random.Generator) -> np.ndarray:
    """(rows, n_scored) an autoregressive process of first order in each segment."""
    noise = spread(one, 1.0, rng)
    found = np.empty_like(noise)
    for span in one.spans[0]:
        value = noise[span.start] / np.sqrt(1 - rho**2)
        for row in range(span.start, span.stop):
            value = rho * value + noise[row]
            found[row] = value
    return found


def by_definition(one: Objective, residual: np.ndarray) -> float:
    """1 + 2 Σ of the autocorrelation until it first vanishes, sum by sum."""
    spans, durations = one.spans
    pieces = []
    for span, duration in zip(spans, durations, strict=True):
        own = residual[span, 0][np.isfinite(one.measured[span, 0])]
        lags = min(len(own) - 1, int(2.0 * len(own) / duration))
        own = own - own.mean()
        pieces.append([float(own[: len(own) - k] @ own[k:]) for k in range(lags + 1)])
    longest = max(map(len, pieces))
    total = np.sum([np.pad(piece, (0, longest - len(piece))) for piece in pieces], axis=0)
    memory = 1.0
    for correlation in total[1:] / total[0]:
        if correlation <= 0:
            break
        memory += 2 * correlation
    return memory


def test_a_residual_is_alike_for_as_long_as_its_autocorrelation_says(recordings):
    one = objective(sized(pendulum(), *recordings), recordings)
    for rho in (0.3, 0.9):
        residual = autocorrelated(one, rho, np.random.default_rng(5))
        (memory,) = memory_of(one, residual)
        assert memory == pytest.approx(by_definition(one, residual), rel=1e-9)
        assert memory == pytest.approx((1 + rho) / (1 - rho), rel=0.5)
        (lifted,) = memory_of(one, residual + 3.0)  # a bias is no memory
        assert lifted == pytest.approx(memory)
    (alternating,) = memory_of(
        one, np.tile([[1.0], [-1.0]], (len(one.measured), 1))[: len(one.measured)]
    )
    assert alternating == 1.0
    (still,) = memory_of(one, np.zeros_like(one.measured))
    assert still == 1.0
    # A block tells something, however long its residual stays alike.
    slow = np.sin(np.linspace(0, 2, len(one.measured)))[:, None]
    assert memory_of(one, slow)[0] == np.median(one.block_counts())


@pytest.mark.parametrize(("rho", "uneven"), [(0.0, 0.3), (0.3, 0.3), (0.8, 0.5)])
def test_wild_blocks_are_trusted_as_little_as_a_student_t_does(recordings, rho, uneven):
    one = objective(sized(pendulum(), *recordings), recordings)
    usual = 0.01 * autocorrelated(one, rho, np.random.default_rng(6))
    wild = usual.copy()
    wild[one.block == 2] *= 10
    beside = Wildness(one, usual, np.full(1, FLOOR))
    even, trust = beside.trust(usual), beside.trust(wild)
    count = one.block_counts()
    for found in (even, trust):
        assert np.sum(found * count) / count.sum() == pytest.approx(1)
    assert even == pytest.approx(1, abs=uneven)
    # By the definition of the weights, at the variance that makes them agree with themselves.
    memory = memory_of(one, usual)
    n, square = count / memory, one.block_squares(wild) / memory
    variance = float(np.mean(usual**2))
    for _ in range(200):
        heavy = (TAILS + n) / (TAILS + square / variance)
        variance = float(np.sum(heavy * square) / n.sum())
    assert trust == pytest.approx(heavy * count.sum() / np.sum(heavy * count), rel=0.04)
    assert trust[2, 0] < 0.1 < 1.2 - uneven < np.delete(trust, 2).min()
    # Its density is that of a table, with the memory and the floor of where it began.
    scale = Scores(
        squares=one.block_squares(usual),
        elsewhere=one.block_squares(usual),
        count=count,
        memory=memory,
        floor=np.hypot(np.full(1, FLOOR), 0.25 * one.numerical_size()),
    )
    as_table = replace(scale, squares=one.block_squares(wild)).elpd_nearby(scale).sum()
    assert beside.density(wild) == pytest.approx(as_table)
    assert beside.density(wild) < beside.density(usual)
