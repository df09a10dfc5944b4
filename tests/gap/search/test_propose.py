"""Proposals: chosen by what they promise of all, with their plain cases, beside wild blocks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.gap.search import propose
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.settle import without_the_wild
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit
from walkerkit.gap.workflow import prepare

PENDULUM = """<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body>
      <joint name="hip" axis="0 1 0" armature="0.01" damping="0.1" range="-1 1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/>
    </body>
  </worldbody>
  <actuator><position joint="hip" kp="40" kv="1"/></actuator>
</mujoco>
"""
READ = "hip/position"


@pytest.fixture
def made(tmp_path: Path) -> Callable[..., tuple[Problem, Fit]]:
    """Makes the problem of a pendulum with an effect hidden, and its fit without any."""
    model = tmp_path / "pendulum.xml"
    model.write_text(PENDULUM)

    def make(effect: str, push: float = 0.0) -> tuple[Problem, Fit]:
        logs = rehearse(model, [effect], seed=3, seconds=4).recordings
        first = logs[0].columns[READ]
        pushed = (logs[0].time > 1.0) & (logs[0].time < 1.4)
        columns = {**logs[0].columns, READ: first + push * pushed}
        logs = [replace(logs[0], columns=columns), *logs[1:]]
        problem = prepare(load_experiments(model, logs), window=0.5, n_threads=1)
        found = problem.problem("zero_order")
        (nothing,) = evaluate(found.fit.objective, [(found.nothing, np.zeros(0))])
        return found, nothing

    return make


def proposed(problem: Problem, current: Fit, *effects: str) -> list[str]:
    problem.fit.refine(current)
    slopes = linearised(problem.fit.objective, current)
    fits = propose.proposals(problem, current, slopes, [CATALOGUE[name] for name in effects])
    return [one.structure.terms[-1].effect.name for one in fits]


def test_a_general_law_comes_with_its_plain_case(made, monkeypatch):
    monkeypatch.setattr(propose, "_FITTED", 1)
    problem, nothing = made("torque_ripple")
    names = proposed(problem, nothing, "torque_ripple", "torque_constant", "encoder_gain")
    assert set(names) == {"torque_ripple", "torque_constant"}


def test_starts_that_ended_at_the_same_are_one(made):
    problem, nothing = made("torque_bias")
    bias, other = (
        replace(nothing, structure=nothing.structure.with_term(term))
        for term in problem.terms([CATALOGUE["torque_bias"], CATALOGUE["torque_constant"]])
    )
    promised = [-5.0, -5.0 + 0.5 * propose.CONVERGED, -5.0, -4.0]
    assert propose.each_once([bias, bias, other, bias], promised) == [0, 2, 3]


def test_a_structure_that_begins_at_several_places_takes_the_place_of_no_other(made):
    problem, nothing = made("torque_bias")
    names = ("torque_bias", "torque_constant", "encoder_gain")
    bias, other, third = (
        replace(nothing, structure=nothing.structure.with_term(term))
        for term in problem.terms([CATALOGUE[name] for name in names])
    )
    again = replace(bias, score=bias.score + 1.0)
    fits = [bias, again, other, again, third]
    assert propose.of_so_many_structures(fits, 1) == [bias, again]
    assert propose.of_so_many_structures(fits, 2) == [bias, again, other, again]
    assert propose.of_so_many_structures(fits, 4) == fits


def test_what_promises_nothing_is_not_fitted(made):
    problem, nothing = made("torque_bias")
    assert "torque_bias" in proposed(problem, nothing, "torque_bias", "clock_skew")
    assert "clock_skew" not in proposed(problem, nothing, "torque_bias", "clock_skew")


def test_a_few_wild_blocks_do_not_outvote_the_rest(made):
    problem, nothing = made("torque_bias", push=0.4)
    tame = without_the_wild(problem, nothing)
    assert tame is not None
    residual = [p.fit.objective.residuals([nothing.case])[0] for p in (problem, tame)]
    before, after = (
        p.fit.objective.mean_square(r)[0, 0] for p, r in zip((problem, tame), residual, strict=True)
    )
    assert after < 0.5 * before
    names = proposed(tame, tame.fit.by_own_error(nothing), "torque_bias", "encoder_offset")
    assert "torque_bias" in names


def test_without_wild_blocks_all_count(made):
    problem, nothing = made("torque_bias")
    assert without_the_wild(problem, nothing) is None


def test_a_stop_is_found_where_the_fit_began_with_another(made):
    problem, nothing = made("end_stop")  # a lower one
    (term,) = problem.terms([CATALOGUE["end_stop"]])
    structure = nothing.structure.with_term(term)
    lower, upper, stiffness = (structure.slots[k].parameter for k in range(3))
    problem.fit.refine(nothing)

    def found(begun: dict[int, float]) -> Fit:
        values = structure.zero.copy()
        values[[*begun]] = [*begun.values()]
        (one,) = evaluate(problem.fit.objective, [(structure, values)])
        return propose.with_all_of_it(problem.fit.objective, one, None)

    above = found({1: upper.starts[0], 2: stiffness.starts[0]})
    assert above.values[0] > lower.zero + lower.scale
    below = found({0: lower.starts[0], 2: stiffness.starts[0]})
    assert below.values[1] == upper.zero  # there is none
