"""Efforts that Python computes: PD control, and PD control through a DC motor."""

from __future__ import annotations

from tests.actuators.contract import EXPRESSIONS, DeterministicContract
from tests.actuators.reference import clip, dc_motor, pd
from walkerkit.actuators import DcMotorActuatorCfg, IdealPdActuatorCfg


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
