"""The tests that dm_control and dm_env ship, pointed at our walkers.

Each class below is a test class of theirs whose robot was exchanged for one of ours: what they ask
of their own walkers they ask of these. Not pointed at us, since there is no walker in them or one
that nothing can stand in for: `composer/environment_test` and `composer/entity_test` (entities of
their own, counted), `walkers/rescale_test` and `walkers/scaled_actuators_test` (functions on MJCF),
`soccer/boxhead_test` and `soccer/humanoid_test` (visuals of those two), arenas, props and mocap.
"""

from __future__ import annotations

import os
from dataclasses import replace
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest
from absl.testing import absltest
from dm_control import composer
from dm_control.composer import hooks_test_utils
from dm_control.composer.observation import observable
from dm_control.locomotion.arenas import corridors as corridor_arenas
from dm_control.locomotion.arenas import floors
from dm_control.locomotion.examples import basic_cmu_2019, basic_rodent_2020, examples_test
from dm_control.locomotion.soccer import task_test as soccer_task_test
from dm_control.locomotion.tasks import corridors as corridor_tasks
from dm_control.locomotion.tasks import (
    corridors_test,
    escape_test,
    go_to_target,
    go_to_target_test,
    random_goal_maze_test,
    reach_test,
)
from dm_control.locomotion.walkers import (
    ant,
    ant_test,
    base_test,
    cmu_humanoid,
    cmu_humanoid_test,
    jumping_ball,
    jumping_ball_test,
    rodent,
    rodent_test,
)
from dm_control.mujoco import engine
from dm_env import test_utils

from tests.walkers.robots import DOG, write
from walkerkit.actuators import IdealPdActuatorCfg
from walkerkit.walkers import MjcfWalker, Quadruped, with_actuators
from walkerkit.walkers.actions import JointPositionAction
from walkerkit.walkers.robot_file import read_robot

HOLD = JointPositionAction(joint_names_expr=(".*",), scale=0.3)
# Their tasks' specs are of controls, and their tests draw actions from the whole of them.
BOUNDED = replace(HOLD, clip=(-1.0, 1.0))
GENTLE = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=0.05, damping=1e-5)
SIGHTED = os.environ.get("MUJOCO_GL") not in ("disable", "disabled", "off", "false", "0")


def seeing(walker):
    """The walker, with a black picture for its camera where there is nothing to render with."""
    if not SIGHTED:
        for name in ("egocentric_camera", "body_camera"):
            if name in walker.observables._observables:
                black = observable.Generic(lambda _: np.zeros((64, 64, 3), dtype=np.uint8))
                walker.observables._observables[name] = black
                walker.observables.__dict__[name] = black
    return walker


def refitted(cls):
    """dm_control's own walker, driven by actuators of ours."""

    def make(*args, **kwargs):
        return seeing(with_actuators(cls(*args, **kwargs), GENTLE, action=BOUNDED))

    return make


@pytest.fixture(scope="session")
def dog_file(tmp_path_factory):
    return write(tmp_path_factory.mktemp("robots"), DOG, "dog.xml")


class Exchanged:
    """Puts robots of ours where a module of theirs looks for its own."""

    robot = None

    @pytest.fixture(autouse=True)
    def exchange(self, monkeypatch, dog_file):
        if not SIGHTED:
            # Bowls upload their height field to a renderer, if there is one.
            monkeypatch.setattr(engine.Physics, "contexts", None)
        pd = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=60.0, damping=1.0)

        def dog(name=None, **_):
            walker = MjcfWalker.from_file(dog_file, pd, name=name or "walker", action=HOLD)
            return seeing(walker)

        def of(cls):
            def make(name="walker", **_):
                return seeing(cls(name=name, action=HOLD))

            return make

        made = {"dog": dog, "quadruped": of(Quadruped)}
        made |= {
            "humanoid": refitted(cmu_humanoid.CMUHumanoid),
            "rat": refitted(rodent.Rat),
            "ant": refitted(ant.Ant),
            "ball": refitted(jumping_ball.JumpingBallWithHead),
        }
        self.make = made[self.robot]
        self.exchanged(monkeypatch, self.make)

    def exchanged(self, monkeypatch, make):
        raise NotImplementedError


def pointed(theirs, patch, robots, without=()):
    """Test classes of theirs, one for each robot; `without` are tests that ask for another's."""
    for robot in robots:

        class Ours(Exchanged, theirs):
            pass

        Ours.robot = robot
        Ours.exchanged = lambda self, monkeypatch, make: patch(monkeypatch, make)
        for name in without:
            tests = [test for test in dir(theirs) if test.startswith(name)]
            assert tests, f"{theirs.__name__} has no test {name!r} any more"
            for test in tests:
                setattr(Ours, test, None)
        Ours.__name__ = Ours.__qualname__ = f"Test{theirs.__name__}On{robot.title()}"
        Ours.__module__ = __name__
        globals()[Ours.__name__] = Ours


def patch_ant(monkeypatch, make):
    monkeypatch.setattr(ant_test, "ant", SimpleNamespace(Ant=make))


def patch_rat(module):
    def patch(monkeypatch, make):
        monkeypatch.setattr(module, "rodent", SimpleNamespace(Rat=make))

    return patch


def patch_humanoid(module):
    def patch(monkeypatch, make):
        monkeypatch.setattr(module, "cmu_humanoid", SimpleNamespace(CMUHumanoid=make))

    return patch


def patch_ball(monkeypatch, make):
    replaced = SimpleNamespace(JumpingBallWithHead=make)
    monkeypatch.setattr(jumping_ball_test, "jumping_ball", replaced)


def patch_soccer(monkeypatch, make):
    monkeypatch.setattr(soccer_task_test, "_walker", lambda name, *_: make(name=name))


# One read from a file, and one that is a class of its own.
OURS = ("dog", "quadruped")

# Of their own robots some tests ask for parts by name, which ours do not have.
pointed(ant_test.AntTest, patch_ant, ("ant",))
pointed(ant_test.AntTest, patch_ant, OURS, without=("test_evaluate_observable",))
pointed(rodent_test.RatTest, patch_rat(rodent_test), ("rat",))
pointed(
    rodent_test.RatTest,
    patch_rat(rodent_test),
    OURS,
    without=("test_get_element", "test_evaluate_observable"),
)
pointed(jumping_ball_test.JumpingBallWithHeadTest, patch_ball, ("ball", *OURS))

# Of the quaternion of a walker that stands upright when it is not turned, their own ant's as well,
# it asks for zeros that rounding does not leave.
TURNED = "test_walker_is_correctly_reinitialized1"
# It takes the first contact for that with the floor; the quadruped's legs touch each other before.
FALLEN = "test_termination"
FALLS = ("dog", "humanoid")
corridors, targets, mazes = map(
    patch_humanoid, (corridors_test, go_to_target_test, random_goal_maze_test)
)
pointed(corridors_test.CorridorsTest, corridors, ("humanoid",))
pointed(corridors_test.CorridorsTest, corridors, ("dog",), without=(TURNED,))
pointed(corridors_test.CorridorsTest, corridors, ("quadruped",), without=(TURNED, FALLEN))
pointed(go_to_target_test.GoToTargetTest, targets, FALLS)
pointed(go_to_target_test.GoToTargetTest, targets, ("quadruped",), without=(FALLEN,))
pointed(random_goal_maze_test.RandomGoalMazeTest, mazes, FALLS)
pointed(random_goal_maze_test.RandomGoalMazeTest, mazes, ("quadruped",), without=(FALLEN,))
# These two tasks take no walkers but theirs.
pointed(escape_test.EscapeTest, patch_rat(escape_test), ("rat", "humanoid"))
pointed(reach_test.ReachTest, patch_rat(reach_test), ("rat", "humanoid"))

# Rendering needs what may not be there, and the throw-in puts robots with legs into the floor.
SOCCER = ("test_render", "test_throw_in")
pointed(soccer_task_test.TaskTest, patch_soccer, ("dog",), without=SOCCER)
pointed(soccer_task_test.UniformInitializerTest, patch_soccer, ("quadruped",))
pointed(soccer_task_test.MultiturnTaskTest, patch_soccer, OURS)


class TestHumanoidOfOurs(Exchanged, cmu_humanoid_test.CMUHumanoidTest):
    """What is left of it with other actuators; their order and gains are the point of the rest."""

    robot = "humanoid"
    test_actuators_sorted_alphabetically0 = None
    test_actuators_sorted_alphabetically1 = None
    test_cmu_humanoid_position_controlled_has_correct_actuators = None
    test_cmu_pose_to_actuation = None

    def exchanged(self, monkeypatch, make):
        replaced = SimpleNamespace(**vars(cmu_humanoid))
        replaced.CMUHumanoid = make
        replaced.CMUHumanoidPositionControlled = refitted(
            cmu_humanoid.CMUHumanoidPositionControlled
        )
        monkeypatch.setattr(cmu_humanoid_test, "cmu_humanoid", replaced)


class TestFramesOfOurs(base_test.BaseWalkerTest):
    """Their walker is a torso turned by 90°."""

    @pytest.fixture(autouse=True)
    def exchange(self, monkeypatch, tmp_path):
        text = """<mujoco model="walker"><worldbody>
          <body name="torso" xyaxes="0 1 0 -1 0 0"><geom size="0.1"/>
            <body name="leg"><joint name="hip"/><geom size="0.1"/></body></body>
          </worldbody></mujoco>"""
        path = write(tmp_path, text)
        cfg = IdealPdActuatorCfg(joint_names_expr=("hip",), stiffness=1.0, damping=0.01)
        monkeypatch.setattr(base_test, "FakeWalker", lambda: MjcfWalker.from_file(path, cfg))


class TestExamplesOfOurs(examples_test.ExampleEnvironmentsTest):
    """All of their example environments, with the walkers refitted."""

    @pytest.fixture(autouse=True)
    def exchange(self, monkeypatch):
        if not SIGHTED:
            monkeypatch.setattr(engine.Physics, "contexts", None)
        monkeypatch.setattr(examples_test, "_NUM_EPISODES", 2)  # a first one, and one after it
        humanoid = refitted(cmu_humanoid.CMUHumanoidPositionControlled)
        monkeypatch.setattr(basic_cmu_2019.cmu_humanoid, "CMUHumanoidPositionControlled", humanoid)
        monkeypatch.setattr(basic_rodent_2020.rodent, "Rat", refitted(rodent.Rat))


@pytest.mark.usefixtures("dog_file")
class EnvironmentContract(test_utils.EnvironmentTestMixin):
    """dm_env's: an episode ends after five steps, so that ends are seen as well."""

    @pytest.fixture(autouse=True)
    def remember_file(self, dog_file):
        self.dog_file = dog_file

    def make_action_sequence(self):
        random_state = np.random.RandomState(0)
        spec = self.environment.action_spec()
        for _ in range(12):
            yield random_state.uniform(spec.minimum, spec.maximum)


class TestCorridorEnvironment(EnvironmentContract, absltest.TestCase):
    def make_object_under_test(self):
        pd = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=60.0, damping=1.0)
        walker = seeing(MjcfWalker.from_file(self.dog_file, pd))
        task = corridor_tasks.RunThroughCorridor(walker, corridor_arenas.EmptyCorridor())
        return composer.Environment(task, time_limit=0.1, random_state=0)


class TestQuadrupedEnvironment(EnvironmentContract, absltest.TestCase):
    def make_object_under_test(self):
        walker = seeing(Quadruped())
        task = corridor_tasks.RunThroughCorridor(walker, corridor_arenas.EmptyCorridor())
        return composer.Environment(task, time_limit=0.1, random_state=0)


class TrackedWalker(hooks_test_utils.HooksTracker, MjcfWalker):
    """Counts the hooks that composer calls, around those of the walker."""


class TestHooks(hooks_test_utils.HooksTestMixin, absltest.TestCase):
    """Composer's: hooks come in their order, each as often as it should, through ours as well."""

    @pytest.fixture(autouse=True)
    def remember_file(self, dog_file):
        self.dog_file = dog_file

    def setUp(self):
        super().setUp()
        timesteps = {
            "physics_timestep": self.physics_timestep,
            "control_timestep": self.control_timestep,
        }
        pd = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=60.0, damping=1.0)
        walker = TrackedWalker(
            test_case=self, robot=read_robot(self.dog_file), actuators=pd, action=HOLD, **timesteps
        )
        self.task.root_entity.attach(walker)
        walker.create_root_joints(walker.parent.mjcf_model.find("attachment_frame", "dog"))
        self.entities.append(walker)
        self.num_episodes, self.steps_per_episode = 2, 20

    def test_scheduling(self):
        env = composer.Environment(self.task)
        for name in composer.HOOK_NAMES:
            env.add_extra_hook(name, getattr(self.extra_hooks, name))
        for _ in range(self.num_episodes):
            with self.track_episode():
                env.reset()
                for _ in range(self.steps_per_episode):
                    env.step(np.zeros(env.action_spec().shape))


def test_a_quadruped_on_its_back_has_fallen():
    walker = Quadruped(action=HOLD)
    task = go_to_target.GoToTarget(walker, floors.Floor())
    environment = composer.Environment(task, random_state=0)
    environment.reset()
    walker.set_pose(environment.physics, position=(0, 0, 0.2), quaternion=(0, 1, 0, 0))
    assert any(environment.step(np.zeros(12)).last() for _ in range(20))


def test_nothing_was_forgotten():
    """Every test module of their walkers and tasks is either pointed at us or named above."""
    shipped = {
        path.name.removesuffix(".py")
        for package in ("walkers", "tasks", "examples")
        for path in resources.files(f"dm_control.locomotion.{package}").iterdir()
        if path.name.endswith("_test.py")
    }
    modules = {
        value.__name__.rpartition(".")[2]
        for value in globals().values()
        if getattr(value, "__name__", "").endswith("_test")
    }
    assert shipped - modules == {"rescale_test", "scaled_actuators_test"}
