"""An effect stays at the joints that need it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, hide, problem_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.places import places_needed
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Structure, Term
from walkerkit.gap.search.trying import Tries

LIMITS = Term(effect=CATALOGUE["effort_limit"], sites=("knee", "ankle"), shared=False)


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """A leg whose ankle reaches a limit."""
    path = tmp_path_factory.mktemp("leg") / "leg.xml"
    path.write_text(LEG, encoding="utf-8")
    return problem_of(path, [hide("effort_limit", "ankle", forcerange=0.2)])


@pytest.mark.parametrize("limit", [1.4, 6.0], ids=["touched", "never reached"])
def test_a_limit_that_may_as_well_be_far_away_is_dropped(problem: Problem, limit: float) -> None:
    """By its slope where it is touched, being without it would be another matter."""
    structure = Structure((LIMITS,), problem.robots)
    (full,) = evaluate(problem.race.objective, [(structure, np.array([limit, 0.2]))])
    (kept,) = places_needed(problem, full, LIMITS).structure.terms
    assert kept.sites == ("ankle",)


def test_a_start_that_moves_too_much_may_move_one_place_only(problem: Problem) -> None:
    structure = Structure((LIMITS,), problem.robots)
    objective = problem.screen.objective
    nothing, start, best = evaluate(
        objective,
        [
            (structure, v)
            for v in (structure.zero, np.array([0.3, 0.2]), np.array([structure.zero[0], 0.2]))
        ],
    )
    assert start.score > nothing.score
    (less,) = Tries(problem, [LIMITS.effect], None)._lessened([start])
    np.testing.assert_array_equal(less.values, best.values)
    assert less.score < nothing.score
