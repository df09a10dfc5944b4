"""The robots that gymnasium ships: degrees, planar roots, floors and settings of long ago."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import mujoco
import pytest

from tests.walkers.others import check_steps, check_trajectory
from walkerkit.walkers.robot_file import read_robot

ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
FILES = sorted(path.name for path in ASSETS.glob("*.xml"))
FLOATING = {"ant.xml", "humanoid.xml", "humanoidstandup.xml"}

pytestmark = pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'")


@pytest.fixture(params=FILES)
def path(request):
    return ASSETS / request.param


@pytest.fixture
def model(path):
    return mujoco.MjModel.from_xml_path(str(path))


def test_there_are_some():
    assert {"ant.xml", "half_cheetah.xml", "pusher.xml", "swimmer.xml", *FLOATING} <= {*FILES}


def test_reading(path, model):
    robot = read_robot(path)
    assert robot.floating == (path.name in FLOATING)
    names = [model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] >= 2]
    assert list(robot.places) == names
    assert (robot.root.worldbody.find("geom", "floor") is None) or not robot.floating


def test_steps(path, model):
    check_steps(path, model)


def test_trajectory(path, model):
    check_trajectory(path, model)
