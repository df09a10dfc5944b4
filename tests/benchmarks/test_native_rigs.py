"""A slice of the benchmark, and its machines against what is known of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.native.machine import STEP, Bristles, Machine, log
from benchmarks.native.robots import ARM, GANTRY, LEG, WHEEL
from benchmarks.native.scenarios import SCENARIOS, Scenario
from benchmarks.native_rigs import QUICK, Found, diagnosed, rows

ROBOTS = {"arm": ARM, "gantry": GANTRY, "leg": LEG, "wheel": WHEEL}


def scenario(name: str) -> Scenario:
    (one,) = [one for one in SCENARIOS if one.name == name]
    return one


def test_what_is_hidden_in_a_leg_under_torque_is_found() -> None:
    found = diagnosed((replace(scenario("leg: weak motor"), seconds=2.5), 0))
    assert found.right
    assert found.place
    assert found.sure == ("torque_constant",)
    assert found.error is not None
    assert found.error < 0.01
    assert found.gap[1] < 0.1 * found.gap[0]


def test_nothing_is_found_where_nothing_is_hidden_but_a_finer_timestep() -> None:
    found = diagnosed((replace(scenario("leg: nothing"), seconds=4.0), 0))
    assert found.right
    assert not found.sure_and_wrong


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_motions_lie_within_their_bounds_and_logs_are_quantised(robot) -> None:
    rng = np.random.default_rng(0)
    motions = robot.motions(2.0, rng)
    assert len(motions) == 4
    for targets in motions.values():
        assert (targets >= np.array(robot.low) - 1e-12).all()
        assert (targets <= np.array(robot.high) + 1e-12).all()
        assert (np.ptp(targets, axis=0) > 0).all()
    (recording,) = log(robot, Machine(), {"steps": motions["steps"]}, ("position",), rng)
    for joint in recording.joints:
        steps = recording.columns[f"{joint}/position"] / robot.quantum
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


def test_bristles_slide_at_their_coulomb_force_and_break_away_at_more() -> None:
    bristles = Bristles(2.0, breakaway=3.0, stribeck=0.05, stiffness=1e4, damping=10.0)
    slow = min(bristles(0.0, 1e-3) for _ in range(round(10 / STEP)))
    assert slow == pytest.approx(-3.0, rel=0.02)
    fast = [bristles(0.0, -1.0) for _ in range(round(1 / STEP))]
    assert fast[-1] == pytest.approx(2.0, rel=1e-3)


def test_late_targets_move_the_machine_later() -> None:
    motions = {"steps": WHEEL.motions(3.0, np.random.default_rng(2))["steps"]}
    logged = [
        log(
            WHEEL, Machine(delay=delay), motions, ("position", "velocity"), np.random.default_rng(0)
        )
        for delay in (0.0, 0.02)
    ]
    prompt, late = (one[0].columns["axle/velocity"] for one in logged)
    apart = [np.sum((late[k:] - prompt[: len(prompt) - k]) ** 2) for k in range(8)]
    assert np.argmin(apart) == round(0.02 * WHEEL.rate)


def test_the_table_counts_what_is_right() -> None:
    right = Found(
        scenario="a",
        hidden="armature",
        verdict="explained",
        names=("armature", "payload"),
        place=True,
        sure=("armature",),
        sure_and_wrong=False,
        error=0.01,
        gap=(1.0, 0.1),
        seconds=1.0,
    )
    alarm = replace(right, hidden="", sure_and_wrong=True)
    silent = replace(right, names=(), sure=(), error=None, place=False)
    table = {row.what: row.result for row in rows([right, alarm, silent])}
    assert table["hidden effect in the first name's set"] == "1 of 2"
    assert table["sure of a wrong name"] == "1 of 3"
    assert table["named where nothing is hidden but a finer timestep"] == "1 of 1"


def test_a_quick_run_is_of_scenarios_that_there_are() -> None:
    assert set(QUICK) <= {one.name for one in SCENARIOS}
    assert len({one.name for one in SCENARIOS}) == len(SCENARIOS)
