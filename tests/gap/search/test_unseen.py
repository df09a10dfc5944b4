"""Looks that all recordings chose are chosen again without what they are to predict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, Q_ONLY, fitted, hide, recorded
from walkerkit.gap import steps
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.search.book import Book
from walkerkit.gap.search.fit import evaluate, polished
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit
from walkerkit.gap.search.unseen import by_unseen, looks_of

COGGING = hide("cogging", "knee", knee__amplitude=0.3, knee__periods=12.0, knee__phase=0.5)


def problem_of(model: Path, *cogging: bool) -> Problem:
    """A leg whose recordings are made with cogging at the knee, or without."""
    made = {which: recorded(model, [COGGING] if which else []) for which in {*cogging}}
    return steps.load(model, [positions(made[one][k]) for k, one in enumerate(cogging)])


def positions(one: Recording) -> Recording:
    columns = {n: column for n, column in one.columns.items() if n.split("/")[1] in Q_ONLY}
    return replace(one, columns=columns)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("leg") / "leg.xml"
    path.write_text(LEG)
    return path


@pytest.fixture(scope="module")
def everywhere(model: Path) -> Problem:
    return problem_of(model, True, True, True)


def cogged(problem: Problem) -> Fit:
    """The best fit with cogging at the knee, from each wave that the recordings show."""
    rubbed = fitted(problem, coulomb_friction=["knee"])
    (term,) = (replace(t, sites=("knee",)) for t in problem.terms([CATALOGUE["cogging"]]))
    structure = rubbed.structure.with_term(term)
    waves = zip(*(slot.parameter.starts for slot in structure.slots[1:]), strict=True)
    objective = problem.fit.objective
    starts = evaluate(objective, [(structure, np.array([*rubbed.values, *w])) for w in waves])
    found = polished(objective, starts, iterations=20)
    return min(found, key=lambda one: one.score)


def left(problem: Problem, one: Fit) -> np.ndarray:
    """(n_blocks, n_scored) sums of squares."""
    return problem.fit.objective.block_squares(problem.fit.residual(one))


def total(squares: np.ndarray, rows: Sequence[bool] | None = None) -> float:
    return float(squares[slice(None) if rows is None else rows].sum())


def test_looks_are_those_of_rare_effects_that_begin_in_several_ways(everywhere: Problem) -> None:
    assert looks_of(cogged(everywhere).structure) == {("cogging", "knee")}
    plain = fitted(everywhere, coulomb_friction=["knee"], torque_bias=["knee"])
    assert looks_of(plain.structure) == frozenset()


def test_what_is_there_is_found_again_without_what_it_is_to_predict(everywhere: Problem) -> None:
    one = cogged(everywhere)
    squares = by_unseen(everywhere, one)
    assert squares is not None
    assert total(squares) < 1.5 * total(left(everywhere, one))
    without = fitted(everywhere, coulomb_friction=["knee"])
    assert total(squares) < 0.1 * total(left(everywhere, without))


def test_what_one_recording_has_is_not_foretold_from_the_others(model: Path) -> None:
    problem = problem_of(model, False, True, False)
    one = cogged(problem)
    squares = by_unseen(problem, one)
    assert squares is not None
    alone = problem.fit.objective.recording_of_block == 1
    without = total(left(problem, fitted(problem, coulomb_friction=["knee"])), alone)
    assert total(left(problem, one), alone) < 0.7 * without
    assert total(squares, alone) > 0.95 * without


def test_one_recording_is_left_out_part_by_part(model: Path) -> None:
    problem = problem_of(model, True)
    assert problem.fit.objective.recording_of_block.max() == 0
    one = cogged(problem)
    squares = by_unseen(problem, one)
    assert squares is not None
    assert total(squares) < 3 * total(left(problem, one))


def test_the_table_believes_looks_as_far_as_they_predict(everywhere: Problem) -> None:
    book, one = Book(everywhere), cogged(everywhere)
    plain = book.add(fitted(everywhere, coulomb_friction=["knee"]))
    first, other = (book.add(replace(one)) for _ in range(2))
    best = book.best
    assert best.fit in (first, other)
    assert book.was_chosen_by_all(best)
    assert not any(book.was_chosen_by_all(m) for m in book.table.members if m.fit is plain)
    before = {id(m.fit): book.table.worth_of(m) for m in reversed(book.table.members)}
    book.choose_again(best, 2 * best.scores.squares)
    assert not any(map(book.was_chosen_by_all, book.table.members))
    after = {id(m.fit): book.table.worth_of(m) for m in reversed(book.table.members)}
    # Others of the same looks are as far from what was said of them.
    lost = {key: before[key] - after[key] for key in before}
    assert lost[id(first)] == pytest.approx(lost[id(other)])
    assert lost[id(first)] > 10
    assert lost[id(plain)] == pytest.approx(0.0, abs=1e-6)
    # And what comes later with them.
    later = book.add(replace(one))
    assert {float(m.too_good.sum()) for m in book.table.members if m.fit is later} == {
        float(m.too_good.sum()) for m in book.table.members if m.fit is first
    }
