"""One log of the leg, written as others write theirs; each returns what can be given to import.

path = WRITERS["pace_pt"].write(log, folder)
WRITERS["pace_pt"].expected(log)        # the recording that it has to become
"""

from __future__ import annotations

import csv
import itertools
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import torch
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from walkerkit.gap import Recording
from walkerkit.gap.ingest.unitree import MESSAGES

JOINTS = ("hip", "thigh", "calf")
RATE = 500
EPOCH = 1_700_000_000 * 10**9
STORE = get_typestore(Stores.ROS2_HUMBLE)
CONTROLLER_STATE = """
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint reference
trajectory_msgs/JointTrajectoryPoint feedback
trajectory_msgs/JointTrajectoryPoint error
trajectory_msgs/JointTrajectoryPoint output
"""
for _name, _definition in {
    **MESSAGES,
    "control_msgs/msg/JointTrajectoryControllerState": CONTROLLER_STATE,
}.items():
    STORE.register(get_types_from_msg(_definition, _name))

ALL = ("position", "velocity", "effort", "position_target")
ANGLES = ("position", "position_target")
Write = Callable[[Recording, Path], Path]


def matrix(log: Recording, signal: str) -> Any:
    return np.stack([log.columns[f"{joint}/{signal}"] for joint in JOINTS], axis=1)


@dataclass(frozen=True, kw_only=True)
class Format:
    """A way to write the log.

    Attributes:
        write: returns the file or folder.
        signals: those that it holds.
        kept: what is left of (T, 3) angles.
        options: of the command line.
    """

    write: Write
    signals: tuple[str, ...] = ALL
    kept: Callable[[Any], Any] = lambda angles: angles
    options: Mapping[str, Any] = field(default_factory=dict)

    def expected(self, log: Recording) -> dict[str, Any]:
        found = {}
        for signal in self.signals:
            values = matrix(log, signal)
            values = self.kept(values) if signal in ANGLES else values
            found |= {f"{joint}/{signal}": values[:, k] for k, joint in enumerate(JOINTS)}
        return found


def message(kind: str, **fields: Any) -> Any:
    return STORE.types[kind](**fields)


def header(stamp: int) -> Any:
    time = message("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
    return message("std_msgs/msg/Header", stamp=time, frame_id="")


def point(positions: Any = (), velocities: Any = (), effort: Any = ()) -> Any:
    return message(
        "trajectory_msgs/msg/JointTrajectoryPoint",
        positions=np.array(positions, float),
        velocities=np.array(velocities, float),
        accelerations=np.zeros(0),
        effort=np.array(effort, float),
        time_from_start=message("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
    )


def state(log: Recording, k: int, stamp: int) -> Any:
    names = JOINTS if k % 2 else JOINTS[::-1]  # the order may change
    columns = {
        signal: np.array([log.columns[f"{joint}/{signal}"][k] for joint in names])
        for signal in ("position", "velocity", "effort")
    }
    return message("sensor_msgs/msg/JointState", header=header(stamp), name=list(names), **columns)


def sent_state(target: Any, stamp: int) -> Any:
    return message(
        "sensor_msgs/msg/JointState",
        header=header(stamp),
        name=list(JOINTS),
        position=target,
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )


def sent_array(target: Any, stamp: int) -> Any:
    layout = message("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    return message("std_msgs/msg/Float64MultiArray", layout=layout, data=target)


def sent_trajectory(target: Any, stamp: int) -> Any:
    return message(
        "trajectory_msgs/msg/JointTrajectory",
        header=header(stamp),
        joint_names=list(JOINTS),
        points=[point(target)],
    )


def controller_state(target: Any, stamp: int) -> Any:
    return message(
        "control_msgs/msg/JointTrajectoryControllerState",
        header=header(stamp),
        joint_names=list(JOINTS),
        reference=point(target, np.zeros(3)),
        feedback=point(target + 0.1),
        error=point(np.full(3, -0.1)),
        output=point(),
    )


def zeros(kind: str) -> Any:
    """A message of zeros."""
    made: dict[str, Any] = {}
    for name, (node, details) in STORE.fielddefs[kind][1]:
        if node.name == "BASE":
            made[name] = 0.0 if details[0].startswith("float") else 0
        elif node.name == "NAME":
            made[name] = zeros(details)
        else:
            (inner, of), count = details
            made[name] = (
                [zeros(of) for _ in range(count)]
                if inner.name == "NAME"
                else np.zeros(count, of[0])
            )
    return STORE.types[kind](**made)


def low_state(log: Recording, k: int, stamp: int) -> Any:
    made = zeros("unitree_go/msg/LowState")
    for motor, joint in zip(made.motor_state, JOINTS, strict=False):
        motor.q, motor.dq, motor.tau_est = (
            float(log.columns[f"{joint}/{signal}"][k]) for signal in ALL[:3]
        )
    return made


def low_command(target: Any, stamp: int) -> Any:
    made = zeros("unitree_go/msg/LowCmd")
    for motor, value in zip(made.motor_cmd, target, strict=False):
        motor.q, motor.kp, motor.kd = float(value), 60.0, 3.0
    return made


def bag(
    topic: str,
    sent: Callable[[Any, int], Any],
    *,
    mcap: bool,
    states: str = "/joint_states",
    made: Callable[[Recording, int, int], Any] = state,
    single: bool = False,
    version: int = 9,
) -> Write:
    """States and commands on topics of their own; commands are given half a millisecond before.

    Version 8, of ROS 2 Humble, leaves the definitions of the messages out of SQLite.
    """

    def write(log: Recording, folder: Path) -> Path:
        plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
        path = folder / "run"
        targets = matrix(log, "position_target")
        with Writer(path, version=version, storage_plugin=plugin) as writer:
            topics: dict[str, Any] = {}
            for k, time in enumerate(log.time):
                stamp = EPOCH + round(time * 1e9)
                before = stamp - 500_000
                for name, at, one in (
                    (topic, before, sent(targets[k], before)),
                    (states, stamp, made(log, k, stamp)),
                ):
                    kind = one.__msgtype__
                    if name not in topics:
                        topics[name] = writer.add_connection(name, kind, typestore=STORE)
                    writer.write(topics[name], at, STORE.serialize_cdr(one, kind))
        return next(path.glob("*.mcap" if mcap else "*.db3")) if single else path

    return write


def lerobot(
    scaled: Callable[[Any], Any], *, calibration: Mapping[str, Any] | None = None, suffix: str = ""
) -> Write:
    """Version 3: the state and the action of each frame are lists of float32."""

    def write(log: Recording, folder: Path) -> Path:
        root = folder / "leg_data"
        (root / "meta").mkdir(parents=True)
        (root / "data" / "chunk-000").mkdir(parents=True)
        names = [f"{joint}{suffix}" for joint in JOINTS]
        vector = {"dtype": "float32", "shape": [len(names)], "names": names}
        info = {
            "codebase_version": "v3.0",
            "robot_type": "leg_follower",
            "fps": RATE,
            "total_episodes": 1,
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "features": {"observation.state": vector, "action": vector},
        }
        (root / "meta" / "info.json").write_text(json.dumps(info))
        if calibration is not None:
            (root / "meta" / "calibration.json").write_text(json.dumps(calibration))
        rows = len(log.time)
        vectors = {
            name: pyarrow.array(
                list(scaled(matrix(log, signal)).astype(np.float32)),
                pyarrow.list_(pyarrow.float32()),
            )
            for name, signal in (("observation.state", "position"), ("action", "position_target"))
        }
        table = pyarrow.table(
            {
                **vectors,
                "timestamp": (np.arange(rows) / RATE).astype(np.float32),
                "frame_index": np.arange(rows),
                "episode_index": np.zeros(rows, int),
                "index": np.arange(rows),
                "task_index": np.zeros(rows, int),
            }
        )
        pyarrow.parquet.write_table(table, root / "data" / "chunk-000" / "file-000.parquet")
        return root

    return write


RANGES = {"hip": (-0.8, 0.8), "thigh": (-1.0, 2.6), "calf": (-2.6, -0.5)}
CALIBRATION = {
    joint: {
        "id": k,
        "drive_mode": 0,
        "homing_offset": 0,
        "range_min": 2048 - width,
        "range_max": 2048 + width,
    }
    for k, (joint, width) in enumerate(zip(JOINTS, (600, 1200, 700), strict=True))
}
_MIDDLE = np.array([0.5 * sum(RANGES[joint]) for joint in JOINTS])
_HALF = 2 * np.pi / 4095 * np.array([600, 1200, 700])


def percent(angles: Any) -> Any:
    """Of the calibrated range, -100 to 100."""
    return 100 * (angles - _MIDDLE) / _HALF


def from_percent(angles: Any) -> Any:
    kept = percent(angles).astype(np.float32).astype(float)
    lower, upper = _MIDDLE - 2 * _HALF / 2, _MIDDLE + 2 * _HALF / 2
    return lower + (kept + 100) / 200 * (upper - lower)


def from_degrees(angles: Any) -> Any:
    return (np.pi / 180) * np.rad2deg(angles).astype(np.float32).astype(float)


def pace(suffix: str, save: Callable[[Path, dict[str, Any]], None]) -> Write:
    def write(log: Recording, folder: Path) -> Path:
        path = folder / f"chirp_data{suffix}"
        save(
            path,
            {
                "time": log.time.astype(np.float32),
                "dof_pos": matrix(log, "position").astype(np.float32),
                "des_dof_pos": matrix(log, "position_target").astype(np.float32),
            },
        )
        return path

    return write


def save_torch(path: Path, arrays: dict[str, Any]) -> None:
    torch.save({name: torch.from_numpy(values) for name, values in arrays.items()}, path)


def save_npz(path: Path, arrays: dict[str, Any]) -> None:
    np.savez(path, **arrays)


def save_npy(path: Path, arrays: dict[str, Any]) -> None:
    kinds = [(name, v.dtype, v.shape[1:]) for name, v in arrays.items()]
    made = np.zeros(len(arrays["time"]), np.dtype(kinds))
    for name, values in arrays.items():
        made[name] = values
    np.save(path, made)


def unitree_jsonl(log: Recording, folder: Path) -> Path:
    """The SDK's state, with the command of the same turn of the loop."""
    path = folder / "go2.jsonl"
    spare = [{"q": 0.0, "dq": 0.0, "tauEst": 0.0, "temperature": 30}] * 17
    with path.open("w") as file:
        for k, time in enumerate(log.time):
            motors = [
                {
                    "q": log.columns[f"{joint}/position"][k],
                    "dq": log.columns[f"{joint}/velocity"][k],
                    "tauEst": log.columns[f"{joint}/effort"][k],
                    "temperature": 30,
                }
                for joint in JOINTS
            ]
            told = [
                {"q": log.columns[f"{j}/position_target"][k], "dq": 0.0, "tau": 0.0, "kp": 60.0}
                for j in JOINTS
            ]
            idle = [{"q": 2.146e9, "dq": 16000.0, "tau": 0.0, "kp": 0.0}] * 17
            row = {
                "timestamp": EPOCH + round(time * 1e9),
                "motorState": [*motors, *spare],
                "motorCmd": [*told, *idle],
                "imu": {"quaternion": [1.0, 0.0, 0.0, 0.0]},
            }
            file.write(json.dumps(row) + "\n")
    return path


def write_csv(path: Path, names: Iterable[str], rows: Iterable[Iterable[Any]]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(rows)
    return path


def unitree_csv(log: Recording, folder: Path) -> Path:
    """A column for each number, in milliseconds since the robot was started."""
    columns: dict[str, Any] = {"tick": np.rint(log.time * 1000).astype(int) + 81_000}
    for k, joint in enumerate(JOINTS):
        for name, signal in (("q", "position"), ("dq", "velocity"), ("tau_est", "effort")):
            columns[f"motor_state_{k}_{name}"] = log.columns[f"{joint}/{signal}"].tolist()
        columns[f"motor_cmd_{k}_q"] = log.columns[f"{joint}/position_target"].tolist()
    return write_csv(folder / "go2.csv", columns, zip(*columns.values(), strict=True))


def plotjuggler(log: Recording, folder: Path) -> Path:
    """Rows of the states' clock and of the commands', each with empty cells for the other."""
    states = [f"/joint_states/{j}/{s}" for j in JOINTS for s in ALL[:3]]
    commands = [f"/joint_commands/{j}/position" for j in JOINTS]
    rows = []
    for k, time in enumerate(log.time):
        stamp = EPOCH + round(time * 1e9)
        told = [repr(float(log.columns[f"{j}/position_target"][k])) for j in JOINTS]
        seen = [repr(float(log.columns[f"{j}/{s}"][k])) for j in JOINTS for s in ALL[:3]]
        for at, cells in (
            (stamp - 500_000, [*[""] * len(seen), *told]),
            (stamp, [*seen, *[""] * len(told)]),
        ):
            rows.append([f"{at // 10**9}.{at % 10**9:09d}", *cells])
    return write_csv(folder / "plotjuggler.csv", ["__time", *states, *commands], rows)


def in_cells(log: Recording, folder: Path) -> Path:
    """Lists as text, as a frame of pandas saves them."""
    columns = {
        name: [repr(row.tolist()) for row in matrix(log, signal)]
        for name, signal in (("q", "position"), ("dq", "velocity"), ("tau", "effort"))
    }
    columns["q_des"] = [repr(row.tolist()) for row in matrix(log, "position_target")]
    stamps = np.rint(log.time * 1e6).astype(int) + 1_700_000_000 * 10**6
    rows = zip(stamps.tolist(), *columns.values(), strict=True)
    return write_csv(folder / "lists.csv", ["timestamp_us", *columns], rows)


def list_parquet(log: Recording, folder: Path) -> Path:
    path = folder / "lists.parquet"
    names = {"joint_pos": "position", "joint_vel": "velocity", "joint_torque": "effort"}
    names |= {"joint_pos_target": "position_target"}
    columns = {name: list(matrix(log, signal)) for name, signal in names.items()}
    stamps = pyarrow.array(np.rint(log.time * 1e9).astype(np.int64) + EPOCH).cast(
        pyarrow.timestamp("ns")
    )
    pyarrow.parquet.write_table(pyarrow.table({"time": stamps, **columns}), path)
    return path


def json_lines(log: Recording, folder: Path) -> Path:
    """Lines of two kinds, each when it happens."""
    path = folder / "log.jsonl"
    lines = itertools.chain.from_iterable(
        (
            {
                "topic": "command",
                "t": round(time + 5 - 5e-4, 6),
                **{
                    joint: {"q_des": log.columns[f"{joint}/position_target"][k]} for joint in JOINTS
                },
            },
            {
                "topic": "state",
                "t": round(time + 5, 6),
                **{
                    joint: {
                        "q": log.columns[f"{joint}/position"][k],
                        "dq": log.columns[f"{joint}/velocity"][k],
                        "tau": log.columns[f"{joint}/effort"][k],
                    }
                    for joint in JOINTS
                },
            },
        )
        for k, time in enumerate(log.time)
    )
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


WRITERS: dict[str, Format] = {
    "bag_mcap_joint_states": Format(write=bag("/joint_commands", sent_state, mcap=True)),
    "mcap_file_trajectory": Format(
        write=bag("/leg_controller/joint_trajectory", sent_trajectory, mcap=True, single=True)
    ),
    "db3_file_array": Format(
        write=bag("/position_controller/commands", sent_array, mcap=False, single=True)
    ),
    "bag_controller_state": Format(
        write=bag("/leg_controller/controller_state", controller_state, mcap=True)
    ),
    "bag_unitree": Format(
        write=bag("/lowcmd", low_command, mcap=False, states="/lowstate", made=low_state, version=8)
    ),
    "lerobot_radians": Format(write=lerobot(lambda angles: angles), signals=ANGLES),
    "lerobot_degrees": Format(
        write=lerobot(np.rad2deg, suffix=".pos"), signals=ANGLES, kept=from_degrees
    ),
    "lerobot_percent": Format(
        write=lerobot(percent, suffix=".pos", calibration=CALIBRATION),
        signals=ANGLES,
        kept=from_percent,
    ),
    "unitree_jsonl": Format(write=unitree_jsonl),
    "unitree_csv": Format(write=unitree_csv),
    "pace_pt": Format(write=pace(".pt", save_torch), signals=ANGLES),
    "pace_npz": Format(write=pace(".npz", save_npz), signals=ANGLES),
    "pace_npy": Format(write=pace(".npy", save_npy), signals=ANGLES),
    "plotjuggler": Format(write=plotjuggler),
    "lists_in_cells": Format(write=in_cells),
    "list_parquet": Format(write=list_parquet),
    "json_lines": Format(write=json_lines),
}
