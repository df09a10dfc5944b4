"""Friction laws, held to their equations sample by sample and to physics in motion."""

import math

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from walkerkit.actuators.drivetrain import (
    AsymmetricFriction,
    Cogging,
    DirectionalEfficiency,
    LawBank,
    LoadDependentFriction,
    PoseDependentFriction,
    PreslidingFriction,
    QuadraticDrag,
    Step,
    StribeckFriction,
    TorqueRipple,
)

INERTIA = 0.02  # kg·m²
DRY = {  # law, parameters, and friction at (q, q̇, τ) while the joint slides
    "asymmetric": (
        AsymmetricFriction,
        {"forward": 0.5, "backward": 0.2},
        lambda q, qd, tau: -0.5 if qd > 0 else 0.2,
    ),
    "Stribeck": (
        StribeckFriction,
        {"breakaway": 0.4, "velocity": 0.3, "exponent": 1.0},
        lambda q, qd, tau: -math.copysign(0.4 * math.exp(-abs(qd) / 0.3), qd),
    ),
    "Gaussian Stribeck": (
        StribeckFriction,
        {"breakaway": 0.4, "velocity": 0.3, "exponent": 2.0},
        lambda q, qd, tau: -math.copysign(0.4 * math.exp(-((qd / 0.3) ** 2)), qd),
    ),
    "load": (
        LoadDependentFriction,
        {"coefficient": 0.3},
        lambda q, qd, tau: -0.3 * abs(tau) * math.copysign(1, qd),
    ),
    "pose": (
        PoseDependentFriction,
        {"amplitude": 0.6, "periods": 7.0, "phase": 0.4},
        lambda q, qd, tau: -math.copysign(0.3 * (1 + math.sin(7 * q + 0.4)), qd),
    ),
    "efficiency": (
        DirectionalEfficiency,
        {"driving": 0.7, "backdriving": 1.1},
        lambda q, qd, tau: -0.3 * tau if tau * qd > 0 else 0.1 * tau,
    ),
}
OTHERS = {
    "drag": (QuadraticDrag, {"drag": 0.07}, lambda q, qd, tau: -0.07 * qd * abs(qd)),
    "cogging": (
        Cogging,
        {"amplitude": 0.3, "periods": 21.0, "phase": -1.0},
        lambda q, qd, tau: 0.3 * math.sin(21 * q - 1),
    ),
    "ripple": (
        TorqueRipple,
        {"amplitude": 0.2, "periods": 12.0, "phase": 2.0},
        lambda q, qd, tau: 0.2 * tau * math.sin(12 * q + 2),
    ),
}
NOTHING = (Cogging, {"amplitude": 0.0, "periods": 1.0, "phase": 0.0})
ODD = ("Stribeck", "Gaussian Stribeck", "load", "efficiency", "drag")


def bank(law, parameters, n=1):
    given = {name: np.full(n, value) for name, value in parameters.items()}
    return LawBank([(law, given)], (n,), 1e-3)


def step_of(q, qd, effort, *, dt=1e-3, dry=0.0, held=0.0):
    q, qd, effort = (np.atleast_1d(np.asarray(x, dtype=float)) for x in (q, qd, effort))
    zeros = np.zeros_like(q)
    return Step(
        dt=dt,
        time=np.zeros(1),
        q=q,
        qd=qd,
        stiffness=zeros,
        damping=zeros,
        limit=zeros + np.inf,
        target=zeros,
        effort=effort,
        extra=zeros.copy(),
        friction=zeros.copy(),
        dry=zeros + dry,
        held=zeros + held,
    )


def sliding(law, parameters, q, qd, effort):
    """What the law does to joints that slide."""
    step = step_of(q, qd, effort)
    bank(law, parameters, len(step.q)).run(law.stage, step)
    return step.extra - step.friction * np.sign(step.qd)


def samples(n=200):
    rng = np.random.default_rng(5)
    return rng.uniform(-2, 2, n), rng.uniform(-1.5, 1.5, n), rng.uniform(-3, 3, n)


@pytest.mark.parametrize("case", [*DRY, *OTHERS])
def test_every_sample_is_that_of_the_equation(case):
    law, parameters, equation = (DRY | OTHERS)[case]
    q, qd, tau = samples()
    expected = [equation(*sample) for sample in zip(q, qd, tau, strict=True)]
    np.testing.assert_allclose(sliding(law, parameters, q, qd, tau), expected, atol=1e-12)


@pytest.mark.parametrize("case", ODD)
def test_the_mirrored_joint_feels_the_mirrored_effort(case):
    law, parameters, _ = (DRY | OTHERS)[case]
    q, qd, tau = samples()
    np.testing.assert_array_equal(
        sliding(law, parameters, -q, -qd, -tau), -sliding(law, parameters, q, qd, tau)
    )


def test_asymmetric_friction_mirrored_has_its_directions_exchanged():
    q, qd, tau = samples()
    one = sliding(AsymmetricFriction, {"forward": 0.5, "backward": 0.2}, q, qd, tau)
    other = sliding(AsymmetricFriction, {"forward": 0.2, "backward": 0.5}, -q, -qd, -tau)
    np.testing.assert_allclose(one, -other, atol=1e-15)


class Joint:
    """A wheel on a bearing under a law, pushed by hand.

    `friction` of a step is all that the law and dry friction did to it.
    """

    XML = """
    <mujoco><option timestep="{dt}" gravity="0 0 0"/>
    <worldbody><body><joint name="j" frictionloss="{dry}" armature="{inertia}"
      solreffriction="{solref} 1" solimpfriction="0.99 0.99 0.001 0.5 2"/>
      <geom size="0.01" mass="1e-6"/></body></worldbody></mujoco>"""

    def __init__(self, law, parameters, *, dry=0.0, dt=1e-3):
        text = self.XML.format(dt=dt, dry=dry, inertia=INERTIA, solref=2 * dt)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.law, self.dry = law, dry
        self.bank = bank(law, parameters)

    def push(self, pushes, efforts=None):
        """Positions, velocities and friction under a series of pushes, (n,) each.

        The drive makes all of a push, or `efforts` of it.
        """
        rows, data = [], self.data
        for push, effort in zip(pushes, pushes if efforts is None else efforts, strict=True):
            q, qd = float(data.qpos[0]), float(data.qvel[0])
            step = step_of(
                q,
                qd,
                effort,
                dt=self.model.opt.timestep,
                dry=self.dry,
                held=data.qfrc_constraint[0],
            )
            self.bank.run(self.law.stage, step)
            self.model.dof_frictionloss[0] = max(self.dry + step.friction[0], 0.0)
            data.qfrc_applied[0] = push + step.extra[0]
            mujoco.mj_step(self.model, data)
            rows.append((q, qd, step.extra[0] + data.qfrc_constraint[0]))
        return np.array(rows).T


@pytest.mark.parametrize("case", DRY)
def test_friction_takes_energy_at_every_step(case):
    law, parameters, _ = DRY[case]
    time = 1e-3 * np.arange(3000)
    pushes = 1.5 * np.sin(9 * time) + 0.4 * np.sin(31 * time + 1) + 0.1 * (time > 1)
    joint = Joint(law, parameters)
    _, qd, friction = joint.push(pushes)
    after = np.append(qd[1:], joint.data.qvel[0])
    # Dry friction that just stops the joint acts against the velocity that it takes away.
    power = friction * 0.5 * (qd + after)
    scale = np.abs(friction).max() * np.abs(qd).max()
    assert power.max() < 2e-3 * scale
    assert power.sum() < -0.2 * scale


@pytest.mark.parametrize("case", DRY)
def test_a_joint_pushed_below_breakaway_creeps_no_more_than_under_coulomb_friction(case):
    law, parameters, _ = DRY[case]
    pose = 0.3 * (1 + math.sin(0.4))
    dry = {"asymmetric": 0.35, "load": 0.3, "efficiency": 0.2, "pose": pose}.get(case, 0.4)
    push, effort = np.full(1000, 0.78 * dry), np.full(1000, 1.0)
    _, crept, _ = Joint(law, parameters).push(push, effort)
    _, coulomb, _ = Joint(*NOTHING, dry=dry).push(push)
    assert np.abs(crept).max() <= 1.01 * np.abs(coulomb).max()
    assert np.abs(coulomb).max() < 2e-3


class TestBristles:
    STIFFNESS, DRY = 40.0, 0.5

    def joint(self, **options):
        return Joint(PreslidingFriction, {"bristle_stiffness": self.STIFFNESS}, **options)

    def led(self, position, dt=1e-3, dry=DRY, held=0.0):
        """Friction along a given motion after a rest, from its second position on."""
        bristles = bank(PreslidingFriction, {"bristle_stiffness": self.STIFFNESS})
        found = []
        for qd in np.append(np.zeros(4), np.diff(position) / dt):
            step = step_of(0.0, qd, 0.0, dt=dt, dry=dry, held=held)
            bristles.run("joint", step)
            found.append(step.extra[0])
            assert step.friction[0] == (0.0 if len(found) <= 4 else -dry)
        return np.array(found[4:])

    def test_they_are_lugre_s(self):
        # A velocity that is constant for a while each, so that both integrate the same motion.
        rng = np.random.default_rng(2)
        speeds = np.repeat(rng.uniform(-1, 1, 25), 10)
        position = np.append(0.0, np.append(0.0, np.cumsum(1e-3 * speeds)))
        z, expected = 0.0, []
        for speed in speeds:
            solved = solve_ivp(
                lambda t, z, v=speed: v - self.STIFFNESS * abs(v) * z / self.DRY,
                (0, 1e-3),
                [z],
                rtol=1e-10,
                atol=1e-14,
            )
            z = float(solved.y[0, -1])
            expected.append(-self.STIFFNESS * z)
        np.testing.assert_allclose(self.led(position)[1:], expected, atol=1e-9)

    def test_they_are_lugre_s_with_stribeck_friction(self):
        both = LawBank(
            [
                (StribeckFriction, {"breakaway": 0.3, "velocity": 0.2, "exponent": 1.0}),
                (PreslidingFriction, {"bristle_stiffness": np.array([self.STIFFNESS])}),
            ],
            (1,),
            1e-3,
        )
        for _ in range(2000):
            step = step_of(0.0, 0.1, 0.0, dry=self.DRY)
            both.run("joint", step)
        assert step.extra[0] == pytest.approx(-0.5 - 0.3 * math.exp(-0.5), rel=1e-4)
        assert step.friction[0] == -self.DRY

    def test_small_loops_are_springs_and_larger_ones_cost_work(self):
        time = 1e-3 * np.arange(2001)
        bend = self.DRY / self.STIFFNESS
        work = []
        for amplitude in (0.01 * bend, 0.5 * bend, 5 * bend):
            position = amplitude * np.sin(2 * np.pi * time)
            force = self.led(position)
            middle = 0.5 * (force[1:] + force[:-1])
            settled = slice(1000, None)
            work.append(-float(np.sum((middle * np.diff(position[1:]))[settled])))
            if amplitude < 0.1 * bend:
                slope = np.polyfit(position[1:], force, 1)[0]
                assert slope == pytest.approx(-self.STIFFNESS, rel=0.02)
            assert np.abs(force).max() <= self.DRY
        assert 0 < work[0] < 1e-5 < work[1] < work[2]
        # Far beyond their reach a loop costs four amplitudes of sliding, less their bending.
        assert 0.6 < work[2] / (4 * 5 * bend * self.DRY) < 1

    def test_a_joint_below_breakaway_springs_and_comes_back_late(self):
        ramp = np.concatenate([np.linspace(0, 0.3, 2000), np.linspace(0.3, 0, 2000)])
        q, _, _ = self.joint(dry=self.DRY).push(ramp)
        bent, back = q[2000], q[-1]
        # Slow loading: dz/dq = 1 − σ₀ z/Fc, which makes them softer than σ₀.
        reach = self.DRY / self.STIFFNESS
        assert bent == pytest.approx(-reach * math.log(1 - 0.3 / self.DRY), rel=0.03)
        assert 0.3 * bent < back < 0.8 * bent
        rigid, _, _ = Joint(*NOTHING, dry=self.DRY).push(ramp)
        assert np.abs(rigid).max() < 0.1 * bent

    def test_a_joint_that_is_held_at_the_start_does_not_sag(self):
        q, _, friction = self.joint(dry=self.DRY).push(np.full(500, 0.3))
        np.testing.assert_allclose(friction, -0.3, atol=0.01)
        assert np.abs(q).max() < 0.02 * 0.3 / self.STIFFNESS
        # And one that slides starts with its bristles bent all the way.
        slid = self.led(np.linspace(0, 1, 1001), held=-self.DRY)
        np.testing.assert_allclose(slid, -self.DRY, rtol=1e-9)

    def test_a_stop_s_force_is_not_taken_for_bristles(self):
        position = np.zeros(10)
        np.testing.assert_array_equal(self.led(position, held=-7.0), np.zeros(9))

    def test_the_motion_is_that_of_a_finer_step(self):
        def moved(dt):
            time = dt * np.arange(round(0.6 / dt))
            q, _, _ = self.joint(dry=self.DRY, dt=dt).push(0.9 * np.sin(14 * time))
            return q[:: round(1e-3 / dt)]

        coarse, fine = moved(1e-3), moved(1e-4)
        assert np.abs(coarse - fine).max() < 0.02 * np.ptp(fine)

    def test_without_friction_they_do_nothing(self):
        np.testing.assert_array_equal(self.led(np.linspace(0, 1, 50), dry=0.0), np.zeros(49))

    def test_energy_never_comes_from_them(self):
        joint = self.joint(dry=self.DRY)
        rng = np.random.default_rng(8)
        pushes = np.repeat(rng.uniform(-1.2, 1.2, 60), 50)
        q, _, friction = joint.push(pushes)
        taken = -np.cumsum(0.5 * (friction[1:] + friction[:-1]) * np.diff(q))
        assert taken.min() > -0.5 * self.DRY**2 / self.STIFFNESS  # what they begin with
        assert taken[-1] > 0.1
