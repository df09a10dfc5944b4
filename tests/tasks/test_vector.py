"""Copies in lock-step go the way that single composer environments go."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from dm_control import composer
from dm_control.locomotion.arenas import floors

from walkerkit.actuators import (
    BuiltinPositionActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    LearnedMlpActuatorCfg,
    Randomization,
)
from walkerkit.actuators.drivetrain import StribeckFriction
from walkerkit.actuators.networks.mlp import Mlp
from walkerkit.tasks import FallLimits, JointPositionAction, Stand, TrackVelocity
from walkerkit.tasks.vector.copies import Copies
from walkerkit.walkers import QUADRUPED_XML, MjcfWalker, Quadruped
from walkerkit.walkers.quadruped import QUADRUPED_DRIVES

pytest.importorskip("gymnasium")

from gymnasium.vector import AutoresetMode, SyncVectorEnv

from walkerkit.tasks.vector import WalkerVectorEnv

N, LIMIT = 3, 0.3
ACTION = JointPositionAction(joint_names_expr=(".*",), scale=1.5)


def late(low, high, **options):
    return [
        DelayedActuatorCfg(base_cfg=drive, delay_min_lag=low, delay_max_lag=high, **options)
        for drive in QUADRUPED_DRIVES
    ]


def learned(folder):
    rng = np.random.default_rng(0)
    sizes = (4, 8, 1)
    Mlp(
        weights=[rng.normal(size=(out, n)) for n, out in pairwise(sizes)],
        biases=[rng.normal(size=out) for out in sizes[1:]],
        activations=["softsign", "identity"],
    ).save(folder / "mlp.npz")
    return LearnedMlpActuatorCfg(
        joint_names_expr=(".*",),
        network_file=folder / "mlp.npz",
        history_length=2,
        pos_scale=1.0,
        vel_scale=1.0,
        torque_scale=5.0,
        saturation_effort=35.0,
        velocity_limit=30.0,
        effort_limit=20.0,
    )


def native():
    return BuiltinPositionActuatorCfg(
        joint_names_expr=(".*",), stiffness=30.0, damping=1.0, effort_limit=20.0
    )


ACTUATORS = {
    "DC motors": lambda folder: QUADRUPED_DRIVES,
    "delay": lambda folder: late(2, 2),
    "lag of an episode": lambda folder: late(0, 4, delay_hold_prob=1.0),
    "lag that wanders": lambda folder: late(0, 4, delay_hold_prob=0.5, delay_update_period=3),
    "MLP": learned,
    "MuJoCo's": lambda folder: native(),
    "MuJoCo's delay": lambda folder: DelayedActuatorCfg(
        base_cfg=native(), delay_min_lag=2, delay_max_lag=2
    ),
}


def singles(make_task, n=N, *, seed=0, limit=LIMIT, **options):
    return [
        composer.Environment(
            make_task(),
            time_limit=limit,
            random_state=seed + i,
            strip_singleton_obs_buffer_dim=True,
            **options,
        )
        for i in range(n)
    ]


def compare(make_task, *, steps=30, seed=0, actions=None, limit=LIMIT):
    """Both go on for some steps; how many episodes fell and how many ran into their limit."""
    environments = WalkerVectorEnv(make_task, N, time_limit=limit)
    others = singles(make_task, seed=seed, limit=limit)
    seen, _ = environments.reset(seed=seed)
    reached = [other.reset() for other in others]
    rng = np.random.default_rng(seed)
    fell = timed_out = 0
    for _ in range(steps):
        for i, step in enumerate(reached):
            assert seen.keys() == step.observation.keys()
            for name, values in step.observation.items():
                np.testing.assert_array_equal(seen[name][i], values, err_msg=name)
        asked = rng.uniform(-1, 1, environments.action_space.shape) if actions is None else actions
        seen, rewards, terminated, truncated, _ = environments.step(asked)
        reached = [other.step(action) for other, action in zip(others, asked, strict=True)]
        expected = [step.reward or 0.0 for step in reached]
        np.testing.assert_allclose(rewards, expected, rtol=0, atol=1e-12)
        lost = [step.last() and step.discount == 0 for step in reached]
        np.testing.assert_array_equal(terminated, lost)
        np.testing.assert_array_equal(
            truncated, [step.last() and step.discount == 1 for step in reached]
        )
        fell, timed_out = fell + int(terminated.sum()), timed_out + int(truncated.sum())
    environments.close()
    return fell, timed_out


class TestSameAsSingleEnvironments:
    @pytest.mark.parametrize("name", ACTUATORS)
    def test_with_these_actuators(self, name, tmp_path):
        cfgs = ACTUATORS[name](tmp_path)
        fell, timed_out = compare(lambda: Stand(Quadruped(actuators=cfgs, action=ACTION)))
        # Both ends of an episode, and what follows them, are among what was compared.
        assert fell + timed_out >= N

    def test_track_velocity(self):
        fell, _ = compare(lambda: TrackVelocity(Quadruped(action=ACTION)), seed=7)
        assert fell

    def test_episodes_that_run_into_the_time_limit(self):
        _, timed_out = compare(lambda: Stand(Quadruped()), actions=np.zeros((N, 12)), steps=40)
        assert timed_out == 2 * N

    def test_falls_of_each_kind(self):
        for limits, steps in (
            (FallLimits(contact=False, tilt=0.1, height=0.0), 40),
            (FallLimits(contact=False, tilt=np.pi, height=0.95), 20),
            (FallLimits(height=0.0, tilt=np.pi), 40),
        ):
            fell, _ = compare(
                lambda limits=limits: Stand(Quadruped(action=ACTION), fall=limits),
                steps=steps,
                limit=2.0,
                actions=np.tile([0.3, 1.0, -1.0], (N, 4)),
            )
            assert fell

    def test_randomized_actuators(self):
        randomizations = (
            Randomization(parameter="stiffness", range=(0.5, 1.5)),
            Randomization(parameter="strength", range=(0.5, 1.0), shared=True),
            Randomization(parameter="armature", range=(0.5, 2.0)),
            Randomization(parameter="delay", range=(0, 4), operation="abs"),
        )

        def task():
            return Stand(
                Quadruped(actuators=late(0, 4, delay_hold_prob=1.0), action=ACTION),
                randomizations=randomizations,
            )

        assert sum(compare(task))

    def test_kept_actuators_of_a_file(self, tmp_path):
        hips = IdealPdActuatorCfg(joint_names_expr=(".*_hip",), stiffness=30.0, damping=1.0)
        text = QUADRUPED_XML.read_text(encoding="utf-8")
        motor = '<actuator><motor name="knee" joint="FL_calf" ctrlrange="-3 3"/></actuator>'
        path = tmp_path / "robot.xml"
        path.write_text(text.replace("</mujoco>", f"{motor}</mujoco>"), encoding="utf-8")
        assert sum(compare(lambda: Stand(MjcfWalker.from_file(path, hips))))

    def test_of_another_task_with_functions(self):
        def task():
            return Dropped(Quadruped(actuators=late(2, 2)))

        environments = WalkerVectorEnv(
            task,
            N,
            observations={"qpos": lambda copies: copies.field("qpos")},
            reward=lambda copies: copies.field("xpos")[:, 1, 2],
            terminated=lambda copies: copies.time > 1.0,
        )
        environments.reset(seed=3)
        others = singles(task, seed=3)
        for other in others:
            other.reset()
        actions = np.random.default_rng(0).uniform(-0.3, 0.3, (N, 12))
        for _ in range(5):
            seen, rewards, *_ = environments.step(actions)
            for i, other in enumerate(others):
                other.step(actions[i])
                np.testing.assert_array_equal(seen["qpos"][i], other.physics.data.qpos)
                assert rewards[i] == other.physics.data.xpos[1, 2]


class Dropped(composer.NullTask):
    """Of somebody else: a walker falls from anywhere."""

    def __init__(self, walker):
        arena = floors.Floor()
        self.walker = walker
        walker.create_root_joints(arena.attach(walker))
        super().__init__(arena)
        self.set_timesteps(control_timestep=0.02, physics_timestep=0.002)

    def initialize_episode(self, physics, random_state):
        self.walker.reinitialize_pose(physics, random_state)
        self.walker.shift_pose(physics, position=[0, 0, random_state.uniform(0.1, 0.3)])

    def action_spec(self, physics):
        return self.walker.action_spec

    def before_step(self, physics, action, random_state):
        self.walker.apply_action(physics, action, random_state)


def stand():
    return Stand(Quadruped(actuators=late(2, 2), action=ACTION))


class TestGymnasium:
    def test_is_what_sync_vector_env_is(self):
        shimmy = pytest.importorskip("shimmy")

        def single():
            (environment,) = singles(stand, 1, recompile_mjcf_every_episode=False)
            return shimmy.DmControlCompatibilityV0(environment)

        for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
            other = SyncVectorEnv([single] * N, autoreset_mode=mode)
            ours = WalkerVectorEnv(stand, N, time_limit=LIMIT, autoreset_mode=mode)
            assert ours.single_observation_space == other.single_observation_space
            assert ours.single_action_space == other.single_action_space
            assert ours.observation_space == other.observation_space
            assert ours.action_space == other.action_space
            assert ours.metadata["autoreset_mode"] == other.metadata["autoreset_mode"]
            both = [environment.reset(seed=2) for environment in (ours, other)]
            _same(both[0][0], both[1][0])
            rng = np.random.default_rng(1)
            ends = 0
            for _ in range(25):
                actions = rng.uniform(-1, 1, (N, 12))
                one, two = (environment.step(actions) for environment in (ours, other))
                _same(one[0], two[0])
                np.testing.assert_allclose(one[1], two[1], rtol=0, atol=1e-12)
                np.testing.assert_array_equal(one[2], two[2])
                np.testing.assert_array_equal(one[3], two[3])
                assert ("final_obs" in one[4]) == ("final_obs" in two[4])
                if "final_obs" in one[4]:
                    final = zip(one[4]["final_obs"], two[4]["final_obs"], strict=True)
                    for mine, others in final:
                        if others is not None:
                            _same(mine, others)
                    np.testing.assert_array_equal(one[4]["_final_obs"], two[4]["_final_obs"])
                ends += int((one[2] | one[3]).sum())
            assert ends
            for environment in (ours, other):
                environment.close()

    def test_without_autoreset(self):
        environments = WalkerVectorEnv(
            stand, N, time_limit=0.04, autoreset_mode=AutoresetMode.DISABLED
        )
        environments.reset(seed=0)
        actions = np.zeros((N, 12))
        environments.step(actions)
        environments.reset(options={"reset_mask": np.array([True, False, False])})
        *_, truncated, _ = environments.step(actions)
        np.testing.assert_array_equal(truncated, [False, True, True])
        with pytest.raises(RuntimeError, match=r"copies \[1, 2\] have ended"):
            environments.step(actions)
        environments.reset(options={"reset_mask": truncated})
        environments.step(actions)

    def test_seeds(self):
        environments = WalkerVectorEnv(stand, N)
        first, _ = environments.reset(seed=5)
        again, _ = environments.reset(seed=[5, 6, 7])
        _same(first, again)
        other, _ = environments.reset()
        assert not np.array_equal(other["quadruped/joints_pos"], first["quadruped/joints_pos"])
        with pytest.raises(ValueError, match="2 seeds were given for 3 copies"):
            environments.reset(seed=[1, 2])
        with pytest.raises(ValueError, match="reset_mask should be 3 of bool"):
            environments.reset(options={"reset_mask": np.ones(2, dtype=bool)})

    def test_does_not_depend_on_threads(self):
        seen = []
        for n_threads in (1, 2):
            environments = WalkerVectorEnv(stand, 6, n_threads=n_threads)
            environments.reset(seed=0)
            for _ in range(5):
                observations, *_ = environments.step(np.full((6, 12), 0.3))
            seen.append(observations)
        _same(*seen)


class TestRefusals:
    def test_actions(self):
        environments = WalkerVectorEnv(stand, N)
        environments.reset(seed=0)
        with pytest.raises(ValueError, match=r"shape \(12,\), the walker takes \(3, 12\)"):
            environments.step(np.zeros(12))
        actions = np.zeros((N, 12))
        actions[1, 2] = np.nan
        with pytest.raises(ValueError, match=r"nan for 'FL_calf' of simulation 1"):
            environments.step(actions)

    def test_tasks_whose_reward_nobody_knows(self):
        class Other(Stand):
            """May do anything."""

        with pytest.raises(ValueError, match=r"reward of Other is not known .* reward=function"):
            WalkerVectorEnv(lambda: Other(Quadruped()), N)

    def test_observables_that_compute(self):
        def task():
            made = stand()
            made.observables["quadruped/joints_pos"].corruptor = lambda v, random_state: v + 1
            return made

        with pytest.raises(ValueError, match=r"'quadruped/joints_pos'.* observations="):
            WalkerVectorEnv(task, N)

    def test_functions_of_another_shape(self):
        with pytest.raises(ValueError, match=r"reward returned shape \(\); it should be \(3,\)"):
            WalkerVectorEnv(stand, N, reward=lambda copies: 1.0)

    def test_the_same_task_twice(self):
        task = stand()
        with pytest.raises(ValueError, match="the same task each time"):
            Copies(lambda: task, N)

    def test_walkers_of_others(self):
        with pytest.raises(TypeError, match="no walker with actuators of ours"):
            Copies(lambda: composer.NullTask(floors.Floor()), N)

    def test_drivetrain_laws(self):
        law = StribeckFriction(joint_names_expr=(".*",), breakaway=0.4, velocity=0.05)
        with pytest.raises(ValueError, match="drivetrain laws"):
            WalkerVectorEnv(
                lambda: Stand(MjcfWalker.from_file(QUADRUPED_XML, QUADRUPED_DRIVES, laws=[law])), N
            )


def test_what_diverges_ends_its_episode_alone():
    environments = WalkerVectorEnv(stand, N)
    environments.reset(seed=0)
    environments.copies.field("qvel")[1, 0] = np.nan
    observations, rewards, terminated, _, _ = environments.step(np.zeros((N, 12)))
    np.testing.assert_array_equal(terminated, [False, True, False])
    assert rewards[1] == 0.0
    assert (rewards[[0, 2]] > 0.5).all()
    observations, *_ = environments.step(np.zeros((N, 12)))
    assert all(np.isfinite(values).all() for values in observations.values())


def test_fields_asked_for_in_the_middle_of_an_episode_are_up_to_date():
    environments = WalkerVectorEnv(stand, N)
    environments.reset(seed=0)
    others = singles(stand)
    for other in others:
        other.reset()
    for step in range(3):
        environments.step(np.full((N, 12), 0.1))
        for i, other in enumerate(others):
            other.step(np.full(12, 0.1))
            if step:
                np.testing.assert_array_equal(
                    environments.copies.field("geom_xpos")[i], other.physics.data.geom_xpos
                )


def _same(one, two):
    assert one.keys() == two.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], two[name], err_msg=name)
