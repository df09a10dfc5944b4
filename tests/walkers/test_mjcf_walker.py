"""A robot file as a walker: in tasks that know nothing of it, at home, with its senses."""

from __future__ import annotations

import gc

import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf
from dm_control.composer.variation import rotations
from dm_control.locomotion.arenas import floors
from dm_control.locomotion.walkers import initializers

from tests.walkers.robots import (
    ARM,
    ARM_PD,
    DOG,
    DOG_HOME,
    DOG_JOINTS,
    KD,
    KP,
    LAG,
    Drive,
    corridor_task,
    dog,
    go_to_target_task,
    soccer_task,
    without_camera,
    write,
)
from walkerkit.actuators import ActuatorCmd, IdealPdActuatorCfg
from walkerkit.actuators.laws.dc_motor import dc_motor_clip
from walkerkit.actuators.laws.pd import PdLaw
from walkerkit.walkers import MjcfWalker

EPISODES, STEPS = 10, 6


class Watch:
    """Checks, right before every physics step, the control of every actuator of a dog.

    The expected numbers come from the state as it is then, from the names in the compiled model and
    from the actions, so that a binding to an earlier model, a law that was skipped or a delay that
    remembers the last episode shows.
    """

    def __init__(self, environment, *walkers):
        self.walkers = walkers
        self.checked = 0
        self.asked: dict[str, list[np.ndarray]] = {}
        environment.add_extra_hook("before_substep", self)
        environment.add_extra_hook("initialize_episode", self.forget)

    def forget(self, physics, random_state):
        self.asked = {walker.mjcf_model.model: [] for walker in self.walkers}

    def __call__(self, physics, action, random_state):
        model, data = physics.model.ptr, physics.data.ptr
        for walker in self.walkers:
            prefix = walker.mjcf_model.full_identifier
            target = dict(
                zip(walker.actuator_group.joint_names, walker.command.position_target, strict=True)
            )
            history = self.asked[walker.mjcf_model.model]
            history.append(target)
            late = history[max(0, len(history) - 1 - LAG)]
            for i in range(model.nactuator):
                name = mujoco.mj_id2name(
                    model, mujoco.mjtObj.mjOBJ_JOINT, model.actuator_trnid[i, 0]
                )
                if not name.startswith(prefix):
                    continue
                joint = model.joint(name)
                q, qd = data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]]
                name = name.removeprefix(prefix)
                control = data.ctrl[model.actuator_ctrladr[i]]
                if name in ("rl_knee", "rr_knee"):
                    column = -2 if name == "rl_knee" else -1
                    assert control == walker.prev_action[column]
                elif name.endswith("knee"):
                    assert control == target[name]
                elif name.startswith("f"):
                    assert control == KP * (target[name] - q) + KD * (0.0 - qd)
                else:
                    effort = KP * (late[name] - q) + KD * (0.0 - qd)
                    motor = (np.array([x]) for x in (effort, qd, 20.0, 30.0, 12.0))
                    assert control == dc_motor_clip(*motor)
                self.checked += 1


@pytest.fixture
def law_calls(monkeypatch):
    """How often a PD law was asked for its effort, through a DC motor or not."""
    calls = []
    effort = PdLaw.effort

    def counted(self, *args):
        calls.append(self)
        return effort(self, *args)

    monkeypatch.setattr(PdLaw, "effort", counted)
    return calls


def actions_of(walkers, random_state):
    return [
        random_state.uniform(w.action_spec.minimum * 0.5, w.action_spec.maximum * 0.5)
        for w in walkers
    ]


class TestInTasks:
    @pytest.mark.parametrize("recompile", [True, False])
    @pytest.mark.parametrize(
        ("make_task", "names"),
        [
            (go_to_target_task, ("dog",)),
            (corridor_task, ("dog",)),
            (soccer_task, ("one", "other")),
            (Drive, ("one", "other")),
        ],
    )
    def test_ten_episodes(self, tmp_path, law_calls, make_task, names, recompile):
        walkers = [dog(tmp_path, name=name) for name in names]
        environment = composer.Environment(
            make_task(*walkers), random_state=3, recompile_mjcf_every_episode=recompile
        )
        watch = Watch(environment, *walkers)
        random_state = np.random.RandomState(5)
        substeps = environment.task.physics_steps_per_control_step
        seen, models = 0, set()
        for _ in range(EPISODES):
            environment.reset()
            models.add(id(environment.physics.model.ptr))
            law_calls.clear()
            for _ in range(STEPS):
                actions = actions_of(walkers, random_state)
                timestep = environment.step(actions if len(names) > 1 else actions[0])
                seen += substeps
                if timestep.last():
                    break
                observations = timestep.observation
                for each in observations if isinstance(observations, list) else [observations]:
                    assert all(np.isfinite(value).all() for value in each.values())
            # One law of its own, and one through a DC motor, per walker and physics step.
            steps = round(environment.physics.time() / environment.physics.timestep())
            assert len(law_calls) % len(walkers) == 0
            assert len([law for law in law_calls if type(law) is PdLaw]) == len(walkers) * steps
        assert watch.checked == seen * len(walkers) * 8
        assert seen >= EPISODES * substeps

    def test_recompilation_leaves_nothing_of_the_last_model(self, tmp_path):
        walker = dog(tmp_path)
        environment = composer.Environment(Drive(walker), random_state=0)
        environment.reset()
        before = environment.physics
        environment.reset()
        gc.collect()
        with pytest.raises(ReferenceError):
            before.time()
        environment.step([walker.action_for()])

    def test_two_walkers_are_commanded_apart(self, tmp_path):
        one, other = dog(tmp_path, name="one"), dog(tmp_path, name="other")
        environment = composer.Environment(Drive(one, other), random_state=0)
        environment.reset()
        environment.step([np.zeros(8), np.ones(8)])
        assert not np.array_equal(one.command.position_target, other.command.position_target)
        np.testing.assert_array_equal(one.prev_action, np.zeros(8))
        np.testing.assert_array_equal(other.prev_action, np.ones(8))

    @pytest.mark.parametrize("legacy_step", [True, False])
    def test_steps_as_dm_control_likes_them(self, tmp_path, legacy_step):
        walker = dog(tmp_path)
        environment = composer.Environment(Drive(walker), random_state=0, legacy_step=legacy_step)
        watch = Watch(environment, walker)
        environment.reset()
        for _ in range(STEPS):
            environment.step([walker.action_for()])
        assert watch.checked == STEPS * 4 * 8


class TestEpisodes:
    @pytest.mark.parametrize("recompile", [True, False])
    @pytest.mark.parametrize("task", [go_to_target_task, Drive])
    def test_no_state_survives_a_reset(self, tmp_path, task, recompile):
        walker = dog(tmp_path)
        environment = composer.Environment(
            task(walker), random_state=0, recompile_mjcf_every_episode=recompile
        )

        def episode(resets=1, seed=8):
            environment.random_state.seed(7)
            random_state = np.random.RandomState(seed)
            for _ in range(resets - 1):
                environment.reset()
                environment.random_state.seed(7)
            rows = [flat(environment.reset())]
            for _ in range(20):
                (action,) = actions_of([walker], random_state)
                rows.append(flat(environment.step([action] if task is Drive else action)))
                rows.append(environment.physics.get_state())
                rows.append(walker.actuator_group.applied_effort)
            return np.concatenate(rows)

        environment.reset()  # the first one compiles, and draws for it, in any case
        first = episode()
        np.testing.assert_array_equal(episode(), first)
        np.testing.assert_array_equal(episode(resets=2), first)
        assert not np.array_equal(episode(seed=9), first)

    def test_the_first_command_is_to_hold_home(self, tmp_path):
        walker = dog(tmp_path)
        environment = composer.Environment(Drive(walker), random_state=0)
        environment.reset()
        environment.step([np.ones(8)])
        environment.reset()
        np.testing.assert_array_equal(walker.prev_action, np.zeros(8))
        held = dict(zip(DOG_JOINTS, DOG_HOME, strict=True))
        names = walker.actuator_group.joint_names
        np.testing.assert_array_equal(
            walker.command.position_target, [held[name] for name in names]
        )


class TestHome:
    def home_of(self, folder, text=DOG, **options):
        path = write(folder, text)
        return MjcfWalker.from_file(
            path,
            IdealPdActuatorCfg(joint_names_expr=("f._hip",), stiffness=KP, damping=KD),
            **options,
        )

    def test_keyframe_called_home_comes_first(self, tmp_path):
        walker = self.home_of(tmp_path)
        np.testing.assert_array_equal(walker.home, DOG_HOME)
        np.testing.assert_array_equal(walker.upright_pose.xpos, [0, 0, 0.29])
        np.testing.assert_array_equal(walker.upright_pose.xquat, [1, 0, 0, 0])

    def test_by_name(self, tmp_path):
        walker = self.home_of(tmp_path, home="curled")
        np.testing.assert_array_equal(walker.home, [0.8, -1.8] * 4)
        assert walker.upright_pose.xpos[2] == 0.2

    def test_first_keyframe_where_none_is_called_home(self, tmp_path):
        text = DOG.replace('name="home"', 'name="up"')
        np.testing.assert_array_equal(self.home_of(tmp_path, text).home, [0.8, -1.8] * 4)

    def test_first_keyframe_even_without_a_name(self, tmp_path):
        text = DOG.replace(' name="home"', "").replace(' name="curled"', "")
        np.testing.assert_array_equal(self.home_of(tmp_path, text).home, [0.8, -1.8] * 4)

    def test_reference_where_there_is_no_keyframe(self, tmp_path):
        text = DOG[: DOG.index("<keyframe>")] + "</mujoco>"
        walker = self.home_of(tmp_path, text)
        np.testing.assert_array_equal(walker.home, np.zeros(8))
        assert walker.upright_pose.xpos[2] == 0.5

    def test_by_joint_others_at_their_reference(self, tmp_path):
        walker = self.home_of(tmp_path, home={"fr_hip": 0.25, "rr_knee": -1.0})
        expected = np.zeros(8)
        expected[[2, 7]] = 0.25, -1.0
        np.testing.assert_array_equal(walker.home, expected)
        assert walker.upright_pose.xpos[2] == 0.5

    def test_by_array(self, tmp_path):
        wanted = np.linspace(-0.5, 0.5, 8)
        walker = self.home_of(tmp_path, home=wanted)
        np.testing.assert_array_equal(walker.home, wanted)
        wanted[:] = 9.0
        assert walker.home.max() == 0.5
        with pytest.raises(ValueError, match="read-only"):
            walker.home[0] = 1.0

    @pytest.mark.parametrize(
        ("home", "text"),
        [
            ("hoem", r"home='hoem'.*did you mean 'home'.*'curled'"),
            ({"fl_hpi": 0.1}, r"home.*'fl_hpi'.*did you mean 'fl_hip'"),
            ({"root": 0.1}, r"home.*no hinge or slide joint 'root'"),
            ([0.1, 0.2], r"home should be 8 positions"),
            ([np.nan] * 8, r"home should be finite"),
            ({"fl_hip": np.inf}, r"home should be finite"),
        ],
    )
    def test_errors_name_it(self, tmp_path, home, text):
        with pytest.raises(ValueError, match=text):
            self.home_of(tmp_path, home=home)

    def test_is_taken_where_the_task_gives_no_pose(self, tmp_path):
        one, other = dog(tmp_path, name="one"), dog(tmp_path, name="other")
        environment = composer.Environment(Drive(one, other), random_state=0)
        for _ in range(2):
            environment.reset()
            for i, walker in enumerate((one, other)):
                joints = environment.physics.bind(walker.observable_joints)
                np.testing.assert_array_equal(joints.qpos, DOG_HOME)
                position, quaternion = walker.get_pose(environment.physics)
                np.testing.assert_array_equal(position, [2.0 * i, 0, 0.29])
                np.testing.assert_array_equal(quaternion, [1, 0, 0, 0])
            environment.step([np.ones(8), np.ones(8)])

    def test_is_where_the_task_has_put_the_walker(self, tmp_path):
        class Put(Drive):
            def initialize_episode(self, physics, random_state):
                self.walkers[0].set_pose(physics, position=[1, 2, 3])
                self.walkers[0].set_velocity(physics, velocity=[1, 0, 0])

        walker = dog(tmp_path)
        environment = composer.Environment(Put(walker), random_state=0)
        environment.reset()
        position, _ = walker.get_pose(environment.physics)
        np.testing.assert_array_equal(position, [1, 2, 3])
        np.testing.assert_array_equal(walker.get_velocity(environment.physics)[0], [1, 0, 0])
        joints = environment.physics.bind(walker.observable_joints)
        np.testing.assert_array_equal(joints.qpos, DOG_HOME)

    def test_is_left_to_a_task_that_sets_the_joints(self, tmp_path):
        class Pose(Drive):
            def initialize_episode(self, physics, random_state):
                self.walkers[0].configure_joints(physics, np.full(8, -0.1))

        walker = dog(tmp_path)
        environment = composer.Environment(Pose(walker), random_state=0)
        environment.reset()
        joints = environment.physics.bind(walker.observable_joints)
        np.testing.assert_array_equal(joints.qpos, np.full(8, -0.1))
        # Forces that are observed at the start belong to that pose.
        at = walker.actuator_group.joint_names.index("fl_hip")
        element = walker.actuator_group.elements[at]
        assert environment.physics.bind(element).ctrl == pytest.approx(KP * 0.5)

    def test_initializers_of_dm_control(self, tmp_path):
        walker = dog(tmp_path, initializer=initializers.NoOpInitializer())
        environment = composer.Environment(Drive(walker), random_state=0)
        environment.reset()
        joints = environment.physics.bind(walker.observable_joints)
        np.testing.assert_array_equal(joints.qpos, np.zeros(8))
        walker = dog(tmp_path, initializer=initializers.UprightInitializer())
        environment = composer.Environment(go_to_target_task(walker), random_state=0)
        environment.reset()
        joints = environment.physics.bind(walker.observable_joints)
        np.testing.assert_array_equal(joints.qpos, DOG_HOME)

    def test_reinitialize_pose_rests(self, tmp_path):
        walker = dog(tmp_path)
        environment = composer.Environment(go_to_target_task(walker), random_state=0)
        environment.reset()
        environment.step(np.ones(8))
        physics = environment.physics
        walker.set_pose(physics, quaternion=rotations.UniformQuaternion()(np.random.RandomState(0)))
        walker.reinitialize_pose(physics, np.random.RandomState(0))
        np.testing.assert_array_equal(physics.bind(walker.observable_joints).qpos, DOG_HOME)
        np.testing.assert_array_equal(physics.data.qvel, 0.0)
        np.testing.assert_array_equal(walker.get_pose(physics)[1], [1, 0, 0, 0])


class TestBase:
    def test_fixed_stays_where_it_was_attached(self, tmp_path):
        arms = [
            MjcfWalker.from_file(
                write(tmp_path, ARM), ARM_PD, name=name, home={"shoulder": 0.4, "elbow": 0.7}
            )
            for name in ("one", "other")
        ]
        assert not arms[0].floating
        environment = composer.Environment(Drive(*arms), random_state=0)
        environment.reset()
        environment.step([np.zeros(2), np.zeros(2)])
        environment.reset()
        for i, arm in enumerate(arms):
            physics = environment.physics
            assert mjcf.get_frame_freejoint(arm.mjcf_model) is None
            np.testing.assert_allclose(physics.bind(arm.root_body).xpos, [2.0 * i, 0, 0.1])
            np.testing.assert_array_equal(physics.bind(arm.observable_joints).qpos, [0.4, 0.7])

    def test_fixed_keeps_its_table(self, tmp_path):
        arm = MjcfWalker.from_file(write(tmp_path, ARM), ARM_PD)
        assert arm.mjcf_model.find("geom", "table") is not None
        composer.Environment(Drive(arm), random_state=0).reset()

    def test_made_to_float(self, tmp_path):
        arm = MjcfWalker.from_file(write(tmp_path, ARM), ARM_PD, floating=True)
        assert arm.floating
        assert arm.mjcf_model.find("geom", "table") is None
        environment = composer.Environment(Drive(arm), random_state=0)
        environment.reset()
        assert environment.physics.model.nv == 8
        np.testing.assert_array_equal(arm.get_pose(environment.physics)[0], [0, 0, 0.1])
        for _ in range(20):
            environment.step([arm.action_for()])
        assert environment.physics.bind(arm.root_body).xpos[2] < 0.1

    def test_made_to_stay(self, tmp_path):
        hung = dog(tmp_path, floating=False)
        assert not hung.floating
        environment = composer.Environment(Drive(hung), random_state=0)
        environment.reset()
        assert environment.physics.model.nv == 8
        np.testing.assert_array_equal(
            environment.physics.bind(hung.observable_joints).qpos, DOG_HOME
        )

    @pytest.mark.parametrize("floating", [True, False])
    def test_alone_as_root_entity(self, tmp_path, floating):
        walker = dog(tmp_path, floating=floating)
        environment = composer.Environment(composer.NullTask(walker), random_state=0)
        for _ in range(2):
            environment.reset()
            np.testing.assert_array_equal(environment.physics.data.qpos, DOG_HOME)
            environment.step(np.zeros(8))

    def test_carries_what_is_attached_to_it(self, tmp_path):
        """Its pose is that of its own joints, whatever else moves on its back."""

        class Flag(composer.Entity):
            def _build(self):
                self._root = mjcf.RootElement(model="flag")
                body = self._root.worldbody.add("body")
                body.add("joint", name="wave", ref=0.3)
                body.add("geom", size=[0.02], pos=[0, 0, 0.1])

            @property
            def mjcf_model(self):
                return self._root

        walker = dog(tmp_path)
        flag = Flag()
        walker.attach(flag, walker.root_body.add("site", pos=[0, 0, 0.1]))
        environment = composer.Environment(Drive(walker), random_state=0)
        for _ in range(2):
            environment.reset()
            physics = environment.physics
            np.testing.assert_array_equal(physics.bind(walker.observable_joints).qpos, DOG_HOME)
            assert physics.bind(flag.mjcf_model.find("joint", "wave")).qpos == 0.3
            environment.step([walker.action_for()])

    def test_upright_is_alive(self, tmp_path):
        walker = dog(tmp_path)
        environment = composer.Environment(Drive(walker), random_state=0)
        environment.reset()
        physics = environment.physics
        physics.forward()
        assert walker.aliveness(physics) == pytest.approx(0.0)
        walker.set_pose(physics, quaternion=[0, 1, 0, 0])
        physics.forward()
        assert walker.aliveness(physics) == pytest.approx(-1.0)


class TestParts:
    def test_found(self, tmp_path):
        walker = dog(tmp_path)
        assert walker.root_body.name == "trunk"
        assert [joint.name for joint in walker.observable_joints] == list(DOG_JOINTS)
        assert [body.name for body in walker.end_effectors] == [
            "fl_shin",
            "fr_shin",
            "rl_shin",
            "rr_shin",
        ]
        assert [geom.name for geom in walker.ground_contact_geoms] == [
            "fl_shin",
            "fr_shin",
            "rl_shin",
            "rr_shin",
        ]

    def test_given(self, tmp_path):
        walker = dog(
            tmp_path,
            root_body="fl_thigh",
            joints=("rr_.*", "fl_hip"),
            end_effectors=("r._shin",),
        )
        assert walker.root_body.name == "fl_thigh"
        assert [j.name for j in walker.observable_joints] == ["fl_hip", "rr_hip", "rr_knee"]
        assert [body.name for body in walker.end_effectors] == ["rl_shin", "rr_shin"]

    @pytest.mark.parametrize(
        ("options", "text"),
        [
            ({"root_body": "trnuk"}, r"no body 'trnuk'.*did you mean 'trunk'"),
            ({"joints": ("fl_hop",)}, r"joints: 'fl_hop' matches none of"),
            ({"end_effectors": ("toe",)}, r"end_effectors: 'toe' matches none of"),
            ({"existing": "both"}, r"existing"),
        ],
    )
    def test_errors_name_it(self, tmp_path, options, text):
        with pytest.raises(ValueError, match=text):
            dog(tmp_path, **options)

    def test_name(self, tmp_path):
        assert dog(tmp_path).mjcf_model.model == "dog"
        assert dog(tmp_path, name="rex").mjcf_model.model == "rex"

    def test_own_sensors_are_used(self, tmp_path):
        text = DOG.replace(
            "<sensor>", '<sensor><gyro name="rate" site="body"/><velocimeter name="v" site="body"/>'
        ).replace("<freejoint", '<site name="body" pos="0.1 0 0"/><freejoint')
        walker = MjcfWalker.from_file(
            write(tmp_path, text),
            IdealPdActuatorCfg(joint_names_expr=("f._hip",), stiffness=KP, damping=KD),
        )
        root = walker.mjcf_model
        assert [sensor.name for sensor in root.sensor.gyro] == ["rate"]
        assert [sensor.name for sensor in root.sensor.velocimeter] == ["v"]
        assert [sensor.name for sensor in root.sensor.accelerometer] == ["accelerometer"]

    def test_camera_looks_ahead(self, tmp_path):
        walker = dog(tmp_path)
        physics = mjcf.Physics.from_mjcf_model(walker.mjcf_model)
        matrix = physics.bind(walker.egocentric_camera).xmat.reshape(3, 3)
        np.testing.assert_allclose(-matrix[:, 2], [1, 0, 0], atol=1e-12)
        np.testing.assert_allclose(matrix[:, 1], [0, 0, 1], atol=1e-12)

    def test_an_own_egocentric_camera_is_used(self, tmp_path):
        text = DOG.replace("<freejoint", '<camera name="egocentric" pos="0.3 0 0"/><freejoint')
        walker = MjcfWalker.from_file(
            write(tmp_path, text),
            IdealPdActuatorCfg(joint_names_expr=("f._hip",), stiffness=KP, damping=KD),
        )
        np.testing.assert_array_equal(walker.egocentric_camera.pos, [0.3, 0, 0])


class TestObservables:
    @pytest.fixture
    def environment(self, tmp_path):
        walker = dog(tmp_path)
        walker.observables.enable_all()
        without_camera(walker)
        return composer.Environment(
            Drive(walker), random_state=0, strip_singleton_obs_buffer_dim=True
        )

    def test_each_has_the_promised_shape_and_is_finite(self, environment):
        (walker,) = environment.task.walkers
        shapes = {
            "joints_pos": (8,),
            "joints_vel": (8,),
            "sensors_gyro": (3,),
            "sensors_accelerometer": (3,),
            "sensors_velocimeter": (3,),
            "sensors_framequat": (4,),
            "position_target": (6,),
            "velocity_target": (6,),
            "effort_target": (6,),
            "computed_effort": (6,),
            "applied_effort": (6,),
            "prev_action": (8,),
        }
        timestep = environment.reset()
        for _ in range(3):
            found = {key.removeprefix("dog/"): value for key, value in timestep.observation.items()}
            assert shapes.items() <= {key: value.shape for key, value in found.items()}.items()
            assert all(np.isfinite(value).all() for value in found.values())
            for name, value in found.items():
                assert value.shape == environment.observation_spec()[f"dog/{name}"].shape
            timestep = environment.step([walker.action_for()])

    def test_they_say_what_is_the_case(self, environment):
        (walker,) = environment.task.walkers
        environment.reset()
        action = np.linspace(-0.4, 0.4, 8)
        seen = environment.step([action]).observation
        physics = environment.physics
        np.testing.assert_array_equal(
            seen["dog/joints_pos"], physics.bind(walker.observable_joints).qpos
        )
        np.testing.assert_array_equal(
            seen["dog/joints_vel"], physics.bind(walker.observable_joints).qvel
        )
        np.testing.assert_array_equal(seen["dog/position_target"], walker.command.position_target)
        np.testing.assert_array_equal(seen["dog/velocity_target"], np.zeros(6))
        np.testing.assert_array_equal(seen["dog/prev_action"], action)
        np.testing.assert_array_equal(
            seen["dog/sensors_framequat"],
            physics.bind(walker.mjcf_model.find("site", "imu"))
            and physics.bind(walker.mjcf_model.sensor.framequat).sensordata,
        )
        names = walker.actuator_group.joint_names
        explicit = [names.index(name) for name in ("fl_hip", "fr_hip", "rl_hip", "rr_hip")]
        elements = [walker.actuator_group.elements[i] for i in explicit]
        np.testing.assert_array_equal(
            seen["dog/applied_effort"][explicit], physics.bind(elements).ctrl
        )
        assert (np.abs(seen["dog/applied_effort"][names.index("rl_hip")])) <= 12.0

    def test_what_they_hand_out_cannot_change_the_walker(self, environment):
        (walker,) = environment.task.walkers
        seen = environment.reset().observation
        command = walker.command.position_target.copy()
        for value in seen.values():
            value[...] = 123.0
        np.testing.assert_array_equal(walker.command.position_target, command)
        assert not (walker.prev_action == 123.0).any()
        assert not (walker.actuator_group.applied_effort == 123.0).any()


def flat(timestep):
    """All numbers of an observation."""
    return np.concatenate([np.zeros(0), *map(np.ravel, timestep.observation.values())])


def test_a_command_in_physical_units(tmp_path):
    walker = dog(tmp_path)
    environment = composer.Environment(Drive(walker), random_state=0)
    environment.reset()
    target = np.array([0.1, -0.2, 0.3, -0.4, 0.5, -0.6])
    environment.step([walker.action_for(ActuatorCmd(position_target=target))])
    np.testing.assert_allclose(walker.command.position_target, target, atol=1e-15)


def test_an_arena_with_an_integrator_of_its_own_is_refused_clearly(tmp_path):
    walker = dog(tmp_path)
    arena = floors.Floor()
    arena.mjcf_model.option.integrator = "RK4"
    with pytest.raises(ValueError, match=r"integrator.*RK4 vs implicitfast"):
        arena.attach(walker)
