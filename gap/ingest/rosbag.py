"""Bags of ROS 2, MCAP and SQLite alike, as recordings; ROS itself is not needed.

    recording = load_bag("run_1", command_topic="/joint_commands")
    recording.save("run_1.csv")

Needs `pip install 'walkerkit[rosbag]'`. `sensor_msgs/JointState` says where the joints were;
commands come from a topic of `JointState`, `trajectory_msgs/JointTrajectory` or
`std_msgs/Float64MultiArray`. Each joint state is a row; a command holds from when it was given
until the next one of its joint, and a trajectory goes from point to point until then.
`walkerkit.gap.ingest` reads more, and finds the topics itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from walkerkit.gap.errors import refusal
from walkerkit.gap.ingest.bag import (
    ARRAY,
    HEADER,
    JOINT_STATE,
    KINDS,
    RECEIVED,
    TRAJECTORY,
    read_bag,
)
from walkerkit.gap.ingest.column_map import ColumnMap, JointMap, SignalMap, TimeMap
from walkerkit.gap.ingest.log import Log
from walkerkit.gap.ingest.rows import recording_of
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.trajectory import TargetKind

_UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N·m"}


def load_bag(
    path: str | Path,
    *,
    command_topic: str,
    joint_topic: str = "/joint_states",
    joints: Sequence[str] = (),
    target: TargetKind = "position",
    name: str | None = None,
) -> Recording:
    """Reads the joints' states and commands of one bag.

    Args:
        path: the bag's folder, or its MCAP file.
        command_topic: where the commands are.
        joint_topic: where the states are.
        joints: the joints of a `Float64MultiArray`, in its order.
        target: what its numbers are: targets of position [rad; m], velocity [rad/s; m/s] or
            effort [N·m; N].
        name: of the recording; by default the bag's.

    Returns:
        A row for each joint state from the first commands on. Its time starts at 0; its notes say
        what was left out.

    Raises:
        ImportError: the package rosbags is not installed.
        InputError: there is no such bag or topic, or it holds something else.
    """
    log = read_bag(Path(path), (joint_topic, command_topic))
    _check_type(log, joint_topic, (JOINT_STATE,))
    _check_type(log, command_topic, (JOINT_STATE, TRAJECTORY, ARRAY))
    states = _joints_of(log, joint_topic)
    signals: dict[str, SignalMap] = {
        kind: SignalMap(pattern=f"{joint_topic}/{{}}/{kind}", unit=_UNITS[kind])
        for kind in KINDS
        if any(f"{joint_topic}/{joint}/{kind}" in log.columns for joint in states)
    }
    if log.topics[command_topic].kind == ARRAY:
        signals |= _numbered(log, command_topic, joints, target)
        commanded = list(joints)
    else:
        commanded = _joints_of(log, command_topic)
        signals |= {
            f"{kind}_target": SignalMap(pattern=f"{command_topic}/{{}}/{kind}", unit=_UNITS[kind])
            for kind in KINDS
            if any(f"{command_topic}/{joint}/{kind}" in log.columns for joint in states)
        }
    if not set(commanded) & set(states):
        raise refusal(
            f"{path}: {command_topic!r} commands {', '.join(sorted(commanded))}, none "
            f"of the joints of {joint_topic!r}: {', '.join(states)}. Rename them."
        )
    clock = HEADER if HEADER in log.topics[joint_topic].clocks else RECEIVED
    mapping = ColumnMap(
        time=TimeMap(clock=clock, unit="ns"),
        signals=signals,
        joints={joint: JointMap(log=joint) for joint in states},
    )
    return recording_of(replace(log, name=name or log.name), mapping)


def _check_type(log: Log, topic: str, types: Sequence[str]) -> None:
    kind = log.topics[topic].kind
    if kind not in types:
        raise refusal(
            f"{log.path}: topic {topic!r} is of {kind}. Give one of {', '.join(types)} instead."
        )


def _joints_of(log: Log, topic: str) -> list[str]:
    """The joints that a topic names, in its order."""
    own = [name for name, column in log.columns.items() if column.topic == topic]
    return list(dict.fromkeys(n.removeprefix(f"{topic}/").rpartition("/")[0] for n in own))


def _numbered(
    log: Log, topic: str, joints: Sequence[str], target: TargetKind
) -> dict[str, SignalMap]:
    """The targets of a topic that does not name its joints."""
    if not joints:
        raise refusal(
            f"{log.path}: topic {topic!r} is of {ARRAY}, which does not name its joints. Give "
            "their names in its order: joints=[...]."
        )
    numbers = sum(column.topic == topic for column in log.columns.values())
    if numbers != len(joints):
        raise refusal(
            f"{log.path}: topic {topic!r} has messages of {numbers} numbers, and "
            f"{len(joints)} joints were given. Name each of its joints once."
        )
    pattern = f"{topic}/data[{{}}]"
    order = tuple(joints)
    return {f"{target}_target": SignalMap(pattern=pattern, unit=_UNITS[target], order=order)}
