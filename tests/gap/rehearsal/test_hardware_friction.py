import mujoco
import numpy as np
import pytest

from walkerkit.gap.rehearsal.hardware_drive import Drives
from walkerkit.gap.rehearsal.hardware_friction import PRESLIDING, Bristles, Friction
from walkerkit.gap.rehearsal.hidden import HiddenEffect

ARM = """
<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><geom size=".1" mass="1"/></body></worldbody>
<actuator><position joint="a" kp="20" kv="1"/></actuator></mujoco>
"""
STEP = 1e-3


def friction(*hidden):
    model = mujoco.MjModel.from_xml_string(ARM)
    return Friction(model, Drives(model), hidden, step=STEP, n_sims=1)


def hide(name, **values):
    return HiddenEffect(effect=name, joints=("a",), values=values)


def sliding(of, speed, q=0.0, load=0.0):
    """Effort once it has slid for a while."""
    for _ in range(int(0.2 / (abs(speed) * STEP)) + 1):
        effort = of.effort(*(np.full((1, 1), value) for value in (speed, q, load)))
    return float(effort[0, 0])


WAVE = {"amplitude": 0.4, "periods": 6.0, "phase": 0.0}


@pytest.mark.parametrize(
    ("hidden", "state", "expected"),
    [
        (hide("asymmetric_friction", forward=0.5, backward=0.2), {"speed": 1.0}, -0.5),
        (hide("asymmetric_friction", forward=0.5, backward=0.2), {"speed": -1.0}, 0.2),
        (hide("stribeck_friction", breakaway=0.6, velocity=0.2), {"speed": 0.2}, -0.6 / np.e),
        (hide("stribeck_friction", breakaway=0.6, velocity=0.2), {"speed": -4.0}, 0.0),
        (hide("load_dependent_friction", coefficient=0.1), {"speed": 1.0, "load": -3.0}, -0.3),
        (hide("load_dependent_friction", coefficient=0.1), {"speed": 1.0}, 0.0),
        (hide("pose_dependent_friction", **WAVE), {"speed": 1.0, "q": np.pi / 12}, -0.4),
        (hide("pose_dependent_friction", **WAVE), {"speed": -1.0, "q": -np.pi / 12}, 0.0),
        (hide("presliding_friction", frictionloss=0.4, bend=0.02), {"speed": 1.0}, -0.4),
    ],
)
def test_slides_at_the_level_of_the_moment(hidden, state, expected):
    assert sliding(friction(hidden), **state) == pytest.approx(expected, abs=1e-4)


def test_a_gear_passes_one_part_when_it_drives_and_another_when_it_is_driven():
    for load, speed, passed in ((2.0, 1.0, 0.8), (2.0, -1.0, 1.1), (-2.0, 1.0, 1.1)):
        gear = friction(hide("directional_efficiency", driving=0.8, backdriving=1.1))
        assert load + sliding(gear, speed, load=load) == pytest.approx(passed * load, rel=1e-6)


def test_bristles_that_bend_far_are_a_spring_at_first():
    soft = friction(hide("presliding_friction", frictionloss=0.4, bend=0.02))
    bent = [soft.effort(*(np.full((1, 1), x) for x in (0.1, 0.0, 0.0)))[0, 0] for _ in range(4)]
    np.testing.assert_allclose(bent, -0.4 / 0.02 * 0.1 * STEP * np.arange(1, 5), rtol=0.02)


def test_dry_friction_of_every_kind_adds_up():
    both = friction(
        hide("load_dependent_friction", coefficient=0.1),
        hide("asymmetric_friction", forward=0.5, backward=0.2),
    )
    assert sliding(both, 1.0, load=2.0) == pytest.approx(-0.7)


@pytest.mark.parametrize(
    "hidden",
    [
        hide("asymmetric_friction", forward=0.5, backward=0.2),
        hide("stribeck_friction", breakaway=0.6, velocity=0.2),
        hide("load_dependent_friction", coefficient=0.1),
        hide("pose_dependent_friction", **WAVE),
        hide("presliding_friction", frictionloss=0.4, bend=0.02),
    ],
)
def test_dry_friction_of_no_kind_gives_energy_away(hidden):
    of, rng = friction(hidden), np.random.default_rng(3)
    speed = np.cumsum(rng.normal(size=8000)) * 0.02
    speed -= np.linspace(speed[0], speed[-1], speed.size)
    q = np.cumsum(speed) * STEP
    load = 3.0 * np.sin(np.arange(speed.size) * 0.01)
    work = sum(
        float(of.effort(*(np.full((1, 1), x) for x in (v, p, t)))[0, 0]) * v * STEP
        for v, p, t in zip(speed, q, load, strict=True)
    )
    assert work < 0


class TestBristles:
    LIMIT = np.array([0.8])
    INERTIA = np.array([10.0])

    def bristles(self, step, limit=LIMIT):
        return Bristles(limit, self.INERTIA, step, 1)

    def after(self, path, step):
        bristles = self.bristles(step)
        return np.array([bristles.torque(np.array([[v]]))[0, 0] for v in np.diff(path) / step])

    @pytest.mark.parametrize("speed", [1e-3, 0.1, 50.0])
    def test_slides_at_coulomb_friction_at_any_speed_and_step(self, speed):
        bristles = self.bristles(0.01)
        for direction in (1.0, -1.0):
            steps = int(20 * PRESLIDING / (speed * 0.01)) + 1
            for _ in range(steps):
                torque = bristles.torque(np.array([[direction * speed]]))
            np.testing.assert_allclose(torque[0], -direction * self.LIMIT, rtol=1e-6)

    def test_is_exact_however_the_motion_is_cut_into_steps(self):
        # 1.2 bends forward, 0.4 back.
        forward, back = 1.2 * PRESLIDING, -0.4 * PRESLIDING
        expected = 0.8 * (1 - np.exp(-1.2))
        expected = expected * np.exp(-0.4) - 0.8 * (1 - np.exp(-0.4))
        for pieces in (1, 3, 100):
            path = np.concatenate(
                [
                    np.linspace(0, forward, pieces + 1),
                    forward + np.linspace(0, back, pieces + 1)[1:],
                ]
            )
            np.testing.assert_allclose(self.after(path, 1e-3)[-1], -expected, rtol=1e-9)

    def test_springs_back_before_it_slides(self):
        small = 0.01 * PRESLIDING
        torque = self.after(np.array([0.0, small, 0.0]), 1e-3)
        np.testing.assert_allclose(torque[0], -0.8 / PRESLIDING * small, rtol=0.01)
        assert abs(torque[1]) < 0.02 * abs(torque[0])

    def test_never_gives_energy_away(self):
        rng = np.random.default_rng(2)
        path = np.cumsum(np.cumsum(rng.normal(size=20000))) * 1e-7
        path -= np.linspace(path[0], path[-1], path.size)
        work = self.after(path, 1e-3) @ np.diff(path)
        assert work < 0

    def test_no_friction_is_no_torque(self):
        bristles = self.bristles(1e-3, np.zeros(1))
        np.testing.assert_array_equal(bristles.torque(np.array([[3.0]])), 0.0)

    def test_is_softer_where_the_inertia_is_too_light_for_the_step(self):
        light = Bristles(self.LIMIT, np.array([1e-6]), 1e-3, 1)
        q, qd = 0.0, 0.05
        for _ in range(3000):
            torque = light.torque(np.array([[qd]]))[0, 0]
            qd += 1e-3 * torque / 1e-6
            q += 1e-3 * qd
            assert abs(qd) < 0.1
