"""How well the base's state is estimated where nobody measures its pose.

Our quadruped stands and shifts on rehearsed hardware (`walkerkit.gap.rehearsal`: ground, servos and
inertial unit of its own physics), and trots in an arena on MuJoCo's soft ground. Its log has what
an inertial unit with bias and noise reads, encoders with noise, and the feet's contacts or none.
The estimate from that is held to the truth beside it.

Attitude is without heading, velocity in the base's frame, as no log of these tells a heading. What
its own stated errors cover is the share of roll, pitch and the three velocities within 1.96 of
their standard deviations.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from dm_control import composer
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from benchmarks import Row
from walkerkit import gap
from walkerkit.actuators import ActuatorCmd, BuiltinPositionActuatorCfg
from walkerkit.gap.recordings.base_state import ANGULAR, LINEAR, POSITION
from walkerkit.gap.recordings.recording import BASE, QUATERNION
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hardware_imu import Imu, felt, imu_readings
from walkerkit.gap.rehearsal.standing import standing_targets, write_standing
from walkerkit.gap.simulation.base_estimate import with_estimated_base
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Robot
from walkerkit.tasks import FallLimits, Stand
from walkerkit.walkers import QUADRUPED_XML, Quadruped
from walkerkit.walkers.gait import Trot

FloatArray = NDArray[np.float64]

SECONDS = 5.0
ENCODER = 1e-4  # rad, noise of the trotting robot's
_WITHIN = 1.96  # standard deviations: 95 %
_TRUTH = (*POSITION, *QUATERNION, *LINEAR, *ANGULAR)


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Of one log.

    Attributes:
        tilt: (T,) angle between the estimated and the true upwards [rad].
        speed: (T,) [m/s].
        within: share of the errors that the stated ones cover.
    """

    tilt: FloatArray
    speed: FloatArray
    within: float


def run(*, quick: bool) -> list[Row]:
    """Standing and trotting, with logged contacts and with inferred ones."""
    seeds = range(1 if quick else 5)
    rows = []
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        for what, logs in (("standing", standing), ("trotting", trotting)):
            found: dict[str, list[Errors]] = {"logged": [], "inferred": []}
            for seed in seeds:
                for robot, log in logs(seed, Path(folder)):
                    for contacts, one in found.items():
                        one.append(errors(robot, log, contacts == "logged"))
            for contacts, each in found.items():
                rows.append(_row(f"{what}, contacts {contacts}", each))
                print(f"{rows[-1].what}: {rows[-1].result}")
    return rows


def _row(what: str, each: list[Errors]) -> Row:
    tilt = np.rad2deg(np.sqrt(np.mean(np.concatenate([one.tilt for one in each]) ** 2)))
    speed = np.sqrt(np.mean(np.concatenate([one.speed for one in each]) ** 2))
    within = float(np.mean([one.within for one in each]))
    return Row(
        what=f"{what}, {len(each)} logs of {SECONDS:g} s",
        result=f"attitude {tilt:.2f}°, velocity {speed:.4f} m/s RMS; {within:.0%} within errors",
        required="0.5°, 0.05 m/s; 90 to 98%",
    )


def errors(robot: Robot, log: gap.Recording, contacts: bool) -> Errors:
    """What the estimate from a log's unit errs by, held to the pose in the same log."""
    hidden = {n for n in log.columns if n in BASE or (n.endswith("/contact") and not contacts)}
    kept = {name: values for name, values in log.columns.items() if name not in hidden}
    found = with_estimated_base(robot, replace(log, columns=kept))
    (true_turn, true_speed), (turn, speed) = (_state(one) for one in (log, found))
    up = np.array([0.0, 0.0, 1.0])
    tilt = np.cross(turn.inv().apply(up), true_turn.inv().apply(up))
    off = turn.inv().apply(speed) - true_turn.inv().apply(true_speed)
    stated = np.stack(
        [found.errors[f"base/orientation_{axis}"] for axis in "xy"]
        + [found.errors[name] for name in LINEAR],
        axis=1,
    )
    both = np.concatenate([tilt[:, :2], off], axis=1)
    return Errors(
        tilt=np.linalg.norm(tilt, axis=1),
        speed=np.linalg.norm(off, axis=1),
        within=float(np.mean(np.abs(both) < _WITHIN * stated)),
    )


def _state(log: gap.Recording) -> tuple[Rotation, FloatArray]:
    quaternion = np.stack([log.columns[name] for name in QUATERNION], axis=1)
    speed = np.stack([log.columns[name] for name in LINEAR], axis=1)
    return Rotation.from_quat(np.roll(quaternion, -1, axis=1)), speed


def standing(seed: int, folder: Path) -> Iterator[tuple[Robot, gap.Recording]]:
    """Shifts, squats and steps on rehearsed hardware."""
    path = write_standing(folder)
    robot = load_robot(path)
    targets = standing_targets(np.random.default_rng(seed), seconds=SECONDS)
    logs = run_hardware(path, [*targets.values()], names=[*targets], seed=seed, base="truth")
    for log in logs:
        yield robot, log


def trotting(seed: int, folder: Path) -> Iterator[tuple[Robot, gap.Recording]]:
    """A trot over MuJoCo's ground, open loop, at a speed that is drawn."""
    del folder
    rng = np.random.default_rng(seed)
    log = trot(Trot(stride=rng.uniform(0.06, 0.14)), SECONDS, base="both")
    states = np.stack([log.columns[name] for name in _TRUTH], axis=1)
    signals = felt(states[:, None], step=1 / log.rate, stride=1)[:, 0]
    columns = {
        name: values + ENCODER * rng.standard_normal(len(values))
        if name.endswith("/position")
        else values
        for name, values in log.columns.items()
    }
    columns |= imu_readings(signals, Imu.drawn(rng), log.rate, rng)
    yield load_robot(QUADRUPED_XML, floating=True), replace(log, columns=columns)


def servos() -> list[BuiltinPositionActuatorCfg]:
    """The quadruped's, of MuJoCo's own, with the gains of its default drives."""
    return [
        BuiltinPositionActuatorCfg(
            joint_names_expr=names, stiffness=gain, damping=damping, effort_limit=limit
        )
        for names, gain, damping, limit in (
            ((".*_hip", ".*_thigh"), 64.0, 1.0, 23.7),
            ((".*_calf",), 143.0, 2.3, 35.55),
        )
    ]


def quadruped() -> Quadruped:
    """Ours, on those."""
    return Quadruped(actuators=servos())


def trot(gait: Trot, seconds: float, base: Any = "pose") -> gap.Recording:
    """The log of the quadruped on servos of MuJoCo's as it trots over a floor."""
    robot = quadruped()
    task = Stand(robot, control_timestep=0.004, joint_noise=0.0, fall=FallLimits(tilt=1.0))
    environment = composer.Environment(task, random_state=0)

    def policy(timestep: Any) -> Any:
        del timestep
        targets = gait(environment.physics.time())
        return robot.drivetrain.action_for(ActuatorCmd(position_target=targets))

    return gap.record(
        environment, policy, seconds=seconds, every="physics_step", name="trot", base=base
    )
