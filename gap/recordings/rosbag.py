"""Bags of ROS 2, MCAP and SQLite alike, as recordings; ROS itself is not needed.

    recording = load_bag("run_1", command_topic="/joint_commands")
    recording.save("run_1.csv")

Needs `pip install 'walkerkit[rosbag]'`. `sensor_msgs/JointState` says where the joints were;
commands come from a topic of `JointState`, `trajectory_msgs/JointTrajectory` or
`std_msgs/Float64MultiArray`. Each joint state is a row; a command holds from when it was given
until the next one of its joint, and a trajectory goes from point to point until then.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, closest, one_line, refusal
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.trajectory import Course, TargetKind, targets_of

FloatArray = NDArray[np.float64]

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
ARRAY = "std_msgs/msg/Float64MultiArray"
_KINDS: tuple[TargetKind, ...] = ("position", "velocity", "effort")
_NANO = 1e-9
_FEW = 0.05  # of the joint states, that may lack a number and are left out


@dataclass(frozen=True, kw_only=True)
class _Message:
    """What one message says: when it was received and stamped [ns], and its joints' values.

    A value that is no number is NaN. Those of a trajectory are the first of its courses.
    """

    received: int
    stamped: int
    values: dict[str, dict[TargetKind, float]]
    courses: dict[str, dict[TargetKind, Course]] = field(default_factory=dict)


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
    path = Path(path)
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ImportError(
            "this needs the package rosbags, which is not installed: "
            "pip install 'walkerkit[rosbag]'"
        ) from None
    if not path.exists():
        raise refusal(f"{path}: no such bag. Check the path.")
    folder = path.parent if path.is_file() and (path.parent / "metadata.yaml").exists() else path
    try:
        store = get_typestore(Stores.LATEST)
        with AnyReader([folder], default_typestore=store) as reader:
            states = _messages(reader, path, joint_topic, (JOINT_STATE,), (), "position")
            commands = _messages(
                reader, path, command_topic, (JOINT_STATE, TRAJECTORY, ARRAY), joints, target
            )
    except InputError:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        raise refusal(
            f"{path}: cannot be read as a bag of ROS 2 ({one_line(error)}). Give the folder with "
            "its metadata.yaml."
        ) from error
    return _Rows(path, joint_topic, command_topic, states, commands).recording(name)


def _messages(
    reader: Any,
    path: Path,
    topic: str,
    types: Sequence[str],
    joints: Sequence[str],
    target: TargetKind,
) -> list[_Message]:
    found = {c.topic: c for c in reader.connections}
    if topic not in found:
        raise refusal(
            f"{path}: no topic {topic!r}{closest(topic, found)}. It has "
            f"{', '.join(f'{name} ({c.msgtype})' for name, c in sorted(found.items()))}."
        )
    kind = found[topic].msgtype
    if kind not in types:
        raise refusal(
            f"{path}: topic {topic!r} is of {kind}. Give one of {', '.join(types)} instead."
        )
    if kind == ARRAY and not joints:
        raise refusal(
            f"{path}: topic {topic!r} is of {kind}, which does not name its joints. Give their "
            "names in its order: joints=[...]."
        )
    messages = []
    chosen = [c for c in reader.connections if c.topic == topic]
    for _, received, raw in reader.messages(connections=chosen):
        message, courses = reader.deserialize(raw, kind), {}
        if kind == ARRAY:
            if len(message.data) != len(joints):
                raise refusal(
                    f"{path}: topic {topic!r} has messages of {len(message.data)} numbers, and "
                    f"{len(joints)} joints were given. Name each of its joints once."
                )
            pairs = zip(joints, message.data, strict=True)
            values = {joint: {target: float(value)} for joint, value in pairs}
            stamped = 0
        else:
            if kind == TRAJECTORY:
                try:
                    courses = targets_of(message)
                except ValueError as error:
                    raise refusal(
                        f"{path}: topic {topic!r} has a trajectory with {error}, which have to "
                        "increase. Mend what publishes it, or cut it out of the bag."
                    ) from None
                values = {joint: _first(told) for joint, told in courses.items()}
            else:
                values = dict(_named(message))
            stamped = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        messages.append(
            _Message(received=received, stamped=stamped, values=values, courses=courses)
        )
    if not messages:
        raise refusal(f"{path}: topic {topic!r} has no messages. Record it again.")
    return messages


def _named(message: Any) -> Iterator[tuple[str, dict[TargetKind, float]]]:
    """What a `JointState` says of each of its joints."""
    given = [(kind, getattr(message, kind)) for kind in _KINDS]
    for k, joint in enumerate(message.name):
        yield joint, {kind: _number(values[k]) for kind, values in given if k < len(values)}


def _first(told: dict[TargetKind, Course]) -> dict[TargetKind, float]:
    """Where the courses of a joint begin, NaN for those of which some point is no number."""
    return {
        kind: course.points[0][course.order] if course.known else np.nan
        for kind, course in told.items()
    }


def _number(value: float) -> float:
    return float(value) if np.isfinite(value) else np.nan


class _Rows:
    """States and commands on one clock."""

    def __init__(
        self,
        path: Path,
        joint_topic: str,
        command_topic: str,
        states: list[_Message],
        commands: list[_Message],
    ):
        self._path = path
        self._joint_topic, self._command_topic = joint_topic, command_topic
        self._notes: list[str] = []
        self._begun: dict[tuple[str, int], Course] = {}  # of positions, by joint and command
        most = max((tuple(s.values) for s in states), key=len)
        whole = [s for s in states if set(s.values) >= set(most)]
        if len(whole) < len(states):
            self._notes.append(
                f"{len(states) - len(whole)} messages of {joint_topic} lack some of the joints "
                "and were left out"
            )
        stamped = all(s.stamped for s in whole)
        times = [s.stamped if stamped else s.received for s in whole]
        if stamped and not all(c.stamped for c in commands):
            # Commands know when they were received only; states tell how the clocks differ.
            ahead = int(np.median([s.received - s.stamped for s in whole]))
            given = [c.received - ahead for c in commands]
            self._notes.append(
                f"commands of {command_topic} have no stamps; they count from when they were "
                "received"
            )
        else:
            given = [c.stamped if stamped else c.received for c in commands]
        order = sorted(range(len(times)), key=times.__getitem__)
        kept = [i for n, i in enumerate(order) if not n or times[i] > times[order[n - 1]]]
        if len(kept) < len(times):
            self._notes.append(f"{len(times) - len(kept)} joint states repeat a stamp: left out")
        self._states = [whole[i] for i in kept]
        self._time = np.array([times[i] for i in kept])
        if any(course.moves for c in commands for t in c.courses.values() for course in t.values()):
            self._notes.append(
                f"trajectories of {command_topic} go from point to point, as a "
                "joint_trajectory_controller takes them"
            )
        order = sorted(range(len(given)), key=given.__getitem__)
        self._commands = [commands[i] for i in order]
        self._given = np.array([given[i] for i in order])

    def recording(self, name: str | None) -> Recording:
        """The rows from the first commands on."""
        joints = list(self._states[0].values)
        targets = {
            f"{joint}/{kind}_target": values
            for joint in joints
            for kind in _KINDS
            if (values := self._target(joint, kind)) is not None
        }
        if not targets:
            known = {joint for c in self._commands for joint in c.values}
            raise refusal(
                f"{self._path}: {self._command_topic!r} commands {', '.join(sorted(known))}, none "
                f"of the joints of {self._joint_topic!r}: {', '.join(joints)}. Rename them."
            )
        ready = np.all([np.isfinite(values) for values in targets.values()], axis=0)
        if not ready.any():
            raise refusal(
                f"{self._path}: no joint state comes after the first command of each joint. "
                "Record both topics at the same time."
            )
        first = int(np.argmax(ready))
        if first:
            self._notes.append(f"{first} joint states before the first commands were left out")
        columns = self._measured(first)
        rows = first + np.flatnonzero(np.all([np.isfinite(v) for v in columns.values()], axis=0))
        columns = {column: values[rows - first] for column, values in columns.items()}
        columns |= {column: values[rows] for column, values in targets.items()}
        time = self._time[rows]
        return Recording(
            name=name or self._path.stem,
            time=_NANO * (time - time[:1]),
            columns=columns,
            source=self._path,
            notes=tuple(self._notes),
        )

    def _target(self, joint: str, kind: TargetKind) -> FloatArray | None:
        """What a joint was told, NaN before it was; None where it never was."""
        given = [k for k, c in enumerate(self._commands) if kind in c.values.get(joint, {})]
        which = [k for k in given if np.isfinite(self._commands[k].values[joint][kind])]
        if not which:
            return None
        if len(which) < len(given):
            self._notes.append(
                f"{len(given) - len(which)} of {len(given)} commands of {joint}/{kind} are no "
                "numbers; those before them were held"
            )
        if self._commands[which[0]].courses:
            return self._followed(joint, kind, which)
        values = np.array([self._commands[k].values[joint][kind] for k in which])
        last = np.searchsorted(self._given[which], self._time, side="right") - 1
        return np.where(last < 0, np.nan, values[last])

    def _followed(self, joint: str, kind: TargetKind, which: Sequence[int]) -> FloatArray:
        """The target of trajectories, each until the next one is given."""
        target = np.full(len(self._time), np.nan)
        ends = np.append(self._given[which], np.iinfo(np.int64).max)
        before = self._position(joint, ends[0]) if kind == "position" else np.nan
        for k, given, until in zip(which, ends[:-1], ends[1:], strict=True):
            course = self._commands[k].courses[joint][kind]
            if course.order:
                course = replace(self._begun[joint, k], order=course.order)
            else:
                course = self._begun[joint, k] = course.begun(before)
            first, last = np.searchsorted(self._time, (given, until))
            target[first:last] = course.at(_NANO * (self._time[first:last] - given))
            (before,) = course.at(_NANO * np.array([until - given]))
        return target

    def _position(self, joint: str, time: int) -> float:
        """Where a joint was [rad; m], NaN where nobody knows."""
        values = np.array([state.values[joint].get("position", np.nan) for state in self._states])
        known = np.isfinite(values)
        if not known.any():
            return np.nan
        return float(np.interp(0.0, (self._time[known] - time).astype(float), values[known]))

    def _measured(self, first: int) -> dict[str, FloatArray]:
        """What was measured from a state on, NaN in the few rows that lack a number."""
        states = self._states[first:]
        found: dict[str, FloatArray] = {}
        for joint in states[0].values:
            for kind in _KINDS:
                values = np.array([state.values[joint].get(kind, np.nan) for state in states])
                lacking = int(np.count_nonzero(np.isnan(values)))
                if lacking == len(states):
                    continue
                told = f"{joint}/{kind} is no number in {lacking} of {len(states)} joint states"
                if lacking > _FEW * len(states):
                    if kind == "position":
                        raise refusal(
                            f"{self._path}: {told} of {self._joint_topic!r}. Mend what publishes "
                            "it, or leave the joint out."
                        )
                    self._notes.append(f"{told}; the column was left out")
                    continue
                if lacking:
                    self._notes.append(f"{told}; these were left out")
                found[f"{joint}/{kind}"] = values
        return found
