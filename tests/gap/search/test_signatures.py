"""What effects promise, on a leg with something hidden in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from tests.gap.search.test_naming import LEG, hide, problem_of
from tests.gap.search.test_starting_states import LEG as UNDER_TORQUE
from tests.gap.search.test_starting_states import logged
from walkerkit.gap import steps
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.search.fit import evaluate, fit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.signatures import View, _within, look
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


def test_what_goes_best_at_all_joints_together_starts_near_the_truth(seen: Look) -> None:
    """A torque at one joint moves the other; each by itself, both start far from what is right."""
    problem, view, terms = seen(
        hide("torque_bias", "knee", bias=0.3), hide("torque_bias", "ankle", bias=-0.05)
    )
    own = index(terms, "torque_bias")
    structure, values = view.shared_out(own)
    assert [slot.place for slot in structure.slots] == ["knee", "ankle"]
    assert values == pytest.approx([0.3, -0.05], rel=0.15)
    shared, apart = evaluate(problem.screen.objective, [(structure, values), view.start([own])])
    assert shared.score < apart.score - 0.5


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


@pytest.mark.parametrize("joint", ["hip", "knee"])
@pytest.mark.parametrize("offset", [0.03, 0.07, -0.07])
def test_one_joint_is_looked_at_both_ways_whatever_the_others_do(
    tmp_path: Path, joint: str, offset: float
) -> None:
    """Under torque, an offset of the hip moves the knee's shank more than the knee's own does."""
    model = tmp_path / "leg.xml"
    model.write_text(UNDER_TORQUE)
    column = f"{joint}/position"
    recordings = [
        replace(one, columns={**one.columns, column: one.columns[column] + offset})
        for one in logged(noise=1e-3)
    ]
    problem = steps.load(model, recordings)
    terms = candidate_terms([CATALOGUE["encoder_offset"]], problem.robots, problem.joints)
    (nothing,) = evaluate(problem.screen.objective, [(problem.nothing, np.zeros(0))])
    problem.searched.look_at(nothing.case)
    problem.screen.refine(nothing)
    view = look(problem.screen, nothing, terms)
    (found,) = view.candidates
    assert list(found.tries) == [joint]
    assert np.sign(found.tries[joint]) == np.sign(offset)
    assert view.score - view.promise([0]) > 1.0


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(("free", "bounded"), [(0, 3), (2, 3), (4, 2), (3, 1)])
def test_factors_with_bounds_are_those_of_least_squares(seed: int, free: int, bounded: int) -> None:
    # What halves and quarters of a timestep change is nearly the same.
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(50, free + bounded)) + 3.0 * rng.normal(size=(50, 1))
    right = columns @ rng.normal(scale=3.0, size=free + bounded) + rng.normal(size=50)
    matrix, target = columns.T @ columns, columns.T @ right
    of_bounded = np.zeros(free + bounded, dtype=bool)
    of_bounded[rng.choice(free + bounded, bounded, replace=False)] = True
    low, high = np.array([0.0, -2.0, 0.0])[:bounded], np.array([2.0, 2.0, 2.5])[:bounded]
    lower, upper = np.full(free + bounded, -np.inf), np.full(free + bounded, np.inf)
    lower[of_bounded], upper[of_bounded] = low, high
    best = lsq_linear(columns, right, bounds=(lower, upper), tol=1e-14)
    x = _within(matrix, target, np.linalg.solve(matrix, target), of_bounded, low, high)
    assert ((x >= lower) & (x <= upper)).all()
    assert np.square(columns @ x - right).sum() == pytest.approx(2 * best.cost, rel=1e-6)
