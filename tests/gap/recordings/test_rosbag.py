from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.gap.recordings.bag import JOINTS, array, command, positions, trajectory, write_bag
from walkerkit.gap import InputError, Recording
from walkerkit.gap.recordings.rosbag import load_bag

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
