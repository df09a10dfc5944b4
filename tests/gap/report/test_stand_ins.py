"""What is said of several effects together."""

from __future__ import annotations

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, Q_ONLY, problem_of
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.report.diagnosis import Diagnosis
from walkerkit.gap.report.stand_ins import most_sure, stand_ins
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Structure, Term

Place = tuple[str, str, tuple[float, ...]]


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """A leg like its model."""
    model = tmp_path_factory.mktemp("leg") / "leg.xml"
    model.write_text(LEG)
    return problem_of(model, (), Q_ONLY)


def named(problem: Problem, *places: Place) -> Fit:
    """Effects at their sites with some increments."""
    terms = tuple(
        Term(effect=CATALOGUE[effect], sites=(site,), shared=site == EVERYWHERE)
        for effect, site, _ in places
    )
    structure = Structure(terms, problem.robots)
    changes = np.concatenate([np.array(change) for _, _, change in places])
    return Fit(
        structure=structure,
        values=structure.zero + changes,
        score=0.0,
        mean_square=np.ones(len(problem.channels)),
    )


FRICTION = ("coulomb_friction", "knee", (0.05,))
DAMPING = ("viscous_friction", "knee", (0.1,))
INERTIA = ("armature", "knee", (0.01,))
LOADED = ("load_dependent_friction", "knee", (0.1,))
DELAY = ("loop_delay", "knee", (0.003,))
FILTER = ("setpoint_filter", "knee", (0.003,))
OTHER_FILTER = ("setpoint_filter", "ankle", (0.003,))
BIAS = ("torque_bias", "knee", (0.1,))
ELASTICITY = ("series_elasticity", "knee", (0.002, 0.05, 0.0))
OTHER_ELASTICITY = ("series_elasticity", "ankle", (0.002, 0.05, 0.0))
SPRING = ("parallel_spring", "ankle", (0.2, 0.0))


@pytest.mark.parametrize(
    ("places", "groups"),
    [
        ((DELAY,), []),
        ((DELAY, BIAS), []),
        ((DELAY, BIAS, SPRING), [("loop_delay", "torque_bias", "parallel_spring")]),
        ((DELAY, BIAS, FRICTION), []),
        ((DELAY, FRICTION, DAMPING), []),
        # Four of any kind fit many a law that is none of them.
        (
            (DELAY, FRICTION, DAMPING, INERTIA),
            [("loop_delay", "coulomb_friction", "viscous_friction", "armature")],
        ),
        # A delay of another kind is fitted by these two, where they are of the same joint.
        ((DELAY, FILTER), [("loop_delay", "setpoint_filter")]),
        ((DELAY, OTHER_FILTER), []),
        # So is a lag of the drive, and friction that gives way before it lets go; dry friction and
        # a spring are what many a gear has.
        ((DELAY, ELASTICITY), [("loop_delay", "series_elasticity")]),
        ((LOADED, ELASTICITY), [("load_dependent_friction", "series_elasticity")]),
        ((LOADED, OTHER_ELASTICITY), []),
        ((FRICTION, ELASTICITY), []),
        ((BIAS, ELASTICITY), []),
    ],
)
def test_many_and_two_of_one_part_may_be_one(
    problem: Problem, places: tuple[Place, ...], groups: list[str]
) -> None:
    assert stand_ins(problem, named(problem, *places)) == tuple(groups)


@pytest.mark.parametrize(("kd", "groups"), [(-0.25, True), (0.25, False)])
def test_two_that_undo_each_other_may_be_one(problem: Problem, kd: float, groups: bool) -> None:
    """Damping that the joint gains and the drive loses moves nothing at all."""
    fit = named(problem, ("viscous_friction", "knee", (0.3,)), ("velocity_gain", "knee", (kd,)))
    assert stand_ins(problem, fit) == ((("viscous_friction", "velocity_gain"),) if groups else ())


def test_one_of_which_no_number_is_known_is_as_likely_as_not(confused: Diagnosis) -> None:
    """The mass of the payload has no standard error."""
    several = [["command_delay", "payload"]]
    assert most_sure(confused.effects, several) == {
        "coulomb_friction": 1.0,
        "command_delay": 0.85,
        "payload": 0.5,
    }
