from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.gap.ingest.bag import (
    JOINTS,
    array,
    command,
    joint_state,
    positions,
    trajectory,
    trajectory_of,
    write_bag,
)
from walkerkit.gap import InputError, Recording
from walkerkit.gap.ingest.rosbag import load_bag

FIRST = 10 / 200  # s, when the first command is given


@pytest.mark.parametrize("mcap", [True, False])
@pytest.mark.parametrize("commands", [command, trajectory, array])
def test_a_bag_is_a_recording(tmp_path: Path, commands: object, mcap: bool) -> None:
    path = write_bag(tmp_path / "run", commands, mcap=mcap)
    joints = JOINTS if commands is array else ()
    recording = load_bag(path, command_topic="/joint_commands", joints=joints)
    assert (recording.name, recording.joints) == ("run", JOINTS)
    time = recording.time + FIRST
    np.testing.assert_allclose(recording.time[:3], [0, 0.005, 0.01], atol=1e-9)
    hip, _ = np.array([positions(t) for t in time]).T
    np.testing.assert_allclose(recording.signal("hip", "position"), hip, atol=1e-9)
    np.testing.assert_allclose(recording.signal("knee", "effort"), time * 200, atol=1e-6)
    assert recording.signal("knee", "velocity") is None
    # The last command that was given, until the next one, 20 ms later.
    given = FIRST + 0.02 * np.floor((time - FIRST) / 0.02 + 1e-6)
    told = np.array([positions(t + 0.05) for t in given])
    np.testing.assert_allclose(recording.signal("hip", "position_target"), told[:, 0], atol=1e-9)
    np.testing.assert_allclose(recording.signal("knee", "position_target"), told[:, 1], atol=1e-9)
    assert any("10 joint states before the first commands" in note for note in recording.notes)
    assert any("no stamps" in note for note in recording.notes) == (commands is array)


def test_a_trajectory_goes_from_point_to_point_until_the_next(tmp_path: Path) -> None:
    """Each command is where the joint is, and where it should be 0.04 s later; one comes at 0.02 s.

    So every target is cut short half way, and goes on from there.
    """
    goals = itertools.cycle([0.4, -0.4])

    def through(stamp: int, position: list[float]) -> Any:
        goal = next(goals)
        return trajectory_of(stamp, [(0.04, {"positions": [goal, 2 * goal]})])

    path = write_bag(tmp_path / "run", through)
    recording = load_bag(path, command_topic="/joint_commands")
    time = recording.time + FIRST
    start = positions(FIRST)
    for joint, where, size in (("hip", start[0], 0.4), ("knee", start[1], 0.8)):
        expected, target = [], where
        for k, now in enumerate(time):
            since, goal = k % 4 * 0.005, size * (-1) ** (k // 4)
            if k % 4 == 0 and k:
                target += (-goal - target) / 2
            expected.append(target + (goal - target) * since / 0.04)
            assert now == pytest.approx(FIRST + 0.005 * k)
        np.testing.assert_allclose(recording.signal(joint, "position_target"), expected, atol=1e-9)
    assert recording.signal("hip", "velocity_target") is None
    assert any("go from point to point, as a joint_traj" in note for note in recording.notes)


def test_a_trajectory_ends_where_it_was_to(tmp_path: Path) -> None:
    """Planned as a whole: one message, with velocities."""
    sent = itertools.count()

    def planned(stamp: int, position: list[float]) -> Any:
        points = [(0.0, {"positions": [0, 0], "velocities": [0, 0]})]
        points += [(0.5, {"positions": [1, 2], "velocities": [0, 0]})]
        return trajectory_of(stamp, points if next(sent) == 0 else [])

    recording = load_bag(write_bag(tmp_path / "run", planned), command_topic="/joint_commands")
    part = np.minimum(recording.time / 0.5, 1)
    wanted = 3 * part**2 - 2 * part**3
    np.testing.assert_allclose(recording.signal("hip", "position_target"), wanted, atol=1e-9)
    slope = 12 * 2 * part * (1 - part)
    np.testing.assert_allclose(recording.signal("knee", "velocity_target"), slope, atol=1e-9)


def test_a_trajectory_that_goes_back_in_time_is_refused(tmp_path: Path) -> None:
    def back(stamp: int, position: list[float]) -> Any:
        return trajectory_of(stamp, [(0.1, {"positions": position})] * 2)

    path = write_bag(tmp_path / "run", back)
    message = r"run: topic '/joint_commands' has a trajectory with points at 0\.1, 0\.1 s from"
    with pytest.raises(InputError, match=message):
        load_bag(path, command_topic="/joint_commands")


def with_gaps(every: int, **gaps: object) -> Callable[..., Any]:
    """Joint states of which one in so many is not as the others."""
    count = itertools.count(1)

    def state(stamp: int, position: list[float], **more: Any) -> Any:
        given = {"position": position, **more}
        return joint_state(stamp, **given | (gaps if next(count) % every == 0 else {}))

    return state


def test_few_states_that_lack_a_number_are_left_out(tmp_path: Path) -> None:
    states = with_gaps(50, effort=[np.nan, 1.0], velocity=[np.inf, np.nan])
    path = write_bag(tmp_path / "run", states=states)
    recording = load_bag(path, command_topic="/joint_commands")
    whole = load_bag(write_bag(tmp_path / "whole"), command_topic="/joint_commands")
    kept = np.flatnonzero((np.arange(len(whole.time)) + 11) % 50)
    assert len(kept) == len(whole.time) - 4
    assert list(recording.columns) == list(whole.columns)
    np.testing.assert_allclose(recording.time, whole.time[kept], atol=1e-9)
    for column, values in whole.columns.items():
        np.testing.assert_array_equal(recording.columns[column], values[kept])
    assert (
        "hip/effort is no number in 4 of 190 joint states; these were left out" in recording.notes
    )
    assert not any("velocity" in note for note in recording.notes)  # which was never measured


def test_a_signal_that_often_lacks_a_number_is_left_out(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run", states=with_gaps(5, effort=[np.nan, 1.0]))
    recording = load_bag(path, command_topic="/joint_commands")
    assert recording.signal("hip", "effort") is None
    assert recording.signal("knee", "effort") is not None
    assert len(recording.time) == 190
    told = "hip/effort is no number in 38 of 190 joint states; the column was left out"
    assert told in recording.notes


def test_a_position_that_often_lacks_a_number_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run", states=with_gaps(5, position=[0.1, np.nan]))
    message = "knee/position is no number in 38 of 190 joint states of '/joint_states'. Mend"
    with pytest.raises(InputError, match=message):
        load_bag(path, command_topic="/joint_commands")


@pytest.mark.parametrize("commands", [command, array])
def test_a_command_that_is_no_number_leaves_the_one_before(
    tmp_path: Path, commands: Callable[..., Any]
) -> None:
    count = itertools.count()

    def told(stamp: int, position: list[float]) -> Any:
        return commands(stamp, [np.nan if next(count) == 9 else position[0], position[1]])

    joints = JOINTS if commands is array else ()
    path = write_bag(tmp_path / "run", told)
    recording = load_bag(path, command_topic="/joint_commands", joints=joints)
    hip = recording.columns["hip/position_target"]
    assert len(np.unique(hip[36:44])) == 2  # of the tenth command, at 36
    assert hip[36] == hip[35]
    lacking = "1 of 48 commands of hip/position are no numbers; those before them were held"
    assert lacking in recording.notes


def test_it_saves_and_loads_as_any_other(tmp_path: Path) -> None:
    recording = load_bag(write_bag(tmp_path / "run"), command_topic="/joint_commands")
    recording.save(tmp_path / "run.csv")
    again = Recording.load(tmp_path / "run.csv")
    for column, values in recording.columns.items():
        np.testing.assert_allclose(again.columns[column], values, atol=1e-12)


def test_numbers_without_names_may_be_efforts(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run", array)
    (file,) = path.glob("*.mcap")
    recording = load_bag(
        file, command_topic="/joint_commands", joints=JOINTS, target="effort", name="torques"
    )
    assert recording.name == "torques"
    assert recording.signal("knee", "effort_target") is not None
    assert recording.signal("knee", "position_target") is None


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        ({"command_topic": "/joint_comands"}, ("'/joint_comands'", "did you mean")),
        ({"command_topic": "/joint_commands"}, ("Float64MultiArray", "joints=")),
        ({"command_topic": "/joint_commands", "joints": ["hip"]}, ("2 numbers", "1 joints")),
        ({"command_topic": "/joint_commands", "joints": ["a", "b"]}, ("a, b", "hip, knee")),
        (
            {"command_topic": "/joint_states", "joint_topic": "/joint_commands"},
            ("'/joint_commands' is of std_msgs", "JointState"),
        ),
    ],
)
def test_what_cannot_be_read_is_refused(
    tmp_path: Path, options: dict[str, object], parts: tuple[str, ...]
) -> None:
    path = write_bag(tmp_path / "run", array, seconds=0.2)
    with pytest.raises(InputError) as refused:
        load_bag(path, **options)  # type: ignore[arg-type]
    for part in (str(path), *parts):
        assert part in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such bag"):
        load_bag(tmp_path / "nothing", command_topic="/c")
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mcap").write_text("no bag")
    for path in ("empty", "text.mcap"):
        with pytest.raises(InputError, match="cannot be read as a bag"):
            load_bag(tmp_path / path, command_topic="/c")
