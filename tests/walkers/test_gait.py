"""The trot: where its feet are, that its joints put them there, and that a quadruped gets ahead."""

import mujoco
import numpy as np
import pytest

from tests.walkers.floor import on_floor
from walkerkit.actuators import ActuatorCmd, DelayedActuatorCfg
from walkerkit.walkers import QUADRUPED_XML, Quadruped, Trot
from walkerkit.walkers.gait import LegGeometry
from walkerkit.walkers.quadruped import LEGS, QUADRUPED_DRIVES

TROT = Trot(fade=0.0)
CYCLE = np.linspace(0.0, 1.0 / TROT.frequency, 400, endpoint=False)


def legs_of(targets):
    return targets.reshape(*targets.shape[:-1], 4, 3)


class TestFeet:
    def test_diagonal_pairs_swing_half_a_cycle_apart(self):
        feet = TROT.feet(CYCLE)
        np.testing.assert_array_equal(feet[:, 0, ::2], feet[:, 3, ::2])  # FL, RR
        np.testing.assert_array_equal(feet[:, 1, ::2], feet[:, 2, ::2])  # FR, RL
        np.testing.assert_allclose(np.roll(feet[:, 0, 0], 200), feet[:, 1, 0], atol=1e-12)
        up = feet[..., 2] > -TROT.height + 1e-9
        assert not (up[:, 0] & up[:, 1]).any()
        assert (up.sum(axis=0) / len(CYCLE) > 0.45).all()

    def test_a_foot_on_the_ground_goes_back_at_the_speed_of_the_trunk(self):
        feet = TROT.feet(CYCLE)[:, 0]
        ground = 0.5 / TROT.frequency > CYCLE
        np.testing.assert_allclose(feet[ground, 2], -TROT.height)
        speed = np.diff(feet[ground, 0]) / np.diff(CYCLE[ground])
        np.testing.assert_allclose(speed, -TROT.speed, rtol=1e-9)
        assert np.ptp(feet[:, 0]) == pytest.approx(TROT.stride, rel=1e-6)
        assert feet[:, 2].max() + TROT.height == pytest.approx(TROT.lift, rel=1e-3)

    def test_is_smooth_and_periodic(self):
        fine = np.linspace(0.0, 3.0 / TROT.frequency, 30001)
        feet = TROT.feet(fine)
        np.testing.assert_allclose(feet[0], feet[10000], atol=1e-9)
        assert np.abs(np.diff(feet, axis=0)).max() < 1e-3  # no jumps
        velocity = np.diff(feet[..., 2], axis=0) / np.diff(fine)[:, None]
        assert np.abs(np.diff(velocity, axis=0)).max() < 0.02  # lifts off and lands softly

    def test_fades_in_from_standing(self):
        trot = Trot(fade=1.0)
        np.testing.assert_array_equal(trot.feet(0.0)[:, ::2], [[0.0, -trot.height]] * 4)
        np.testing.assert_array_equal(trot.feet(1.3), TROT.feet(1.3))

    def test_backwards_is_the_mirror_image(self):
        ahead, back = TROT.feet(CYCLE), Trot(fade=0.0, stride=-TROT.stride).feet(CYCLE)
        np.testing.assert_allclose(back[..., 0], -ahead[..., 0], atol=1e-12)
        np.testing.assert_array_equal(back[..., 1:], ahead[..., 1:])


class TestJoints:
    def test_put_the_feet_of_the_quadruped_where_they_are_meant_to_be(self):
        model = mujoco.MjModel.from_xml_path(str(QUADRUPED_XML))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        random = np.random.default_rng(0)
        geometry = LegGeometry()
        for _ in range(50):
            feet = np.array([0.0, 0.0, -0.27]) + random.uniform(-0.1, 0.1, (4, 3))
            left = np.array([1.0, -1.0, 1.0, -1.0])
            feet[:, 1] += geometry.hip * left
            data.qpos[7:] = geometry.angles(feet, left).ravel()
            mujoco.mj_kinematics(model, data)
            for k, leg in enumerate(LEGS):
                hip = data.body(f"{leg}_hip")
                trunk = data.body("trunk")
                reached = data.site(f"{leg}_foot").xpos - hip.xpos
                np.testing.assert_allclose(
                    trunk.xmat.reshape(3, 3).T @ reached, feet[k], atol=1e-12
                )

    def test_begin_at_home_and_stay_within_the_ranges(self):
        model = mujoco.MjModel.from_xml_path(str(QUADRUPED_XML))
        np.testing.assert_allclose(Trot()(0.0), model.key("home").qpos[7:], atol=2e-3)
        targets = TROT(CYCLE)
        assert (targets > model.jnt_range[1:, 0]).all()
        assert (targets < model.jnt_range[1:, 1]).all()

    def test_hips_stay_still_when_it_goes_straight(self):
        np.testing.assert_allclose(legs_of(TROT(CYCLE))[..., 0], 0.0, atol=1e-12)

    def test_one_time_or_many(self):
        assert Trot()(0.3).shape == (12,)
        assert Trot()(np.zeros((2, 5))).shape == (2, 5, 12)
        np.testing.assert_array_equal(Trot()([0.3, 0.4])[1], Trot()(0.4))


class TestRefusals:
    def test_of_what_no_leg_reaches(self):
        with pytest.raises(ValueError, match=r"0\.45 m from the thigh's axis.*from 0 to 0\.42 m"):
            LegGeometry().angles([0.0, 0.08, -0.45], 1.0)
        with pytest.raises(ValueError, match="lower `height`, `stride` or `lift`"):
            LegGeometry().angles([0.0, 0.02, -0.01], 1.0)
        with pytest.raises(ValueError, match="lower `height`, `stride` or `lift`"):
            Trot(height=0.43)

    @pytest.mark.parametrize(
        ("name", "value"), [("frequency", 0.0), ("lift", -0.1), ("fade", -1.0), ("height", 0.0)]
    )
    def test_of_numbers_out_of_bounds(self, name, value):
        with pytest.raises(ValueError, match=name):
            Trot(**{name: value})

    def test_of_what_is_no_number(self):
        with pytest.raises(TypeError, match="stride"):
            Trot(stride="long")
        with pytest.raises(ValueError, match="thigh"):
            LegGeometry(thigh=0.0)


def trotted(walker, trot, seconds=8.0):
    """Way of the root, least height and worst aliveness of a trot."""
    environment = on_floor(walker)
    physics = environment.physics
    root = physics.bind(walker.root_body)
    start, height, alive = root.xpos.copy(), np.inf, 0.0
    for _ in range(round(seconds / 0.02)):
        target = ActuatorCmd(position_target=trot(physics.time()))
        action = walker.action_for(target)
        assert np.abs(action).max() <= 1.0
        environment.step(action)
        height = min(height, float(root.xpos[2]))
        alive = min(alive, walker.aliveness(physics))
    return root.xpos - start, height, alive


class TestTrot:
    @pytest.mark.parametrize("drive", ["DC motor", "late", "position controlled"])
    def test_gets_ahead_and_does_not_fall(self, drive):
        walker = {
            "DC motor": lambda: Quadruped(),
            "late": lambda: Quadruped(
                actuators=[
                    DelayedActuatorCfg(base_cfg=cfg, delay_max_lag=2) for cfg in QUADRUPED_DRIVES
                ]
            ),
            "position controlled": lambda: Quadruped(position_controlled=True),
        }[drive]()
        way, height, alive = trotted(walker, Trot())
        assert way[0] >= 8.0 * 0.25
        assert abs(way[1]) < 0.5
        assert height > 0.2
        assert alive > -0.01

    def test_backwards_goes_backwards(self):
        way, height, _ = trotted(Quadruped(), Trot(stride=-0.12), seconds=4.0)
        assert way[0] < -0.5
        assert height > 0.2
