"""What decides between explanations, on evidence that is made up."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from walkerkit.gap.search.evidence import Evidence
from walkerkit.gap.search.worth import close_to
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
