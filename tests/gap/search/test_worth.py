"""What decides between explanations, on evidence that is made up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.gap.search.test_naming import LEG, problem_of
from walkerkit.gap.search.evidence import Evidence
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.worth import close_to, much_is_lost, worth_it
from walkerkit.gap.search.worth import confidence as confidence_of


def evidence(*scores: float, spread: float = 0.0) -> Evidence:
    """Fits with such scores, each of which resampling moves by `spread` on its own."""
    values = np.array(scores)
    random = np.random.default_rng(0)
    resampled: NDArray[np.float64] = values + spread * random.standard_normal((400, len(scores)))
    return Evidence(
        mean_square=np.exp(2 * values)[:, None],
        fitted_mean_square=np.exp(2 * values)[:, None],
        held=values,
        both=values,
        held_resampled=resampled,
        both_resampled=resampled,
    )


@pytest.mark.parametrize(
    ("scores", "spread", "close"),
    [
        ((-3.0, -3.0, -2.0), 0.0, [1]),
        ((-3.0, -2.99, -2.97), 0.0, [1]),
        ((-3.0, -2.9, -2.5), 0.0, []),
        ((-3.0, -2.9, -2.5), 0.1, [1]),  # ahead in more of the resamples than chance allows
        ((-3.0,), 0.0, []),
    ],
)
def test_fits_as_good_as_the_first_are_close(
    scores: tuple[float, ...], spread: float, close: list[int]
) -> None:
    assert close_to(evidence(*scores, spread=spread), 5) == close


@pytest.mark.parametrize(
    ("scores", "confidence"),
    [((-3.0,), 1.0), ((-3.0, -2.5), 1.0), ((-3.0, -3.0), 0.5), ((-3.0, -3.0, -3.0, -1.0), 1 / 3)],
)
def test_confidence_is_shared_with_equals(scores: tuple[float, ...], confidence: float) -> None:
    assert confidence_of(evidence(*scores), 5) == pytest.approx(confidence)


def test_confidence_falls_as_the_evidence_blurs() -> None:
    sure, blurred = (confidence_of(evidence(-3.0, -2.8, spread=s), 5) for s in (0.05, 0.3))
    assert 0.5 < blurred < sure <= 1


def test_much_is_lost_on_all_recordings_together() -> None:
    blind = replace(evidence(-2.0, -3.0), held=np.array([-3.0, -3.0]))
    assert much_is_lost(blind, 1)
    assert not much_is_lost(evidence(-2.9, -3.0), 1)
    assert not much_is_lost(evidence(-3.0, -2.0), 1)


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """A leg like its model; only its noise matters here."""
    model = tmp_path_factory.mktemp("leg") / "leg.xml"
    model.write_text(LEG)
    return problem_of(model, ())


@pytest.mark.parametrize(
    ("gain", "by_chance", "effects", "worth"),
    [
        (0.30, 0.10, 1, True),
        (0.30, 0.10, 2, False),  # a second effect has to bring half as much again
        (0.40, 0.10, 2, True),
        (0.30, 0.20, 1, False),
        (0.10, 0.10, 1, False),
        (0.10, 0.02, 1, True),
        (0.03, 0.00, 1, False),
    ],
)
def test_a_large_gain_may_rest_on_few_blocks(
    problem: Problem, gain: float, by_chance: float, effects: int, worth: bool
) -> None:
    before = 50 * problem.noise
    sizes = np.stack([before, before * np.exp(-gain)])
    scores = np.log(sizes).mean(axis=1)
    resampled = np.tile(scores, (200, 1))
    resampled[: round(200 * by_chance)] = scores[::-1]
    made_up = replace(
        evidence(*scores),
        mean_square=sizes**2,
        fitted_mean_square=sizes**2,
        held_resampled=resampled,
        both_resampled=resampled,
    )
    assert worth_it(problem, made_up, 1, effects=effects) is worth
