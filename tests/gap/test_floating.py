"""Robots that float through the whole workflow: a stool that shifts on its three legs."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_control import composer

from tests.tasks.stools import STOOL
from walkerkit import gap
from walkerkit.actuators import ActuatorCmd, BuiltinPositionActuatorCfg
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.report.console import as_text
from walkerkit.tasks import FallLimits, Stand
from walkerkit.walkers import MjcfWalker

SERVOS = "".join(f'<position joint="{name}" kp="60"/>' for name in ("front", "left", "right"))
MODULE = """
from pathlib import Path
from tests.gap.test_floating import walker
def make():
    return walker(Path(__file__).parent)
"""


def walker(folder: Path) -> MjcfWalker:
    path = folder / "stool.xml"
    path.write_text(STOOL, encoding="utf-8")
    servo = BuiltinPositionActuatorCfg(joint_names_expr=(".*",), stiffness=60.0, damping=1.5)
    return MjcfWalker.from_file(path, servo)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """What a stool in an arena leaves behind as it shifts from leg to leg."""
    robot = walker(tmp_path_factory.mktemp("stool"))
    task = Stand(robot, control_timestep=0.004, joint_noise=0.0, fall=FallLimits(tilt=1.0))
    environment = composer.Environment(task, random_state=0)
    time = 0.0

    def policy(timestep: Any) -> Any:
        nonlocal time
        time += 0.004
        moved = 0.2 + 0.07 * np.sin(np.array([5.0, 7.0, 9.0]) * time) * min(time, 1.0)
        return robot.drivetrain.action_for(ActuatorCmd(position_target=moved))

    return gap.record(environment, policy, seconds=3.0, every="physics_step", name="stool")


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A function that returns the stool, as a user would write it."""
    (tmp_path / "made_stool.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "made_stool", raising=False)
    return "made_stool:make"


def changed(log: Recording, columns: Mapping[str, Any]) -> Recording:
    return replace(log, columns={**log.columns, **columns})


def test_a_walker_s_log_leaves_no_gap_to_the_model_that_made_it(log: Recording, model: str) -> None:
    diagnosis = gap.compare(model, [log])
    assert diagnosis.verdict == "no_gap"
    assert diagnosis.gap.horizon == 0.5
    signals = diagnosis.gap.signals
    assert signals["base_position"].unit == "m"
    assert signals["base_orientation"].unit == "rad"
    assert signals["base_position"].before < 5e-4
    assert signals["base_orientation"].before < 1e-3
    traces = {(trace.joint, trace.signal): trace for trace in diagnosis.traces}
    height = traces["base", "position_z"]
    assert height.unit == "m"
    np.testing.assert_allclose(height.before, height.measured, atol=1e-3)
    assert {"position_x", "orientation_z"} <= {s for joint, s in traces if joint == "base"}
    text = as_text(diagnosis)
    assert "level floor" in text
    assert "The base floats" in text


def test_where_the_log_has_the_floor_does_not_matter(log: Recording, model: str) -> None:
    """Nor which of the two quaternions of a pose it has, nor that its velocities are missing."""
    base = {name: log.columns[name] for name in log.columns if name.startswith("base/")}
    poses = {name: v for name, v in base.items() if "velocity" not in name}
    flipped = {name: v * (-1) ** np.arange(len(v)) for name, v in base.items() if "quat" in name}
    other = changed(log, {**flipped, "base/position_z": base["base/position_z"] + 0.013})
    kept = {name: v for name, v in other.columns.items() if name not in base or name in poses}
    other = replace(other, columns=kept)
    expected, found = (gap.compare(model, [one]).gap for one in (log, other))
    assert expected.position.before < 5e-4
    assert found.position.before < 5e-4
    assert found.signals["base_position"].before < 5e-4


def test_a_velocity_that_contradicts_the_poses_is_told(log: Recording, model: str) -> None:
    drifts = {"base/linear_velocity_y": 1.0 + log.columns["base/linear_velocity_y"]}
    diagnosis = gap.compare(model, [changed(log, drifts)])
    assert diagnosis.gap.position.before < 5e-4
    told = "base/linear_velocity_x, _y and _z contradict how the base's pose changes"
    assert any(told in note for note in diagnosis.notes)
    assert not any("contradict" in note for note in gap.compare(model, [log]).notes)


def test_a_floating_robot_needs_its_base(log: Recording, tmp_path: Path) -> None:
    path = tmp_path / "stool_on_servos.xml"
    path.write_text(STOOL.replace("</worldbody>", f"</worldbody><actuator>{SERVOS}</actuator>"))
    columns = {name: v for name, v in log.columns.items() if "base/position" not in name}
    part = replace(log, columns=columns)
    with pytest.raises(gap.InputError, match="lacks 'base/position_x' and 2 more"):
        gap.compare(path, [part])
    with pytest.raises(gap.InputError, match="hang the robot up"):
        gap.compare(path, [part])


def test_the_base_of_a_mounted_robot_is_unused(log: Recording, tmp_path: Path) -> None:
    path = tmp_path / "hung.xml"
    text = STOOL.replace("</worldbody>", f"</worldbody><actuator>{SERVOS}</actuator>")
    path.write_text(text.replace("<freejoint/>", "").replace('qpos="0 0 0.5 1 0 0 0 ', 'qpos="'))
    diagnosis = gap.compare(path, [log])
    assert diagnosis.gap.horizon is None
    assert set(diagnosis.gap.signals) == {"position", "velocity", "effort"}
    (note,) = [note for note in diagnosis.notes if "nothing uses" in note]
    assert "base/position_x" in note
    assert "base/angular_velocity_z" in note
