"""Tests of what a diagnosis says of its gaps."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import pytest

from tests.gap.conftest import LegDiagnosis
from walkerkit.gap.report.gaps import GapSize
from walkerkit.gap.report.replayed import beside_each_other
from walkerkit.gap.report.result import verdict_on
from walkerkit.gap.simulation.load_robot import robot_from_spec


@pytest.mark.parametrize(
    ("after", "explained"),
    [(0.029, True), (0.1, True), (0.3, False), (0.52, False), (0.9, False)],
)
def test_an_effort_that_stays_is_not_explained(after: float, explained: bool) -> None:
    effort = GapSize(unit="N·m", before=0.52, after=after, noise_floor=0.012, numerical_floor=0.016)
    assert effort.floor == pytest.approx(0.02)
    assert effort.at_floor == (after < 0.03)
    assert effort.mostly_closed == explained


@pytest.mark.parametrize(
    ("before", "after", "floor", "closed"),
    [
        (0.0, 0.0, 0.0, 1.0),
        (0.0, 0.1, 0.0, 0.0),
        (0.0, 0.1, 0.02, 0.0),
        (0.1, 0.1, 0.0, 0.0),
        (0.1, 0.05, 0.0, 0.0),  # of an endless way
        (0.01, 0.1, 0.02, 0.0),  # from below its floor
        (0.5, math.inf, 0.02, 0.0),
        (0.2, 0.3, 0.02, 0.0),
        (0.2, 0.1, 0.05, 0.5),
    ],
)
def test_how_much_of_a_gap_is_closed(
    before: float, after: float, floor: float, closed: float
) -> None:
    size = GapSize(unit="rad", before=before, after=after, noise_floor=floor)
    assert size.closed == pytest.approx(closed)
    assert size.mostly_closed is (closed >= 0.5)


def test_a_gap_of_one_joint_is_not_hidden_by_the_others(leg: LegDiagnosis) -> None:
    still = GapSize(unit="rad", before=0.001, after=0.001, noise_floor=0.001)
    moved = replace(still, before=0.0032, after=0.0032)
    together = replace(still, before=0.0013, after=0.0013)
    gap = replace(leg().gap, position=together, finer_position=None)
    few = replace(gap, joints={"hip": still, "knee": replace(still, after=0.0019)})
    assert few.position_at_floor
    assert few.hidden_joints == ()

    gap = replace(gap, joints={"hip": still, "knee": moved})
    assert not gap.position_at_floor
    assert gap.hidden_joints == ("knee",)
    # Nothing is left at a finer timestep, or something is.
    finer = replace(gap, finer_position=still, finer_joints={"hip": still, "knee": still})
    assert finer.position_at_floor
    assert finer.hidden_joints == ()
    assert not replace(finer, finer_joints={"hip": still, "knee": moved}).position_at_floor
    # The timestep leaves as much at a neighbour.
    coarse = replace(moved, numerical_near=0.0015)
    assert replace(gap, joints={"hip": still, "knee": coarse}).position_at_floor
    # A gap of all joints together hides none.
    assert replace(gap, position=moved).hidden_joints == ()


def test_what_the_timestep_leaves_reaches_a_neighbour_as_far_as_inertia_carries_it() -> None:
    hand = """<mujoco><worldbody><body><joint name="wrist"/>
      <geom type="capsule" fromto="0 0 0 .2 0 0" size=".03"/>
      <body pos=".2 0 0"><joint name="finger"/>
        <geom type="capsule" fromto="0 0 0 .02 0 0" size=".004"/></body></body>
      <body pos="0 1 0"><joint name="other"/><geom size=".05" pos=".1 0 0"/></body>
      </worldbody></mujoco>"""
    robot = robot_from_spec(mujoco.MjSpec.from_string(hand), "hand.xml")
    still = GapSize(unit="rad", before=0.1, after=0.1, noise_floor=0.001)
    floors = {"wrist": 1e-6, "finger": 0.4, "other": 0.3}
    sizes = {name: replace(still, numerical_floor=floor) for name, floor in floors.items()}
    near = {name: one.numerical_near for name, one in beside_each_other(robot, sizes).items()}
    assert near == {"wrist": near["wrist"], "finger": 0.4, "other": 0.3}
    # By how far it turns where the finger turns by itself, in MuJoCo.
    data = mujoco.MjData(robot.model)
    data.qfrc_applied[1] = 1e-4
    robot.model.opt.gravity[:] = 0
    mujoco.mj_forward(robot.model, data)
    assert abs(data.qacc[0] / data.qacc[1]) * 0.4 < near["wrist"] < 0.01
    # What carries it moves it whole.
    sizes |= {"wrist": replace(still, numerical_floor=0.5)}
    assert beside_each_other(robot, sizes)["finger"].numerical_near == 0.5


def test_few_restarts_may_leave_more_by_chance(leg: LegDiagnosis) -> None:
    size = GapSize(unit="rad", before=0.0024, after=0.0024, noise_floor=0.001)
    assert not size.at_floor
    lucky = replace(size, by_chance=2.5)
    assert lucky.at_floor
    gap = replace(leg().gap, position=lucky, finer_position=None)
    assert replace(gap, joints={"knee": lucky}).position_at_floor
    assert not replace(gap, joints={"knee": size}).position_at_floor
    assert not replace(gap, joints={"knee": replace(lucky, after=0.003)}).position_at_floor


def test_what_makes_every_held_out_gap_larger_explains_nothing(leg: LegDiagnosis) -> None:
    larger = GapSize(unit="rad", before=0.010, after=0.014, noise_floor=0.001)
    smaller = replace(larger, after=0.008)
    gap = replace(leg().gap, position=larger, finer_position=None, scored=("position", "effort"))

    def verdict(**sizes: GapSize) -> str:
        signals = {"position": larger, "effort": sizes.get("effort", larger)}
        with_them = replace(gap, signals=signals, finer_position=sizes.get("finer"))
        return verdict_on(replace(with_them, position=sizes.get("position", larger)), named=True)

    assert verdict() == "unexplained"
    # One signal is nearer, or the position at a finer timestep.
    assert verdict(position=smaller) == "partly_explained"
    assert verdict(effort=smaller) == "partly_explained"
    assert verdict(finer=smaller) == "partly_explained"
    # The model as given runs away.
    assert verdict(position=replace(larger, before=math.nan)) == "partly_explained"
