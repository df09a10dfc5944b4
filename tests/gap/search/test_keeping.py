"""What stays of the effects that were added: what is known to be there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, hide, problem_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.keeping import settled, where_certain
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Structure, Term

EVERY = tuple(CATALOGUE.values())
DAMPED = Term(effect=CATALOGUE["viscous_friction"], sites=("knee", "ankle"), shared=False)
ROTOR = Term(effect=CATALOGUE["armature"], sites=("ankle",), shared=False)


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """A leg whose knee is damped."""
    path = tmp_path_factory.mktemp("leg") / "leg.xml"
    path.write_text(LEG, encoding="utf-8")
    return problem_of(path, [hide("viscous_friction", "knee", damping=0.3)])


@pytest.mark.parametrize(
    ("terms", "values", "places"),
    [
        ((DAMPED,), [0.3, 0.001], {"viscous_friction": ("knee",)}),
        ((DAMPED, ROTOR), [0.3, 0.0, 1e-5], {"viscous_friction": ("knee",)}),
        ((ROTOR,), [1e-5], {}),
    ],
    ids=["a place", "one of two", "the only one"],
)
def test_what_is_not_known_to_be_there_goes(
    problem: Problem, terms: tuple[Term, ...], values: list[float], places: dict[str, object]
) -> None:
    structure = Structure(terms, problem.robots)
    (full,) = evaluate(problem.fit.objective, [(structure, np.array(values))])
    found, _ = settled(problem, where_certain(problem, full, EVERY, whole=True))
    assert {term.effect.name: term.sites for term in found.structure.terms} == places
    if places:
        assert found.values[0] == pytest.approx(0.3, rel=0.05)


def test_what_is_certain_stays(problem: Problem) -> None:
    structure = Structure((replace(DAMPED, sites=("knee",)),), problem.robots)
    (full,) = evaluate(problem.fit.objective, [(structure, np.array([0.3]))])
    assert where_certain(problem, full, EVERY, whole=True) is full


@pytest.mark.parametrize(
    ("term", "values"), [(DAMPED, [0.3, 0.001]), (ROTOR, [1e-5])], ids=["a place", "the only one"]
)
def test_what_something_else_may_pull_waits(
    problem: Problem, term: Term, values: list[float]
) -> None:
    (full,) = evaluate(
        problem.fit.objective, [(Structure((term,), problem.robots), np.array(values))]
    )
    assert where_certain(problem, full, EVERY, whole=False) is full
