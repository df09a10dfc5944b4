"""Our robots and a real one stand: a small part of `python -m benchmarks standing`."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path
from types import ModuleType

import pytest

from walkerkit.actuators import MOTORS, IdealPdActuatorCfg, gains_from_bandwidth
from walkerkit.walkers import Biped, MjcfWalker, Quadruped


@pytest.fixture
def standing(repository: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(repository))
    return importlib.import_module("benchmarks.standing")


@pytest.mark.parametrize("drive", ["PD", "DC motor"])
@pytest.mark.parametrize("robot", ["quadruped", "biped"])
def test_ours_stand_ten_seconds_behind_a_delay(standing, robot, drive):
    stood = standing.stand(robot, drive, 0)
    assert not stood.fell
    assert stood.tilt < 0.1
    assert stood.height > 0.9
    assert stood.effort < 0.7


@pytest.mark.parametrize("robot", [Quadruped, Biped])
def test_ours_stand_position_controlled(standing, robot):
    stood = standing.hold(robot(position_controlled=True), 0, seconds=3.0)
    assert not stood.fell
    assert stood.effort < 0.7


def test_pose_and_lags_are_random_and_belong_to_the_seed(standing):
    one, again, other = (standing.stand("quadruped", "PD", seed, 0.2) for seed in (0, 0, 1))
    assert one == again
    assert one != other
    assert one.tilt > 0.001


def test_delay_makes_a_difference(standing):
    _, motors = standing.ROBOTS["quadruped"]
    late = standing.late(motors, "DC motor")
    assert [cfg.delay_max_lag * standing.PHYSICS_STEP for cfg in late] == [0.004, 0.004]
    stood, prompt = (
        standing.hold(Quadruped(actuators=cfgs), 0, 0.2) for cfgs in (late, list(motors))
    )
    assert stood != prompt


def test_limp_robots_fall_and_are_seen_to_fall(standing):
    for robot in (Quadruped, Biped):
        limp = IdealPdActuatorCfg(
            joint_names_expr=(".*",), stiffness=1.0, damping=0.1, effort_limit=30.0
        )
        stood = standing.hold(robot(actuators=limp), 0, seconds=2.0)
        assert stood.fell


def test_go1_stands_on_the_gains_and_armatures_of_its_motors(standing, real_logs):
    path = real_logs / "robots" / "unitree_go1" / "go1.xml"
    if not path.is_file():
        pytest.skip(f"{path} is missing: set WALKERKIT_DATA to the folder that holds robots/")
    cfgs = []
    for motor, expressions in (
        ("unitree_go1_hip", (".*_hip_joint", ".*_thigh_joint")),
        ("unitree_go1_knee", (".*_calf_joint",)),
    ):
        data = MOTORS[motor].actuator()
        gains = gains_from_bandwidth(data.reflected_inertia, 2 * 3.1416 * 10, damping_ratio=2.0)
        cfgs.append(
            IdealPdActuatorCfg(
                joint_names_expr=expressions,
                stiffness=gains.stiffness,
                damping=gains.damping,
                effort_limit=data.effort_limit,
                armature=data.reflected_inertia,
            )
        )
    home = {"hip": 0.0, "thigh": 0.9, "calf": -1.8}
    walker = MjcfWalker.from_file(
        path,
        actuators=cfgs,
        home={
            f"{leg}_{joint}_joint": position
            for leg in ("FR", "FL", "RR", "RL")
            for joint, position in home.items()
        },
    )
    assert [name[:2] for name in walker.actuator_group.joint_names[::3]] == ["FR", "FL", "RR", "RL"]
    stood = standing.hold(walker, 0)
    assert not stood.fell
    assert stood.height > 0.8
    assert stood.effort < 0.5


def test_benchmark_has_a_row_for_each_robot_and_drive(standing, monkeypatch, capsys):
    brief = standing.Stood(fell=False, tilt=0.01, height=0.99, effort=0.3)
    fell = dataclasses.replace(brief, fell=True)
    monkeypatch.setattr(standing, "stand", lambda robot, drive, seed: fell if seed == 1 else brief)
    rows = standing.run(quick=True)
    assert len(rows) == 4
    assert rows[0].result.startswith("1 of 2 stand 10 s")
    assert capsys.readouterr().out.count("\n") == 4
