"""The book: of what slopes promise, what is fitted by itself and what stays in the table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.gap.search.test_naming import LEG, fitted, hide, problem_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.book import Book, KnownErrors, stopped_since
from walkerkit.gap.search.by_itself import unknown_parts
from walkerkit.gap.search.certainty import covariance
from walkerkit.gap.search.compare import Member, Rare, is_worth_a_name, rare_effects
from walkerkit.gap.search.decision import KNOWN
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Fit


@pytest.fixture(scope="module")
def leg(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """With dry friction at the knee and torque that is off at both joints."""
    model: Path = tmp_path_factory.mktemp("leg") / "leg.xml"
    model.write_text(LEG)
    biased = hide("torque_bias", "knee", "ankle", knee__bias=0.5, ankle__bias=0.3)
    return problem_of(model, [hide("coulomb_friction", "knee", frictionloss=0.3), biased])


def rubbed(leg: Problem, *biased: str, friction: str = "coulomb_friction") -> Fit:
    return fitted(leg, **{friction: ["knee"], "torque_bias": list(biased)})


def by_rare(book: Book) -> dict[Rare, list[Member]]:
    found: dict[Rare, list[Member]] = {}
    for member in book.table.members:
        found.setdefault(member.rare, []).append(member)
    return found


def test_slopes_are_believed_as_far_as_others_of_the_same_rare_effects_kept_to_them(
    leg: Problem,
) -> None:
    book = Book(leg)
    right = book.add(rubbed(leg, "knee", "ankle"))
    other = book.add(rubbed(leg, "knee", "ankle", friction="viscous_friction"))
    promised = {
        id(one): max(book.table.worth_of(m) for m in book.table.members if m.fit is one)
        for one in (right, other)
    }
    asked: list[Fit] = []

    def alone(member: Member) -> Fit:
        asked.append(member.fit)
        values = right.values.copy()
        values[0] = 0.0  # no friction at all, so that it falls far short
        (poor,) = evaluate(leg.fit.objective, [(right.structure, values)])
        return poor

    book.fit_what_is_in_the_running(alone)
    came = book.table.worth_of(book.best)
    assert came < promised[id(other)] < promised[id(right)]
    assert all(one is right for one in asked)
    assert max(book.table.worth) == came  # what the other promises is forgotten


def test_what_comes_down_to_other_rare_effects_leaves_the_table(leg: Problem) -> None:
    book = Book(leg)
    both = book.add(rubbed(leg, "knee", "ankle"))
    single = book.add(rubbed(leg, "knee"))
    of_both, of_single = (rare_effects(one.structure) for one in (both, single))
    book.fit_what_is_in_the_running(lambda member: member.fit)
    assert book.best.rare == of_both
    keys = [member.key for member in book.table.members if member.fit is book.best.fit]
    assert len({*keys}) == len(keys)  # a fit that needs all it has is there once
    book.came_down(book.best, single)
    assert of_both not in by_rare(book)
    asked: list[Member] = []

    def alone(member: Member) -> Fit:
        asked.append(member)
        return member.fit

    book.fit_what_is_in_the_running(alone)
    assert book.best.rare == of_single
    assert not asked  # it is by itself already


def test_what_is_left_of_the_best_has_to_be_better_than_what_others_explain(leg: Problem) -> None:
    book = Book(leg)
    both = book.add(rubbed(leg, "knee", "ankle"))
    ankle = rubbed(leg, "ankle")
    book.add(fitted(leg, coulomb_friction=["knee"], com_offset=["thigh", "shin"]))
    book.fit_what_is_in_the_running(lambda member: member.fit)
    before, best = book.table, book.best
    assert best.fit is both
    as_told = book.to_be_told(best)
    as_told.came_down(best, ankle)
    assert as_told.best.rare != best.rare  # weights elsewhere make up for more than that
    assert book.table is before
    as_told.came_down(as_told.best, ankle)
    assert as_told.best.fit is ankle  # which may be told


def test_of_what_is_not_known_that_is_left_out_first_which_is_missed_least(leg: Problem) -> None:
    found = rubbed(leg, "knee", "ankle")
    values = np.array([found.values[0], 1e-3, 1.1e-3])
    (hardly,) = evaluate(leg.fit.objective, [(found.structure, values)])
    errors = KnownErrors(leg, hardly, linearised(leg.fit.objective, hardly))
    assert (errors.of()[1:] < KNOWN).all()
    parts = [np.array([1]), np.array([2])]
    assert unknown_parts(errors, parts, [2.0, 1.0]) == [1, 0]
    assert unknown_parts(errors, parts, [1.0, 2.0]) == [0, 1]
    assert unknown_parts(errors, parts)[0] == int(np.argmin(errors.of()[1:]))
    sure = KnownErrors(leg, found, linearised(leg.fit.objective, found))
    assert unknown_parts(sure, parts, [1.0, 2.0]) == []


def test_what_others_with_fewer_rare_effects_do_as_well_leaves_the_table(leg: Problem) -> None:
    biased = fitted(leg, coulomb_friction=["knee"], torque_bias=["knee", "ankle"])
    more = fitted(leg, coulomb_friction=["knee"], torque_bias=["knee", "ankle"], payload=["shin"])
    for order in ((more, biased), (biased, more)):
        book = Book(leg)
        book.add(fitted(leg, coulomb_friction=["knee"]))
        for one in order:
            book.add(one)
        assert {rare_effects(biased.structure), frozenset()} == {*by_rare(book)}


def test_what_slopes_had_near_the_best_is_fitted_by_itself_though_that_gained(leg: Problem) -> None:
    knee, ankle = rubbed(leg, "knee"), rubbed(leg, "ankle")
    itself = {rare_effects(one.structure): one for one in (knee, ankle)}

    def ahead(book: Book) -> float:
        worth = {m.rare: book.table.worth_of(m) for m in reversed(book.table.members)}
        return worth[rare_effects(ankle.structure)] - worth[rare_effects(knee.structure)]

    def begun(part: float) -> Book:
        values = ankle.values.copy()
        values[-1] *= part
        (poor,) = evaluate(leg.fit.objective, [(ankle.structure, values)])
        book = Book(leg)
        for one in (poor, knee):
            book.add(one)
        return book

    part = brentq(lambda part: ahead(begun(part)) - 1.0, 0.5, 1.0, rtol=1e-4)
    book, asked = begun(part), []
    assert 0 < ahead(book) < 2

    def alone(member: Member) -> Fit:
        asked.append(member.rare)
        return itself[member.rare]

    book.fit_what_is_in_the_running(alone)
    assert ahead(book) > 20
    assert asked == [rare_effects(ankle.structure), rare_effects(knee.structure)]


def test_what_slopes_promise_is_not_told_if_it_never_came(leg: Problem) -> None:
    book, right = Book(leg), rubbed(leg, "knee", "ankle")
    for one in (right, rubbed(leg, "knee"), rubbed(leg, "ankle")):
        book.add(one)
    values = right.values.copy()
    values[-2:] *= -1.0  # pushed the other way, so that it falls far short
    (poor,) = evaluate(leg.fit.objective, [(right.structure, values)])
    assert len(by_rare(book)) == 3
    book.fit_what_is_in_the_running(lambda member: poor, most=1)
    assert book.best.fit is poor
    assert max(book.table.worth) == book.table.worth_of(book.best)
    assert by_rare(book).keys() == {rare_effects(poor.structure)}


def test_what_ran_into_a_bound_since_others_were_left_out(leg: Problem) -> None:
    free = rubbed(leg, "knee", "ankle")
    structure = free.structure
    (bias,) = (term for term in structure.terms if term.effect.name == "torque_bias")
    ankle = structure.columns(bias, "ankle")
    stopped = replace(free, values=free.values.copy())
    stopped.values[ankle] = structure.bounds[1][ankle]
    assert stopped_since(free, stopped) == [bias]
    assert stopped_since(stopped, stopped) == []
    assert stopped_since(free, free) == []


@pytest.fixture(scope="module")
def known(leg: Problem) -> dict[str, Fit]:
    """Fits of the leg: with what is hidden in it, and with less."""
    (nothing,) = evaluate(leg.fit.objective, [(leg.nothing, np.zeros(0))])
    return {
        "nothing": nothing,
        "rubbed": fitted(leg, coulomb_friction=["knee"]),
        "at the knee": rubbed(leg, "knee"),
        "at both": rubbed(leg, "knee", "ankle"),
    }


def changed(leg: Problem, one: Fit, **values: float) -> Fit:
    """A fit with other values of its newest effect at some places."""
    own = {slot.place: k for k, slot in enumerate(one.structure.slots)}  # the newest comes last
    moved = one.values.copy()
    for place, value in values.items():
        moved[own[place]] = value
    (found,) = evaluate(leg.fit.objective, [(one.structure, moved)])
    return found


def test_a_rare_effect_enters_if_some_number_of_it_is_known(
    leg: Problem, known: dict[str, Fit]
) -> None:
    both = known["at both"]
    bias = both.structure.columns(both.structure.terms[-1])
    for values, enters in [
        ({}, True),
        ({"ankle": 0.0}, True),  # that of the knee is
        ({"knee": 0.0, "ankle": 0.0}, False),
        ({"ankle": both.structure.bounds[1][bias[-1]]}, False),  # no estimate
    ]:
        book = Book(leg)
        assert book.has(book.add(changed(leg, both, **values))) is enters


def test_what_diverges_enters_nothing(leg: Problem, known: dict[str, Fit]) -> None:
    book, wild = Book(leg), replace(known["at both"], score=np.inf)
    assert book.add(wild) is wild
    assert not book.table.members


def test_what_leaves_no_smaller_gaps_than_fewer_rare_effects_do_is_no_member(
    leg: Problem, known: dict[str, Fit]
) -> None:
    book = Book(leg)
    fewer = book.add(known["at both"])
    hardly = changed(leg, fitted_beside(leg, fewer), shin=1e-3)
    assert not book.has(book.add(hardly, beside=fewer))
    # The same with fewer numbers than one beside it need not beat that.
    same = book.add(replace(known["at both"]), beside=fewer, smaller=True)
    assert book.has(same)


def test_what_has_something_else_instead_is_a_rival_though_its_gaps_are_no_smaller(
    tmp_path: Path,
) -> None:
    model = tmp_path / "leg.xml"
    model.write_text(LEG)
    leg = problem_of(model, [hide("coulomb_friction", "knee", frictionloss=0.3)])
    joints = [channel.joint for channel in leg.channels]
    (nothing,) = evaluate(leg.fit.objective, [(leg.nothing, np.zeros(0))])
    book = Book(leg)
    book.add(nothing)
    rubbed = book.add(fitted(leg, coulomb_friction=["knee"]))
    rival = book.add(fitted(leg, asymmetric_friction=["knee"]))
    of = {id(m.fit): m for m in reversed(book.table.members)}
    assert of[id(rival)].rare
    assert not is_worth_a_name(of[id(rubbed)], of[id(rival)], joints)
    assert book.best.fit is rubbed
    # Of what has the friction, too, it is asked what it brings beside that.
    both = fitted(leg, coulomb_friction=["knee"], asymmetric_friction=["ankle"])
    assert not book.has(book.add(both))


def fitted_beside(leg: Problem, one: Fit) -> Fit:
    """A fit with a payload beside it, still without one."""
    (term,) = (replace(term, sites=("shin",)) for term in leg.terms([CATALOGUE["payload"]]))
    structure = one.structure.with_term(term)
    (found,) = evaluate(leg.fit.objective, [(structure, np.append(one.values, 0.0))])
    return found


def test_what_is_far_behind_what_is_beside_it_is_not_looked_at(
    leg: Problem, known: dict[str, Fit]
) -> None:
    book = Book(leg)
    beside = book.add(known["rubbed"])
    far = changed(leg, known["at the knee"], knee=-3.0)
    assert book.add(far, beside=beside) is far
    assert not book.has(far)
    assert book.has(book.add(known["at the knee"], beside=beside))


def test_of_two_fits_of_one_structure_the_likelier_is_kept(
    leg: Problem, known: dict[str, Fit]
) -> None:
    book, right, other = Book(leg), known["at the knee"], known["at both"]
    beside = book.add(known["rubbed"])
    leg.fit.refine(beside)
    worse = changed(leg, right, knee=0.3 * right.values[-1])
    assert book.likeliest([worse, other, right], beside) == [right, other]
    assert book.likeliest([other], beside) == [other]


def test_gains_are_what_was_tried_takes_off_the_score(leg: Problem, known: dict[str, Fit]) -> None:
    book = Book(leg)
    beside = book.add(known["rubbed"])
    assert not book.has_tried("torque_bias")
    gains = []
    for one in (known["at the knee"], known["at both"], changed(leg, known["at both"], knee=0.4)):
        book.add(one, beside=beside)
        gains.append(beside.score - one.score)
        assert book.gains == {(2, "torque_bias"): max(gains)}
    assert book.has_tried("torque_bias")
    assert not book.has_tried("payload")
    book.add(known["at both"], beside=known["nothing"], smaller=True)
    assert book.gains == {(2, "torque_bias"): max(gains)}


def test_gains_of_the_ground_are_what_comes_back_without(
    leg: Problem, known: dict[str, Fit]
) -> None:
    book = Book(leg)
    both = book.add(known["at both"])
    whole, without = (m for m in book.table.members if m.fit is both)
    assert without.units == whole.units - {("coulomb_friction", "knee")}
    sizes = [np.log(np.hypot(m.scores.size, m.scores.floor)).mean() for m in (whole, without)]
    expected = {(1, "coulomb_friction"): pytest.approx(sizes[1] - sizes[0])}
    assert book.gains == expected
    book.add(known["at the knee"])  # by what was found first
    assert book.gains == expected


def test_what_a_smaller_fit_lacks_is_worth_a_name_or_not(
    leg: Problem, known: dict[str, Fit]
) -> None:
    book = Book(leg)
    rubs, both = (book.add(known[name]) for name in ("rubbed", "at both"))
    same = book.add(replace(both), beside=both, smaller=True)
    assert not book.is_enough(rubs, both)
    assert book.is_enough(same, both)
    unread = known["at the knee"]
    assert book.is_enough(rubs, unread)
    assert not book.is_enough(unread, both)
    assert not book.is_enough(unread, replace(unread))


def test_slopes_of_the_latest_fit_are_kept_and_carried_to_those_beside_it(
    leg: Problem, known: dict[str, Fit]
) -> None:
    book = Book(leg)
    beside = book.add(known["rubbed"])
    slopes = book.slopes(beside)
    assert book.slopes(beside) is slopes
    book.add(known["at the knee"], beside=beside)
    assert book.slopes(beside) is slopes
    other = book.slopes(known["at both"])
    assert other is not slopes
    assert book.slopes(known["at both"]) is other
    assert len(other.jacobian) == len(known["at both"].values)


def test_errors_are_those_of_what_is_kept_beside_what_is_fixed(
    leg: Problem, known: dict[str, Fit]
) -> None:
    both = fitted(leg, coulomb_friction=["knee"], torque_bias=["knee", "ankle"], cogging=["knee"])
    leg.fit.refine(both)
    slopes = linearised(leg.fit.objective, both)
    leg.screen.refine(both)
    variance, _ = covariance(leg.fit.objective, both, leg.noise, slopes, leg.screen.objective)
    errors = KnownErrors(leg, both, slopes)
    away = np.abs(both.values - both.structure.zero)
    shape = np.array([slot.parameter.shape for slot in both.structure.slots])
    assert shape.any()
    assert (errors.of()[shape] == 0).all()
    std = np.sqrt(np.diag(variance))
    np.testing.assert_allclose(errors.of()[~shape], (away / std)[~shape], rtol=1e-6)
    kept = [0, 2]
    within = np.linalg.inv(np.linalg.inv(variance)[np.ix_(kept, kept)])
    expected = away[kept] / np.sqrt(np.diag(within))
    fixed = {*range(len(away))} - {*kept}
    np.testing.assert_allclose(errors.of(fixed)[kept], expected, rtol=1e-4)
    assert (errors.of(fixed)[[*fixed]] == 0).all()
