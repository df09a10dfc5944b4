"""What effects promise, on a leg with something hidden in it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, hide, problem_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.search.fit import evaluate, fit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.signatures import View, look
from walkerkit.gap.search.structure import Term, candidate_terms

EFFECTS = ("viscous_friction", "torque_bias", "position_gain", "payload", "sensor_delay")
Look = Callable[..., tuple[Problem, View, list[Term]]]


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Look:
    """Looks at a leg with hidden effects from its plain model."""
    model = tmp_path_factory.mktemp("leg") / "leg.xml"
    model.write_text(LEG)

    def look_at(*hidden: HiddenEffect) -> tuple[Problem, View, list[Term]]:
        problem = problem_of(model, hidden)
        terms = candidate_terms([CATALOGUE[n] for n in EFFECTS], problem.robots, problem.joints)
        (nothing,) = evaluate(problem.screen.objective, [(problem.nothing, np.zeros(0))])
        problem.screen.refine(nothing)
        return problem, look(problem.screen, nothing, terms), list(terms)

    return look_at


def index(terms: list[Term], effect: str) -> int:
    return next(i for i, term in enumerate(terms) if term.effect.name == effect)


def test_the_hidden_effect_promises_most_and_keeps_it(seen: Look) -> None:
    problem, view, terms = seen(hide("torque_bias", "knee", bias=0.3))
    promised = [view.promise([i]) for i in range(len(terms))]
    best = index(terms, "torque_bias")
    assert int(np.argmin(promised)) == best
    assert view.candidates[best].term.sites == ("knee",)
    objective = problem.screen.objective
    (found,) = fit(objective, evaluate(objective, [view.start([best])]))
    assert found.score == pytest.approx(promised[best], abs=0.15)
    assert found.values == pytest.approx([0.3], rel=0.1)


def test_a_pair_promises_what_neither_does_alone(seen: Look) -> None:
    _, view, terms = seen(
        hide("viscous_friction", "ankle", damping=0.3), hide("torque_bias", "knee", bias=0.3)
    )
    pair = index(terms, "viscous_friction"), index(terms, "torque_bias")
    alone = min(view.promise([i]) for i in range(len(terms)))
    assert view.promise(pair) < alone - 0.3
    others = [
        view.promise([i, k])
        for i in range(len(terms))
        for k in range(i)
        if {i, k} != set(pair) and terms[i].effect is not terms[k].effect
    ]
    assert view.promise(pair) < min(others)
    structure, values = view.start(pair)
    assert [(t.effect.name, t.sites) for t in structure.terms] == [
        ("viscous_friction", ("ankle",)),
        ("torque_bias", ("knee",)),
    ]
    assert (values > 0).all()


def test_more_can_only_promise_more(seen: Look) -> None:
    _, view, terms = seen(hide("position_gain", "knee", delta_kp=5.0))
    for i in range(len(terms)):
        assert view.promise([i]) <= view.score + 1e-9
        for k in range(i):
            both = view.promise([i, k])
            assert both <= min(view.promise([i]), view.promise([k])) + 0.02


def test_one_value_for_all_starts_as_one(seen: Look) -> None:
    _, view, terms = seen(hide("sensor_delay", "*", delay=0.01))
    shared = index(terms, "sensor_delay")
    assert terms[shared].shared
    structure, values = view.start([shared])
    assert (len(structure.slots), values.tolist()) == (1, [0.01])


def test_a_shared_effect_of_one_joint_is_looked_at_joint_by_joint(seen: Look) -> None:
    _, view, terms = seen(hide("sensor_delay", "knee", delay=0.01))
    promised = [view.promise([i]) for i in range(len(view.candidates))]
    best = view.candidates[int(np.argmin(promised))].term
    assert (best.effect.name, best.sites, best.shared) == ("sensor_delay", ("knee",), False)
    assert len(view.candidates) > len(terms)
