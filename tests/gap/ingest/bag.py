"""Writes a bag of ROS 2 as a robot would have recorded it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
EPOCH = 1_700_000_000 * 10**9  # ns
LATENCY = 2_000_000  # ns, from a stamp to the recorder
JOINTS = ("hip", "knee")


def header(stamp: int) -> Any:
    time = STORE.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id="")


def joint_state(stamp: int, position: list[float], **more: Any) -> Any:
    given = {"name": list(JOINTS), "velocity": [], "effort": []} | more
    arrays = {k: np.array(v, float) for k, v in given.items() if k != "name"}
    return STORE.types["sensor_msgs/msg/JointState"](
        header=header(stamp), name=given["name"], position=np.array(position, float), **arrays
    )


def trajectory(stamp: int, position: list[float]) -> Any:
    return trajectory_of(stamp, [(0.0, {"positions": position})])


def trajectory_of(stamp: int, points: Sequence[tuple[float, Mapping[str, Any]]]) -> Any:
    """A trajectory through points, each of a time from its start [s] and some of its fields."""
    fields = ("positions", "velocities", "accelerations", "effort")
    made = [
        STORE.types["trajectory_msgs/msg/JointTrajectoryPoint"](
            **{field: np.array(given.get(field, ()), float) for field in fields},
            time_from_start=STORE.types["builtin_interfaces/msg/Duration"](
                sec=int(time), nanosec=round(time % 1 * 1e9)
            ),
        )
        for time, given in points
    ]
    return STORE.types["trajectory_msgs/msg/JointTrajectory"](
        header=header(stamp), joint_names=list(JOINTS), points=made
    )


def array(stamp: int, position: list[float]) -> Any:
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return STORE.types["std_msgs/msg/Float64MultiArray"](
        layout=layout, data=np.array(position, float)
    )


def command(stamp: int, position: list[float]) -> Any:
    return joint_state(stamp, position)


def positions(seconds: float) -> list[float]:
    """Where the joints are, and where they were told to be a little earlier."""
    return [0.3 * np.sin(3 * seconds), 0.5 * np.cos(2 * seconds)]


def write_bag(
    path: Path,
    commands: Any = command,
    *,
    states: Any = joint_state,
    mcap: bool = True,
    seconds: float = 1.0,
) -> Path:
    """States at 200 Hz, commands at 50 Hz that begin a little later."""
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        topics: dict[str, Any] = {}
        for k in range(round(seconds * 200)):
            stamp = EPOCH + k * 5_000_000
            sent = [("/joint_states", states(stamp, positions(k / 200), effort=[1.0, k]))]
            if k >= 10 and k % 4 == 2:
                sent.append(("/joint_commands", commands(stamp, positions(k / 200 + 0.05))))
            for topic, message in sent:
                kind = message.__msgtype__
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, typestore=STORE)
                raw = STORE.serialize_cdr(message, kind)
                writer.write(topics[topic], stamp + LATENCY, raw)
    return path
