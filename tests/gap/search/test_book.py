"""The book: of what slopes promise, what is fitted by itself and what stays in the table."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import pytest
from scipy.optimize import brentq

from tests.gap.search.test_naming import LEG, fitted, hide, problem_of
from walkerkit.gap.search.book import Book, stopped_since
from walkerkit.gap.search.compare import Member, Rare, rare_effects
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.problem import Problem
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

    def alone(member: Member, done: Collection[Rare]) -> Fit:
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


def test_what_comes_down_to_rare_effects_of_another_is_no_member(leg: Problem) -> None:
    book = Book(leg)
    both = book.add(rubbed(leg, "knee", "ankle"))
    single = [book.add(rubbed(leg, joint)) for joint in ("knee", "ankle")]
    members = by_rare(book)
    poor, good = sorted(
        single, key=lambda one: max(map(book.table.worth_of, members[rare_effects(one.structure)]))
    )
    asked: list[tuple[Rare, set[Rare]]] = []

    def alone(member: Member, done: Collection[Rare]) -> Fit:
        asked.append((member.rare, set(done)))
        return replace(poor)

    book.fit_what_is_in_the_running(alone)
    rare = [rare_effects(one.structure) for one in (both, good, poor)]
    assert asked == [(rare[0], set()), (rare[1], {rare[2]})]
    assert book.best.rare == rare[2]
    assert rare[1] not in by_rare(book)


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

    def alone(member: Member, done: Collection[Rare]) -> Fit:
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
    book.fit_what_is_in_the_running(lambda member, done: poor, most=1)
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
