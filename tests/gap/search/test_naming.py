"""Forward selection on small problems: what is named, where, and what is dropped again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.manifest import load_experiments
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.search import keeping, naming, trying
from walkerkit.gap.search.contest import contests
from walkerkit.gap.search.evidence import Evidence, weigh, weigh_as_told
from walkerkit.gap.search.fit import evaluate, fit
from walkerkit.gap.search.naming import Round, name_effects
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Structure, candidate_terms
from walkerkit.gap.search.trying import Tries
from walkerkit.gap.search.worth import worth_it
from walkerkit.gap.workflow import prepare
from walkerkit.tasks.excitation import BATTERY

LEG = """
<mujoco model="leg">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="thigh">
      <joint name="knee" axis="0 1 0" armature="0.005" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
      <body name="shin" pos="0 0 -0.25">
        <joint name="ankle" axis="0 1 0" armature="0.005" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="knee" kp="30" kv="1"/>
    <position joint="ankle" kp="20" kv="0.5"/>
  </actuator>
</mujoco>
"""
RATE, SECONDS = 250.0, 2.0
PLAIN = (
    *("viscous_friction", "coulomb_friction", "armature", "payload", "position_gain"),
    *("velocity_gain", "torque_constant", "torque_bias", "command_delay", "encoder_offset"),
    *("base_tilt", "backlash", "timestep"),
)

Q_ONLY = ("position_target", "position")
EVERYTHING = (*Q_ONLY, "velocity", "effort")

Make = Callable[..., Problem]


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Makes the problem of a leg with hidden effects; the chirp is held out."""
    model = tmp_path_factory.mktemp("leg") / "leg.xml"
    model.write_text(LEG)

    def make(*hidden: HiddenEffect, signals: Sequence[str] = EVERYTHING) -> Problem:
        return problem_of(model, hidden, signals)

    return make


RECORDED: dict[str, list[Recording]] = {}


def problem_of(
    model: Path, hidden: Sequence[HiddenEffect], signals: Sequence[str] = EVERYTHING
) -> Problem:
    if str(hidden) not in RECORDED:
        RECORDED[str(hidden)] = recorded(model, hidden)
    logged = [
        replace(
            one,
            columns={
                name: column
                for name, column in one.columns.items()
                if name.split("/")[1] in signals
            },
        )
        for one in RECORDED[str(hidden)]
    ]
    experiments = load_experiments(model, logged)
    return prepare(experiments, window=0.5, n_threads=1).problem("zero_order")


def recorded(model: Path, hidden: Sequence[HiddenEffect]) -> list[Recording]:
    time = np.arange(0.0, SECONDS, 1 / RATE)
    rng = np.random.default_rng(0)
    room = np.array([0.6, 0.5])
    targets = [
        BATTERY[name](time, lower=-room, upper=room, rng=rng, max_velocity=6.0)
        for name in ("multisine", "slow_triangle", "chirp")
    ]
    return run_hardware(model, targets, rate=RATE, hidden=hidden, seed=1)


def hide(effect: str, *joints: str, **values: float) -> HiddenEffect:
    return HiddenEffect(
        effect=effect,
        joints=joints,
        values={key.replace("__", "/"): value for key, value in values.items()},
    )


def search(problem: Problem, *effects: str) -> tuple[Round, ...]:
    return name_effects(problem, [CATALOGUE[name] for name in effects])


def found(rounds: Sequence[Round]) -> dict[str, dict[str, float]]:
    """Effect to place to the value of its first parameter, of the final fit."""
    fit = rounds[-1].fit
    slots = zip(fit.structure.slots, fit.values.tolist(), strict=True)
    named: dict[str, dict[str, float]] = {}
    for slot, value in slots:
        named.setdefault(slot.term.effect.name, {}).setdefault(slot.place, value)
    return named


# Where to stop


def test_without_effects_there_is_one_empty_round(problem: Make) -> None:
    (only,) = search(problem(hide("torque_bias", "knee", bias=0.3)))
    assert (only.candidates, only.named, only.fit.structure.terms) == ((), None, ())


def test_nothing_is_named_where_nothing_is_hidden(problem: Make) -> None:
    (only,) = search(problem(), *PLAIN)
    assert (only.named, only.fit.structure.terms) == (None, ())


def test_at_the_floor_nothing_is_even_tried(problem: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keeping, "_AT_FLOOR", 1e9)
    (only,) = search(problem(hide("torque_bias", "knee", bias=0.3)), *PLAIN)
    assert (only.candidates, only.named, only.fit.structure.terms) == ((), None, ())


def test_effects_that_do_not_help_are_tried_and_lose(problem: Make) -> None:
    (only,) = search(problem(hide("torque_bias", "knee", bias=0.3)), "armature")
    assert [one.term.effect.name for one in only.candidates] == ["armature"]
    assert only.named is None
    assert only.fit.structure.terms == ()
    assert only.candidates[0].gain < 0.04
    assert not only.candidates[0].close


def test_never_more_than_so_many_rounds(problem: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trying, "MOST_EFFECTS", 1)
    both = hide("torque_bias", "knee", bias=0.3), hide("sensor_delay", "*", delay=0.01)
    rounds = search(problem(*both), "torque_bias", "sensor_delay")
    assert [one.named is not None for one in rounds] == [True, False]
    assert rounds[-1].candidates == ()


# What is named, and where


def test_the_named_effect_leads_its_round(problem: Make) -> None:
    rounds = search(problem(hide("torque_bias", "knee", bias=0.3)), "payload", "torque_bias")
    first = rounds[0].candidates
    assert rounds[0].named is not None
    assert first[0].term.effect is rounds[0].named.effect is CATALOGUE["torque_bias"]
    assert first[0].gain > first[1].gain
    assert [one.close for one in first] == [False, False]
    assert rounds[0].confidence > 0.95
    assert rounds[-1].named is None


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [
        (hide("torque_bias", "ankle", bias=0.2), {"ankle": 0.2}),
        (
            hide("torque_bias", "knee", "ankle", knee__bias=-0.3, ankle__bias=0.2),
            {"knee": -0.3, "ankle": 0.2},
        ),
    ],
    ids=["one joint", "both joints"],
)
def test_an_effect_stays_at_the_joints_that_need_it(
    problem: Make, hidden: HiddenEffect, expected: dict[str, float]
) -> None:
    named = found(search(problem(hidden), "torque_bias"))
    assert named == {"torque_bias": pytest.approx(expected, rel=0.1)}


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [
        (hide("sensor_delay", "*", delay=0.01), {"*": 0.01}),
        (hide("sensor_delay", "ankle", delay=0.01), {"ankle": 0.01}),
        (
            hide("sensor_delay", "knee", "ankle", knee__delay=0.004, ankle__delay=0.012),
            {"knee": 0.004, "ankle": 0.012},
        ),
    ],
    ids=["shared", "one joint", "two delays"],
)
def test_a_delay_is_shared_only_where_all_joints_have_it(
    problem: Make, hidden: HiddenEffect, expected: dict[str, float]
) -> None:
    rounds = search(problem(hidden), "sensor_delay")
    assert found(rounds) == {"sensor_delay": pytest.approx(expected, rel=0.1)}
    # One value and one each are two ways to try one effect.
    assert [one.term.effect.name for one in rounds[0].candidates] == ["sensor_delay"]


def test_a_payload_stays_on_the_body_that_carries_it(problem: Make) -> None:
    hidden = HiddenEffect(effect="payload", bodies=("shin",), values={"mass": 0.15})
    named = found(search(problem(hidden), "payload"))
    assert named == {"payload": {"shin": pytest.approx(0.15, rel=0.1)}}


def test_a_gear_that_loses_by_its_load_may_lose_by_its_direction(problem: Make) -> None:
    gear = hide("directional_efficiency", "knee", driving=0.75, backdriving=1.25)
    rounds = search(problem(gear), "load_dependent_friction", "directional_efficiency")
    assert set(found(rounds)) == {"load_dependent_friction"}
    close = [one.term.effect.name for one in rounds[0].candidates if one.close]
    assert close == ["directional_efficiency"]


def test_the_usual_cause_of_two_that_are_alike_is_named(problem: Make) -> None:
    leg = problem(hide("viscous_friction", "knee", damping=0.1), signals=Q_ONLY)
    both = [CATALOGUE["velocity_gain"], CATALOGUE["viscous_friction"]]
    rare, usual = both
    (nothing,) = evaluate(leg.fit.objective, [(leg.nothing, np.zeros(0))])
    # However little the usual one promised.
    tries = Tries(leg, both, None)
    (gain,) = tries.each_on_top_of(nothing, [rare])
    tries.like = lambda others, effect: frozenset({rare.name})  # type: ignore[method-assign]
    (met,) = contests(leg, tries, gain)
    assert [one.structure.terms[-1].effect for one in met.fits] == [rare, usual]
    assert [one.fit.structure.terms[-1].effect for one in met.better] == [usual]
    # And never the other way round.
    (damping,) = tries.each_on_top_of(nothing, [usual])
    (met,) = contests(leg, Tries(leg, both, None), damping)
    assert met.better == ()


def test_a_plainer_effect_is_named_where_a_wider_one_is_no_better(problem: Make) -> None:
    leg = problem(hide("coulomb_friction", "knee", frictionloss=0.3))
    effects = [CATALOGUE["coulomb_friction"], CATALOGUE["stribeck_friction"]]
    (nothing,) = evaluate(leg.fit.objective, [(leg.nothing, np.zeros(0))])
    tries = Tries(leg, effects, None)
    (wide,) = tries.each_on_top_of(nothing, effects[1:])
    (met,) = contests(leg, tries, wide)
    assert met.better[0].fit.structure.terms[0].effect is effects[0]


def test_many_numbers_that_are_a_little_wrong_are_no_rarer_effect(problem: Make) -> None:
    hidden = (
        hide("viscous_friction", "*", damping=0.02),
        hide("armature", "*", armature=0.001),
        hide("coulomb_friction", "*", frictionloss=0.01),
    )
    usual = ("viscous_friction", "armature", "coulomb_friction")
    rare = ("velocity_gain", "command_delay", "sensor_delay", "quadratic_drag", "position_gain")
    named = found(search(problem(*hidden, signals=Q_ONLY), *rare, *usual))
    assert named
    assert set(named) <= set(usual)


def test_who_wins_a_round_is_judged_by_its_own_numerical_error(
    problem: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    leg = problem(hide("coulomb_friction", "knee", frictionloss=0.3))
    judged: list[str] = []

    def finalists(problem: Problem, fits: Sequence[Fit]) -> list[tuple[Fit, Evidence]]:
        ((found, evidence),) = keeping.finalists(problem, fits)
        judged.append(found.structure.terms[-1].effect.name)
        if len(judged) == 1:  # as if its own error hid all that it explains
            evidence = weigh(problem, [replace(found, values=found.structure.zero)])
        return [(found, evidence)]

    def best(fits: Sequence[Fit], evidence: Evidence) -> list[int]:
        return [int(np.argmin(evidence.both[1:]))][: len(fits)]

    monkeypatch.setattr(naming, "finalists", finalists)
    monkeypatch.setattr(naming, "_could_win", best)
    search(leg, "coulomb_friction", "asymmetric_friction")
    assert sorted(judged[:2]) == ["asymmetric_friction", "coulomb_friction"]


@pytest.mark.parametrize("ahead", [0, 2])
def test_two_effects_that_are_worth_it_only_together_are_found(
    problem: Make, monkeypatch: pytest.MonkeyPatch, ahead: int
) -> None:
    """By what one of them makes of the recordings that are fitted, where no pair is promised."""
    leg = problem(
        hide("viscous_friction", "knee", damping=0.2), hide("torque_bias", "ankle", bias=0.4)
    )

    def not_alone(*compared: Any, effects: int = 1) -> bool:
        return effects > 1 and worth_it(*compared, effects=effects)

    monkeypatch.setattr(naming, "worth_it", not_alone)
    monkeypatch.setattr(trying, "_MOST_PAIRS", 0)
    monkeypatch.setattr(naming, "_MOST_AHEAD", ahead)
    named = found(search(leg, "viscous_friction", "torque_bias", "armature"))
    assert set(named) == ({"viscous_friction", "torque_bias"} if ahead else set())


def test_finalists_are_fitted_as_each_is_alone(problem: Make) -> None:
    leg = problem(hide("coulomb_friction", "knee", frictionloss=0.3))
    names = ("coulomb_friction", "viscous_friction", "quadratic_drag")
    effects = [CATALOGUE[name] for name in names]
    (nothing,) = evaluate(leg.fit.objective, [(leg.nothing, np.zeros(0))])
    fits = Tries(leg, effects, None).each_on_top_of(nothing, effects)
    assert len(fits) >= len(names)
    together = keeping.finalists(leg, fits[:3])
    for one, (found, evidence) in zip(fits, together, strict=False):
        ((alone, own),) = keeping.finalists(leg, [one])
        np.testing.assert_allclose(found.values, alone.values, rtol=1e-9)
        np.testing.assert_allclose(evidence.both, own.both, rtol=1e-9)


def test_an_effect_that_stood_in_for_others_leaves_again(problem: Make) -> None:
    hidden = (
        hide("coulomb_friction", "knee", frictionloss=0.3),
        hide("command_delay", "*", delay=0.012),
    )
    rounds = search(problem(*hidden), "velocity_gain", "coulomb_friction", "command_delay")
    assert set(found(rounds)) == {"coulomb_friction", "command_delay"}
    terms = [term.effect.name for term in rounds[-1].fit.structure.terms]
    assert len(terms) == len(set(terms))


def test_what_only_the_fitted_recordings_show_stays(tmp_path: Path) -> None:
    model = tmp_path / "leg.xml"
    model.write_text(LEG)
    time, room = np.arange(0.0, SECONDS, 1 / RATE), np.array([0.6, 0.5])
    rng = np.random.default_rng(0)
    moving = [
        BATTERY[name](time, lower=-room, upper=room, rng=rng, max_velocity=6.0)
        for name in ("multisine", "chirp")
    ]
    hidden = [
        hide("torque_bias", "knee", bias=0.5),
        hide("viscous_friction", "*", damping=0.3),
    ]
    logs = run_hardware(
        model, [*moving, np.zeros_like(moving[0])], rate=RATE, hidden=hidden, seed=1
    )
    given = load_experiments(model, logs, held_out=logs[2:])
    leg = prepare(given, window=0.5, n_threads=1).problem("zero_order")
    effects = [CATALOGUE[name] for name in ("viscous_friction", "torque_bias")]
    terms = candidate_terms(effects, leg.robots, leg.joints)
    structure = Structure(terms, leg.robots)
    both = fit(leg.fit.objective, evaluate(leg.fit.objective, [(structure, structure.zero)]))
    found = keeping.kept(leg, both[0], [], effects)
    assert [term.effect for term in found.structure.terms] == effects


def test_effects_that_can_do_the_same_become_what_one_of_them_generalises(problem: Make) -> None:
    hidden = (
        hide("torque_bias", "knee", bias=0.3),
        hide("coulomb_friction", "knee", frictionloss=0.15),
    )
    leg = problem(*hidden)
    alike = [CATALOGUE[name] for name in ("torque_bias", "asymmetric_friction")]
    terms = [
        replace(term, sites=("knee",)) for term in candidate_terms(alike, leg.robots, leg.joints)
    ]
    structure = Structure(tuple(terms), leg.robots)
    # The bias is 0.3 and the friction 0.15, or 0.25 and 0.2 one way and 0.1 the other, and so on.
    (either,) = evaluate(leg.fit.objective, [(structure, np.array([0.25, 0.1, 0.2]))])
    plain = CATALOGUE["coulomb_friction"]
    kept = keeping.kept(leg, either, [], [*alike, plain])
    assert [term.effect for term in kept.structure.terms] == [alike[0], plain]
    np.testing.assert_allclose(kept.values, [0.3, 0.15], rtol=0.1)
    # Nobody may name what is not in the catalogue.
    kept = keeping.kept(leg, either, [], alike)
    assert {term.effect for term in kept.structure.terms} <= set(alike)


def test_what_whole_rollouts_say_is_the_gap_that_is_told(problem: Make) -> None:
    leg = problem(hide("torque_bias", "ankle", bias=0.2))
    nothing = evaluate(leg.fit.objective, [(leg.nothing, np.zeros(0))])
    told = weigh_as_told(leg, nothing)
    np.testing.assert_allclose(told.mean_square[0], leg.told.as_it_is([nothing[0].case])[0][0])
    np.testing.assert_array_equal(told.both, told.held)


def test_the_same_problem_gives_the_same_answer_twice(problem: Make) -> None:
    leg = problem(hide("torque_bias", "ankle", bias=0.2))
    once, again = (search(leg, "payload", "torque_bias") for _ in range(2))
    np.testing.assert_array_equal(once[-1].fit.values, again[-1].fit.values)
    assert [one.confidence for one in once] == [one.confidence for one in again]


def test_progress_is_told(problem: Make) -> None:
    told: list[tuple[str, float]] = []
    leg = problem(hide("torque_bias", "ankle", bias=0.2))
    name_effects(leg, [CATALOGUE["torque_bias"]], lambda *what: told.append(what))
    assert told[0] == ("effect 1: screening 1 candidates", 0.0)
    assert {stage for stage, _ in told} >= {"effect 1: fitting 1 candidates"}
    assert all(0 <= done <= 1 for _, done in told)
