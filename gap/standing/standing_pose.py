"""A robot as it stands: which pose, on what, held by which targets, and how fast it can sway.

    stand = find_stand(robot)
    stand.qpos, stand.soles, stand.joints       # where its servos leave it, and on what
    stand.bandwidth                             # Hz, of its slowest mode on its servos

Its servos are sent the first keyframe, and what they make of that under gravity is the pose from
which motions are drawn: soft servos sag, and so do those of the robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space

from walkerkit.gap.errors import refusal, some
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.gap.standing.simulated import Simulated, sent, simulated
from walkerkit.gap.standing.soles import Area, Sole, put_down, soles_at
from walkerkit.gap.standing.variants import Variants, gain, variants

FloatArray = NDArray[np.float64]

_SETTLES, _RATE = 2.0, 100.0  # s, Hz
_MOST_TILT = 0.3  # rad
_LEAST_HEIGHT = 0.7  # of that of the keyframe
_STILL = 1e-6  # of the stiffest mode; what is softer is held by no servo


@dataclass(frozen=True, kw_only=True)
class Stand:
    """A robot on its feet.

    Attributes:
        robot: the robot.
        base: what floats.
        joints: those that are sent positions.
        targets: (n_joints,) which hold it [rad; m].
        qpos: (nq,) the pose in which they do, on the model.
        soles: what it stands on then.
        variants: the model, and what it may be instead.
        bandwidth: frequency of its slowest mode on its servos, with its feet fixed [Hz].
    """

    robot: Robot
    base: Base
    joints: tuple[Joint, ...]
    targets: FloatArray
    qpos: FloatArray
    soles: tuple[Sole, ...]
    variants: Variants
    bandwidth: float

    @cached_property
    def points(self) -> tuple[FloatArray, ...]:
        """(n, 3) of each sole where it stands, in the world's frame [m]."""
        data = self.at(self.qpos)
        return tuple(sole.where(data) for sole in self.soles)

    @property
    def level(self) -> float:
        """Height of the ground [m]."""
        return float(np.concatenate(self.points)[:, 2].mean())

    @property
    def height(self) -> float:
        """Of the base over the ground [m]."""
        return float(self.qpos[self.base.qpos + 2]) - self.level

    @property
    def centre(self) -> FloatArray:
        """(2,) its centre of mass over the ground [m]."""
        found: FloatArray = self.at(self.qpos).subtree_com[self.base.id, :2].copy()
        return found

    def area(self, *, without: int | None = None) -> Area:
        """The area that it stands on, with all soles or without one of them."""
        kept = [points for k, points in enumerate(self.points) if k != without]
        return Area(np.concatenate(kept)[:, :2] if kept else np.zeros((1, 2)))

    def at(self, qpos: FloatArray) -> mujoco.MjData:
        """Kinematics of the model at a pose."""
        data = mujoco.MjData(self.robot.model)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self.robot.model, data)
        mujoco.mj_comPos(self.robot.model, data)
        return data


def find_stand(robot: Robot, *, n_threads: int = 0) -> Stand:
    """Lets a robot stand.

    Args:
        robot: it floats, and its first keyframe has it on its feet.
        n_threads: of the simulation, 0 for all cores.

    Raises:
        InputError: it does not float, some of its drives take no positions, nothing of it touches
            the ground, or it does not stand by itself.
    """
    base = robot.base
    if base is None:
        raise refusal(
            f"{robot.source}: no robot floats in it, so that none stands. Give the model with its "
            "free joint, or leave out --standing for one that hangs."
        )
    joints = _sent_positions(robot)
    down = put_down(robot, base)
    targets = down[[joint.qpos for joint in joints]]
    doubted = variants(robot, base, joints)
    time = np.arange(0.0, _SETTLES, 1 / _RATE)
    held = {j.name: np.full(len(time), u) for j, u in zip(joints, targets, strict=True)}
    (ran,) = simulated(
        [sent(robot, base, down, time, held)], robot, base, doubted.trials, n_threads=n_threads
    )
    _check_stands(robot, base, down, doubted, ran)
    qpos = ran.qpos[0, -1].copy()
    soles = soles_at(robot, qpos)
    if not soles:
        raise refusal(
            f"{robot.source}: the robot is off the ground {_SETTLES:g} s after it was put down on "
            "it. Make its contacts softer, or its timestep shorter, until it stands still."
        )
    return Stand(
        robot=robot,
        base=base,
        joints=joints,
        targets=targets,
        qpos=qpos,
        soles=soles,
        variants=doubted,
        bandwidth=_bandwidth(robot, joints, qpos, soles),
    )


def _sent_positions(robot: Robot) -> tuple[Joint, ...]:
    """The joints that are sent positions, which are all that are driven.

    Raises:
        InputError: there are none, or some are driven otherwise.
    """
    driven = [joint for joint in robot.joints.values() if joint.commanded]
    others = [joint.name for joint in driven if joint.drive("position") is None]
    if others or not driven:
        which = f"joints {some(others)} take no" if others else "its joints take no"
        raise refusal(
            f"{robot.source}: {which} positions, which is what standing takes. Turn its motors "
            "into the servos that its controller is: walkerkit servo MODEL --kp KP --kd KD --out "
            "NEW.xml."
        )
    return tuple(driven)


def _check_stands(
    robot: Robot, base: Base, down: FloatArray, doubted: Variants, ran: Simulated
) -> None:
    """Raises InputError where the robot, or one that it may be, does not stay on its feet."""
    for k, name in enumerate(doubted.names):
        end = ran.qpos[k, -1]
        if np.isfinite(end).all():
            quaternion = end[base.qpos + 3 : base.qpos + 7]
            _, x, y, _ = quaternion / np.linalg.norm(quaternion)
            tilt = float(np.arccos(np.clip(1 - 2 * (x * x + y * y), -1, 1)))
            fallen = end[base.qpos + 2] - down[base.qpos + 2]
            if tilt < _MOST_TILT and fallen > -(1 - _LEAST_HEIGHT) * abs(down[base.qpos + 2]):
                continue
        raise refusal(
            f"{robot.source}: the robot does not stand still by its servos alone when it is sent "
            f"its first keyframe ({name}). Give a keyframe in which it stands, or the gains that "
            "hold it: walkerkit servo MODEL --kp KP --kd KD --out NEW.xml."
        )


def _bandwidth(
    robot: Robot, joints: tuple[Joint, ...], qpos: FloatArray, soles: tuple[Sole, ...]
) -> float:
    """Frequency of the slowest mode on the servos' springs, with the feet fixed [Hz]."""
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    rows = []
    for sole in soles:
        for point in sole.where(data):
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, point, sole.body)
            rows.append(jacobian)
    free = null_space(np.concatenate(rows)) if rows else np.eye(model.nv)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    stiffness = np.zeros(model.nv)
    for joint in joints:
        stiffness[joint.dof] = gain(robot, joint, "stiffness")
    squares = eigh(free.T @ (stiffness[:, None] * free), free.T @ mass @ free, eigvals_only=True)
    held = squares[squares > _STILL * squares.max(initial=1e-12)]
    return float(np.sqrt(held.min(initial=np.inf)) / (2 * np.pi))
