"""Naming on small problems: what is named, where, how surely, and what is dropped again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.report.named import confusion_set
from walkerkit.gap.search.by_itself import all_estimated, only_needed
from walkerkit.gap.search.compare import Table
from walkerkit.gap.search.decision import LEAST_GAIN
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.naming import Explanation, Named, by_usual_names, name_effects
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import Reduction
from walkerkit.gap.search.settle import settled
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit, extended
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


def search(problem: Problem, *effects: str) -> Explanation:
    return name_effects(problem, [CATALOGUE[name] for name in effects])


def found(explanation: Explanation) -> dict[str, dict[str, float]]:
    """Effect to place to the value of its first parameter, of the final fit."""
    fit = explanation.fit
    slots = zip(fit.structure.slots, fit.values.tolist(), strict=True)
    named: dict[str, dict[str, float]] = {}
    for slot, value in slots:
        named.setdefault(slot.term.effect.name, {}).setdefault(slot.place, value)
    return named


def test_a_rare_effect_meets_the_ordinary_that_stands_in_for_it(tmp_path: Path) -> None:
    """Beside gains that follow a payload in the light of a large error it promises nothing."""
    model = tmp_path / "leg.xml"
    model.write_text(LEG)
    rng = np.random.default_rng(3)
    heavier = HiddenEffect(effect="payload", bodies=("shin",), values={"mass": 0.2})
    logs = []
    for log in recorded(model, [heavier]):
        columns = {name: v for name, v in log.columns.items() if name.split("/")[1] in Q_ONLY}
        for name in ("knee/position", "ankle/position"):
            wobble = gaussian_filter1d(rng.standard_normal(len(log.time)), 12)
            columns[name] = columns[name] + 0.002 * wobble / wobble.std()
        logs.append(replace(log, columns=columns))
    leg = prepare(load_experiments(model, logs), window=0.5, n_threads=1).problem("zero_order")
    ordinary = ("viscous_friction", "armature", "position_gain", "velocity_gain")
    table = search(leg, *ordinary, "payload", "torque_bias").table
    key = (("payload", ("shin",)),)
    (alone,) = [k for k in np.flatnonzero(table.once) if table.members[k].key == key]
    member = table.members[alone]
    assert table.weights[alone] > 0.2
    (k,) = member.kept
    assert member.values[k] == pytest.approx(0.2, rel=0.1)


# Where to stop


def test_without_effects_nothing_is_searched(problem: Make) -> None:
    explanation = search(problem(hide("torque_bias", "knee", bias=0.3)))
    assert (explanation.searched, explanation.named, found(explanation)) == (False, (), {})


def test_nothing_is_named_where_nothing_is_hidden(problem: Make) -> None:
    assert found(search(problem(), *PLAIN)) == {}


def test_effects_that_do_not_help_are_tried_and_lose(problem: Make) -> None:
    explanation = search(problem(hide("torque_bias", "knee", bias=0.3)), "quadratic_drag")
    assert explanation.searched
    assert found(explanation) == {}
    assert all(gain < 0.05 for gain in explanation.gains.values())


# What is named, and where


def test_what_is_named_is_sure_and_told_with_what_else_was_tried(problem: Make) -> None:
    explanation = search(problem(hide("torque_bias", "knee", bias=0.3)), "payload", "torque_bias")
    (only,) = explanation.named
    assert only.term.effect is CATALOGUE["torque_bias"]
    assert only.confidence > 0.95
    assert only.exchanges == {}
    frame = explanation.table.frame()
    assert frame.structure[0] == "torque_bias (knee)"
    assert frame.weight.sum() == pytest.approx(1)
    assert frame.difference[0] == 0


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
        (hide("viscous_friction", "ankle", damping=0.2), {"viscous_friction": {"ankle": 0.2}}),
        (
            hide("coulomb_friction", "knee", frictionloss=0.3),
            {"coulomb_friction": {"knee": 0.3}},
        ),
        (hide("position_gain", "knee", delta_kp=6.0), {"position_gain": {"knee": 6.0}}),
    ],
    ids=["damping", "dry friction", "gain"],
)
def test_of_the_ground_only_what_is_needed_is_named(
    problem: Make, hidden: HiddenEffect, expected: dict[str, dict[str, float]]
) -> None:
    explanation = search(problem(hidden), *PLAIN)
    assert {name: pytest.approx(values, rel=0.1) for name, values in expected.items()} == found(
        explanation
    )
    assert explanation.named[0].confidence > 0.9


def test_a_rare_effect_is_judged_on_top_of_what_is_wrong_everywhere(problem: Make) -> None:
    hidden = (
        hide("viscous_friction", "*", damping=0.08),
        hide("armature", "*", armature=0.003),
        hide("coulomb_friction", "*", frictionloss=0.05),
        hide("torque_bias", "knee", bias=0.4),
    )
    explanation = search(problem(*hidden), *PLAIN)
    rare = [one.term for one in explanation.named if not one.term.effect.ordinary]
    assert [(term.effect.name, term.sites) for term in rare] == [("torque_bias", ("knee",))]
    assert found(explanation)["torque_bias"] == {"knee": pytest.approx(0.4, rel=0.1)}


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [
        (hide("sensor_delay", "*", delay=0.01), {"*": 0.01}),
        (hide("sensor_delay", "ankle", delay=0.01), {"ankle": 0.01}),
    ],
    ids=["shared", "one joint"],
)
def test_a_delay_is_shared_only_where_all_joints_have_it(
    problem: Make, hidden: HiddenEffect, expected: dict[str, float]
) -> None:
    named = found(search(problem(hidden), "sensor_delay"))
    assert named == {"sensor_delay": pytest.approx(expected, rel=0.1)}


def test_a_payload_stays_on_the_body_that_carries_it(problem: Make) -> None:
    hidden = HiddenEffect(effect="payload", bodies=("shin",), values={"mass": 0.15})
    named = found(search(problem(hidden), "payload"))
    assert named == {"payload": {"shin": pytest.approx(0.15, rel=0.1)}}


def test_the_usual_cause_of_two_that_are_alike_is_named(problem: Make) -> None:
    leg = problem(hide("viscous_friction", "knee", damping=0.1), signals=Q_ONLY)
    explanation = search(leg, "velocity_gain", "viscous_friction")
    (only,) = explanation.named
    assert only.term.effect.name == "viscous_friction"
    # No log of positions parts the two, so that they count as one.
    assert only.confidence > 0.9
    assert list(only.equivalent) == ["velocity_gain"]
    assert only.exchanges == {}  # what has it by its other name has nothing else in its place


def fitted(problem: Problem, **places: Sequence[str]) -> Fit:
    """A fit of some effects at some joints to what is fitted."""
    terms = [
        replace(term, sites=tuple(places[term.effect.name]))
        for term in problem.terms([CATALOGUE[name] for name in places])
    ]
    start = extended(fit_of_nothing(problem), terms)
    return settled(problem.fit, start, passes=2)


def fit_of_nothing(problem: Problem) -> Fit:
    (nothing,) = evaluate(problem.fit.objective, [(problem.nothing, np.zeros(0))])
    return nothing


def test_what_no_channel_parts_is_told_by_its_usual_name(problem: Make) -> None:
    leg = problem(hide("viscous_friction", "knee", damping=0.1), signals=Q_ONLY)
    told = by_usual_names(leg, fitted(leg, velocity_gain=["knee"], viscous_friction=["ankle"]))
    (term,) = told.structure.terms
    assert (term.effect.name, term.places) == ("viscous_friction", ("knee", "ankle"))
    knee, ankle = told.values
    assert knee == pytest.approx(0.1, rel=0.05)
    assert abs(ankle) < 0.01
    # An effort parts them.
    leg = problem(hide("viscous_friction", "knee", damping=0.1))
    kept = fitted(leg, velocity_gain=["knee"])
    assert by_usual_names(leg, kept) is kept


def test_an_effect_of_which_nothing_is_known_is_not_told(problem: Make) -> None:
    leg = problem(hide("coulomb_friction", "knee", frictionloss=0.3))
    both = fitted(leg, coulomb_friction=["knee"], torque_bias=["ankle"])
    told = all_estimated(leg, both)
    assert [term.effect.name for term in told.structure.terms] == ["coulomb_friction"]
    assert told.values == pytest.approx(0.3, rel=0.05)
    assert all_estimated(leg, told) is told


def test_what_is_worth_no_name_is_left_out_of_what_is_told(problem: Make) -> None:
    leg = problem(hide("coulomb_friction", "knee", frictionloss=0.3))
    both = ["knee", "ankle"]
    full = fitted(leg, coulomb_friction=["knee"], viscous_friction=both, armature=both)
    told = only_needed(leg, full)
    assert [(t.effect.name, t.places) for t in told.structure.terms] == [
        ("coulomb_friction", ("knee",))
    ]
    assert told.score < full.score + LEAST_GAIN


def test_what_resembles_a_named_effect_is_fitted_in_its_place(problem: Make) -> None:
    leg = problem(HiddenEffect(effect="payload", bodies=("shin",), values={"mass": 0.15}))
    alike = CATALOGUE["payload"].resembles
    others = ("parallel_spring", "torque_bias", "encoder_offset", "base_tilt", "strength_drift")
    explanation = search(leg, "armature", "position_gain", "payload", *alike, *others)
    assert found(explanation)["payload"] == {"shin": pytest.approx(0.15, rel=0.1)}
    assert {(2, name) for name in alike} <= explanation.gains.keys()


def test_what_by_itself_needs_an_effect_no_more_is_no_rival(problem: Make) -> None:
    leg = problem(hide("coulomb_friction", "knee", frictionloss=0.3))
    right = fitted(leg, coulomb_friction=["knee"])
    both = fitted(leg, coulomb_friction=["knee"], torque_bias=["ankle"], armature=["ankle"])
    slopes = linearised(leg.fit.objective, both)
    rival = Reduction(leg.fit.objective, both, slopes, leg.noise).best()
    rival = replace(rival, kept=np.arange(2))  # without the armature
    only = Named(
        term=right.structure.terms[0],
        confidence=1.0,
        ways=[{"coulomb_friction"}],
        exchanges={"torque_bias": rival},
        equivalent={},
    )
    told = Explanation(fit=right, named=(only,), table=Table((rival,)), gains={}, searched=True)
    assert confusion_set(leg, told, 3) == []


def test_a_plainer_effect_is_named_where_a_wider_one_is_no_better(problem: Make) -> None:
    leg = problem(hide("coulomb_friction", "knee", frictionloss=0.3))
    assert set(found(search(leg, "stribeck_friction", "coulomb_friction"))) == {"coulomb_friction"}


def test_two_effects_are_found_together(problem: Make) -> None:
    hidden = (
        hide("coulomb_friction", "knee", frictionloss=0.3),
        hide("command_delay", "*", delay=0.012),
    )
    explanation = search(problem(*hidden), "velocity_gain", "coulomb_friction", "command_delay")
    assert set(found(explanation)) == {"coulomb_friction", "command_delay"}


def test_the_same_problem_gives_the_same_answer_twice(problem: Make) -> None:
    leg = problem(hide("torque_bias", "ankle", bias=0.2))
    once, again = (search(leg, "payload", "torque_bias") for _ in range(2))
    np.testing.assert_array_equal(once.fit.values, again.fit.values)
    assert [one.confidence for one in once.named] == [one.confidence for one in again.named]


def test_nothing_of_what_is_held_out_reaches_what_is_named(tmp_path: Path) -> None:
    model = tmp_path / "leg.xml"
    model.write_text(LEG)
    logs = recorded(model, [hide("torque_bias", "knee", bias=0.3)])
    rng = np.random.default_rng(3)
    garbled = {
        name: column if name.endswith("target") else column + 0.05 * rng.normal(size=column.shape)
        for name, column in logs[2].columns.items()
    }

    def answer(held_out: Recording) -> tuple[object, ...]:
        given = load_experiments(model, [*logs[:2], held_out], held_out=[held_out])
        leg = prepare(given, window=0.5, n_threads=1).problem("zero_order")
        explanation = search(leg, "torque_bias", "payload", "viscous_friction", "armature")
        return (
            explanation.fit.structure.key,
            explanation.fit.values.tobytes(),
            [one.confidence for one in explanation.named],
            explanation.unknown,
        )

    assert answer(logs[2]) == answer(replace(logs[2], columns=garbled))


def test_progress_is_told(problem: Make) -> None:
    told: list[tuple[str, float]] = []
    leg = problem(hide("torque_bias", "ankle", bias=0.2))
    effects = [CATALOGUE["torque_bias"], CATALOGUE["armature"]]
    name_effects(leg, effects, lambda *what: told.append(what))
    assert told[0] == ("ordinary effects", 0.0)
    assert {stage for stage, _ in told} >= {"1 candidates beside 0 named"}
    assert all(0 <= done <= 1 for _, done in told)


@pytest.mark.parametrize("damping", [0.012, 0.1])
def test_what_mends_nothing_as_simulated_is_not_told(tmp_path: Path, damping: float) -> None:
    """The error of a long timestep drowns a little friction, and not much of it."""
    model, coarse = tmp_path / "leg.xml", tmp_path / "coarse.xml"
    model.write_text(LEG)
    coarse.write_text(LEG.replace('timestep="0.002"', 'timestep="0.008"'))
    logs = recorded(model, [hide("viscous_friction", "knee", damping=damping)])
    leg = prepare(load_experiments(coarse, logs), window=0.5, n_threads=1).problem("zero_order")
    told = search(leg, "viscous_friction", "coulomb_friction", "armature")
    assert told.table.best.effects
    assert bool(told.named) is (damping == 0.1)
