"""How replayed robots moved: of each recording its worst part, as measured and as simulated.

    motions(problem, before, after)     # what the report draws

It is what the gap is of: positions as encoders show them, simulated over the told horizon. A joint
that no log has is where the model's equality constraints put it, or else at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from walkerkit.gap.recordings.base_state import ORIENTATIONS, angles, quaternions
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.report.motion import POSE, Motion, Which
from walkerkit.gap.report.replayed import Replayed
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]

LONGEST, RATE = 10.0, 30.0
"""Seconds of a recording that are kept at most, and frames a second."""
_CLOSED_RATE = 10.0  # where loops have to be closed, which takes milliseconds a frame
_ROUNDED = 1e-6


def motions(
    problem: Problem, before: Mapping[str, Replayed], after: Mapping[str, Replayed]
) -> tuple[Motion, ...]:
    """The worst part of every recording, held-out recordings first.

    Args:
        problem: what the recordings are of.
        before: both halves by name, as the model was given.
        after: the same as it was mended.
    """
    found = []
    for name in ("held", "fit"):
        half: Half = getattr(problem, name)
        robots = [k for k, some in enumerate(half.recordings) if some]
        pairs = zip(
            robots, before[name].replays, before[name].predicted, after[name].predicted, strict=True
        )
        for robot, replay, old, new in pairs:
            for rows in _recordings(replay):
                each: dict[Which, FloatArray] = {
                    "measured": replay.measured[rows],
                    "before": old[rows],
                    "after": new[rows],
                }
                found.append(_motion(replay, rows, each, robot, held_out=name == "held"))
    return tuple(found)


def _recordings(replay: Replay) -> list[NDArray[np.intp]]:
    """The rows of each recording."""
    owner = np.array([segment.recording.name for segment in replay.segments])
    return [
        np.flatnonzero(owner[replay.segment_of_row] == name)
        for name in dict.fromkeys(owner.tolist())
    ]


def _motion(
    replay: Replay,
    rows: NDArray[np.intp],
    each: Mapping[Which, FloatArray],
    robot: int,
    *,
    held_out: bool,
) -> Motion:
    """One recording's.

    Args:
        replay: with the model as given.
        rows: the recording's.
        each: (len(rows), n_channels) what is compared.
        robot: index of the robot.
        held_out: as in `Motion`.
    """
    recording = replay.segments[replay.segment_of_row[rows[0]]].recording
    start = np.array([segment.start for segment in replay.segments])
    time = replay.time_of_row[rows] + start[replay.segment_of_row[rows]]
    known = {
        channel.joint: c
        for c, channel in enumerate(replay.channels)
        if channel.signal == "position" and not np.isnan(each["measured"][:, c]).all()
    }
    moving, columns = replay.robot, list(known.values())
    span = _worst(time, each["before"][:, columns] - each["measured"][:, columns])
    absent = _absent(moving, known)
    bound = [name for name in absent if name in moving.loops.joints]
    rate = _CLOSED_RATE if bound else RATE
    kept = np.arange(span.start, span.stop)[:: _nth(time[span], rate)]
    joints = [*known]
    addresses = [moving.joints[name].qpos for name in joints]
    parts = {which: [values[kept][:, columns]] for which, values in each.items()}
    at = time[kept]
    places = {channel.signal: c for c, channel in enumerate(replay.channels) if channel.of_base}
    if moving.base is not None and places:
        joints += POSE
        addresses += range(moving.base.qpos, moving.base.qpos + len(POSE))
        for which, values in each.items():
            parts[which].append(_pose(recording, at, values[kept], places))
    found = {which: np.concatenate(some, axis=1) for which, some in parts.items()}
    if bound:
        found = {which: _closed(moving, addresses, some, bound) for which, some in found.items()}
        joints += bound
        addresses += [moving.joints[name].qpos for name in bound]
    return Motion(
        recording=recording.name,
        held_out=held_out,
        robot=robot,
        model=moving.model,
        time=at,
        joints=tuple(joints),
        addresses=tuple(addresses),
        absent=tuple(name for name in absent if name not in bound),
        base_estimated=bool(places) and "position_x" not in places,
        whole=span.stop - span.start == time.size,
        **found,
    )


def _worst(time: FloatArray, error: FloatArray) -> slice:
    """The rows, at most `LONGEST` seconds of them, that have the largest error.

    Args:
        time: (T,) rising [s].
        error: (T, n_joints) simulated minus measured, NaN where either is none.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.nan_to_num(np.square(error).sum(axis=1), nan=0.0, posinf=0.0)
    total = np.concatenate([[0.0], np.cumsum(squares)])
    ends = np.searchsorted(time, time + LONGEST + _ROUNDED, side="right")
    first = int(np.argmax(total[ends] - total[: time.size]))
    # Where the worst is near the end, what fits before it is shown, too.
    first = min(first, int(np.searchsorted(time, time[-1] - LONGEST - _ROUNDED)))
    return slice(first, int(ends[first]))


def _nth(time: FloatArray, rate: float) -> int:
    """How many samples go to one frame, where there are at most `rate` of these in a second."""
    if time.size < 3:
        return 1
    return max(1, int(np.ceil(1 / (rate * float(np.median(np.diff(time)))) - _ROUNDED)))


def _pose(
    recording: Recording, time: FloatArray, values: FloatArray, places: Mapping[str, int]
) -> FloatArray:
    """The base's pose, (n, 7) as a MuJoCo free joint has it.

    Args:
        recording: has the pose, measured or estimated.
        time: (n,) instants [s].
        values: (n, n_channels) what is compared.
        places: the base's signals to their columns; what is not among them is the recording's.
    """

    def signal(name: str) -> FloatArray:
        if name in places:
            return values[:, places[name]]
        return np.interp(time, recording.time, recording.columns[f"base/{name}"])

    position = [signal(f"position_{axis}") for axis in "xyz"]
    if all(name in places for name in ORIENTATIONS):
        turned = [signal(name) for name in ORIENTATIONS]
    else:
        yaw = np.interp(time, recording.time, angles(quaternions(recording))[:, 2])
        turned = [*(signal(name) for name in ORIENTATIONS[:2]), yaw]
    finite = np.isfinite(turned).all(axis=0)
    quaternion = np.full((time.size, 4), np.nan)
    if finite.any():
        turns = Rotation.from_euler("xyz", np.stack(turned, axis=1)[finite])
        quaternion[finite] = turns.as_quat(scalar_first=True)
    # A quaternion and its opposite are one pose, and what is between two frames is not.
    signs = np.sign(np.nan_to_num(np.sum(quaternion[1:] * quaternion[:-1], axis=1), nan=1.0))
    quaternion[1:] *= np.cumprod(np.where(signs < 0, -1.0, 1.0))[:, None]
    return np.concatenate([np.stack(position, axis=1), quaternion], axis=1)


def _absent(robot: Robot, known: Mapping[str, int]) -> list[str]:
    """The joints that no log has; what lies between a motor and its link is none."""
    plays = {joint.play.name for joint in robot.joints.values() if joint.play is not None}
    return [name for name in robot.joints if name not in known and name not in plays]


def _closed(
    robot: Robot, addresses: Sequence[int], values: FloatArray, bound: Sequence[str]
) -> FloatArray:
    """Positions with those of the joints that equality constraints bind to them.

    Args:
        robot: the robot as given.
        addresses: of the known positions in qpos.
        values: (n, n_known) of these.
        bound: names of the joints to find.
    """
    model = robot.model
    qpos = np.tile(rest(model).qpos, (len(values), 1))
    qpos[:, list(addresses)] = values
    dofs = [
        dof
        for joint in range(model.njnt)
        if int(model.jnt_qposadr[joint]) in addresses
        for dof in np.flatnonzero(model.dof_jntid == joint).tolist()
    ]
    own = [robot.joints[name].qpos for name in bound]
    found = np.full((len(values), len(own)), np.nan)
    fine = np.isfinite(qpos).all(axis=1)
    if fine.any():
        zero = np.zeros((int(fine.sum()), model.nv))
        found[fine] = robot.loops.closed(qpos[fine], zero, dofs)[0][:, own]
    return np.concatenate([values, found], axis=1)
