"""What of a fit it needs, by algebra: where the others go when some numbers are left out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, fitted, hide, problem_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.compare import Member, is_worth_a_name
from walkerkit.gap.search.decision import LEAST_GAIN, PRICE_PLACE, PRICE_RARE, TEMPERATURE
from walkerkit.gap.search.fit import Promise
from walkerkit.gap.search.foretold import Foretold
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import Reduction, hoped_for, ordinary
from walkerkit.gap.search.score import Scoring, memory_of
from walkerkit.gap.search.slopes import Slopes, linearised, posterior_equations
from walkerkit.gap.search.structure import Fit, Unit

ORDINARY = ("viscous_friction", "coulomb_friction", "armature", "position_gain", "velocity_gain")


@pytest.fixture(scope="module")
def leg(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    model: Path = tmp_path_factory.mktemp("leg") / "leg.xml"
    model.write_text(LEG)
    biased = hide("torque_bias", "knee", knee__bias=0.5)
    return problem_of(model, [hide("coulomb_friction", "knee", frictionloss=0.3), biased])


@pytest.fixture(scope="module")
def full(leg: Problem) -> Fit:
    """All that is ordinary, and a bias at both joints."""
    found = fitted(leg, **{name: ["knee", "ankle"] for name in (*ORDINARY, "torque_bias")})
    leg.fit.refine(found)
    return found


def test_the_others_follow_to_where_slopes_have_the_least_cost(leg: Problem, full: Fit) -> None:
    slopes = linearised(leg.fit.objective, full)
    normal, _ = posterior_equations(leg.fit.objective, full, slopes)
    away = (full.values - full.structure.zero) / full.structure.scale
    found = Reduction(leg.fit.objective, full, slopes, leg.noise).members()
    assert len(found) > 1
    for one in found:
        kept = one.kept
        gone = np.setdiff1d(np.arange(len(away)), kept)
        assert len(gone)
        # Least where the slope of the quadratic in those that stay is nought.
        expected = np.linalg.solve(
            normal[np.ix_(kept, kept)], normal[np.ix_(kept, gone)] @ away[gone]
        )
        moved = (one.values - full.values) / full.structure.scale
        np.testing.assert_allclose(moved[kept], expected, rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(moved[gone], -away[gone])


def test_what_was_hidden_stays_and_what_was_not_goes(leg: Problem, full: Fit) -> None:
    slopes = linearised(leg.fit.objective, full)
    reduction = Reduction(leg.fit.objective, full, slopes, leg.noise, any_may_go=True)
    one = reduction.best(few=True)
    assert one.effects == {"coulomb_friction": ("knee",), "torque_bias": ("knee",)}
    named = {full.structure.slots[k].unit: one.values[k] for k in one.kept}
    assert named["coulomb_friction", "knee"] == pytest.approx(0.3, abs=0.02)
    assert named["torque_bias", "knee"] == pytest.approx(0.5, abs=0.02)


def test_what_is_lacked_at_first_is_in_no_structure(leg: Problem, full: Fit) -> None:
    gone = ("coulomb_friction", "knee")
    reduction = Reduction(leg.fit.objective, full, linearised(leg.fit.objective, full), leg.noise)
    assert all(gone not in reduction.best([gone], few=few).units for few in (False, True))


class Dropping:
    """The same by dense algebra, each set of numbers solved for anew."""

    def __init__(self, problem: Problem, full: Fit, slopes: Slopes, any_may_go: bool):
        objective = problem.fit.objective
        self.full, self.any_may_go = full, any_may_go
        self.foretold = Foretold(objective, slopes)
        self.scoring = Scoring(objective, full, self.foretold, problem.noise)
        self.memory = memory_of(objective, slopes.residual)
        self.normal, _ = posterior_equations(objective, full, slopes)
        self.away = (full.values - full.structure.zero) / full.structure.scale
        self.joints = [channel.joint for channel in objective.channels]
        self.samples = objective.samples
        self.columns: dict[Unit, list[int]] = {}
        for k, slot in enumerate(full.structure.slots):
            self.columns.setdefault(slot.unit, []).append(k)
        self.units = [
            unit
            for unit in self.columns
            if any_may_go or CATALOGUE[unit[0]].ordinary or len(self.places(unit[0])) > 1
        ]

    def places(self, effect: str) -> list[str]:
        return [place for name, place in self.columns if name == effect]

    def moved(self, gone: Sequence[Unit]) -> np.ndarray:
        """Where the others go once some are at their zero, in scales."""
        own = [k for unit in gone for k in self.columns[unit]]
        stay = np.setdiff1d(np.arange(len(self.away)), own)
        found = np.zeros_like(self.away)
        found[own] = -self.away[own]
        found[stay] = -np.linalg.pinv(self.normal[np.ix_(stay, stay)], rcond=1e-12) @ (
            self.normal[np.ix_(stay, own)] @ found[own]
        )
        return found

    def cost(self, gone: Sequence[Unit]) -> float:
        moved = self.moved(gone)
        return 0.5 * float(moved @ self.normal @ moved)

    def member(self, gone: Sequence[Unit]) -> Member:
        moved = self.moved(gone)
        kept = [k for unit, own in self.columns.items() if unit not in gone for k in own]
        effects: dict[str, tuple[str, ...]] = {}
        for name, place in (unit for unit in self.columns if unit not in gone):
            effects[name] = (*effects.get(name, ()), place)
        return Member(
            effects=effects,
            scores=self.scoring.scores([(self.foretold.far(moved), np.sort(kept))], self.memory)[0],
            fit=self.full,
            kept=np.sort(kept),
            values=self.full.values + moved * self.full.structure.scale,
        )

    def may_go(self, unit: Unit, gone: Sequence[Unit]) -> bool:
        elsewhere = [(unit[0], place) for place in self.places(unit[0]) if place != unit[1]]
        is_free = self.any_may_go or CATALOGUE[unit[0]].ordinary
        return is_free or any(other not in gone for other in elsewhere)

    def best(self, first: Sequence[Unit] = (), *, few: bool = False) -> Member:
        """The cheapest goes again and again; the last worth as much, or if few, hardly less."""
        here = self.foretold.score(np.zeros_like(self.away))
        alone = {u: self.foretold.score(self.moved([u])) - here for u in self.units}
        usual = [*CATALOGUE]
        gone = [*first]
        told = most = self.member(gone)

        def worth(one: Member) -> float:
            return one.scores.elpd_nearby(one.scores).sum() / TEMPERATURE + one.log_prior

        while True:
            cost = {
                u: max(self.cost([*gone, u]), alone[u] if alone[u] > LEAST_GAIN else 0.0)
                for u in self.units
                if u not in gone and self.may_go(u, gone)
            }
            if not cost:
                return told
            least = min(cost.values()) + TEMPERATURE / self.samples
            alike = [u for u, its in cost.items() if its <= least]
            gone.append(max(alike, key=lambda unit: usual.index(unit[0])))
            member = self.member(gone)
            if worth(member) >= worth(most):
                told = most = member
            elif few and not is_worth_a_name(member, most, self.joints):
                told = member


WITH_MANY_NUMBERS = ("coulomb_friction", "stribeck_friction", "position_gain", "torque_bias")


@pytest.fixture(scope="module", params=["one number each", "several numbers, some idle"])
def some(request: pytest.FixtureRequest, leg: Problem, full: Fit) -> Fit:
    if request.param == "one number each":
        return full
    found = fitted(leg, **{name: ["knee", "ankle"] for name in WITH_MANY_NUMBERS})
    leg.fit.refine(found)
    return found


@pytest.mark.parametrize("any_may_go", [False, True])
def test_the_cheapest_go_as_they_do_where_each_set_is_solved_for_anew(
    leg: Problem, some: Fit, any_may_go: bool
) -> None:
    slopes = linearised(leg.fit.objective, some)
    apart = Dropping(leg, some, slopes, any_may_go)
    reduction = Reduction(leg.fit.objective, some, slopes, leg.noise, any_may_go=any_may_go)
    found = [reduction.whole, reduction.best(few=True), *reduction.members()]
    here = apart.foretold.score(np.zeros_like(apart.away))
    for unit in apart.units:
        lost = apart.foretold.score(apart.moved([unit])) - here
        assert reduction.lost[unit] == pytest.approx(lost, rel=1e-3, abs=1e-6)
    best = apart.best()
    expected = [apart.member([]), apart.best(few=True), best]
    expected += [
        apart.best([unit for unit in apart.units if unit[0] == name]) for name in ordinary(best)
    ]
    assert [dict(one.effects) for one in found] == [dict(one.effects) for one in expected]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.kept, other.kept)
        scale = some.structure.scale
        np.testing.assert_allclose(one.values / scale, other.values / scale, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(one.scores.squares, other.scores.squares, rtol=1e-3)


def test_a_whole_fit_that_needs_all_is_its_most_probable_structure(leg: Problem) -> None:
    needed = fitted(leg, coulomb_friction=["knee"], torque_bias=["knee"])
    leg.fit.refine(needed)
    slopes = linearised(leg.fit.objective, needed)
    reduction = Reduction(leg.fit.objective, needed, slopes, leg.noise)
    found = reduction.members()
    assert [dict(one.effects) for one in found] == [
        {"coulomb_friction": ("knee",), "torque_bias": ("knee",)},
        {"torque_bias": ("knee",)},
    ]
    assert found[0].key == reduction.whole.key


def test_a_fit_hopes_for_the_most_probable_structure_within_it(leg: Problem, full: Fit) -> None:
    """By a score that is a quadratic, of numbers that have nothing to do with each other."""
    structure, rng, samples = full.structure, np.random.default_rng(0), 400.0
    for _ in range(20):
        curvature = 10 ** rng.uniform(-4, 0, len(full.values))
        values = structure.zero + rng.normal(0, 1, len(full.values)) * structure.scale
        hope = Promise(score=-5.0, values=values, normal=np.diag(curvature))
        away = (values - structure.zero) / structure.scale
        costs = samples / TEMPERATURE * 0.5 * curvature * away**2
        prices = PRICE_PLACE + structure.surprise(values)
        rare = np.array([not slot.term.effect.ordinary for slot in structure.slots])
        # Cheapest first, until as much as may go has gone; of a rare effect one place stays.
        order = np.argsort(costs)
        order = [k for k in order if not rare[k] or k != order[np.flatnonzero(rare[order])[-1]]]
        each = [
            -samples / TEMPERATURE * hope.score
            - PRICE_RARE
            - costs[order[:count]].sum()
            - np.delete(prices, order[:count]).sum()
            for count in range(len(order) + 1)
        ]
        assert hoped_for(structure, hope, samples) == pytest.approx(max(each), rel=1e-6)
        assert int(np.argmax(each)) not in (0, len(order))
