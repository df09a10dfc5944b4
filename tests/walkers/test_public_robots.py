"""Go1 and H1 as their makers' files have them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from dm_control import composer

from tests.walkers.others import check_steps, check_trajectory, driven
from tests.walkers.robots import corridor_task, go_to_target_task
from walkerkit.actuators import IdealPdActuatorCfg
from walkerkit.walkers import MjcfWalker
from walkerkit.walkers.robot_file import read_robot

LEG = ("hip", "thigh", "calf")


@pytest.fixture
def go1(real_logs):
    return real_logs / "robots" / "unitree_go1" / "go1.xml"


@pytest.fixture
def h1(real_logs):
    return real_logs / "robots" / "unitree_h1" / "h1.xml"


@pytest.fixture(params=["go1", "h1"])
def path(request):
    return request.getfixturevalue(request.param)


def plain(path):
    return mujoco.MjModel.from_xml_path(str(path))


def test_steps(path):
    check_steps(path, plain(path))


def test_trajectory(path):
    check_trajectory(path, plain(path))


def test_go1(go1):
    robot = read_robot(go1)
    assert robot.floating
    assert robot.root_body.name == "trunk"
    assert list(robot.places) == [
        f"{leg}_{j}_joint" for leg in ("FR", "FL", "RR", "RL") for j in LEG
    ]
    assert robot.left_out == ("sensor imu_upvector",)
    np.testing.assert_array_equal(robot.poses[""][0], [0, 0, 0.445])


def test_h1_with_its_scene(h1):
    path = h1.parent / "scene.xml"
    robot = read_robot(path)
    assert robot.floating
    assert robot.root_body.name == "pelvis"
    np.testing.assert_array_equal(robot.poses["stand"][0], [0, 0, 0.98])
    np.testing.assert_array_equal(robot.keyframes["stand"][:5], [0, 0, -0.4, 0.8, -0.4])
    assert {"geom floor", "body com_target", "body left_foot_target"} <= set(robot.left_out)
    assert list(robot.places) == list(read_robot(h1).places)


@pytest.mark.parametrize(
    ("robot", "make_task"), [("go1", corridor_task), ("h1", go_to_target_task)]
)
def test_in_tasks(robot, make_task, request):
    path = request.getfixturevalue(robot)
    model = plain(path)
    names = driven(model) or (".*",)
    cfg = IdealPdActuatorCfg(joint_names_expr=names, stiffness=40.0, damping=1.0, armature=0.05)
    walker = MjcfWalker.from_file(path, cfg)
    environment = composer.Environment(make_task(walker), random_state=0)
    for _ in range(2):
        timestep = environment.reset()
        for _ in range(10):
            timestep = environment.step(walker.action_for())
            assert all(np.isfinite(value).all() for value in timestep.observation.values())
