"""A stopgap: a network beside a joint's drive, trained on the fitted recordings.

    found = learned_drive(problem, robot, "knee", before=0.02)
    found.after                           # position error of the knee on held-out recordings [rad]
    found.trained.save("stopgap_knee.npz")

From the last few position errors and velocities the network learns what the drive reported beside
what its law makes. It is kept only where the held-out recordings, simulated with it in the loop,
are followed much better than without. It knows nothing of poses or loads, and cannot learn what
acts on the joint beside the drive, so it is no diagnosis and no model.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.laws.law import Law
from walkerkit.actuators.learned import LearnedMlpActuatorCfg
from walkerkit.actuators.networks.trained import TrainedMlp
from walkerkit.actuators.networks.training_rows import Scales, TrainingRows
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.commands import between_samples
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.stopgap.closed_loop import can_close, closed_loop_gap
from walkerkit.gap.stopgap.network import beside, fit_network

FloatArray = NDArray[np.float64]
Signals = tuple[FloatArray, FloatArray, FloatArray]

_HISTORY = 3  # samples of each signal
_FEWEST = 100  # steps of a recording that says something
_HELD_OUT = 0.2  # of each fitted recording, to know when to stop
_SHRINKS = 0.25  # of the joint's position error that it has to take away
_STRONGER = 1.5  # times the largest effort that was reported: what it may ask for
_FAST = 1e3  # times the peak speed: no torque–speed line


@dataclass(frozen=True, kw_only=True, eq=False)
class LearnedDrive:
    """A network in the place of a joint's drive.

    Attributes:
        joint: the joint.
        trained: the network, with its scales; the drive's own law is in it.
        effort_limit: the most that it may ask for [N·m; N].
        velocity_limit: speed of its torque–speed line, out of reach [rad/s; m/s].
        lag: physics steps by which its targets are late.
        before: root-mean-square position error of the joint on held-out recordings [rad; m].
        after: the same with the network in the loop.
    """

    joint: str
    trained: TrainedMlp
    effort_limit: float
    velocity_limit: float
    lag: int
    before: float
    after: float

    def fields(self, file: str) -> dict[str, Any]:
        """The fields of its `LearnedMlpActuatorCfg`, in plain numbers.

        Args:
            file: where the network is.
        """
        trained = self.trained
        return {
            "network_file": file,
            "pos_scale": trained.pos_scale,
            "vel_scale": trained.vel_scale,
            "torque_scale": trained.torque_scale,
            "input_order": trained.input_order,
            "history_length": trained.history_length,
            "saturation_effort": 2 * self.effort_limit,
            "velocity_limit": self.velocity_limit,
            "effort_limit": self.effort_limit,
        }


def learned_drive(
    problem: Problem, robot: Robot, joint: str, *, before: float
) -> LearnedDrive | None:
    """Trains a network, and closes the loop over it on the held-out recordings.

    Args:
        problem: what the recordings are of; one model.
        robot: the mended robot.
        joint: the joint.
        before: its position error on held-out recordings as it is [rad; m].

    Returns:
        The drive, or None where none can be trained (`why_none`), or it is not worth it.
    """
    if why_none(problem, robot, joint):
        return None
    late = float(robot.model.actuator_delay[robot.joints[joint].drives[0].actuator])
    lag = round(late / robot.model.opt.timestep)
    signals = [
        _signals(problem, robot, joint, recording, lag) for recording in problem.fit.recordings[0]
    ]
    signals = [one for one in signals if len(one[0]) >= _FEWEST]
    if not signals:
        return None
    law = _drive_law(robot, joint)
    error, velocity, effort = (np.concatenate(parts) for parts in zip(*signals, strict=True))
    if not all(np.ptp(signal) > 0 for signal in (error, velocity, effort)):
        return None
    drive = LearnedDrive(
        joint=joint,
        trained=beside(fit_network(_rows(signals, law), _HISTORY), **law),
        effort_limit=_STRONGER * float(np.abs(effort).max()),
        velocity_limit=_FAST * float(np.abs(velocity).max()),
        lag=lag,
        before=before,
        after=np.inf,
    )
    after = closed_loop_gap(problem, problem.held, robot, joint, runnable(drive), lag=lag)
    return replace(drive, after=after) if after < (1 - _SHRINKS) * before else None


def why_none(problem: Problem, robot: Robot, joint: str) -> str:
    """Why no network can be trained in the place of a joint's drive, or "".

    Args:
        problem: what the recordings are of.
        robot: the mended robot.
        joint: the joint.
    """
    if len(problem.robots) > 1:
        return "the recordings are of several models"
    if any(recording.signal(joint, "effort") is None for recording in problem.recordings):
        return "its effort was not logged"
    if not can_close(robot, joint):
        return "its drive is no plain servo, or what is named acts in it or in how it is read"
    return ""


def runnable(drive: LearnedDrive) -> Law:
    """The law that a walker would run, of the one joint."""
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "drive.npz")
        drive.trained.save(file)
        cfg = LearnedMlpActuatorCfg(joint_names_expr=(".*",), **drive.fields(file))
        return cfg.law({name: np.array([value]) for name, value in cfg.numbers().items()})


def _drive_law(robot: Robot, joint: str) -> dict[str, float]:
    """The joint's own drive as kp e − kd q̇ + c, as mended, without its limits."""
    model, drive = robot.model, robot.joints[joint].drives[0]
    gear = float(model.actuator_gear[model.actuator_outadr[drive.actuator], 0])
    gain = float(model.actuator_gainprm[drive.actuator, 0])
    b0, b1, b2 = (float(b) for b in model.actuator_biasprm[drive.actuator, :3])
    return {
        "stiffness": -b1 * gear**2,
        "damping": -b2 * gear**2,
        "constant": gear * (gain * drive.offset + b0),
    }


def _signals(problem: Problem, robot: Robot, joint: str, recording: Recording, lag: int) -> Signals:
    """Position error, velocity and reported effort at the physics' own steps, (T, 1) each."""
    step = robot.model.opt.timestep
    time = np.arange(recording.time[0], recording.time[-1], step)
    qpos, qvel = MeasuredState(recording, [joint]).at(time)
    at = time - lag * step
    target = between_samples(recording, f"{joint}/position_target", at, problem.hold, step)
    measured = robot.measured(joint)
    logged = np.interp(time, recording.time, recording.columns[f"{joint}/effort"])
    reported = (logged - measured.effort_offset) / measured.effort_scale
    return (target - qpos[:, 0])[:, None], qvel, reported[:, None]


def _rows(signals: Sequence[Signals], law: Mapping[str, float]) -> TrainingRows:
    """What was reported beside the law, of which the end of each recording is left out."""
    kp, kd, constant = law["stiffness"], law["damping"], law["constant"]
    beside_law = [(e, v, effort - (kp * e - kd * v + constant)) for e, v, effort in signals]
    error, velocity, effort = (np.concatenate(parts) for parts in zip(*beside_law, strict=True))
    scales: Scales = {
        "pos_scale": 1 / float(np.std(error)),
        "vel_scale": 1 / float(np.std(velocity)),
        "torque_scale": float(np.std(effort)),
    }
    each = [
        TrainingRows.of(
            dict(zip(("position_error", "velocity", "effort"), one, strict=True)),
            history_length=_HISTORY,
            input_order="pos_vel",
            given=dict(scales),  # type: ignore[arg-type]
            validation_fraction=_HELD_OUT,
        )
        for one in beside_law
    ]
    (features, targets), (others, wanted) = (
        tuple(np.concatenate(parts) for parts in zip(*of_all, strict=True))
        for of_all in ([one.training for one in each], [one.validation for one in each])
    )
    return TrainingRows(scales=scales, training=(features, targets), validation=(others, wanted))
