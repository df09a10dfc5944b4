"""What stays of the effects that were added: what is known to be there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.gap.search.test_naming import LEG, RATE, hide, problem_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.manifest import load_experiments
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.search import keeping
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.keeping import settled, where_certain
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Structure, Term
from walkerkit.gap.workflow import prepare
from walkerkit.tasks.excitation import BATTERY

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


def judge(monkeypatch: pytest.MonkeyPatch, sure: dict[tuple[str, str], float]) -> None:
    """Has numbers be known by so many standard errors, those of other effects and places by 9."""

    def certainty(objective: Objective, one: Fit, *_: object) -> NDArray[np.float64]:
        keys = [(slot.term.effect.name, slot.place) for slot in one.structure.slots]
        return np.array([sure.get(key, 9.0) for key in keys])

    monkeypatch.setattr(keeping, "certainty", certainty)


def fit_of(problem: Problem, *terms: tuple[Term, list[float]]) -> Fit:
    structure = Structure(tuple(term for term, _ in terms), problem.robots)
    values = np.concatenate([some for _, some in terms])
    (one,) = evaluate(problem.fit.objective, [(structure, values)])
    return one


def places(one: Fit) -> dict[str, tuple[str, ...]]:
    return {term.effect.name: term.sites for term in one.structure.terms}


def test_places_and_the_only_effect_wait_for_what_else_may_pull_them(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = fit_of(problem, (ROTOR, [1e-5]))
    assert where_certain(problem, alone, EVERY, whole=False) is alone
    judge(monkeypatch, {("viscous_friction", "ankle"): 0.5})
    two = fit_of(problem, (DAMPED, [0.3, 0.001]), (ROTOR, [1e-5]))
    assert where_certain(problem, two, EVERY, whole=False) is two
    found = where_certain(problem, two, EVERY, whole=True)
    assert places(found) == {"viscous_friction": ("knee",), "armature": ("ankle",)}


@pytest.mark.parametrize(("known", "left"), [(1.5, ("knee", "ankle")), (0.5, ("knee",))])
def test_a_place_of_unknown_direction_goes_even_where_it_seems_worth_it(
    problem: Problem, monkeypatch: pytest.MonkeyPatch, known: float, left: tuple[str, ...]
) -> None:
    judge(monkeypatch, {("viscous_friction", "ankle"): known})
    monkeypatch.setattr(keeping, "worth_it", lambda *_, **__: True)
    one = fit_of(problem, (DAMPED, [0.3, 0.001]))
    assert places(where_certain(problem, one, EVERY, whole=True)) == {"viscous_friction": left}


def test_a_place_without_which_much_is_lost_stays(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    judge(monkeypatch, {("viscous_friction", "knee"): 0.5})
    one = fit_of(problem, (DAMPED, [0.3, 0.001]))
    assert where_certain(problem, one, EVERY, whole=True) is one


def test_a_needed_effect_does_not_hide_a_needless_one(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    judge(monkeypatch, {("viscous_friction", "knee"): 0.1, ("armature", "ankle"): 0.5})
    one = fit_of(problem, (replace(DAMPED, sites=("knee",)), [0.3]), (ROTOR, [1e-5]))
    found = where_certain(problem, one, EVERY, whole=True)
    assert places(found) == {"viscous_friction": ("knee",)}


@pytest.mark.parametrize("beside", [True, False])
def test_what_is_felt_nowhere_goes(
    problem: Problem, monkeypatch: pytest.MonkeyPatch, beside: bool
) -> None:
    judge(monkeypatch, {("armature", "ankle"): np.inf, ("viscous_friction", "ankle"): np.inf})
    terms = [(DAMPED, [0.3, 0.0])] if beside else []
    found = where_certain(problem, fit_of(problem, *terms, (ROTOR, [0.0])), EVERY, whole=True)
    assert places(found) == ({"viscous_friction": ("knee",)} if beside else {})


def test_a_needed_place_does_not_hide_a_needless_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    end, toe = "</body>\n    </body>", 'position joint="toe" kp="10" kv="0.2"'
    foot = """
        <body name="foot" pos="0 0 -0.2"><joint name="toe" axis="0 1 0" armature="0.003"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.1" size="0.02" mass="0.2"/></body>"""
    path = tmp_path / "leg.xml"
    path.write_text(
        LEG.replace("</body>\n    </body>", f"{foot}{end}").replace(
            "</actuator>", f"<{toe}/></actuator>"
        )
    )
    rng, room = np.random.default_rng(0), np.array([0.6, 0.5, 0.4])
    time = np.arange(0.0, 2.0, 1 / RATE)
    targets = [
        BATTERY[name](time, lower=-room, upper=room, rng=rng, max_velocity=6.0)
        for name in ("multisine", "chirp")
    ]
    hidden = [hide("viscous_friction", joint, damping=0.3) for joint in ("knee", "ankle")]
    logs = run_hardware(path, targets, rate=RATE, hidden=hidden, seed=1)
    problem = prepare(load_experiments(path, logs), window=0.5, n_threads=1).problem("zero_order")
    one = fit_of(problem, (replace(DAMPED, sites=("knee", "ankle", "toe")), [0.3, 0.3, 0.001]))
    judge(monkeypatch, {("viscous_friction", "ankle"): 0.1, ("viscous_friction", "toe"): 1.5})
    found = where_certain(problem, one, EVERY, whole=True)
    assert places(found) == {"viscous_friction": ("knee", "ankle")}
