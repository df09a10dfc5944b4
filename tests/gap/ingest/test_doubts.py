"""What cannot be told is refused in one line, and the line's remedy works when it is followed."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from tests.gap.ingest import writers
from tests.gap.ingest.writers import JOINTS, WRITERS, matrix
from walkerkit.gap import InputError, Recording
from walkerkit.gap.ingest.column_map import ColumnMap
from walkerkit.gap.ingest.importing import Imported, import_log
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.walkers.leg import LEG_XML


def read(path: Path, text: str = "") -> Imported:
    """Imports a log by a map of which the text is given."""
    file = path.parent / "map.toml"
    file.write_text(text)
    return import_log(path, load_robot(LEG_XML), ColumnMap.load(file) if text else None)


def refused(path: Path, *words: str, text: str = "") -> str:
    with pytest.raises(InputError) as error:
        read(path, text)
    message = str(error.value)
    assert len(message.splitlines()) == 1
    for word in (str(path), *words):
        assert word in message
    return message


def table(path: Path, log: Recording, **more: Any) -> Path:
    """An NPZ of the leg's position and targets with other arrays."""
    arrays = {
        "time": log.time,
        "q": matrix(log, "position"),
        "q_des": matrix(log, "position_target"),
        **more,
    }
    np.savez(path, **{name: values for name, values in arrays.items() if values is not None})
    return path


def test_two_columns_that_may_be_the_command(tmp_path: Path, log: Recording) -> None:
    sent = matrix(log, "position_target")
    path = table(tmp_path / "log.npz", log, q_cmd=sent + 1)
    refused(path, "position_target may be 'q_des[{}]' or 'q_cmd[{}]'", "[signals.position_target]")
    (recording,) = read(path, '[signals.position_target]\nfrom = "q_cmd[{}]"').recordings
    np.testing.assert_array_equal(recording.columns["thigh/position_target"], sent[:, 1] + 1)


def test_no_command(tmp_path: Path, log: Recording) -> None:
    path = table(tmp_path / "log.npz", log, q_des=None, u=matrix(log, "position_target"))
    refused(path, "no column looks like the position target", "'u[{}]'")
    (recording,) = read(path, '[signals.position_target]\nfrom = "u[{}]"').recordings
    assert recording.signal("calf", "position_target") is not None


def test_as_many_numbers_as_no_joints(tmp_path: Path, log: Recording) -> None:
    q, sent = matrix(log, "position"), matrix(log, "position_target")
    path = table(tmp_path / "log.npz", log, q=np.c_[q, q[:, :1]], q_des=np.c_[sent, sent[:, :1]])
    refused(path, "'q[{}]' has 4 numbers", "3 driven joints, hip, thigh, calf", 'hip = "0"')
    (recording,) = read(path, '[joints]\nhip = "3"\nthigh = "1"\ncalf = "2"').recordings
    np.testing.assert_array_equal(recording.columns["hip/position"], q[:, 0])


def test_an_unknown_joint(tmp_path: Path, log: Recording) -> None:
    path = table(tmp_path / "log.npz", log)
    with pytest.raises(InputError, match=r"map.toml: joint 'knee' is not in the model .*leg.xml"):
        read(path, '[joints]\nknee = "0"')
    refused(path, "'q[{}]' has 3 numbers, 0, 1, 2,", text='[joints]\nhip = "9"')
    text = '[joints]\nhip = "0"\nthigh = "9"'
    refused(path, "joint 'thigh' has no position", "'q[9]'", text=text)


def test_a_missing_topic(tmp_path: Path, log: Recording) -> None:
    path = WRITERS["bag_mcap_joint_states"].write(log, tmp_path)
    text = '[signals.position_target]\nfrom = "/commands/{}/position"'
    refused(path, "no column '/commands/{}/position'", "'/joint_commands/{}/position'", text=text)


def test_degrees_or_per_cent(tmp_path: Path, log: Recording) -> None:
    form = WRITERS["lerobot_percent"]
    path = form.write(log, tmp_path)
    refused(
        path,
        "positions of up to 38.",
        "may be degrees, or per cent",
        "below a line [signals.position]",
        'unit = "deg"',
        '"m100"',
    )
    degrees = read(path, '[signals.position]\nunit = "deg"').recordings[0]
    percent = read(path, '[signals.position]\nunit = "m100"').recordings[0]
    np.testing.assert_array_equal(
        percent.columns["hip/position"], form.expected(log)["hip/position"]
    )
    assert not np.allclose(degrees.columns["hip/position"], percent.columns["hip/position"])


def test_per_cent_without_a_calibration_is_of_the_model_s_range(
    tmp_path: Path, log: Recording
) -> None:
    path = writers.lerobot(writers.percent)(log, tmp_path)
    imported = read(path, '[signals.position]\nunit = "m100"')
    assert imported.map.joints is not None
    assert imported.map.joints["thigh"].range == (-1.0, 2.6)
    assert any("parts of a range were taken of the model's" in note for note in imported.notes)


def test_degrees_that_are_beyond_the_range_are_told(tmp_path: Path, log: Recording) -> None:
    path = table(
        tmp_path / "log.npz",
        log,
        q=np.rad2deg(matrix(log, "position")),
        q_des=np.rad2deg(matrix(log, "position_target")),
        dq=np.rad2deg(matrix(log, "velocity")),
    )
    imported = read(path)
    (recording,) = imported.recordings
    for signal in ("position", "velocity", "position_target"):
        found = recording.columns[f"calf/{signal}"]
        np.testing.assert_allclose(found, log.columns[f"calf/{signal}"], atol=1e-12)
    assert any("taken for degrees" in note for note in imported.notes)
    assert any("taken for deg/s" in note for note in imported.notes)


def test_a_log_without_a_clock(tmp_path: Path, log: Recording) -> None:
    path = table(tmp_path / "log.npz", log, time=None)
    refused(path, "no column of time", "rate = 200")
    (recording,) = read(path, "[time]\nrate = 500").recordings
    np.testing.assert_array_equal(recording.time, log.time)


def test_epoch_seconds_in_float32(tmp_path: Path, log: Recording) -> None:
    stamps = (log.time + 1.7e9).astype(np.float32)
    path = table(tmp_path / "log.npz", log, time=stamps)
    refused(path, "32-bit floats", "128 s only", "rate = 200")
    (recording,) = read(path, "[time]\nrate = 500").recordings
    np.testing.assert_array_equal(recording.time, log.time)


def test_signs_offsets_and_names(tmp_path: Path, log: Recording) -> None:
    q, sent, tau = (matrix(log, s) for s in ("position", "position_target", "effort"))
    path = table(tmp_path / "log.npz", log, q=0.2 - q, q_des=0.2 - sent, tau=-1000 * tau)
    joints = "\n".join(
        f'{joint} = {{log = "{k}", sign = -1, offset = 0.2}}' for k, joint in enumerate(JOINTS)
    )
    text = f'[signals.effort]\nfrom = "tau[{{}}]"\nunit = "mN·m"\n\n[joints]\n{joints}'
    (recording,) = read(path, text).recordings
    for column, values in recording.columns.items():
        np.testing.assert_allclose(values, log.columns[column], atol=1e-9, err_msg=column)


def test_two_clocks_in_one_table(tmp_path: Path, log: Recording) -> None:
    """Commands have stamps of their own, a step and a half before the states beside them."""
    sent = matrix(log, "position_target")
    clocks = {"time_cmd": log.time - 0.003, "time_state": log.time, "time": None}
    path = table(tmp_path / "log.npz", log, **clocks)
    imported = read(path)
    assert imported.map.time is not None
    assert imported.map.time.clock == "time_state"
    assert imported.map.signals["position_target"].clock == "time_cmd"
    (recording,) = imported.recordings
    held = recording.columns["hip/position_target"]
    np.testing.assert_array_equal(held[:-1], sent[1:, 0])


def test_commands_at_a_lower_rate(tmp_path: Path, log: Recording) -> None:
    """A table of their own, with its clock."""
    sent, every = matrix(log, "position_target")[::5], 5
    path = table(tmp_path / "log.npz", log, q_des=sent, time_cmd=log.time[::every], time=log.time)
    (recording,) = read(path).recordings
    expected = np.repeat(sent[:, 2], every)[: len(log.time)]
    np.testing.assert_array_equal(recording.columns["calf/position_target"], expected)


def test_efforts_of_another_rate_are_interpolated(tmp_path: Path, log: Recording) -> None:
    slow = log.time[::10]
    tau = np.c_[slow, 2 * slow, 3 * slow]
    path = table(tmp_path / "log.npz", log, tau=tau, time_tau=slow)
    (recording,) = read(path).recordings
    inside = log.time <= slow[-1]
    np.testing.assert_allclose(
        recording.columns["calf/effort"][inside], 3 * log.time[inside], atol=1e-9
    )
    assert any("calf/effort has samples of its own" in note for note in recording.notes)


FLOATING = """
<mujoco><worldbody><geom type="plane" size="0 0 1"/><body name="trunk" pos="0 0 1"><freejoint/>
<geom size="0.1"/><body><joint name="hip" axis="0 1 0" range="-1 1" limited="true"/>
<geom size="0.05" pos="0 0 -0.2"/></body></body></worldbody>
<actuator><position joint="hip" kp="10"/></actuator></mujoco>
"""


def test_an_imu_tells_of_a_base_that_floats(tmp_path: Path) -> None:
    (tmp_path / "floating.xml").write_text(FLOATING)
    time = np.arange(200) / 100
    turn = np.c_[np.cos(time / 2), np.zeros(200), np.sin(time / 2), np.zeros(200)]
    columns: Mapping[str, Any] = {
        "time": time,
        "hip_pos": 0.1 * np.sin(time),
        "hip_pos_des": 0.1 * np.sin(time),
        "imu_state.quaternion": turn,
        "imu_state.gyroscope": np.c_[np.zeros(200), np.ones(200), np.zeros(200)],
    }
    np.savez(tmp_path / "log.npz", **columns)
    (recording,) = import_log(
        tmp_path / "log.npz", load_robot(tmp_path / "floating.xml")
    ).recordings
    np.testing.assert_allclose(recording.columns["base/quaternion_y"], turn[:, 2], atol=1e-15)
    assert np.all(recording.columns["base/angular_velocity_y"] == 1)


def test_all_episodes_of_a_data_set_tell_its_unit(tmp_path: Path, log: Recording) -> None:
    """One that hardly moves could be per cent as well; it is in the unit of the others."""
    path = writers.lerobot(np.rad2deg, suffix=".pos")(log, tmp_path)
    file = next(path.rglob("*.parquet"))
    table = pyarrow.parquet.read_table(file)
    rows = table.num_rows
    still = np.array([0.5, 20, -60]) + 0.1 * np.sin(np.arange(rows))[:, None]
    still = still.astype(np.float32)
    vectors = {
        name: pyarrow.array(list(still), pyarrow.list_(pyarrow.float32()))
        for name in ("observation.state", "action")
    }
    other = {name: vectors.get(name, table.column(name)) for name in table.column_names}
    other["episode_index"] = pyarrow.array(np.ones(rows, int))
    both = pyarrow.concat_tables([pyarrow.table(other), table])
    pyarrow.parquet.write_table(both, file)
    first, second = read(path).recordings
    assert (first.name, second.name) == ("leg_data_episode_000", "leg_data_episode_001")
    np.testing.assert_allclose(
        first.columns["hip/position"], log.columns["hip/position"], atol=1e-6
    )
    found = second.columns["hip/position"]
    np.testing.assert_allclose(found, np.deg2rad(still[:, 0]), atol=1e-9)
    (chosen,) = read(path, "episodes = [1]\n[signals.position]\nunit = 'deg'").recordings
    assert chosen.name == second.name
    refused(path, "no episode 7", "It has 0 to 1", text="episodes = [7]")


def many(path: Path, names: Iterable[str]) -> Path:
    """An arm of many joints."""
    joints = "".join(f'<body><joint name="{n}"/><geom size="0.1"/></body>' for n in names)
    servos = "".join(f'<position joint="{n}" kp="1"/>' for n in names)
    path.write_text(
        f"<mujoco><worldbody>{joints}</worldbody><actuator>{servos}</actuator></mujoco>"
    )
    return path


def test_more_than_ten_places_are_in_their_order(tmp_path: Path) -> None:
    """Positions have names, commands have places, and the tenth is not the second."""
    names = "abcdefghijkl"
    model = many(tmp_path / "many.xml", names)
    rows = [
        {"time": 0.01 * k, "cmd": [float(n) for n in range(12)]}
        | {name: {"q": 0.1 * np.sin(k)} for name in names}
        for k in range(50)
    ]
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(map(json.dumps, rows)))
    imported = import_log(path, load_robot(model))
    assert imported.map.signals["position_target"].order == tuple(names)
    (recording,) = imported.recordings
    for place, name in enumerate(names):
        assert np.all(recording.columns[f"{name}/position_target"] == place)


def test_a_gripper_is_in_per_cent_of_its_own(tmp_path: Path, log: Recording) -> None:
    """Whatever the unit of the arm is; the model's calf is the gripper here."""
    path = writers.lerobot(lambda angles: 50 + 0 * angles)(log, tmp_path)
    info = path / "meta" / "info.json"
    info.write_text(info.read_text().replace('"calf"', '"gripper_calf"'))
    for unit, thigh in (("deg", np.deg2rad(50)), ("m100", -1.0 + 0.75 * 3.6)):
        imported = read(path, f'[signals.position]\nunit = "{unit}"')
        (recording,) = imported.recordings
        np.testing.assert_allclose(recording.columns["thigh/position"], thigh)
        np.testing.assert_allclose(recording.columns["calf/position"], -1.55)
