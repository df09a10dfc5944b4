"""What would pass for a name, against least squares by numpy and what is known of a servo."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.gap.servo import SERVO, recorded
from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE, Effect
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.search.decision import NUMERICAL_LEFT, PRICE_RARE, PRICE_UNKNOWN
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.lookalikes import Lookalikes, lookalikes
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.settle import settled
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Case, Fit, Structure, extended
from walkerkit.gap.workflow import prepare

FRICTION = ("viscous_friction", "armature", "coulomb_friction")
OTHERS = ("stribeck_friction", "pose_dependent_friction", "parallel_spring", "torque_bias")

FloatArray = NDArray[np.float64]
Logs = Callable[..., tuple[Path, list[Recording]]]
Make = Callable[..., Problem]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Logs:
    """A servo, and logs of it with something hidden at its joint."""
    model = tmp_path_factory.mktemp("servo") / "servo.xml"
    model.write_text(SERVO)

    def record(effect: str, **values: float) -> tuple[Path, list[Recording]]:
        return model, recorded(model, HiddenEffect(effect=effect, joints=("knee",), values=values))

    return record


@pytest.fixture(scope="module")
def problem(logs: Logs) -> Make:
    """What is to be explained of such logs."""

    def make(effect: str, **values: float) -> Problem:
        setup = prepare(load_experiments(*logs(effect, **values)), window=0.5, n_threads=1)
        return setup.problem("zero_order")

    return make


@pytest.fixture(scope="module")
def loaded(problem: Make) -> tuple[Problem, Fit]:
    """Friction in proportion to the load, of which dry friction tells a part."""
    servo = problem("load_dependent_friction", coefficient=0.3)
    return servo, fitted(servo, *FRICTION)


def fitted(problem: Problem, *names: str) -> Fit:
    """Some effects, fitted to what is fitted."""
    (nothing,) = evaluate(problem.fit.objective, [(Structure((), problem.robots), np.zeros(0))])
    terms = problem.terms([CATALOGUE[name] for name in names])
    return settled(problem.fit, extended(nothing, terms), passes=2)


def effects(*names: str) -> list[Effect]:
    return [CATALOGUE[name] for name in names]


def test_shares_are_those_of_least_squares(loaded: tuple[Problem, Fit]) -> None:
    """By numpy on whole matrices, each try of an effect on its own."""
    servo, told = loaded
    found = lookalikes(servo, told, effects(*OTHERS))["coulomb_friction"]
    servo.screen.refine(told)
    objective, slopes = servo.screen.objective, linearised(servo.screen.objective, told)
    residual = slopes.residual
    root = np.sqrt(objective.weights(objective.mean_square(residual)))
    assert {channel.joint for channel in objective.channels} == {"knee"}

    def change(structure: Structure, values: FloatArray) -> FloatArray:
        (rows,) = objective.freed([Case(structure=structure, values=values[None])])
        (own,) = objective.freed([told.case])
        return (rows[0] - own[0]) * root

    def left(target: FloatArray, *columns: FloatArray) -> float:
        """The least sum of squares of what some columns leave of a target."""
        matrix = np.stack([column.ravel() for column in columns], axis=1)
        matrix = matrix / np.linalg.norm(matrix, axis=0)
        x = np.linalg.lstsq(matrix, target.ravel(), rcond=1e-6)[0]
        return float(np.square(target.ravel() - matrix @ x).sum())

    friction = 2
    without = told.values.copy()
    without[friction] = 0.0
    gone = change(told.structure, without)
    rest = [*(slopes.jacobian[[0, 1]] * root), *(objective.numerical.changes * root)]
    its = [slopes.jacobian[friction] * root, gone]
    size = servo.noise**2 + (NUMERICAL_LEFT * objective.numerical_size()) ** 2
    noise = float((objective.weights(objective.mean_square(residual)) * objective.count) @ size)
    explained = left(gone, *rest)
    unexplained = left(residual * root, *rest, *its) - noise
    assert found.share == pytest.approx(explained / (explained + unexplained), rel=1e-3)
    for name in OTHERS:
        (term,) = servo.terms(effects(name))
        structure = told.structure.with_term(term)
        parameters = [slot.parameter for slot in structure.slots[3:]]
        shares = []
        starts = [*zip(*(one.starts for one in parameters), strict=True)]
        for start in {starts[0], starts[(len(starts) - 1) // 2], starts[-1]}:
            made = change(structure, np.append(told.values, start))
            shares.append(1 - left(made, *rest, *its) / left(made, *rest))
        assert found.passing[name] == pytest.approx(np.mean(np.array(shares) >= found.share))


def test_what_leaves_nothing_would_pass_for_nothing(problem: Make) -> None:
    servo = problem("viscous_friction", damping=0.3)
    told = fitted(servo, "viscous_friction")
    assert servo.leaves_nothing(told)
    assert lookalikes(servo, told, [*CATALOGUE.values()]) == {}


def test_what_is_there_would_pass_for_little(problem: Make) -> None:
    """The simulated hardware rubs with bristles, so that dry friction leaves a little."""
    servo = problem("coulomb_friction", frictionloss=0.5)
    told = fitted(servo, *FRICTION)
    assert not servo.leaves_nothing(told)
    found = lookalikes(servo, told, [*CATALOGUE.values()])["coulomb_friction"]
    assert found.share > 0.99
    assert len(found.passing) > 20
    assert found.odds < 0.02


def test_what_is_in_its_place_would_pass_for_many(loaded: tuple[Problem, Fit]) -> None:
    servo, told = loaded
    found = lookalikes(servo, told, [*CATALOGUE.values()])["coulomb_friction"]
    assert 0.2 < found.share < 0.9
    assert {"stribeck_friction", "pose_dependent_friction"} <= {*found.names}
    assert not {"parallel_spring", "torque_bias"} & {*found.names}
    assert "coulomb_friction" not in found.passing
    assert "viscous_friction" not in found.passing  # it is told


def test_odds_go_with_what_is_listed_and_how_rare_the_name_is() -> None:
    passing = {"payload": 1.0, "base_tilt": 0.5, "com_offset": 0.25}
    rare = Lookalikes(price=PRICE_RARE, share=0.7, passing=passing)
    assert rare.odds == pytest.approx(1.75 * math.exp(PRICE_RARE - PRICE_UNKNOWN))
    assert replace(rare, price=0.0).odds == pytest.approx(1.75 * math.exp(-PRICE_UNKNOWN))
    assert rare.names == ("payload",)
    same = rare.without(["payload", "armature"])
    assert same.passing == {"base_tilt": 0.5, "com_offset": 0.25}
    assert same.share == rare.share


def test_what_is_doubted_is_as_likely_as_what_is_usual(loaded: tuple[Problem, Fit]) -> None:
    servo, _ = loaded
    rare = fitted(servo, "armature", "torque_bias")
    (term,) = (t for t in rare.structure.terms if t.effect.name == "torque_bias")
    doubted = replace(term, doubted=frozenset(term.sites))
    other = replace(rare, structure=rare.structure.replaced(term, doubted))
    found, as_doubted = (
        lookalikes(servo, fit, effects(*OTHERS))["torque_bias"] for fit in (rare, other)
    )
    assert (found.price, as_doubted.price) == (PRICE_RARE, 0.0)
    assert found.passing == as_doubted.passing


def test_the_result_says_for_what_a_name_would_pass(logs: Logs) -> None:
    model, recordings = logs("load_dependent_friction", coefficient=0.3)
    told = gap.diagnose(model, recordings, effects=[*FRICTION, *OTHERS], n_threads=1).diagnosis
    assert told.effects
    assert all(effect.confidence < 0.9 for effect in told.effects)
    said = [note for note in told.notes if "of a kind that the catalogue does not have" in note]
    assert {note.split()[0] for note in said} == {effect.effect for effect in told.effects}
    assert "stribeck_friction" in " ".join(said)
