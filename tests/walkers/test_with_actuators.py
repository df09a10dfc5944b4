"""Actuators of ours on dm_control's own walkers."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from dm_control import composer
from dm_control.composer.observation.observable import MJCFCamera
from dm_control.locomotion.arenas import floors
from dm_control.locomotion.tasks import go_to_target
from dm_control.locomotion.walkers import ant, base, cmu_humanoid, jumping_ball, rodent

from tests.walkers.robots import Drive
from walkerkit.actuators import (
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
)
from walkerkit.walkers import with_actuators
from walkerkit.walkers.actions import JointPositionAction

TIMESTEP = 0.002


INERTIAS = {}


def inertia_of(walker):
    """What each joint moves, of walkers that nothing was changed in yet; each kind once."""
    kind = type(walker), len(walker.actuators)
    if kind not in INERTIAS:
        model = mujoco.MjModel.from_xml_string(
            walker.mjcf_model.to_xml_string(), walker.mjcf_model.get_assets()
        )
        names = [model.joint(i).name for i in range(model.njnt)]
        # A body's own degrees of freedom, and those of what carries it, floating or not.
        INERTIAS[kind] = dict(zip(names, 1 / model.dof_invweight0, strict=True))
    return INERTIAS[kind]


def gains(walker, damping, stiffness):
    """Of each joint, for the inertia that it moves: what explicit integration bears."""
    inertia = inertia_of(walker)
    return {
        "joint_names_expr": tuple(inertia),
        "stiffness": {name: stiffness * i / TIMESTEP**2 for name, i in inertia.items()},
        "damping": {name: damping * i / TIMESTEP for name, i in inertia.items()},
    }


def explicit(walker):
    return IdealPdActuatorCfg(**gains(walker, 0.05, 0.005))


def native(walker):
    return BuiltinPdActuatorCfg(**gains(walker, 0.05, 0.005))


def delayed(walker):
    numbers = gains(walker, 0.02, 0.0005)
    strong = {name: 10 * kp for name, kp in numbers["stiffness"].items()}
    motor = DcMotorActuatorCfg(
        **numbers, saturation_effort=strong, velocity_limit=300.0, effort_limit=strong
    )
    return DelayedActuatorCfg(base_cfg=motor, delay_max_lag=2)


WALKERS = {
    "ant": ant.Ant,
    "humanoid 2019": cmu_humanoid.CMUHumanoid,
    "humanoid 2019, positions": cmu_humanoid.CMUHumanoidPositionControlled,
    "humanoid 2020": cmu_humanoid.CMUHumanoidPositionControlledV2020,
    "rat": rodent.Rat,
    "ball": jumping_ball.JumpingBallWithHead,
    "ball with a camera": lambda: jumping_ball.JumpingBallWithHead(camera_control=True),
}
KINDS = {"explicit": explicit, "native": native, "delayed": delayed}


@pytest.fixture(params=WALKERS)
def make(request):
    return WALKERS[request.param]


def environment_of(walker, **options):
    walker.observables.enable_all()
    for item in walker.observables.as_dict().values():
        item.enabled = not isinstance(item, MJCFCamera)
    task = Drive(walker, timestep=TIMESTEP, substeps=5)
    return composer.Environment(task, random_state=0, **options)


class TestEpisodes:
    @pytest.mark.parametrize("kind", KINDS)
    def test_three_of_random_actions(self, make, kind):
        walker = make()
        with_actuators(walker, KINDS[kind](walker))
        environment = environment_of(walker, recompile_mjcf_every_episode=kind == "delayed")
        random_state = np.random.RandomState(2)
        spec = walker.action_spec
        for _ in range(3):
            timestep = environment.reset()
            for _ in range(5):
                for name, value in timestep.observation.items():
                    assert np.isfinite(value).all(), name
                    assert value.shape == environment.observation_spec()[name].shape
                timestep = environment.step([random_state.uniform(spec.minimum, spec.maximum)])
        applied = walker.actuator_group.applied_effort
        assert np.isfinite(applied).all()
        assert applied.any()

    def test_in_a_task_of_dm_control(self, make):
        walker = make()
        with_actuators(walker, explicit(walker))
        task = go_to_target.GoToTarget(
            walker, floors.Floor(), physics_timestep=TIMESTEP, control_timestep=10 * TIMESTEP
        )
        environment = composer.Environment(task, random_state=0)
        for _ in range(2):
            environment.reset()
            spec = environment.action_spec()
            names = spec.name.replace("walker/", "").split("\t")
            n = len(walker.actuator_group.joint_names)
            assert spec.shape == walker.action_spec.shape
            assert names[n:] == walker.action_spec.name.split("\t")[n:]
            for _ in range(3):
                environment.step(walker.action_for())

    def test_no_state_survives_a_reset(self, make):
        walker = make()
        with_actuators(walker, delayed(walker))
        environment = environment_of(walker)

        def episode():
            environment.random_state.seed(5)
            environment.reset()
            for _ in range(5):
                environment.step([np.full(walker.action_spec.shape, 0.1)])
            return environment.physics.get_state()

        np.testing.assert_array_equal(episode(), episode())


class TestWhatItIs:
    def test_the_same_walker_with_actuators_of_ours_and_the_kept(self, make):
        walker = make()
        cls = type(walker)
        pose, effectors = walker.upright_pose, walker.end_effectors
        old = list(walker.actuators)
        tendons = [element for element in old if getattr(element, "tendon", None) is not None]
        joints = list(walker.observable_joints)
        names = list(walker.observables.as_dict())
        result = with_actuators(walker, explicit(walker))
        assert result is walker
        assert isinstance(walker, cls)
        assert isinstance(walker, base.Walker)
        assert walker.upright_pose == pose
        assert walker.end_effectors == effectors
        assert list(walker.actuators) == [*walker.actuator_group.elements, *tendons]
        assert list(walker.actuators) == walker.mjcf_model.find_all("actuator")
        assert all(element.is_removed for element in old if element not in tendons)
        assert walker.action_spec.shape == (len(walker.actuators),)
        assert walker.prev_action.shape == walker.action_spec.shape
        # It observes what it did.
        assert list(walker.observable_joints)[: len(joints)] == joints
        driven = {element.joint for element in walker.actuator_group.elements}
        assert driven <= set(walker.observable_joints)
        assert list(walker.observables.as_dict()) == names
        environment = environment_of(walker)
        seen = environment.reset().observation
        prefix = walker.mjcf_model.full_identifier
        bound = environment.physics.bind(walker.observable_joints)
        np.testing.assert_array_equal(seen[f"{prefix}joints_pos"][0], bound.qpos)

    def test_what_was_worked_out_before_is_worked_out_anew(self):
        walker = rodent.Rat()
        assert any(element.joint.name == "knee_L" for element in walker.joint_actuators)
        cfg = IdealPdActuatorCfg(joint_names_expr=("knee_.",), stiffness=0.01, damping=1e-5)
        with_actuators(walker, cfg)
        assert not any(element.is_removed for element in walker.joint_actuators)
        assert set(walker.actuator_group.elements) <= set(walker.joint_actuators)

    def test_order_of_actions_is_that_of_the_model(self):
        walker = cmu_humanoid.CMUHumanoid()
        names = [joint.name for joint in walker.mjcf_model.find_all("joint")]
        legs = [name for name in names if name.startswith(("l", "r"))]
        cfgs = [
            IdealPdActuatorCfg(joint_names_expr=tuple(some), stiffness=1.0, damping=0.001)
            for some in (legs[1::2], legs[::2])
        ]
        with_actuators(walker, cfgs)
        environment = environment_of(walker)
        model = environment.physics.model.ptr
        spec = walker.action_spec.name.split("\t")
        for i, name in enumerate(spec[: len(legs)]):
            assert model.joint(model.actuator_trnid[i, 0]).name == f"walker/{name}"
        for i, name in enumerate(spec[len(legs) :], start=len(legs)):
            assert model.actuator(i).name == f"walker/{name}"
        np.testing.assert_array_equal(
            walker.actuator_group.ctrl_ids, np.arange(len(legs), dtype=int)
        )


class TestOptions:
    def test_existing_ones_of_other_joints_stay(self):
        walker = ant.Ant()
        cfg = IdealPdActuatorCfg(joint_names_expr=(".*_hip",), stiffness=5.0, damping=0.1)
        with_actuators(walker, cfg)
        corners = ["front_left", "front_right", "back_right", "back_left"]
        assert walker.action_spec.name.split("\t") == [
            *(f"{corner}_hip" for corner in corners),
            *(f"{corner}_ankle" for corner in corners),
        ]
        environment = environment_of(walker)
        environment.reset()
        environment.step([np.r_[np.zeros(4), 0.25, -0.5, 2.0, -2.0]])
        kept = environment.physics.bind(walker.actuators[4:]).ctrl
        np.testing.assert_array_equal(kept, [0.25, -0.5, 1.0, -1.0])

    def test_existing_can_be_taken_over(self):
        walker = cmu_humanoid.CMUHumanoidPositionControlled()
        old = list(walker.actuators)
        with_actuators(walker, XmlPositionActuatorCfg(joint_names_expr=(".*",)))
        assert sorted(old, key=id) == sorted(walker.actuators, key=id)
        environment = environment_of(walker)
        environment.reset()
        action = np.linspace(-0.9, 0.9, 56)
        environment.step([action])
        # Scaled actuators span the range from -1 to 1 as an action of ours does.
        np.testing.assert_allclose(environment.physics.bind(walker.actuators).ctrl, action)

    def test_motors_can_be_taken_over(self):
        walker = ant.Ant()
        with_actuators(walker, XmlMotorActuatorCfg(joint_names_expr=(".*",)))
        environment_of(walker).reset()

    def test_two_on_one_joint_are_refused_where_they_are_kept(self):
        with pytest.raises(ValueError, match="already has the actuator"):
            with_actuators(ant.Ant(), explicit(ant.Ant()), existing="keep")

    def test_default_pose(self):
        walker = ant.Ant()
        cfg = IdealPdActuatorCfg(joint_names_expr=("back_left_.*",), stiffness=5.0, damping=0.1)
        with_actuators(
            walker,
            cfg,
            default={"back_left_ankle": 0.7},
            action=JointPositionAction(joint_names_expr=(".*_hip",), scale=0.5),
        )
        environment_of(walker).reset()
        asked = dict(
            zip(walker.actuator_group.joint_names, walker.command.position_target, strict=True)
        )
        assert asked == {"back_left_hip": 0.0, "back_left_ankle": 0.7}
        assert walker.action_spec.name.split("\t")[0] == "back_left_hip"

    @pytest.mark.parametrize(
        "cls", [cmu_humanoid.CMUHumanoid, cmu_humanoid.CMUHumanoidPositionControlledV2020]
    )
    def test_actions_span_ranges_in_radians(self, cls):
        """Those humanoids say no unit of angles, and mean radians, as every arena does."""
        walker = cls()
        ranges = {joint.name: joint.range for joint in walker.mjcf_model.find_all("joint")}
        with_actuators(walker, explicit(walker))
        environment = environment_of(walker)
        for value in (-1, 1):
            environment.reset()
            environment.step([np.full(walker.action_spec.shape, value)])
            for name, target in zip(
                walker.actuator_group.joint_names, walker.command.position_target, strict=True
            ):
                assert target == pytest.approx(ranges[name][int(value > 0)])

    def test_default_pose_is_the_upright_one(self):
        class Crouching(ant.Ant):
            @property
            def upright_pose(self):
                return base.WalkerPose(qpos=np.linspace(-0.1, 0.1, 8))

        walker = Crouching()
        with_actuators(walker, explicit(walker))
        joints = walker.mjcf_model.find_all("joint")
        pose = {joint.name: q for joint, q in zip(joints, np.linspace(-0.1, 0.1, 8), strict=True)}
        asked = dict(
            zip(walker.actuator_group.joint_names, walker.command.position_target, strict=True)
        )
        assert asked == pose

    def test_armature_and_native_delay(self):
        walker = ant.Ant()
        base_cfg = BuiltinPositionActuatorCfg(
            joint_names_expr=(".*",), stiffness=20.0, damping=0.5, armature=0.123
        )
        cfg = DelayedActuatorCfg(base_cfg=base_cfg, delay_min_lag=2, delay_max_lag=2)
        with_actuators(walker, cfg)
        environment = environment_of(walker)
        physics = environment.physics
        np.testing.assert_array_equal(physics.model.dof_armature[6:], 0.123)
        np.testing.assert_allclose(physics.model.ptr.actuator_delay, 2 * TIMESTEP)


class TestRefusals:
    def test_twice(self):
        walker = ant.Ant()
        cfg = explicit(walker)
        with_actuators(walker, cfg)
        with pytest.raises(TypeError, match="ActuatedAnt has actuators of ours already"):
            with_actuators(walker, cfg)

    def test_of_what_is_no_walker(self):
        with pytest.raises(TypeError, match="walker should be a dm_control walker, got"):
            with_actuators(floors.Floor(), explicit(ant.Ant()))

    def test_of_an_attached_one(self):
        walker = ant.Ant()
        floors.Floor().attach(walker)
        with pytest.raises(ValueError, match="Ant is attached to 'floor' already"):
            with_actuators(
                walker, IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=1.0, damping=0.1)
            )

    @pytest.mark.parametrize(
        ("default", "text"),
        [
            ({"back_left_hop": 0.1}, r"no hinge or slide joint 'back_left_hop'.*'back_left_hip'"),
            ({"back_left_hip": np.nan}, r"default\['back_left_hip'\] should be finite, got nan"),
        ],
    )
    def test_of_a_default(self, default, text):
        walker = ant.Ant()
        with pytest.raises(ValueError, match=text):
            with_actuators(walker, explicit(walker), default=default)

    def test_leaves_the_class_alone(self):
        walker = ant.Ant()
        with pytest.raises(ValueError, match="'hop' matches none"):
            with_actuators(
                walker, IdealPdActuatorCfg(joint_names_expr=("hop",), stiffness=1, damping=1)
            )
        assert type(walker) is ant.Ant
        with_actuators(walker, explicit(walker))
