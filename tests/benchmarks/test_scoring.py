import dataclasses

import pytest

from benchmarks.hidden import scoring
from benchmarks.hidden.cases import CLUTTER, NUISANCES
from benchmarks.hidden.outcome import Hidden, Named, Outcome, Value
from benchmarks.hidden.table import line, rows


def hidden(effect="coulomb_friction", places=("calf",), alike=()):
    return Hidden(effect=effect, places=places, alike=alike, text=f"{effect} somewhere")


def named(effect="coulomb_friction", places=("calf",), confidence=0.97, doubt=(), alike=(), **more):
    return Named(
        effect=effect, places=places, confidence=confidence, doubt=doubt, alike=alike, **more
    )


def outcome(truth=(), said=(), tier="one_effect", verdict="explained", **more):
    return Outcome(
        case=f"{tier}-000",
        tier=tier,
        off=more.pop("off", ""),
        verdict=verdict,
        hidden=tuple(truth),
        named=tuple(said),
        **more,
    )


def test_an_outcome_survives_its_line_of_json():
    value = Value(name="frictionloss", place="calf", true=0.5, value=0.51, std=None)
    told = outcome([hidden(alike=("x",))], [named(doubt=("a",), values=(value,))], oracle=0.1)
    assert Outcome.from_json(told.to_json()) == told
    assert "\n" not in told.to_json()


class TestNames:
    def test_the_first_counts(self):
        assert scoring.first_right(outcome([hidden()], [named(), named("armature")]))
        assert not scoring.first_right(outcome([hidden()], [named("armature"), named()]))
        assert not scoring.first_right(outcome([hidden()], []))

    def test_what_is_exactly_equivalent_is_the_same_name(self):
        delay = hidden("command_delay", alike=("sensor_delay",))
        assert scoring.first_right(
            outcome([delay], [named("sensor_delay", alike=("command_delay",))])
        )

    def test_the_confusion_set_has_the_name_its_doubts_and_what_equals_them(self):
        assert scoring.truth_in_set(outcome([hidden()], [named("armature", doubt=("x",))])) is False
        doubted = outcome([hidden()], [named("backlash", doubt=("coulomb_friction",))])
        assert scoring.truth_in_set(doubted)
        assert scoring.set_size(doubted) == 2
        alike = outcome([hidden("a", alike=("b",))], [named("c", doubt=("b",))])
        assert scoring.truth_in_set(alike)
        assert scoring.set_size(outcome([hidden()], [])) == 0

    @pytest.mark.parametrize(
        ("said", "right"),
        [
            ([named("a"), named("b")], True),
            ([named("b"), named("c"), named("a")], True),
            ([named("a"), named("c")], False),
            ([named("a")], False),
            # One name is not enough for two effects, whatever it equals.
            ([named("a", alike=("b",)), named("c")], False),
            ([named("a", alike=("b",)), named("a", alike=("b",))], True),
        ],
    )
    def test_two_effects_need_a_name_each(self, said, right):
        assert scoring.all_named(outcome([hidden("a"), hidden("b")], said)) is right

    def test_two_effects_may_each_be_in_doubt(self):
        said = [named("x", doubt=("a",)), named("y", doubt=("b", "c"))]
        both = outcome([hidden("a"), hidden("b")], said)
        assert scoring.all_in_sets(both)
        assert not scoring.all_named(both)


class TestPlaces:
    @pytest.mark.parametrize(
        ("truth", "said", "right"),
        [
            (("calf",), ("calf",), True),
            (("calf", "hip"), ("hip", "calf"), True),
            (("calf",), ("hip", "calf"), False),
            (("calf", "hip"), ("calf",), False),
            ((), (), True),
        ],
    )
    def test_are_right_as_a_whole(self, truth, said, right):
        told = outcome([hidden(places=truth)], [named(places=said)])
        assert scoring.place_right(told) is right

    def test_can_be_right_under_a_wrong_name(self):
        assert scoring.place_right(outcome([hidden()], [named("armature")]))

    def test_of_an_equivalent_elsewhere_are_none(self):
        tilt = named("base_tilt", places=(), alike=("encoder_offset",))
        assert scoring.place_right(outcome([hidden("encoder_offset")], [tilt]))
        assert not scoring.place_right(outcome([hidden()], []))


class TestHonesty:
    def test_bristles_are_a_false_alarm_but_not_an_unfounded_one(self):
        bristles = outcome([], [named("presliding_friction")])
        assert scoring.false_alarm(bristles)
        assert not scoring.unfounded_alarm(bristles)
        assert scoring.unfounded_alarm(outcome([], [named("presliding_friction"), named()]))
        sure = outcome([hidden("backlash")], [named("presliding_friction", confidence=0.99)])
        assert scoring.confidently_wrong(sure)
        assert not scoring.unfounded(sure)

    def test_any_name_is_a_false_alarm_but_for_what_is_off(self):
        assert scoring.false_alarm(outcome([], [named()]))
        assert not scoring.false_alarm(outcome([], []))
        assert not scoring.false_alarm(
            outcome([], [named("viscous_friction")], off="nuisance", beside=NUISANCES)
        )
        assert scoring.false_alarm(outcome([], [named("viscous_friction")], off="timestep"))
        assert scoring.false_alarm(
            outcome([], [named("armature"), named("payload")], off="nuisance", beside=NUISANCES)
        )

    def test_what_is_left_is_admitted(self):
        assert scoring.admits(outcome(verdict="unexplained"))
        assert scoring.admits(outcome(verdict="partly_explained"))
        assert not scoring.admits(outcome(verdict="explained"))
        assert not scoring.admits(outcome(verdict="no_gap"))

    def test_a_wrong_name_is_worse_when_it_is_sure(self):
        unsure, sure = named("payload", confidence=0.6), named("payload", confidence=0.95)
        assert not scoring.confidently_wrong(outcome([hidden()], [unsure]))
        assert scoring.confidently_wrong(outcome([hidden()], [named(), sure]))
        assert not scoring.confidently_wrong(outcome([hidden()], [named()]))

    def test_sure_names_are_right_or_wrong_one_by_one(self):
        some = [
            outcome([hidden()], [named(), named("payload"), named("armature", confidence=0.5)]),
            outcome([], [named("armature"), named("payload")], off="nuisance", beside=NUISANCES),
        ]
        assert scoring.stated(some) == [True, False, False]

    def test_intervals_hold_the_truth_or_not(self):
        def value(std, true=1.0):
            return Value(name="frictionloss", place="calf", true=true, value=1.1, std=std)

        said = named(values=(value(0.1), value(0.05), value(None), value(0.1, 1.29)))
        assert scoring.covered([outcome([hidden()], [said])]) == [True, False, True]

    def test_ratios_are_of_cases_with_an_oracle(self):
        some = [outcome(after=0.3, oracle=0.2), outcome(after=0.3, oracle=None)]
        assert scoring.ratios(some) == [pytest.approx(1.5)]


class TestTable:
    def test_counts_its_tiers_and_says_what_is_required(self):
        right = outcome([hidden()], [named()], after=0.1, oracle=0.1, seconds=3.0)
        wrong = outcome([hidden()], [named("armature", confidence=0.99)], seconds=5.0)
        table = {row.what: row for row in rows([right, wrong])}
        first = table["one_effect: first name right"]
        assert (first.result, first.reference) == ("50% (1 of 2)", "95 %")
        assert table["one_effect: right joint or body"].result == "100% (2 of 2)"
        assert table["right of the names given with 0.9 or more"].result == "50% (1 of 2)"
        assert "nothing: false alarm" not in table

    def test_impossible_cases_count_for_nothing_and_failed_ones_as_wrong(self):
        failed = outcome([hidden()], verdict="failed", error="ValueError: why")
        table = {row.what: row for row in rows([failed, outcome(verdict="impossible")])}
        assert table["one_effect: first name right"].result == "0% (0 of 1)"
        assert table["cases that raised an error"].result == "1"
        assert table["cases where nothing of the hidden shows"].result == "one_effect-000"

    def test_no_outcomes_no_rows(self):
        assert rows([]) == []

    @pytest.mark.parametrize(
        ("told", "mark"),
        [
            (outcome([hidden()], [named()]), "right"),
            (outcome([hidden()], [named(places=("hip",))]), "place"),
            (outcome([hidden()], [named("a", doubt=("coulomb_friction",))]), "in doubt"),
            (outcome([hidden()], [named("a")]), "WRONG"),
            (outcome([], [named("a")], tier="nothing"), "ALARM"),
            (outcome([hidden()], [named("a")], tier="outside"), "WRONG"),
            (outcome([hidden()], [], tier="outside", verdict="unexplained"), "right"),
            (outcome([hidden()], [], tier="outside", verdict="no_gap"), "silent"),
        ],
    )
    def test_a_line_says_how_it_went(self, told, mark):
        assert f" {mark} " in line(told)
        assert "\n" not in line(dataclasses.replace(told, error="KeyError: 'x'"))


class TestCluttered:
    TRUTH = (hidden("base_tilt", places=("calf", "hip")),)

    def of(self, *said):
        return outcome(self.TRUTH, said, tier="cluttered", off="clutter", beside=CLUTTER)

    def test_what_is_ordinary_comes_before_nothing_and_is_no_wrong_name(self):
        told = self.of(named("armature"), named("base_tilt", places=("calf", "hip")))
        assert scoring.rare_first(told)
        assert scoring.rare_place(told)
        assert not scoring.rare_and_wrong(told)
        assert scoring.stated([told]) == [True]
        assert "right" in line(told)

    def test_bristles_are_its_clutter_too(self):
        assert scoring.rare_first(self.of(named("presliding_friction"), named("base_tilt")))

    def test_another_rare_name_is_wrong_wherever_it_stands(self):
        first = self.of(named("cogging"), named("base_tilt"))
        second = self.of(named("base_tilt"), named("cogging"))
        assert not scoring.rare_first(first)
        assert scoring.rare_first(second)
        assert scoring.rare_and_wrong(first)
        assert scoring.rare_and_wrong(second)
        assert "WRONG" in line(second)

    def test_an_ordinary_name_that_is_equivalent_to_the_hidden_one_is_no_clutter(self):
        truth = hidden("sensor_delay", alike=("command_delay",))
        said = named("command_delay", alike=("sensor_delay",))
        assert scoring.rare_first(
            outcome([truth], [said], tier="cluttered", off="clutter", beside=CLUTTER)
        )
