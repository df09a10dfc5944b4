"""Controller and motor of the rehearsal robot, by what drives do."""

import mujoco
import numpy as np
import pytest

from walkerkit.gap.rehearsal.hardware_controller import Controller
from walkerkit.gap.rehearsal.hardware_drive import Drives
from walkerkit.gap.rehearsal.hardware_motor import SUPPLY, Motor, supply
from walkerkit.gap.rehearsal.hidden import HiddenEffect

STEP = 1e-3
ARM = """
<mujoco><compiler angle="radian"/><worldbody><body>
  <joint name="a" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="1"/>
  <body pos="0 0 -.3"><joint name="b" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="1"/></body></body></worldbody>
<actuator><position joint="a" kp="20" kv="1" forcerange="-120 120"/>
  <position joint="b" kp="20" kv="1" forcerange="-120 120"/></actuator></mujoco>
"""


def hide(name, joints=("*",), **values):
    return HiddenEffect(effect=name, joints=joints, values=values)


def drives():
    return Drives(mujoco.MjModel.from_xml_string(ARM))


def motor(*hidden, start=0):
    return Motor(drives(), hidden, step=STEP, start=start)


def controller(*hidden):
    return Controller(drives(), hidden, step=STEP, n_sims=1)


def both(value):
    return np.full((1, 2), float(value))


class TestMotor:
    # Points of a DC motor's characteristic with S = 100 N·m and V = 50 rad/s.
    @pytest.mark.parametrize(
        ("asked", "speed", "made"),
        [
            (30, 10, 30),
            (90, 10, 80),
            (80, 40, 20),
            (30, 40, 20),
            (-30, 10, -30),
            (-120, 50, -100),
            (50, 75, -50),
            (-90, -30, -40),
            (90, -30, 90),
        ],
    )
    def test_runs_out_of_voltage_at_speed(self, asked, speed, made):
        limited = motor(hide("torque_speed_limit", saturation_effort=100.0, velocity_limit=50.0))
        assert limited.made(both(asked), both(speed))[0, 0] == pytest.approx(made)

    def test_has_less_left_when_its_neighbour_draws_power(self):
        sagging = motor(hide("supply_sag", sag=0.002))
        asked = np.array([[100.0, 10.0]])
        np.testing.assert_allclose(sagging.made(asked, np.array([[0.0, 0.0]])), asked)
        # 10 N·m at 20 rad/s are 200 W, which take 40 % of 120 N·m.
        np.testing.assert_allclose(sagging.made(asked, np.array([[0.0, 20.0]])), [[72.0, 10.0]])

    def test_makes_less_of_a_lower_supply_and_is_slower(self):
        effects = [
            hide("supply_voltage", swing=0.2),
            hide("torque_speed_limit", saturation_effort=100.0, velocity_limit=50.0),
        ]
        made = {}
        for asked, speed in ((50.0, 0.0), (200.0, 0.0), (200.0, 10.0)):
            low = motor(*effects)
            made[asked, speed] = [low.made(both(asked), both(speed))[0, 0] for _ in range(3000)]
        part = supply(STEP * np.arange(3000), 0.2) / SUPPLY
        assert part.min() < 0.85
        np.testing.assert_allclose(made[50.0, 0.0], 50 * part)
        np.testing.assert_allclose(made[200.0, 0.0], 100 * part)
        np.testing.assert_allclose(made[200.0, 10.0], 100 * part - 20)

    def test_lags(self):
        lagging = motor(hide("actuator_lag", time_constant=0.02))
        lagging.made(both(0), both(0))
        made = [lagging.made(both(1), both(0))[0, 0] for _ in range(20)]
        assert made[-1] == pytest.approx(1 - np.exp(-1))

    @pytest.mark.parametrize("delay", [0.004, 0.0045, 0.0002])
    def test_answers_late(self, delay):
        late = motor(hide("loop_delay", delay=delay))
        made = [late.made(both(k * STEP), both(0))[0, 0] for k in range(20)]
        np.testing.assert_allclose(made[6:], np.arange(6, 20) * STEP - delay)

    def test_weakens_from_the_log_s_beginning_and_does_not_tell(self):
        warm = motor(hide("strength_drift", rate=0.1), start=5)
        for _ in range(5):
            warm.made(both(2), both(0))
        assert warm.delivered(both(2), both(0))[0, 0] == 2.0
        for _ in range(1000):
            reported = warm.made(both(2), both(0))
        assert reported[0, 0] == 2.0
        assert warm.delivered(reported, both(0))[0, 0] == pytest.approx(1.8)

    def test_ripples_in_proportion_and_cogs_always(self):
        angles = np.linspace(0, 2 * np.pi, 400, endpoint=False)
        wave = {"amplitude": 0.2, "periods": 7.0, "phase": 0.4}
        for effort in (0.0, 5.0):
            rippled, cogged = (
                np.array([of.delivered(both(effort), both(a))[0, 0] for a in angles])
                for of in (motor(hide("torque_ripple", **wave)), motor(hide("cogging", **wave)))
            )
            assert rippled.mean() == pytest.approx(effort)
            assert np.ptp(rippled) == pytest.approx(0.4 * effort, rel=1e-3)
            assert np.ptp(cogged) == pytest.approx(0.4, rel=1e-3)
        # Over a turn magnets give back what they take.
        assert cogged.mean() == pytest.approx(5.0)

    def test_one_joint_s_is_not_the_other_s(self):
        weak = motor(hide("torque_ripple", ("b",), amplitude=0.5, periods=1.0, phase=np.pi / 2))
        np.testing.assert_allclose(weak.delivered(both(2), both(0)), [[2.0, 3.0]])


class TestController:
    def test_leaves_small_errors_alone_but_not_their_speed(self):
        lazy = controller(hide("controller_deadband", width=0.1))
        np.testing.assert_allclose(lazy.asked(both(0.09), both(0), both(0)), 0.0)
        np.testing.assert_allclose(lazy.asked(both(-0.09), both(0), both(0.5)), -0.5)
        np.testing.assert_allclose(lazy.asked(both(0.11), both(0), both(0)), 2.2)

    def test_adds_up_errors_until_its_limit(self):
        adding = controller(hide("integral_action", gain=100.0))
        asked = [adding.asked(both(0.5), both(0), both(0))[0, 0] for _ in range(1000)]
        assert asked[-1] == pytest.approx(10.0 + 100.0 * 0.5)
        for _ in range(3000):
            asked = adding.asked(both(0.5), both(0), both(0))
        assert asked[0, 0] == 120.0
        # It lets go at once: nothing was wound up beyond the limit.
        assert adding.asked(both(-0.5), both(0), both(0))[0, 0] < 120.0

    def test_feeds_back_a_speed_of_a_moment_ago(self):
        behind = controller(hide("velocity_filter", time_constant=0.05))
        behind.asked(both(0), both(0), both(0))
        asked = [behind.asked(both(0), both(0), both(1))[0, 0] for _ in range(50)]
        assert asked[-1] == pytest.approx(-(1 - np.exp(-1)))

    def test_filters_what_it_has_held(self):
        jump = np.ones((80, 1, 2))
        jump[:11] = 0.0
        arriving = controller(
            hide("setpoint_filter", time_constant=0.02), hide("sample_and_hold", period=0.01)
        ).arriving(jump, start=0)
        # It looks at 10 ms, just too early, and at 20 ms again.
        assert not arriving[:21].any()
        assert arriving[40, 0, 0] == pytest.approx(1 - np.exp(-1))
