"""A slice of the benchmark: short experiments on one joint, and a catalogue of a few effects."""

from dataclasses import replace

import pytest

from benchmarks import hidden_effects
from benchmarks.hidden import scoring
from benchmarks.hidden.cases import NUISANCES, Case, cases
from benchmarks.hidden.outcome import Hidden, Named, Outcome
from benchmarks.hidden.running import run_case

FEW = ("viscous_friction", "torque_bias", "command_delay")
TIMESTEP = ("timestep", *NUISANCES)
SHORTER = 3.0  # 4 s each


def slice_of(**kind):
    case = Case(tier="slice", number=0, rig="pendulum", channels="q+qd+tau", **kind)
    return run_case(case, effects=FEW, shorter=SHORTER)


def test_a_hidden_effect_is_named_where_it_is():
    outcome = slice_of(hide=("torque_bias",))
    assert scoring.first_right(outcome)
    assert scoring.place_right(outcome)
    assert len(scoring.covered([outcome])) == 1
    assert scoring.ratios([outcome]) == [pytest.approx(1.0, abs=0.1)]
    assert outcome.after < 0.5 * outcome.before
    assert Outcome.from_json(outcome.to_json()) == outcome


def test_nothing_is_named_where_nothing_is_hidden():
    outcome = slice_of(off="substeps")
    assert outcome.verdict == "no_gap"
    assert not scoring.false_alarm(outcome)


def test_what_is_taken_out_of_the_catalogue_is_missed():
    outcome = slice_of(hide=("torque_bias",), removed=True)
    assert "torque_bias" not in {named.effect for named in outcome.named}
    assert outcome.oracle is None
    assert scoring.admits(outcome)


def test_cases_that_are_in_the_file_are_not_run_again(tmp_path):
    out = tmp_path / "some.jsonl"
    known = [
        Outcome(case=case.name, tier=case.tier, off="", verdict="no_gap", hidden=(), named=())
        for case in cases("nothing", 3)
    ]
    out.write_text("".join(outcome.to_json() + "\n" for outcome in known))
    assert list(hidden_effects.outcomes(cases("nothing", 3), out=out)) == known
    assert len(out.read_text().splitlines()) == 3


def test_a_quick_run_is_a_part_of_every_kind():
    chosen = {tier: cases(tier, count) for tier, count in hidden_effects.QUICK.items()}
    assert set(chosen) <= set(hidden_effects.TIERS)
    assert all(chosen.values())


def test_another_integrator_does_not_stand_in_for_a_drive_that_is_a_little_off():
    # Explicit integration would leave a third of its gap, a finer timestep nearly all of it.
    case = cases("nothing", draw=1)[1]
    assert (case.off, case.channels) == ("nuisance", "q")
    assert "timestep" not in {named.effect for named in run_case(case, effects=TIMESTEP).named}


def test_the_ground_that_a_walking_robot_lands_on_is_neither_right_nor_wrong():
    def named(effect):
        return Named(effect=effect, places=("FL_hip",), confidence=1.0, doubt=(), alike=())

    case = cases("trotting")[0]
    hidden = Hidden(effect="armature", places=("FL_hip",), alike=(), text="")
    outcome = Outcome(
        case=case.name,
        tier=case.tier,
        off="",
        verdict="explained",
        hidden=(hidden,),
        named=(named("ground_compliance"), named("armature")),
        beside=case.beside,
    )
    assert scoring.rare_first(outcome)
    assert scoring.rare_place(outcome)
    assert not scoring.rare_and_wrong(outcome)
    assert not scoring.false_alarm(replace(outcome, hidden=(), named=outcome.named[:1]))
    # Where it is hidden it has to come first as any other.
    softer = replace(hidden, effect="ground_compliance")
    assert scoring.rare_first(replace(outcome, hidden=(softer,)))
    assert not scoring.rare_first(replace(outcome, hidden=(softer,), named=outcome.named[1:]))
