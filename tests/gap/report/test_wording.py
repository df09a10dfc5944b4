"""The sentences of a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from walkerkit.gap.report import wording
from walkerkit.gap.report.diagnosis import Diagnosis
from walkerkit.gap.report.gaps import GapSize

LegDiagnosis = Callable[..., Diagnosis]


def test_explained(leg: LegDiagnosis) -> None:
    assert wording.verdict_sentence(leg()) == (
        "The gap is explained by coulomb_friction at calf (98 % sure): the position error shrinks "
        "from 6.6 to 1.1 mrad, where the noise of the measurement alone would leave 1.0 mrad."
    )


def test_partly_explained_names_the_rivals_and_what_remains(confused: Diagnosis) -> None:
    sentence = wording.verdict_sentence(confused)
    assert sentence.startswith("Part of the gap is explained by coulomb_friction at calf (98 % ")
    assert "command_delay of the whole robot (52 % sure, could also be sensor_delay or " in sentence
    assert " and payload of body shin (91 % sure): " in sentence
    assert sentence.endswith("What remains stands out most at calf (velocity reversal).")


def test_nothing_is_missing_beside_a_gap_that_is_none(leg: LegDiagnosis) -> None:
    doubted = replace(leg(), unknown=0.86)
    assert wording.unknown(doubted) == (
        "That something is missing besides, which the catalogue cannot name, is 86 % probable."
    )
    assert wording.unknown(replace(doubted, verdict="partly_explained")) == (
        "A gap remains, so something is missing besides. That it is an effort that goes smoothly "
        "with how the joints move and are loaded, which the catalogue cannot name, is "
        "86 % probable."
    )
    assert wording.unknown(replace(doubted, unknown=0.0, verdict="partly_explained")) == (
        "A gap remains, so something is missing besides. No effort that goes smoothly with how the "
        "joints move and are loaded makes up for it."
    )
    unexplained = wording.unknown(replace(doubted, effects=(), verdict="unexplained"))
    assert unexplained.startswith("A gap remains, so something is missing. That it is an effort")
    assert wording.unknown(replace(doubted, effects=(), verdict="no_gap")) == ""
    assert wording.unknown(replace(doubted, unknown=None)) == ""


def test_no_gap_and_unexplained(leg: LegDiagnosis) -> None:
    bare = replace(leg(), effects=(), locations=())
    assert wording.verdict_sentence(replace(bare, verdict="no_gap")).startswith(
        "Nothing is missing"
    )
    unexplained = replace(leg(), effects=(), verdict="unexplained")
    sentence = wording.verdict_sentence(unexplained)
    assert sentence.startswith("No effect of the catalogue explains the gap")
    assert sentence.endswith("It stands out most at calf (velocity reversal).")
    assert "stands out" not in wording.verdict_sentence(replace(bare, verdict="unexplained"))


def test_a_joint_whose_gap_the_others_hide_is_told(leg: LegDiagnosis) -> None:
    still = GapSize(unit="rad", before=0.0010, after=0.0010, noise_floor=0.0010)
    hidden = replace(still, before=0.0032, after=0.0032)
    gap = replace(leg().gap, position=still, joints={"hip": still, "calf": hidden})
    alone = "; at calf alone it is 3.2 mrad, over a floor of 1.0 mrad"
    partly = replace(leg(), gap=replace(gap, signals={}), verdict="partly_explained")
    assert alone in wording.verdict_sentence(partly)
    assert alone in wording.verdict_sentence(replace(partly, effects=(), verdict="unexplained"))


def test_a_simulation_that_diverges_has_no_size(leg: LegDiagnosis) -> None:
    diagnosis = leg()
    unknown = replace(diagnosis.gap.position, before=math.nan)
    gone = replace(diagnosis, gap=replace(diagnosis.gap, position=unknown, signals={}))
    assert "the position error is 1.1 mrad, and unknown before" in wording.verdict_sentence(gone)
    nothing = replace(gone, effects=(), verdict="unexplained")
    assert "is unknown, as the simulation diverges" in wording.verdict_sentence(nothing)


def test_an_effort_gap_that_a_stiff_loop_hides_in_the_position_is_told(leg: LegDiagnosis) -> None:
    stiff = GapSize(unit="rad", before=0.0010, after=0.0010, noise_floor=0.0010)
    diagnosis = leg()
    sentence = wording.verdict_sentence(
        replace(diagnosis, gap=replace(diagnosis.gap, position=stiff))
    )
    assert "the effort error shrinks from 0.52 to 0.041 N·m" in sentence


def test_a_gap_that_no_regime_holds_is_at_its_joint(leg: LegDiagnosis) -> None:
    everywhere = replace(leg().locations[0], regime="everywhere")
    assert wording.spot(everywhere) == "calf"


def test_a_timestep_that_leaves_more_than_the_noise_is_told(leg: LegDiagnosis) -> None:
    gap = leg().gap
    blurred = replace(gap.position, numerical_floor=0.0031)
    coarse = replace(leg(), gap=replace(gap, position=blurred))
    assert wording.verdict_sentence(coarse).endswith(
        "would leave 1.0 mrad and the timestep of the simulation 3.1 mrad."
    )


def test_a_gap_that_the_timestep_hides_is_told_at_a_finer_one(leg: LegDiagnosis) -> None:
    gap = leg().gap
    hidden = replace(gap.position, before=0.0031, after=0.0035, numerical_floor=0.0031)
    finer = replace(gap.position, before=0.0024, after=0.0011)
    coarse = replace(gap, position=hidden, finer_position=finer)
    assert (
        "at a quarter of the simulation's timestep the position error shrinks from 2.4 to 1.1 mrad"
        in wording.verdict_sentence(replace(leg(), gap=coarse))
    )


def test_many_joints_are_counted(leg: LegDiagnosis) -> None:
    named = replace(leg().effects[0], joints=tuple(f"j{index}" for index in range(12)))
    assert wording.place(named) == " at j0, j1, j2 and 9 more"


def test_a_value_at_its_bound_has_no_error_whatever_it_claims(leg: LegDiagnosis) -> None:
    (estimate,) = leg().effects[0].parameters
    stuck = replace(estimate, at_bound=True)
    assert wording.estimate(estimate) == ("0.152 ± 0.004", "N·m", "")
    assert wording.estimate(stuck) == ("0.152", "N·m", wording.AT_BOUND)
    assert wording.estimate(replace(estimate, std=None))[2] == wording.NOT_IDENTIFIABLE


def test_the_basis_says_where_it_was_measured(leg: LegDiagnosis, confused: Diagnosis) -> None:
    whole = replace(leg(), recordings=("walk", "steps"), held_out=("steps",))
    assert "on held-out recordings (steps), which no fit has seen" in wording.basis(whole)
    assert "whole rollouts" in wording.basis(whole)
    in_time = replace(whole, held_out=("walk[2:3]", "steps[2:3]"))
    assert "on held-out blocks of time of the recordings" in wording.basis(in_time)
    assert "windows of 0.5 s" in wording.basis(confused)


def test_a_gap_that_grows_is_not_said_to_shrink(leg: LegDiagnosis) -> None:
    gap = leg().gap
    larger = {name: replace(one, after=1.1 * one.before) for name, one in gap.signals.items()}
    grown = replace(gap, position=larger["position"], signals=larger)
    found = wording.verdict_sentence(replace(leg(), gap=grown, verdict="partly_explained"))
    assert "the position error does not shrink, but is " in found
    assert "shrinks from" not in found


def test_what_makes_the_held_out_gap_larger_explains_nothing(leg: LegDiagnosis) -> None:
    found = wording.verdict_sentence(replace(leg(), verdict="unexplained"))
    assert found.startswith("The gap is not explained: ")
    assert "fits the fitted recordings best, but the position error of those held out is" in found


def test_what_was_not_tried_is_not_said_to_explain_nothing(leg: LegDiagnosis) -> None:
    nothing = replace(leg(), verdict="unexplained", effects=())
    assert wording.verdict_sentence(nothing).startswith("No effect of the catalogue explains")
    few = wording.verdict_sentence(replace(nothing, only=("torque_bias", "backlash")))
    assert few.startswith("The gap is not explained by torque_bias or backlash, the only effects")
    none = wording.verdict_sentence(replace(nothing, only=()))
    assert none.startswith("Simulation and measurement disagree")


def test_what_was_chosen_has_no_error_and_no_warning(leg: LegDiagnosis) -> None:
    (estimate,) = leg().effects[0].parameters
    chosen = replace(estimate, name="timestep", value=0.0025, std=0.0, unit="s")
    assert wording.estimate(chosen) == ("2.50", "ms", "")


def test_a_weak_next_experiment_is_not_sold_as_a_strong_one(confused: Diagnosis) -> None:
    wanted = confused.next_experiment
    assert wanted is not None
    assert "Send next_experiment.csv to the robot (the excitation disturbed_hold), record" in (
        wording.advice(confused)
    )
    assert "may not be enough" not in wording.advice(confused)
    weak = replace(confused, next_experiment=replace(wanted, separation=1.2, file=None))
    assert "apart by 1.2 standard deviations, which may not be enough" in wording.advice(weak)
    strong = replace(confused, next_experiment=replace(wanted, separation=960.0))
    assert "by more than 100 standard deviations." in wording.advice(strong)


def test_no_next_experiment_is_told_where_one_is_wanted(
    leg: LegDiagnosis, confused: Diagnosis
) -> None:
    assert wording.advice(leg()) == ""
    barred = replace(confused, next_experiment=None, obstacle="No hands.")
    assert wording.advice(barred) == "No hands."
    none = wording.advice(replace(confused, next_experiment=None))
    assert none.startswith("No experiment of the battery")


def test_a_changed_set_up_is_an_instruction_with_a_model_of_its_own(confused: Diagnosis) -> None:
    wanted = confused.next_experiment
    assert wanted is not None
    payload = replace(
        wanted,
        excitation="steps",
        set_up="known_payload",
        instruction="Put 0.5 kg on body shin.",
        model="next_experiment.xml",
    )
    advice = wording.advice(replace(confused, next_experiment=payload))
    assert advice.startswith("Put 0.5 kg on body shin. Send next_experiment.csv to the robot")
    assert "next_experiment.xml, your model with this change" in advice
    release = replace(payload, excitation="release", set_up="motor_off", instruction="Let go.")
    advice = wording.advice(replace(confused, next_experiment=release))
    assert advice.startswith(
        "Let go. The pose to let go from is in the first row of next_experiment.csv. Record what "
        "it does, and diagnose again"
    )
    assert "apart by" in advice
    elsewhere = replace(release, between=("command_delay",))
    assert "predicted to tell where command_delay is by" in (
        wording.advice(replace(confused, next_experiment=elsewhere))
    )


def test_an_exact_equivalence_gives_its_reason(confused: Diagnosis) -> None:
    reason = "Without effort, both shift the curves."
    delay = replace(confused.effects[1], equivalent=(("sensor_delay", reason),))
    (doubt,) = wording.doubts(replace(confused, effects=(delay,)))
    assert doubt.startswith(
        "command_delay of the whole robot and sensor_delay leave the same log, whatever is "
        f"commanded. {reason} With these recordings, command_delay of the whole robot cannot be "
        "told from setpoint_filter: "
    )


def test_nothing_is_quite_sure() -> None:
    assert wording.sure(1.0) == ">99 %"
    assert wording.sure(0.93) == "93 %"


def test_names_that_would_not_print_are_replaced() -> None:
    assert wording.label("a\x1b[31mb\u202ec\n") == "a�[31mb�c�"
