"""Bags of ROS 2, MCAP and SQLite alike, as columns; ROS itself is not needed.

    log = read_bag(Path("run_1"))
    log.columns["/joint_states/hip/position"], log.columns["/lowcmd/motor_cmd[3].q"]

Needs `pip install 'walkerkit[rosbag]'`. A `JointState` and a `JointTrajectory` become
`<topic>/<joint>/<kind>`; the numbers of any other message are `<topic>/<path>`, where a list's
entries have their joint's name if the message has it, else their place. Each topic has the clock
`received`, and `header` where its messages are stamped.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from walkerkit.gap.errors import InputError, closest, one_line, refusal
from walkerkit.gap.ingest import unitree
from walkerkit.gap.ingest.gather import Gather, flat
from walkerkit.gap.ingest.log import Log
from walkerkit.gap.recordings.trajectory import Course, TargetKind, targets_of

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
ARRAY = "std_msgs/msg/Float64MultiArray"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
HEADER, RECEIVED = "header", "received"
KINDS: tuple[TargetKind, ...] = ("position", "velocity", "effort")

_BULKY = ("Image", "CompressedImage", "PointCloud2", "LaserScan", "TFMessage", "OccupancyGrid")
_TALK = ("rcl_interfaces/", "diagnostic_msgs/", "visualization_msgs/", "rosgraph_msgs/")
_CONTROLLER_STATE_OF_HUMBLE = """
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
"""


def read_bag(path: Path, topics: Iterable[str] | None = None) -> Log:
    """Reads the numbers of a bag.

    Args:
        path: the bag's folder, or its .mcap or .db3 file.
        topics: those that are wanted; by default all that may be signals.

    Raises:
        ImportError: the package rosbags is not installed.
        InputError: there is no such bag or topic, or it cannot be read.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise ImportError(
            "this needs the package rosbags, which is not installed: "
            "pip install 'walkerkit[rosbag]'"
        ) from None
    if not path.exists():
        raise refusal(f"{path}: no such bag. Check the path.")
    folder = path.parent if path.is_file() and (path.parent / "metadata.yaml").exists() else path
    store = get_typestore(Stores.LATEST)
    known = {CONTROLLER_STATE: _CONTROLLER_STATE_OF_HUMBLE, **unitree.MESSAGES}
    for name, definition in known.items():
        store.register(get_types_from_msg(definition, name))
    try:
        with AnyReader([folder], default_typestore=store) as reader:
            return _read(reader, path, topics)
    except InputError:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        raise refusal(
            f"{path}: cannot be read as a bag of ROS 2 ({one_line(error)}). Give the folder with "
            "its metadata.yaml."
        ) from error


def _read(reader: Any, path: Path, topics: Iterable[str] | None) -> Log:
    found = {c.topic: c for c in reader.connections}
    for topic in topics or ():
        if topic not in found:
            raise refusal(
                f"{path}: no topic {topic!r}{closest(topic, found)}. It has "
                f"{', '.join(f'{name} ({c.msgtype})' for name, c in sorted(found.items()))}."
            )
    wanted = [c for c in reader.connections if _may_be_signals(c.msgtype)]
    if topics is not None:
        wanted = [c for c in reader.connections if c.topic in set(topics)]
    gather = Gather()
    for connection, received, raw in reader.messages(connections=wanted) if wanted else ():
        topic, kind = connection.topic, connection.msgtype
        message = reader.deserialize(raw, kind)
        clocks = {RECEIVED: received}
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        if stamp is not None and (stamped := stamp.sec * 10**9 + stamp.nanosec):
            clocks[HEADER] = stamped
        sample, courses = _numbers(path, topic, kind, message)
        gather.add(topic, kind, clocks, sample, courses)
    made, columns = gather.done()
    for topic in topics or ():
        if topic not in made:
            raise refusal(f"{path}: topic {topic!r} has no messages. Record it again.")
    return Log(path=path, name=path.stem, topics=made, columns=columns)


def _may_be_signals(kind: str) -> bool:
    return kind.rpartition("/")[2] not in _BULKY and not kind.startswith(_TALK)


def _numbers(
    path: Path, topic: str, kind: str, message: Any
) -> tuple[Mapping[str, float], Mapping[str, Course]]:
    """What a message says, by column."""
    if kind == JOINT_STATE:
        given = [(kind, getattr(message, kind)) for kind in KINDS]
        return {
            f"{topic}/{joint}/{kind}": _number(values[k])
            for k, joint in enumerate(message.name)
            for kind, values in given
            if k < len(values)
        }, {}
    if kind == TRAJECTORY:
        try:
            told = targets_of(message)
        except ValueError as error:
            raise refusal(
                f"{path}: topic {topic!r} has a trajectory with {error}, which have to "
                "increase. Mend what publishes it, or cut it out of the bag."
            ) from None
        courses = {f"{topic}/{joint}/{k}": c for joint, one in told.items() for k, c in one.items()}
        return {column: _first(course) for column, course in courses.items()}, courses
    fields = {key: value for key, value in vars(message).items() if key != "header"}
    return flat(fields, f"{topic}/"), {}


def _first(course: Course) -> float:
    """Where a course begins, NaN for one of which some point is no number."""
    return course.points[0][course.order] if course.known else np.nan


def _number(value: float) -> float:
    return float(value) if np.isfinite(value) else np.nan
