"""Held-out recordings simulated with a learned drive at one joint, as a walker would run it.

    gap = closed_loop_gap(problem, robot, joint, law, lag=2)      # rad

The joint's own drive is taken out of the model and the law's effort applied instead, before every
physics step; everything else is as in a replay. Robots with drivetrain laws, floating bases or a
log that is not the joint's own position are left to replays (`can_close`).
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.laws.law import Law
from walkerkit.gap.recordings.segments import Segment, cut
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.commands import between_samples, routes
from walkerkit.gap.simulation.robot import Measurement, Robot
from walkerkit.gap.simulation.start import memory, rest, start_state
from walkerkit.walkers.batch import LockStep

FloatArray = NDArray[np.float64]


def can_close(robot: Robot, joint: str) -> bool:
    """Whether a joint's drive can be replaced and the loop be closed over the rest as it is."""
    ideal = Measurement()
    measured = robot.measured(joint)
    as_it_is = Measurement(effort_scale=measured.effort_scale, effort_offset=measured.effort_offset)
    drives = robot.joints[joint].drives
    return (
        not robot.laws
        and not robot.programs
        and robot.base is None
        and len(drives) == 1
        and drives[0].kind == "position"
        and measured == as_it_is
        and all(
            robot.measured(other).position_delay == ideal.position_delay for other in robot.joints
        )
    )


def closed_loop_gap(
    problem: Problem, half: Half, robot: Robot, joint: str, law: Law, *, lag: int
) -> float:
    """Root-mean-square position error of the joint; infinite where the simulation diverges.

    Args:
        problem: how recordings are replayed; it has one robot.
        half: the recordings.
        robot: the robot.
        joint: the joint whose drive the law stands for.
        law: the law, of one joint; it is allocated anew.
        lag: physics steps by which its targets are late.
    """
    segments = cut(half.recordings[0], problem.window)
    squares, count = 0.0, 0
    for recording in dict.fromkeys(id(segment.recording) for segment in segments):
        mine = [segment for segment in segments if id(segment.recording) == recording]
        error = _errors(problem, robot, joint, law, lag, mine)
        if not np.isfinite(error).all():
            return float("inf")
        squares += float(error @ error)
        count += len(error)
    return float(np.sqrt(squares / count))


def _errors(
    problem: Problem, robot: Robot, joint: str, law: Law, lag: int, segments: list[Segment]
) -> FloatArray:
    """Position errors of the windows of one recording, simulated side by side."""
    model, recording = robot.model, segments[0].recording
    step, n = model.opt.timestep, len(segments)
    joints = [robot.joints[name] for name in recording.joints]
    ours = robot.joints[joint]
    steps = int(np.ceil(max(segment.duration for segment in segments) / step)) + 1
    remembered = memory(model)
    offsets = step * np.arange(-remembered - lag, steps)
    start = np.array([segment.start for segment in segments])
    ctrl = np.tile(rest(model).ctrl, (n, len(offsets), 1))
    applied = np.zeros((n, len(offsets), model.nv))
    targets = np.zeros((n, len(offsets)))
    for route in routes(robot, recording):
        times = (start[:, None] + offsets).ravel()
        values = between_samples(recording, route.column, times, problem.hold, step).reshape(n, -1)
        if route.drive is not None and route.drive == ours.drive("position"):
            targets = values
        elif route.drive is not None:
            ctrl[..., route.drive.ctrl] = route.drive.control(values)
        elif route.joint is not None:
            applied[..., route.joint.dof] += values
    qpos, qvel = MeasuredState(recording, recording.joints).at(start)
    places = [one.qpos for one in joints], [one.dof for one in joints]
    before = lag + remembered
    state = start_state(model, ctrl[:, lag:before], qpos, qvel, places)
    law.allocate((n, 1))
    law.reset(None)
    batch = _without_drive(model, ours.drives[0].actuator, n, problem.n_threads)
    live = {name: batch.live(name) for name in ("qpos", "qvel", "ctrl", "qfrc_applied")}

    def act(k: int) -> None:
        q, qd = live["qpos"][:, [ours.qpos]], live["qvel"][:, [ours.dof]]
        _, effort = law.effort(targets[:, [before + k - lag]], None, None, q, qd)
        live["ctrl"][...] = ctrl[:, before + k]
        live["qfrc_applied"][...] = applied[:, before + k]
        live["qfrc_applied"][:, ours.dof] += effort[:, 0]

    rollout = batch.step_by_step(state, steps - 1, act)
    path = np.concatenate(
        [qpos[:, [recording.joints.index(joint)]], rollout.records["qpos"][..., ours.qpos]], axis=1
    )
    measured = recording.columns[f"{joint}/position"]
    return np.concatenate(
        [
            np.interp(recording.time[s.first : s.last] - s.start, step * np.arange(steps), path[i])
            - measured[s.first : s.last]
            for i, s in enumerate(segments)
        ]
    )


def _without_drive(model: mujoco.MjModel, actuator: int, n: int, n_threads: int) -> LockStep:
    """Simulations in which an actuator does nothing."""
    off = np.array(model.actuator_gainprm), np.array(model.actuator_biasprm)
    for parameters in off:
        parameters[actuator] = 0.0
    return LockStep(
        model,
        n,
        fields={
            "actuator_gainprm": np.repeat(off[0][None], n, axis=0),
            "actuator_biasprm": np.repeat(off[1][None], n, axis=0),
        },
        n_threads=n_threads,
    )
