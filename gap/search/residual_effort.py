"""The effort that a simulation lacks, from short windows of the measured motion.

    missing = residual_effort(problem, mended, joints=("knee",))
    missing.residual                     # (n, 1) N·m

A window of some 20 ms starts from the measured state and is simulated with the recorded commands.
The effort that, held over it, would have led to the measured velocity at its end is what the
simulation lacks there. How an effort moves the velocity is simulated too, so that servos, coupled
links and all that was mended already count as they are. Windows in which the joint sticks say
nothing and are left out, and so are those in which it rests, since they do not tell which way its
friction points.

The simulation runs at a quarter of its timestep. What smoothing makes of fast motion is found on
the simulation's own log of the same experiment, which lacks nothing, and taken out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import Segment, whole
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.search.objective import BLOCK
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.replay import Channel, Replay, as_they_are
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials
from walkerkit.gap.units import LARGEST_POSITION

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_WINDOW = 0.02  # s
_FEWEST_STEPS = 4  # samples of the log
_MARGIN = 0.1  # s at both ends of a recording, where smoothing is one-sided
_MOST = 400  # windows of fitted, and of held-out recordings
_TOGETHER = 80  # windows simulated at once, which keep a second of past commands each
_PUSH = 0.05  # of the joint's peak effort
_SOFT = 1e-9  # N·m/rad of the spring that pushes
_STUCK = 0.2  # of the usual answer to a push
_AT_REST = 0.01  # of the joint's peak speed
_FINER = 4  # times


@dataclass(frozen=True, kw_only=True)
class ResidualEffort:
    """Windows of the measured motion, and what the simulation lacks in each.

    Attributes:
        joints: the joints.
        time: (n,) middle of each window [s].
        q, qd, qdd: (n, n_joints) measured motion there [rad, rad/s, rad/s²; m…].
        effort: (n, n_joints) the drive's effort, as logged where it was, else as simulated [N·m].
        residual: (n, n_joints) effort that the simulation lacks [N·m; N]; NaN where the joint
            sticks or rests.
        block: (n,) number of the stretch of about half a second that a window belongs to.
        held_out: (n,) whether its recording was held out.
    """

    joints: tuple[str, ...]
    time: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    effort: FloatArray
    residual: FloatArray
    block: IntArray
    held_out: NDArray[np.bool_]

    def at(self, rows: NDArray[np.bool_]) -> ResidualEffort:
        """Some of the windows."""
        chosen = {item.name: getattr(self, item.name)[rows] for item in fields(self)[1:]}
        return replace(self, **chosen)


def residual_effort(
    problem: Problem,
    robots: Sequence[Robot],
    joints: Sequence[str],
) -> ResidualEffort | None:
    """Measures the effort that robots lack.

    Args:
        problem: the recordings, and how they are replayed.
        robots: the robots, one for each of the problem's.
        joints: where to look; efforts of other joints are taken to be right.

    Returns:
        The windows of all recordings that have these joints, or None where there are none.
    """
    finer = [robot.refined(_FINER) for robot in robots]
    experiments = [
        (name, robot, recording)
        for name, half in (("fit", problem.fit), ("held", problem.held))
        for robot, mine in zip(finer, half.recordings, strict=True)
        for recording in mine
        if all(joint in recording.joints for joint in joints)
    ]
    own_logs = _own_logs(problem, [(robot, recording) for _, robot, recording in experiments])
    count = Counter(name for name, *_ in experiments)
    parts: list[dict[str, FloatArray]] = []
    blocks = 0
    for (name, robot, recording), own in zip(experiments, own_logs, strict=True):
        for segments in _batches(recording, _MOST // count[name]):
            part = _windows(problem, robot, segments, joints)
            if own is not None:
                same = [replace(segment, recording=own) for segment in segments]
                part["lacking"] -= _lacking(problem, robot, same, joints)
            part["held_out"] = np.full(len(segments), float(name == "held"))
            part["block"] = blocks + (part["time"] - recording.time[0]) // BLOCK
            parts.append(part)
        blocks += int((recording.time[-1] - recording.time[0]) / BLOCK) + 1
    if not parts:
        return None
    found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    residual = _solved(found["answer"], found["lacking"])
    slow = [_AT_REST * robots[0].excursion(joint).velocity for joint in joints]
    residual[np.abs(found["qd"]) < slow] = np.nan
    return ResidualEffort(
        joints=tuple(joints),
        time=found["time"],
        q=found["q"],
        qd=found["qd"],
        qdd=found["qdd"],
        effort=found["effort"],
        residual=residual,
        block=found["block"].astype(np.int64),
        held_out=found["held_out"] > 0,
    )


def _own_logs(
    problem: Problem, experiments: Sequence[tuple[Robot, Recording]]
) -> list[Recording | None]:
    """What the simulation itself logs of experiments; None where it flies off, or in windows."""
    if problem.window is not None:
        return [None] * len(experiments)
    replays = [
        Replay(
            robot,
            whole(recording),
            [Channel(joint=joint, signal="position") for joint in recording.joints],
            hold=problem.hold,
        )
        for robot, recording in experiments
    ]
    found: list[Recording | None] = []
    for (_, recording), predicted in zip(
        experiments, as_they_are(replays, problem.n_threads), strict=True
    ):
        logged = {
            f"{joint}/position": column
            for joint, column in zip(recording.joints, predicted.T, strict=True)
        }
        measured = [recording.columns[f"{joint}/position"] for joint in recording.joints]
        farthest = max(LARGEST_POSITION, 2 * float(np.abs(measured).max()))
        near = bool((np.abs(predicted) <= farthest).all())  # what is NaN is not
        found.append(replace(recording, columns={**recording.columns, **logged}) if near else None)
    return found


def _batches(recording: Recording, most: int) -> Iterator[list[Segment]]:
    """Windows spread evenly over a recording, some at a time."""
    time = recording.time
    step = float(np.median(np.diff(time)))
    steps = max(_FEWEST_STEPS, round(_WINDOW / step))
    first = int(np.searchsorted(time, time[0] + _MARGIN))
    last = int(np.searchsorted(time, time[-1] - _MARGIN)) - steps
    count = min(most, max(0, last - first) // steps)
    starts = np.linspace(first, last, count, endpoint=False).astype(int)
    found = [Segment(recording=recording, first=int(s), last=int(s) + steps + 1) for s in starts]
    for start in range(0, count, _TOGETHER):
        yield found[start : start + _TOGETHER]


def _windows(
    problem: Problem, robot: Robot, segments: Sequence[Segment], joints: Sequence[str]
) -> dict[str, FloatArray]:
    """The windows' motion and efforts, (n, n_joints) each, and how efforts move the joints."""
    channels = [Channel(joint=j, signal=s) for s in ("velocity", "effort") for j in joints]
    replay = Replay(robot, segments, channels, hold=problem.hold, n_threads=problem.n_threads)
    trials = Trials(robot, 1 + len(joints))
    sizes = [_PUSH * robot.excursion(joint).effort for joint in joints]
    for row, (joint, size) in enumerate(zip(joints, sizes, strict=True), start=1):
        _push(trials, row, joint, size)
    predicted = replay.predict(trials)
    ends = _ends(segments)
    velocity = predicted[:, ends - 1, : len(joints)]
    duration = np.array([segment.duration for segment in segments])
    start = np.array([segment.start for segment in segments])
    state = MeasuredState(segments[0].recording, joints)
    _, left = state.at(start)
    _, reached = state.at(start + duration)
    q, qd = state.at(start + 0.5 * duration)
    known = [robot.measured(joint) for joint in joints]
    offset = np.array([one.effort_offset for one in known])
    scale = np.array([one.effort_scale for one in known])
    middle = (np.concatenate([[0], ends[:-1]]) + ends - 1) // 2
    # As it is at the joint, not as the log shows it.
    simulated = (predicted[0, middle, len(joints) :] - offset) / scale
    logged = (replay.measured[middle, len(joints) :] - offset) / scale
    return {
        "time": start + 0.5 * duration,
        "q": q,
        "qd": qd,
        "qdd": (reached - left) / duration[:, None],
        "effort": np.where(np.isfinite(logged), logged, simulated),
        "lacking": reached - velocity[0],
        # (n, n_joints, n_joints): rad/s that the effort of each joint brings to each
        "answer": np.moveaxis(velocity[1:] - velocity[0], 0, 2) / np.array(sizes),
    }


def _lacking(
    problem: Problem, robot: Robot, segments: Sequence[Segment], joints: Sequence[str]
) -> FloatArray:
    """(n, n_joints) velocities at the ends of windows that the simulation does not reach."""
    channels = [Channel(joint=joint, signal="velocity") for joint in joints]
    replay = Replay(robot, segments, channels, hold=problem.hold, n_threads=problem.n_threads)
    (predicted,) = replay.predict(Trials(robot, 1))
    ends = np.array([segment.start + segment.duration for segment in segments])
    _, reached = MeasuredState(segments[0].recording, joints).at(ends)
    lacking: FloatArray = reached - predicted[_ends(segments) - 1]
    return lacking


def _ends(segments: Sequence[Segment]) -> IntArray:
    return np.cumsum([segment.last - segment.first for segment in segments])


def _push(trials: Trials, row: int, joint: str, size: float) -> None:
    """Adds a constant effort at a joint to one variant: a spring, very long and very soft."""
    at = trials.robot.joints[joint]
    stiffness, rest = trials.field("jnt_stiffness"), trials.field("qpos_spring")
    own = stiffness[row, at.id]
    rest[row, at.qpos] = (own * rest[row, at.qpos] + size) / (own + _SOFT)
    stiffness[row, at.id] = own + _SOFT


def _solved(answer: FloatArray, lacking: FloatArray) -> FloatArray:
    """The efforts that bring what is lacking, (n, n_joints); NaN at joints that stick."""
    n, n_joints = lacking.shape
    own = np.abs(np.einsum("nii->ni", answer))
    whole = np.isfinite(np.concatenate([answer.reshape(n, -1), lacking], axis=1)).all(axis=1)
    usual = np.median(own[whole], axis=0) if whole.any() else np.ones(n_joints)
    moves = whole[:, None] & np.greater(own, _STUCK * usual)
    # A joint that sticks takes no part.
    both = moves[:, :, None] & moves[:, None, :]
    matrix = np.where(both, answer, np.eye(n_joints))
    efforts = np.linalg.solve(matrix, np.where(moves, lacking, 0.0)[..., None])[..., 0]
    return np.where(moves, efforts, np.nan)
