"""Tests of what a diagnosis says of its gaps."""

from __future__ import annotations

import pytest

from walkerkit.gap.report.diagnosis import GapSize


@pytest.mark.parametrize(
    ("after", "explained"),
    [(0.029, True), (0.1, True), (0.3, False), (0.52, False), (0.9, False)],
)
def test_an_effort_that_stays_is_not_explained(after: float, explained: bool) -> None:
    effort = GapSize(unit="N·m", before=0.52, after=after, noise_floor=0.012, numerical_floor=0.016)
    assert effort.floor == pytest.approx(0.02)
    assert effort.at_floor == (after < 0.03)
    assert effort.mostly_closed == explained
