"""What of a fit it needs, by algebra: where the others go when some numbers are left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, fitted, hide, problem_of
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import members, reduced
from walkerkit.gap.search.slopes import linearised, posterior_equations
from walkerkit.gap.search.structure import Fit

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
    found = members(leg.fit.objective, full, slopes, leg.noise)
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
    one = reduced(leg.fit.objective, full, slopes, leg.noise)
    assert one.effects == {"coulomb_friction": ("knee",), "torque_bias": ("knee",)}
    named = {full.structure.slots[k].unit: one.values[k] for k in one.kept}
    assert named["coulomb_friction", "knee"] == pytest.approx(0.3, abs=0.02)
    assert named["torque_bias", "knee"] == pytest.approx(0.5, abs=0.02)


def test_without_says_what_no_member_has(leg: Problem, full: Fit) -> None:
    slopes = linearised(leg.fit.objective, full)
    gone = ("coulomb_friction", "knee")
    found = members(leg.fit.objective, full, slopes, leg.noise, without=[gone])
    assert all(gone not in one.units for one in found)
