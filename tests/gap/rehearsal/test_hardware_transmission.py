import mujoco
import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hardware_drive import Drives
from walkerkit.gap.rehearsal.hardware_transmission import Stops, Transmission
from walkerkit.gap.rehearsal.hidden import HiddenEffect

STEP = 2.5e-4
ROTOR, LINK = 0.01, 0.03
PAIR = f"""
<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody><body>
  <joint name="a" axis="0 0 1" armature="{ROTOR}"/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 {LINK}"/></body></worldbody>
<actuator><position joint="a" kp="20" kv="1"/></actuator></mujoco>
"""


class Bench:
    """A rotor and a link that nothing holds."""

    def __init__(self, *hidden):
        self.model = mujoco.MjModel.from_xml_string(PAIR)
        drives = Drives(self.model)
        self.gear = Transmission(self.model, drives, hidden, step=STEP, n_sims=1)
        self.q, self.qd = np.zeros((2, 1, 1))

    def step(self, torque=0.0):
        self.gear.motor_side(self.q, self.qd)
        effort = self.gear.link_effort(np.full((1, 1), torque), self.q, self.qd)
        self.qd = self.qd + STEP * effort / LINK
        self.q = self.q + STEP * self.qd
        return float(effort[0, 0])

    def motor(self):
        angle, speed = self.gear.motor_side(self.q, self.qd)
        return float(angle[0, 0]), float(speed[0, 0])

    def momentum(self):
        return ROTOR * self.motor()[1] + LINK * float(self.qd[0, 0])

    def energy(self):
        return 0.5 * ROTOR * self.motor()[1] ** 2 + 0.5 * LINK * float(self.qd[0, 0]) ** 2


def elastic(stiffness=40.0):
    return HiddenEffect(effect="series_elasticity", joints=("a",), values={"stiffness": stiffness})


def loose(width=0.1):
    return HiddenEffect(effect="backlash", joints=("a",), values={"width": width})


def test_rigid_joints_are_left_alone():
    bench = Bench()
    assert not bench.gear.any
    assert bench.model.dof_armature[0] == ROTOR
    assert bench.step(2.0) == 2.0
    assert bench.motor() == (bench.q[0, 0], bench.qd[0, 0])


def test_the_rotor_takes_the_armature_with_it():
    assert Bench(elastic()).model.dof_armature[0] == 0.0


@pytest.mark.parametrize("hidden", [(elastic(),), (loose(),), (elastic(), loose())])
def test_torque_becomes_momentum_of_both(hidden):
    bench = Bench(*hidden)
    for _ in range(400):
        bench.step(0.5)
    # What the link gets over a step is the mean of what the rotor gave.
    assert bench.momentum() == pytest.approx(0.5 * 400 * STEP, rel=1e-9)


def test_an_elastic_gear_rings_at_its_resonance():
    bench = Bench(elastic(40.0))
    for _ in range(4):
        bench.step(20.0)
    twist = []
    for _ in range(3000):
        bench.step()
        twist.append(bench.motor()[0] - bench.q[0, 0])
    spectrum = np.abs(np.fft.rfft(np.array(twist) * np.hanning(3000)))
    found = np.fft.rfftfreq(3000, STEP)[np.argmax(spectrum)]
    expected = np.sqrt(40.0 * (1 / ROTOR + 1 / LINK)) / (2 * np.pi)
    assert found == pytest.approx(expected, rel=0.08)
    assert np.abs(twist[-500:]).max() < np.abs(twist[:500]).max()


def test_an_elastic_gear_is_wound_up_by_the_torque_over_its_stiffness():
    bench = Bench(elastic(40.0))
    efforts, angles = [], []
    for _ in range(4000):
        bench.qd[:] = bench.q[:] = 0.0
        efforts.append(bench.step(2.0))
        angles.append(bench.motor()[0])
    # It rings about where it comes to rest.
    assert np.mean(efforts[2000:]) == pytest.approx(2.0, rel=0.02)
    assert np.mean(angles[2000:]) == pytest.approx(2.0 / 40.0, rel=0.02)


def test_loose_teeth_pass_nothing_until_they_touch():
    bench = Bench(loose(0.1))
    while bench.motor()[0] < 0.049:
        assert bench.step(0.2) == 0.0
        assert bench.qd[0, 0] == 0.0
    for _ in range(200):
        bench.step(0.2)
    assert bench.qd[0, 0] > 0.0


def test_loose_teeth_push_and_never_pull():
    bench = Bench(loose(0.1))
    for k in range(3000):
        effort = bench.step(0.3 if (k // 600) % 2 else -0.3)
        twist = bench.motor()[0] - bench.q[0, 0]
        assert abs(twist) < 0.06
        # The sign of the mean over a step is that of the flank it was pushed by.
        assert effort * twist >= 0.0


def test_loose_teeth_lose_energy_and_never_win_any():
    bench = Bench(loose(0.1))
    for _ in range(60):
        bench.step(3.0)
    energies = []
    for _ in range(3000):
        bench.step()
        energies.append(bench.energy())
    assert max(energies) <= energies[0] * (1 + 1e-3)
    # In the end both turn together.
    together = 0.5 * (ROTOR + LINK) * (bench.momentum() / (ROTOR + LINK)) ** 2
    assert energies[-1] == pytest.approx(together, rel=0.05)


def test_refuses_a_gear_without_a_rotor():
    model = mujoco.MjModel.from_xml_string(PAIR.replace(f'armature="{ROTOR}"', ""))
    with pytest.raises(InputError, match=r"joint 'a' has no armature.*; give it one"):
        Transmission(model, Drives(model), [elastic()], step=STEP, n_sims=1)


class TestStops:
    def stops(self):
        model = mujoco.MjModel.from_xml_string(PAIR)
        stop = HiddenEffect(effect="end_stop", joints=("a",), values={"lower": -0.2, "upper": 0.3})
        return Stops(model, Drives(model), [stop])

    def test_do_nothing_between_them(self):
        stops = self.stops()
        assert stops.any
        for q in (-0.19, 0.0, 0.29):
            assert stops.effort(np.full((1, 1), q), np.full((1, 1), 5.0)) == 0.0

    def test_hold_a_joint_that_is_pressed_against_them(self):
        stops, q, qd = self.stops(), np.zeros((1, 1)), np.zeros((1, 1))
        for _ in range(3000):
            qd = qd + STEP * (4.0 + stops.effort(q, qd)) / (ROTOR + LINK)
            q = q + STEP * qd
        assert 0.3 < q[0, 0] < 0.31
        assert abs(qd[0, 0]) < 1e-4

    def test_give_back_less_than_they_take(self):
        stops, q, qd = self.stops(), np.full((1, 1), -0.15), np.full((1, 1), -3.0)
        while q[0, 0] < -0.1:
            qd = qd + STEP * stops.effort(q, qd) / (ROTOR + LINK)
            q = q + STEP * qd
            assert stops.effort(q, qd)[0, 0] >= 0.0
        assert 0.1 < qd[0, 0] < 2.9
