"""What holds of every robot of ours: its file, its pose, its motors, and its two kinds of drive."""

import re

import mujoco
import numpy as np
import pytest
from dm_control import composer
from dm_control.locomotion.arenas import floors
from dm_control.locomotion.tasks import go_to_target

from tests.walkers.floor import on_floor
from walkerkit.actuators import (
    MOTORS,
    ActuatorCmd,
    DcMotorActuatorCfg,
    IdealPdActuatorCfg,
    XmlPositionActuatorCfg,
    parallel_linkage,
)
from walkerkit.walkers import (
    BIPED_XML,
    LEG_XML,
    QUADRUPED_XML,
    SERVO_BENCH_XML,
    Biped,
    Leg,
    Quadruped,
    ServoBench,
)

FILES = {Leg: LEG_XML, ServoBench: SERVO_BENCH_XML, Quadruped: QUADRUPED_XML, Biped: BIPED_XML}
FLOATING = (Quadruped, Biped)
JOINTS = {
    Leg: ["hip", "thigh", "calf"],
    ServoBench: ["shaft"],
    Quadruped: [
        f"{leg}_{joint}" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")
    ],
    Biped: [
        f"{side}_{joint}"
        for side in ("left", "right")
        for joint in ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
    ],
}
MASS = {Leg: 3.95, ServoBench: 11.2, Quadruped: 12.04, Biped: 29.2}
HIP, KNEE = (MOTORS[f"unitree_go1_{joint}"].actuator() for joint in ("hip", "knee"))
SMALL, LARGE, PITCH = (
    MOTORS[f"unitree_{name}"].actuator() for name in ("5020", "7520_22", "7520_14")
)
MOTOR = {
    ServoBench: {"shaft": HIP},
    Quadruped: {".*_(hip|thigh)": HIP, ".*_calf": KNEE},
    Biped: {
        ".*_hip_(pitch|yaw)": PITCH,
        ".*_(hip_roll|knee)": LARGE,
        ".*_ankle_.*": parallel_linkage([SMALL, SMALL])[0],
    },
}
# A reflection in the plane y = 0: what is left goes right, and turns about x and z change sign.
OTHER_SIDE = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL", "left": "right", "right": "left"}
every = pytest.mark.parametrize("robot", FILES)
floating = pytest.mark.parametrize("robot", FLOATING)


def plain(robot):
    """The robot's own file, at home."""
    model = mujoco.MjModel.from_xml_path(str(FILES[robot]))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def hinges(model):
    return [i for i in range(model.njnt) if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE]


def mirrored(name):
    first, _, rest = name.partition("_")
    return f"{OTHER_SIDE[first]}_{rest}" if first in OTHER_SIDE else name


@every
class TestFile:
    def test_is_made_of_primitives(self, robot):
        model, _ = plain(robot)
        assert model.nmesh == model.nhfield == model.ntex == 0
        assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        assert model.opt.timestep in (0.001, 0.002)
        for kind, name in (
            (mujoco.mjtObj.mjOBJ_SITE, "imu"),
            (mujoco.mjtObj.mjOBJ_CAMERA, "egocentric"),
            (mujoco.mjtObj.mjOBJ_KEY, "home"),
        ):
            assert mujoco.mj_name2id(model, kind, name) >= 0, name

    def test_has_the_joints_and_the_mass_that_it_says(self, robot):
        model, _ = plain(robot)
        assert [model.joint(i).name for i in hinges(model)] == JOINTS[robot]
        assert model.body_mass.sum() == pytest.approx(MASS[robot], abs=1e-6)
        # A tensor that no solid body has would be refused, one of a millimetre's would not.
        assert model.body_inertia[1:][model.body_mass[1:] > 0].min() > 1e-6

    def test_home_is_well_within_the_ranges(self, robot):
        model, data = plain(robot)
        at = hinges(model)
        assert model.jnt_limited[at].all()
        low, high = model.jnt_range[at].T
        home = data.qpos[model.jnt_qposadr[at]]
        assert (home - low > 0.1).all()
        assert (high - home > 0.1).all()


@floating
class TestAtHome:
    def test_touches_nothing_of_its_own(self, robot):
        _, data = plain(robot)
        assert data.ncon == 0

    def test_feet_are_level_and_touch_the_ground_at_zero(self, robot):
        model, data = plain(robot)
        feet = [i for i in range(model.ngeom) if model.geom(i).name.endswith("_foot")]
        assert len(feet) == {Quadruped: 4, Biped: 2}[robot]
        for foot in feet:
            thick = model.geom_size[foot, 0]
            if robot is Biped:
                assert data.geom_xmat[foot, 8] == pytest.approx(1.0, abs=1e-12)
                thick = model.geom_size[foot, 2]
            assert data.geom_xpos[foot, 2] - thick == pytest.approx(0.0, abs=1e-5)

    def test_centre_of_mass_is_above_the_middle_of_the_feet(self, robot):
        model, data = plain(robot)
        feet = [i for i in range(model.nsite) if model.site(i).name.endswith("_foot")]
        middle = data.site_xpos[feet].mean(axis=0)
        np.testing.assert_allclose(data.subtree_com[1][:2], middle[:2], atol=0.015)

    def test_is_its_own_mirror_image(self, robot):
        model, data = plain(robot)
        turn = np.diag([1.0, -1.0, 1.0])
        for i in range(1, model.nbody):
            other = model.body(mirrored(model.body(i).name)).id
            assert model.body_mass[i] == pytest.approx(model.body_mass[other])
            np.testing.assert_allclose(data.xpos[other], turn @ data.xpos[i], atol=1e-12)
            np.testing.assert_allclose(data.xipos[other], turn @ data.xipos[i], atol=1e-12)
            mine, theirs = (
                data.ximat[k].reshape(3, 3)
                @ np.diag(model.body_inertia[k])
                @ data.ximat[k].reshape(3, 3).T
                for k in (i, other)
            )
            np.testing.assert_allclose(theirs, turn @ mine @ turn, atol=1e-12)
        for i in hinges(model):
            other = model.joint(mirrored(model.joint(i).name)).id
            sign = 1.0 if model.jnt_axis[i, 1] else -1.0
            np.testing.assert_allclose(model.jnt_axis[other], model.jnt_axis[i])
            np.testing.assert_allclose(
                model.jnt_range[other], np.sort(sign * model.jnt_range[i]), atol=1e-12
            )
            dof, its = model.jnt_dofadr[[i, other]]
            for field in ("dof_armature", "dof_damping", "dof_frictionloss"):
                assert getattr(model, field)[dof] == getattr(model, field)[its]
            place, its = model.jnt_qposadr[[i, other]]
            assert data.qpos[its] == pytest.approx(sign * data.qpos[place])

    def test_feet_alone_bear_its_weight(self, robot):
        walker = robot(position_controlled=True)
        environment = on_floor(walker)
        physics = environment.physics
        floor = int(physics.bind(environment.task.root_entity.ground_geoms[0]).element_id)
        feet = set(np.atleast_1d(physics.bind(walker.ground_contact_geoms).element_id))
        for _ in range(100):
            environment.step(walker.action_for())
        force, total = np.zeros(6), 0.0
        for i in range(physics.data.ncon):
            contact = physics.data.contact[i]
            pair = {int(contact.geom1), int(contact.geom2)}
            assert floor in pair
            assert pair & feet
            mujoco.mj_contactForce(physics.model.ptr, physics.data.ptr, i, force)
            total += force[0]
        assert total == pytest.approx(9.81 * MASS[robot], rel=0.01)


class TestMotors:
    @pytest.mark.parametrize("robot", MOTOR)
    def test_are_those_of_the_datasheets(self, robot):
        walker = robot()
        model, _ = plain(robot)
        joints = walker.drivetrain.joints
        stall = {}
        for cfg, actuator in zip(
            walker.actuator_group.cfgs, walker.actuator_group.actuators, strict=True
        ):
            assert isinstance(cfg, DcMotorActuatorCfg)
            stall.update(dict.fromkeys(actuator.joint_names, cfg.saturation_effort))
        for i, name in enumerate(joints.names):
            (motor,) = (m for key, m in MOTOR[robot].items() if re.fullmatch(key, name))
            dof = model.joint(name).dofadr[0]
            assert model.dof_armature[dof] == pytest.approx(motor.reflected_inertia, rel=1e-5)
            assert joints.efforts[i] == motor.effort_limit == stall[name]
            assert joints.speeds[i] == motor.velocity_limit

    def test_ankles_of_the_biped_hold_against_gravity(self):
        model, data = plain(Biped)
        ankle = model.joint("left_ankle_pitch")
        above = data.subtree_com[1][2] - data.xanchor[ankle.id][2]
        gravity = 9.81 * MASS[Biped] * above
        group = Biped().actuator_group
        stiffness = next(
            actuator.nominal("stiffness")[0]
            for actuator in group.actuators
            if "left_ankle_pitch" in actuator.joint_names
        )
        assert 2 * stiffness > 3 * gravity


@every
class TestWalker:
    def test_joints_are_in_kinematic_order(self, robot):
        for walker in (robot(), robot(position_controlled=True)):
            assert list(walker.actuator_group.joint_names) == JOINTS[robot]
            assert [joint.name for joint in walker.observable_joints] == JOINTS[robot]
            assert walker.action_spec.name.split("\t") == JOINTS[robot]
            assert [element.joint.name for element in walker.actuators] == JOINTS[robot]

    def test_knows_its_own_parts(self, robot):
        walker = robot(name="mine")
        assert walker.mjcf_model.model == "mine"
        assert walker.floating is (robot in FLOATING)
        assert walker.egocentric_camera.name == "egocentric"
        assert walker.mjcf_model.find("site", "imu") is not None
        assert len(walker.end_effectors) == {Quadruped: 4, Biped: 2}.get(robot, 1)
        model, _ = plain(robot)
        np.testing.assert_array_equal(walker.home, model.key("home").qpos[-len(JOINTS[robot]) :])
        assert model.body(1).name == walker.root_body.name

    def test_controls_of_a_position_controlled_one_are_its_actions(self, robot):
        walker = robot(position_controlled=True)
        environment = on_floor(walker)
        ctrl = environment.physics.data.ctrl
        random = np.random.default_rng(0)
        home = walker.action_for()
        np.testing.assert_allclose(ctrl, home, atol=1e-12)
        for _ in range(3):
            action = np.clip(home + random.uniform(-0.1, 0.1, home.shape), -1, 1)
            environment.step(action)
            np.testing.assert_allclose(ctrl, action, atol=1e-12)
        model, _ = plain(robot)
        for end, column in ((-1.0, 0), (1.0, 1)):
            environment.step(np.full(len(home), end))
            targets = walker.command.position_target
            np.testing.assert_allclose(targets, model.jnt_range[hinges(model), column])

    def test_both_kinds_of_drive_have_the_same_gains_and_limits(self, robot):
        ours, native = robot(), robot(position_controlled=True)
        root = native.mjcf_model
        model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
        limits = []
        for i, name in enumerate(JOINTS[robot]):
            (actuator,) = (a for a in ours.actuator_group.actuators if name in a.joint_names)
            column = actuator.joint_names.index(name)
            # Native ones have their gains in the model, others in their configs.
            if robot is Leg:
                kp, kv, limit = 60.0, 3.0, 30.0
            else:
                kp, kv, limit = (
                    actuator.nominal(number)[column]
                    for number in ("stiffness", "damping", "effort_limit")
                )
            np.testing.assert_allclose(model.actuator_biasprm[i, 1:3], [-kp, -kv], rtol=1e-12)
            np.testing.assert_allclose(model.actuator_forcerange[i], [-limit, limit])
            limits.append(limit)
        np.testing.assert_allclose(native.drivetrain.joints.efforts, limits)

    def test_holds_home_with_both_kinds_of_drive(self, robot):
        final = []
        for position_controlled in (False, True):
            walker = robot(position_controlled=position_controlled)
            environment = on_floor(walker)
            for _ in range(150):
                environment.step(walker.action_for())
            final.append(environment.physics.bind(walker.observable_joints).qpos.copy())
            assert np.abs(final[-1] - walker.home).max() < 0.06
        # Static sag does not care who integrates the law.
        np.testing.assert_allclose(final[0], final[1], atol=2e-3)

    def test_other_actuators_take_the_place_of_its_own(self, robot):
        cfg = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=7.0, damping=0.5)
        walker = robot(actuators=cfg)
        assert len(walker.actuators) == len(JOINTS[robot])
        assert all(element.tag == "general" for element in walker.actuators)
        assert walker.action_spec.shape == (len(JOINTS[robot]),)
        with pytest.raises(ValueError, match="leave one of the two out"):
            robot(actuators=cfg, position_controlled=True)

    def test_attaches_nowhere_and_stands_there(self, robot):
        walker = robot()
        environment = composer.Environment(composer.NullTask(walker), random_state=0)
        for _ in range(2):
            environment.reset()
            joints = environment.physics.bind(walker.observable_joints)
            np.testing.assert_array_equal(joints.qpos, walker.home)
            environment.physics.step(5)


def test_a_config_that_takes_over_finds_no_servos_where_there_are_none():
    with pytest.raises(ValueError, match="has 0 actuators in the XML"):
        Quadruped(actuators=XmlPositionActuatorCfg(joint_names_expr=(".*",)))


def test_two_robots_and_two_fixed_ones_share_a_floor():
    legs = [Leg(name="one"), Leg(name="two")]
    walkers = [Quadruped(), *legs, Biped(position_controlled=True)]
    environment = on_floor(*walkers, positions=[[0, 0, 0], [0, 1, 0], [0, 2, 0.1], [0, 0, 0]])
    physics = environment.physics
    for leg, place in zip(legs, ([0, 1, 0.6], [0, 2, 0.7]), strict=True):
        np.testing.assert_allclose(physics.bind(leg.root_body).xpos, place)
    walkers[3].shift_pose(physics, position=[0, -1, 0])
    for _ in range(50):
        environment.step(np.concatenate([walker.action_for() for walker in walkers]))
    for walker in walkers:
        joints = physics.bind(walker.observable_joints)
        np.testing.assert_allclose(joints.qpos, walker.home, atol=0.06)
    for leg, place in zip(legs, ([0, 1, 0.6], [0, 2, 0.7]), strict=True):
        np.testing.assert_allclose(physics.bind(leg.root_body).xpos, place)


@floating
def test_gains_are_for_the_timesteps_of_dm_control_s_tasks_too(robot):
    walker = robot()
    task = go_to_target.GoToTarget(walker=walker, arena=floors.Floor())
    assert task.physics_timestep == 0.005
    environment = composer.Environment(task, random_state=0)
    environment.reset()  # where a gain beyond its bound would be warned of
    for _ in range(100):
        environment.step(walker.action_for())
    joints = environment.physics.bind(walker.observable_joints)
    np.testing.assert_allclose(joints.qpos, walker.home, atol=0.06)
    assert np.abs(joints.qvel).max() < 0.5


def test_feet_of_the_walkers_are_where_they_stand():
    for walker in (Quadruped(), Biped()):
        environment = on_floor(walker)
        environment.step(walker.action_for(ActuatorCmd(position_target=walker.home)))
        feet = environment.physics.bind(walker.feet).xpos
        assert feet.shape == (len(walker.end_effectors), 3)
        assert (feet[:, 2] < 0.03).all()
    assert Leg().foot.tag == "site"
    assert ServoBench().tip.tag == "site"
