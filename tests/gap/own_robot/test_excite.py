from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from walkerkit.gap import InputError, cli
from walkerkit.gap.own_robot.excite import ORDER, targets_for
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.tasks.excitation import BATTERY
from walkerkit.walkers.leg import LEG_XML

ARM = """
<mujoco><compiler angle="radian"/><worldbody>
  <body><joint name="first" axis="0 1 0" range="-2 2"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02"/>
    <body pos="0 0 -0.3"><joint name="second" axis="0 1 0" range="-1.5 3.1"/>
      <geom type="capsule" fromto="0 0 -0.06 0 0 -0.28" size="0.02"/>
      <body pos="0 0 -0.3"><joint name="third" axis="0 1 0" range="-3.1 3.1"/>
        <geom type="capsule" fromto="0 0 -0.06 0 0 -0.4" size="0.02"/></body></body></body>
</worldbody><actuator>
  <position joint="first" kp="9" ctrlrange="-0.1 2"/><motor joint="second"/><motor joint="third"/>
</actuator><keyframe><key qpos="0 {second} {third}"/></keyframe></mujoco>
"""


def test_the_order_has_all_of_the_battery() -> None:
    assert set(ORDER) == set(BATTERY)


def test_targets_stay_within_limits_and_their_speed(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(second=0, third=0))
    battery = targets_for(load_robot(path), seconds=4, rate=200, speed=1.5)
    assert len(battery.files) == 1 + len(BATTERY)
    spans = []
    for columns in battery.files.values():
        time = columns["time"]
        assert len(time) == 800
        first = columns["first/position_target"]
        assert -0.1 <= first.min() < first.max() <= 2
        for joint in ("first", "second", "third"):
            target = columns[f"{joint}/position_target"]
            assert np.abs(np.diff(target) / np.diff(time)).max() <= 1.5 * (1 + 1e-9)
            assert target[0] == pytest.approx(target[-1], abs=1e-9)
        spans.append(np.ptp(first))
    assert spans[0] == pytest.approx(spans[1] / 10, rel=0.2)
    for word in ("emergency stop", "`first` |", "`<joint>/position`", "1_small_slow_triangle.csv"):
        assert word in battery.readme


def test_a_model_that_could_not_be_compared_is_told(tmp_path: Path) -> None:
    path, arm = tmp_path / "arm.xml", ARM.format(second=0, third=0)
    first = '<body><joint name="first"'
    floating = arm.replace(first, f'<body><freejoint/><geom size="0.1" contype="0"/>{first}')
    floating = floating.replace("</worldbody>", "</body></worldbody>")
    path.write_text(floating.replace('qpos="', 'qpos="0 0 1 1 0 0 0 '))
    floats, motors = targets_for(load_robot(path), seconds=2, rate=100).notes[:2]
    assert "`walkerkit hang`" in floats
    assert motors.startswith("'second', 'third' have torque motors")
    path.write_text(arm.replace("<motor", '<position kp="9"'))
    assert not any("walkerkit" in note for note in targets_for(load_robot(path), seconds=2).notes)


def test_links_do_not_meet_on_the_way(tmp_path: Path) -> None:
    """At home the last link is beside the first, so that the whole room would drive it in there."""
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(second=2.3, third=1.3))
    robot = load_robot(path)
    battery = targets_for(robot, seconds=4, rate=100)
    (shrunk,) = (n for n in battery.notes if "of their room, so that links do not meet" in n)
    assert shrunk.split(",")[0].replace("targets", "Targets") in battery.readme
    data = mujoco.MjData(robot.model)
    for columns in battery.files.values():
        poses = np.stack([columns[f"{j}/position_target"] for j in robot.joints], axis=1)
        for pose in poses[::2]:
            data.qpos[:] = pose
            mujoco.mj_forward(robot.model, data)
            assert data.ncon == 0


def test_the_command_writes_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "targets"
    arguments = ["walkerkit", "excite", LEG_XML, "--out", out, "--seconds", 2, "--joint", "calf"]
    monkeypatch.setattr(sys, "argv", [*map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    names = sorted(path.name for path in out.iterdir() if not path.name.startswith("."))
    assert names[0] == "1_small_slow_triangle.csv"
    assert len(names) == 2 + len(BATTERY)
    header = (out / names[0]).read_text().splitlines()[0]
    assert header == "time,calf/position_target"
    assert str(out / "README.md") in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"seconds": 0}, ("seconds is 0", "up to 600")),
        ({"share": 1.5}, ("share is 1.5", "up to 1")),
        ({"joints": ["clf"]}, ("'clf'", "did you mean 'calf'")),
    ],
)
def test_numbers_that_make_no_sense(options: dict[str, object], words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as refused:
        targets_for(load_robot(LEG_XML), **options)  # type: ignore[arg-type]
    for word in words:
        assert word in str(refused.value)
