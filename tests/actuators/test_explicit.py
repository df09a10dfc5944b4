"""Efforts that Python computes: PD control, and PD control through a DC motor."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from tests.actuators.contract import EXPRESSIONS, DeterministicContract
from tests.actuators.reference import clip, dc_motor, pd
from tests.actuators.robots import built, robot
from walkerkit.actuators import (
    ActuatorCmd,
    DcMotorActuatorCfg,
    IdealPdActuatorCfg,
    RemotizedPdActuatorCfg,
)


class TestIdealPd(DeterministicContract):
    words = ("position", "velocity", "effort")
    limits = (8.0, 8.0, 8.0)
    cfg = IdealPdActuatorCfg(
        joint_names_expr=EXPRESSIONS, stiffness=25.0, damping=0.4, effort_limit=8.0
    )

    def expected(self, j, history, q, qd):
        asked = pd(25.0, 0.4, *history[-1], q, qd)
        return asked, clip(asked, -8.0, 8.0)


class TestUnlimited(DeterministicContract):
    cfg = IdealPdActuatorCfg(
        joint_names_expr=EXPRESSIONS,
        stiffness={"hip": 20.0, "knee": 10.0, "rail": 30.0},
        damping={"hip|knee": 0.2, "rail": 0.5},
    )

    def expected(self, j, history, q, qd):
        asked = pd((20.0, 10.0, 30.0)[j], (0.2, 0.2, 0.5)[j], *history[-1], q, qd)
        return asked, asked


class TestDcMotor(DeterministicContract):
    words = ("position", "velocity", "effort")
    limits = (6.0, 6.0, 6.0)
    cfg = DcMotorActuatorCfg(
        joint_names_expr=EXPRESSIONS,
        stiffness=30.0,
        damping=0.3,
        effort_limit=6.0,
        saturation_effort={"hip": 9.0, "knee": 7.0, "rail": 8.0},
        velocity_limit={"hip": 4.0, "knee": 6.0, "rail": 0.5},
    )

    def expected(self, j, history, q, qd):
        asked = pd(30.0, 0.3, *history[-1], q, qd)
        return asked, dc_motor(asked, qd, (9.0, 7.0, 8.0)[j], (4.0, 6.0, 0.5)[j], 6.0)


TABLE = ((-0.6, 2.0), (-0.2, 5.0), (0.1, 1.0), (0.4, 9.0))


def interpolated(q):
    """The table's limit at an angle."""
    if q <= TABLE[0][0]:
        return TABLE[0][1]
    for (a, low), (b, high) in pairwise(TABLE):
        if q <= b:
            return low + (high - low) * (q - a) / (b - a)
    return TABLE[-1][1]


class TestRemotizedPd(DeterministicContract):
    words = ("position", "velocity", "effort")
    limits = (6.0, 6.0, 6.0)
    cfg = RemotizedPdActuatorCfg(
        joint_names_expr=EXPRESSIONS,
        stiffness=25.0,
        damping=0.4,
        effort_limit=6.0,
        effort_lookup=TABLE,
    )

    def expected(self, j, history, q, qd):
        asked = pd(25.0, 0.4, *history[-1], q, qd)
        limit = min(interpolated(q), 6.0)
        return asked, clip(asked, -limit, limit)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ((), r"effort_lookup should have two or more rows .*got \(\)"),
        (((0.0, 1.0),), "two or more rows"),
        (3.0, r"effort_lookup should be rows of \(angle, effort limit\), got 3.0"),
        ("table", "effort_lookup should be rows of .*got 'table'"),
        (((0.0, 1.0, 2.0), (1.0, 2.0, 3.0)), "effort_lookup should be rows of"),
        (((0.0, 1.0), (0.0, 2.0)), "effort_lookup .*rising angles"),
        (((1.0, 1.0), (0.0, 2.0)), "effort_lookup .*rising angles"),
        (((0.0, float("nan")), (1.0, 2.0)), "effort_lookup .*finite"),
        (((0.0, -1.0), (1.0, 2.0)), "effort_lookup has the negative effort limit -1.0"),
    ],
)
def test_bad_lookup(table, message):
    with pytest.raises((ValueError, TypeError), match=message):
        RemotizedPdActuatorCfg(
            joint_names_expr=EXPRESSIONS, stiffness=1.0, damping=0.1, effort_lookup=table
        )


def test_strength_weakens_what_is_left_and_not_what_was_asked_for():
    actuator, _ = built(TestIdealPd.cfg, robot())
    cmd = ActuatorCmd(position_target=[1.0, 1.0, 1.0])
    actuator.compute(cmd)
    asked, left = actuator.computed_effort, actuator.applied_effort
    actuator.set("strength", [0.5, 1.0, 0.0])
    controls = actuator.compute(cmd)
    np.testing.assert_array_equal(actuator.computed_effort, asked)
    np.testing.assert_array_equal(actuator.applied_effort, left * [0.5, 1.0, 0.0])
    np.testing.assert_array_equal(controls, actuator.applied_effort)


def test_efforts_are_zero_after_a_reset():
    actuator, _ = built(TestIdealPd.cfg, robot())
    actuator.compute(ActuatorCmd(position_target=[1.0, 1.0, 1.0]))
    assert actuator.applied_effort.any()
    actuator.reset()
    assert not actuator.applied_effort.any()
    assert not actuator.computed_effort.any()
