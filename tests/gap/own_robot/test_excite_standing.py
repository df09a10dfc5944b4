"""What a robot on its feet is sent: it stays on them, in MuJoCo's own simulation too."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.gap.standing.robots import write_four_legs, write_two_legs
from walkerkit.gap import InputError, cli
from walkerkit.gap.own_robot import excite_standing
from walkerkit.gap.own_robot.excite import Battery
from walkerkit.gap.own_robot.excite_standing import standing_targets_for
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.standing import choose
from walkerkit.gap.standing.motions import MOTIONS
from walkerkit.walkers.leg import LEG_XML

SECONDS, RATE = 6.0, 250.0


def battery(path: Path, **options: float) -> Battery:
    robot = load_robot(path)
    return standing_targets_for(
        robot, seconds=SECONDS, rate=RATE, n_threads=1, **{"speed": 15.0, **options}
    )


def played(path: Path, columns: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Height and tilt of the base as MuJoCo alone plays a file from the first keyframe."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    names = {
        model.actuator(a).id: model.joint(model.actuator(a).trnid[0]).name for a in range(model.nu)
    }
    tracks = np.stack([columns[f"{names[a]}/position_target"] for a in range(model.nu)], axis=1)
    heights, tilts = [], []
    hold = round(1 / RATE / model.opt.timestep)
    for row in np.concatenate([tracks[:1].repeat(250, axis=0), tracks]):
        data.ctrl[:] = row
        mujoco.mj_step(model, data, hold)
        heights.append(data.qpos[2])
        tilts.append(float(np.arccos(np.clip(data.xmat[1].reshape(3, 3)[2, 2], -1, 1))))
    return np.array(heights), np.array(tilts)


@pytest.fixture(scope="module", autouse=True)
def few_sizes() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choose, "SIZES", (1.0, 0.35))
        yield


@pytest.fixture(scope="module")
def four_legs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Battery]:
    path = write_four_legs(tmp_path_factory.mktemp("four"))
    return path, battery(path)


@pytest.fixture(scope="module")
def two_legs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Battery]:
    path = write_two_legs(tmp_path_factory.mktemp("two"))
    return path, battery(path, share=0.5)


def test_four_legs_do_all_of_it(four_legs: tuple[Path, Battery]) -> None:
    names = [name.removesuffix(".csv").partition("_")[2] for name in four_legs[1].files]
    assert names == ["small_shift", "shift", "sway", "twist", "squat", "lift", "hop"]


@pytest.mark.parametrize("robot", ["four_legs", "two_legs"])
def test_all_files_leave_the_robot_upright(robot: str, request: pytest.FixtureRequest) -> None:
    path, made = request.getfixturevalue(robot)
    assert len(made.files) >= 5
    first = read_first(made)
    for name, columns in made.files.items():
        heights, tilts = played(path, dict(columns))
        assert tilts.max() < 0.3, name
        assert heights.min() > 0.6 * heights[200], name
        assert heights[-1] == pytest.approx(heights[200], abs=0.02), name
        for column, series in columns.items():
            if column == "time":
                continue
            assert series[0] == pytest.approx(first[column], abs=1e-9), name
            assert series[-1] == pytest.approx(first[column], abs=2e-3), name


def read_first(made: Battery) -> dict[str, float]:
    return {column: float(series[0]) for column, series in next(iter(made.files.values())).items()}


def test_a_hop_leaves_the_ground_and_a_lift_lifts(four_legs: tuple[Path, Battery]) -> None:
    path, made = four_legs
    hop = next(columns for name, columns in made.files.items() if name.endswith("_hop.csv"))
    heights, _ = played(path, dict(hop))
    assert heights.max() > heights[200] + 0.01


def test_the_page_has_what_to_do_and_what_to_log(four_legs: tuple[Path, Battery]) -> None:
    page = four_legs[1].readme
    for word in (
        "slack rope",
        "emergency stop",
        "`1_small_shift.csv` | 30%",
        "base/imu_angular_velocity_x",
        "`FL_foot`",
        "-40% and +25%",
        "`FL_calf` |",
    ):
        assert word in page


def only(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Leaves out the other motions, which others see here."""
    few = [motion for motion in MOTIONS if motion.name in names]
    monkeypatch.setattr(excite_standing, "safe_motions", partial(choose.safe_motions, motions=few))


def test_what_drives_cannot_do_is_left_out_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    only(monkeypatch, "squat", "hop")
    made = battery(write_four_legs(tmp_path, limit=8.0), share=0.3)
    left = [note for note in made.notes if "is left out" in note]
    assert any(note.startswith("hop ") and "N·m of its 8" in note for note in left)
    assert not any(name.endswith("_hop.csv") for name in made.files)
    assert left[0][1:] in made.readme


def test_robots_that_do_not_stand_are_refused(tmp_path: Path) -> None:
    weak = write_four_legs(tmp_path, limit=2.0)
    with pytest.raises(InputError, match=r"does not stand still .* walkerkit servo MODEL"):
        battery(weak)
    with pytest.raises(InputError, match="leave out --standing for one that hangs"):
        battery(LEG_XML)
    with pytest.raises(InputError, match=r"seconds is 3\. A robot on its feet takes 6 or more"):
        standing_targets_for(load_robot(weak), seconds=3.0)


def test_motors_are_to_become_servos_first(tmp_path: Path) -> None:
    path = write_two_legs(tmp_path)
    text = path.read_text().replace("<position ", "<motor ")
    path.write_text(text.replace(' kp="300" kv="6" forcerange="-80 80"', ""))
    with pytest.raises(InputError, match=r"'left_yaw'.* take no positions.* walkerkit servo"):
        battery(path)


def test_the_command_writes_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    only(monkeypatch, "shift", "squat")
    path, out = write_two_legs(tmp_path), tmp_path / "targets"
    options = ["--standing", "--seconds", 6, "--rate", 100, "--share", 0.4, "--threads", 1]
    arguments = ["walkerkit", "excite", path, "--out", out, *options]
    monkeypatch.setattr(sys, "argv", [*map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    told = capsys.readouterr()
    assert "trying to squat" in told.err
    assert str(out / "README.md") in told.out
    files = sorted(out.glob("*.csv"))
    assert files[0].name == "1_small_shift.csv"
    rows = files[0].read_text().splitlines()
    assert rows[0].startswith("time,left_yaw/position_target")
    assert len(rows) == 601


def test_single_joints_are_for_robots_that_hang(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_two_legs(tmp_path)
    arguments = ["walkerkit", "excite", path, "--standing", "--joint", "left_knee"]
    monkeypatch.setattr(sys, "argv", [*map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert "Leave out --joint or --standing" in capsys.readouterr().err
