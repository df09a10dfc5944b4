"""What is known is not changed, what is doubted costs nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, hide, problem_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.search.beliefs import Beliefs
from walkerkit.gap.search.naming import name_effects
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Structure

EVERY = tuple(CATALOGUE.values())


@pytest.fixture(scope="module")
def leg(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """A leg whose knee is damped."""
    model = tmp_path_factory.mktemp("leg") / "leg.xml"
    model.write_text(LEG)
    return problem_of(model, [hide("viscous_friction", "knee", damping=0.2)])


def places(problem: Problem, beliefs: Beliefs) -> dict[str, tuple[str, ...]]:
    terms = replace(problem, beliefs=beliefs).terms(EVERY)
    return {term.effect.name: term.sites for term in terms}


def test_what_is_known_is_nowhere(leg: Problem) -> None:
    free = places(leg, Beliefs())
    assert "payload" in free
    assert "payload" not in places(leg, Beliefs.of(known=["payload"]))
    assert places(leg, Beliefs.of(known="mass:shin"))["payload"] == ("thigh",)
    known = places(leg, Beliefs.of(known=["kp:knee", "armature"]))
    assert known["position_gain"] == ("ankle",)
    assert "armature" not in known
    assert known["viscous_friction"] == free["viscous_friction"]


def test_what_is_doubted_has_no_prior(leg: Problem) -> None:
    doubting = replace(leg, beliefs=Beliefs.of(doubt=["damping"]))
    terms = doubting.terms([CATALOGUE["viscous_friction"], CATALOGUE["armature"]])
    structure = Structure(terms, leg.robots)
    assert np.isinf(structure.prior[:2]).all()
    assert np.isfinite(structure.prior[2:]).all()


def test_what_is_doubted_at_a_joint_is_doubted_there_alone(leg: Problem) -> None:
    doubting = replace(leg, beliefs=Beliefs.of(doubt=["position_gain:knee"]))
    (gains,) = doubting.terms([CATALOGUE["position_gain"]])
    apart = Structure((gains,), leg.robots)
    assert [slot.place for slot in apart.slots] == ["knee", "ankle"]
    assert np.isinf(apart.prior).tolist() == [True, False]
    shared = Structure((replace(gains, shared=True),), leg.robots)
    assert np.isfinite(shared.prior).all()


def test_a_known_cause_is_not_named(leg: Problem) -> None:
    effects = [CATALOGUE[name] for name in ("viscous_friction", "armature", "coulomb_friction")]
    knowing = replace(leg, beliefs=Beliefs.of(known=["damping:knee"]))
    terms = name_effects(knowing, effects).fit.structure.terms
    assert "knee" not in [s for t in terms if t.effect.name == "viscous_friction" for s in t.sites]


@pytest.mark.parametrize(
    ("known", "told"),
    [
        ("payloads", r"--known payloads: no effect .* 'payloads' \(did you mean 'payload'"),
        (
            "payload:shine",
            r"payload is not at 'shine' \(did you mean 'shin', 'thigh'\?\); it can be at",
        ),
    ],
)
def test_a_word_that_nothing_has_is_refused(leg: Problem, known: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        Beliefs.of(known=[known]).check(EVERY, leg.robots, leg.joints)
