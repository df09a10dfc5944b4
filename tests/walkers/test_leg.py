import subprocess
import sys

import mujoco
import numpy as np
import pytest

from tests.walkers.floor import on_floor
from walkerkit.actuators import ActuatorCmd
from walkerkit.walkers import LEG_XML, Leg

NAMES = ["hip", "thigh", "calf"]


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_path(str(LEG_XML))


def settled(model, targets, seconds=2.0):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = targets
    mujoco.mj_step(model, data, round(seconds / model.opt.timestep))
    return data


def test_plain_mjcf_is_the_robot_that_was_promised(model):
    assert [model.joint(i).name for i in range(model.njnt)] == NAMES
    assert [model.actuator(i).name for i in range(model.nu)] == NAMES
    np.testing.assert_array_equal(model.jnt_axis, [[1, 0, 0], [0, 1, 0], [0, 1, 0]])
    np.testing.assert_allclose([model.body(n).mass[0] for n in NAMES], [0.7, 1.0, 0.25])
    assert model.opt.timestep == 0.001
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model.nmesh == model.nhfield == 0
    # PyMJCF does not resolve inherited ranges, so they are written out and must agree.
    np.testing.assert_array_equal(model.actuator_ctrlrange, model.jnt_range)
    home = model.key("home")
    np.testing.assert_array_equal(home.qpos, home.ctrl)
    assert np.all((home.qpos > model.jnt_range[:, 0]) & (home.qpos < model.jnt_range[:, 1]))


def test_no_pose_makes_contact(model):
    data = mujoco.MjData(model)
    for corner in np.stack(np.meshgrid(*model.jnt_range), -1).reshape(-1, 3):
        data.qpos[:] = corner
        mujoco.mj_forward(model, data)
        assert data.ncon == 0


@pytest.mark.parametrize("joint", range(3))
def test_servos_step_without_overshoot_and_sag_visibly(model, joint):
    home = model.key("home").qpos.copy()
    data = settled(model, home)
    sag = np.abs(data.qpos - home)
    assert np.all((sag > 1e-3) & (sag < 0.05))
    start = data.qpos[joint]
    data.ctrl[joint] += 0.3
    path = []
    for _ in range(500):
        mujoco.mj_step(model, data)
        path.append(data.qpos[joint] - start)
    assert max(path) < 1.02 * path[-1]
    assert 0.02 < np.argmax(np.array(path) > 0.63 * path[-1]) * model.opt.timestep < 0.1


class TestWalker:
    @pytest.fixture
    def leg(self):
        leg = Leg()
        for name in ("joints_pos", "joints_vel", "position_target"):
            getattr(leg.observables, name).enabled = True
        return leg

    def test_starts_at_home_after_every_reset(self, leg):
        environment = on_floor(leg)
        for _ in range(2):
            environment.reset()
            joints = environment.physics.bind(leg.observable_joints)
            np.testing.assert_array_equal(joints.qpos, leg.home)
            np.testing.assert_array_equal(joints.qvel, 0)
            np.testing.assert_array_equal(environment.physics.data.ctrl, leg.home)
            for _ in range(10):
                environment.step(leg.action_for(ActuatorCmd(position_target=leg.home + 0.1)))
            assert np.abs(joints.qpos - leg.home).max() > 0.05

    def test_runs_the_plain_model_s_dynamics(self, leg, model):
        environment = on_floor(leg, control_timestep=0.001, physics_timestep=0.001)
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        for k in range(100):
            target = leg.home + 0.2 * np.sin(0.05 * k)
            step = environment.step(leg.action_for(ActuatorCmd(position_target=target)))
            data.ctrl[:] = target
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(environment.physics.data.qpos, data.qpos, atol=1e-12)
        np.testing.assert_allclose(step.observation["leg/joints_pos"], data.qpos, atol=1e-12)
        np.testing.assert_allclose(step.observation["leg/joints_vel"], data.qvel, atol=1e-10)
        np.testing.assert_allclose(step.observation["leg/position_target"], target, atol=1e-12)

    def test_actions_span_the_joints_ranges(self, leg, model):
        spec = leg.action_spec
        np.testing.assert_array_equal(spec.minimum, [-1.0] * 3)
        np.testing.assert_array_equal(spec.maximum, [1.0] * 3)
        assert spec.name.split("\t") == NAMES
        environment = on_floor(leg)
        for end, column in ((-1.0, 0), (1.0, 1), (2.0, 1)):
            environment.step(np.full(3, end))
            np.testing.assert_allclose(
                environment.physics.data.ctrl, model.jnt_range[:, column], atol=1e-12
            )

    def test_members_that_tasks_look_for(self):
        leg = Leg(name="left")
        assert leg.mjcf_model.model == "left"
        assert leg.root_body.name == "base"
        assert [joint.name for joint in leg.observable_joints] == NAMES
        assert [actuator.name for actuator in leg.actuators] == NAMES
        assert [body.name for body in leg.end_effectors] == ["calf"]
        assert leg.foot.tag == "site"
        assert leg.egocentric_camera.tag == "camera"
        np.testing.assert_array_equal(leg.upright_pose.qpos, leg.home)
        with pytest.raises(ValueError, match="read-only"):
            leg.home[0] = 1.0


def test_two_legs_hang_in_one_arena_and_stay_there():
    legs = [Leg(name="left"), Leg(name="right")]
    environment = on_floor(*legs, positions=[[0, 0, 0], [0, 1, 0]])
    physics = environment.physics
    assert physics.model.nv == 6
    for leg, side in zip(legs, (0.0, 1.0), strict=True):
        leg.reinitialize_pose(physics, np.random.RandomState(0))
        np.testing.assert_allclose(physics.bind(leg.root_body).xpos, [0, side, 0.6])
    for _ in range(10):
        environment.step(np.concatenate([leg.action_for() for leg in legs]))
    for leg, side in zip(legs, (0.0, 1.0), strict=True):
        np.testing.assert_allclose(physics.bind(leg.root_body).xpos, [0, side, 0.6])
        np.testing.assert_allclose(physics.bind(leg.observable_joints).qpos, leg.home, atol=0.05)


def test_package_leaves_dm_control_alone_until_a_walker_is_asked_for():
    check = (
        "import sys, walkerkit.walkers as w; assert 'dm_control' not in sys.modules;"
        " w.LEG_XML; assert 'dm_control' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", check], check=True)


def test_unknown_name_is_an_attribute_error():
    import walkerkit.walkers

    with pytest.raises(AttributeError, match="no attribute 'Arm'"):
        walkerkit.walkers.Arm  # noqa: B018
