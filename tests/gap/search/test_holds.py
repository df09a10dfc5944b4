"""How targets are read, by what each reading could explain."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.gap.search.test_naming import LEG, problem_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.holds import _flexible_scores
from walkerkit.gap.search.structure import Structure, candidate_terms


def test_what_stood_in_for_another_reading_is_not_in_its_way(tmp_path: Path) -> None:
    model = tmp_path / "leg.xml"
    model.write_text(LEG)
    problem = problem_of(model, (), ("position_target", "position", "effort"))
    (skew,) = candidate_terms([CATALOGUE["clock_skew"]], problem.robots, problem.joints)
    structure = Structure((skew,), problem.robots)
    objective = problem.fit.objective
    nothing, named = evaluate(
        objective, [(problem.nothing, np.zeros(0)), (structure, np.array([-0.01]))]
    )
    (right,) = _flexible_scores([problem], nothing)
    (found,) = _flexible_scores([problem], named)
    assert found <= right + 1e-6
