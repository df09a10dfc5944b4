import numpy as np
import pytest

from walkerkit.gap.rehearsal.hardware_friction import PRESLIDING, Bristles


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
