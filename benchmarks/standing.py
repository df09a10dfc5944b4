"""Whether our robots stand: ten seconds at home under delayed drives, from poses that are not home.

Each run starts with joints up to 0.05 rad and the body up to 0.03 rad off, the lowest foot on the
floor, and asks for home with a jitter of 0.01 rad at 50 Hz, without which a delay of targets would
change nothing. Lags are drawn anew before every physics step, from 0 to 4 ms. Fallen is who leans
by more than 45 degrees or sinks below 0.7 of the height at home. Efforts are what the law asks for,
before any limit, so that a limit that was reached shows.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import numpy as np
from dm_control import composer
from dm_control.locomotion.arenas import floors

from benchmarks import Row
from walkerkit.actuators import (
    ActuatorCfg,
    ActuatorCmd,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
)
from walkerkit.walkers import Biped, MjcfWalker, Quadruped
from walkerkit.walkers.biped import BIPED_DRIVES
from walkerkit.walkers.quadruped import QUADRUPED_DRIVES

ROBOTS = {"quadruped": (Quadruped, QUADRUPED_DRIVES), "biped": (Biped, BIPED_DRIVES)}
DRIVES = ("PD", "DC motor")
CONTROL_STEP, PHYSICS_STEP = 0.02, 0.002  # s
MAX_LAG = 2  # physics steps: 4 ms
JOINTS, TILT, JITTER = 0.05, 0.03, 0.01  # rad


@dataclass(frozen=True, kw_only=True)
class Stood:
    """How a robot stood.

    Attributes:
        fell: it fell, or the simulation diverged.
        tilt: largest angle between its up and home's [rad].
        height: lowest height of its root, as a share of that at home.
        effort: largest effort that a joint's law asked for, as a share of its limit.
    """

    fell: bool
    tilt: float
    height: float
    effort: float


def run(*, quick: bool) -> list[Row]:
    """All robots, drives and seeds."""
    seeds = range(2 if quick else 20)
    rows = []
    for robot in ROBOTS:
        for drive in DRIVES:
            stood = [stand(robot, drive, seed) for seed in seeds]
            upright = sum(not one.fell for one in stood)
            tilt = max(one.tilt for one in stood)
            effort = max(one.effort for one in stood)
            rows.append(
                Row(
                    what=f"{robot}, {drive}, 0-4 ms late",
                    result=(
                        f"{upright} of {len(stood)} stand 10 s; leaning at most {tilt:.3f} rad, "
                        f"effort at most {effort:.0%} of its limit"
                    ),
                    reference="all, within 100%",
                )
            )
            print(f"{rows[-1].what}: {rows[-1].result}")
    return rows


def stand(robot: str, drive: str, seed: int, seconds: float = 10.0) -> Stood:
    """Lets a robot stand.

    Args:
        robot: one of `ROBOTS`.
        drive: one of `DRIVES`.
        seed: of pose, jitter and lags.
        seconds: for how long.
    """
    walker_class, motors = ROBOTS[robot]
    return hold(walker_class(actuators=late(motors, drive)), seed, seconds)


def hold(walker: MjcfWalker, seed: int, seconds: float = 10.0) -> Stood:
    """Lets a walker hold its home pose, as this module's text says."""
    task = Standing(walker)
    environment = composer.Environment(task, random_state=seed)
    environment.reset()
    random = np.random.default_rng(seed)
    home = np.array(walker.drivetrain.joints.default)
    fell = False
    for _ in range(round(seconds / CONTROL_STEP)):
        target = home + JITTER * random.standard_normal(home.shape)
        step = environment.step(walker.action_for(ActuatorCmd(position_target=target)))
        if step.last():
            fell = True
            break
    return Stood(
        fell=fell or task.tilt > np.pi / 4 or task.height < 0.7,
        tilt=task.tilt,
        height=task.height,
        effort=task.effort,
    )


def late(motors: Iterable[DcMotorActuatorCfg], drive: str) -> Sequence[ActuatorCfg]:
    """The drives behind a delay, as DC motors or without their torque-speed line."""
    bases: Iterable[ActuatorCfg] = motors
    if drive == "PD":
        kept = [field.name for field in fields(IdealPdActuatorCfg)]
        bases = [
            IdealPdActuatorCfg(**{name: getattr(motor, name) for name in kept}) for motor in motors
        ]
    return [DelayedActuatorCfg(base_cfg=base, delay_max_lag=MAX_LAG) for base in bases]


class Standing(composer.Task):  # type: ignore[misc]
    """A walker on a floor, somewhat off its home pose, watched at every physics step.

    Args:
        walker: one that floats.
    """

    def __init__(self, walker: MjcfWalker):
        self._walker = walker
        self._arena = floors.Floor()
        self._arena.add_free_entity(walker)
        self.set_timesteps(CONTROL_STEP, PHYSICS_STEP)
        self._home_height = 1.0
        self.tilt, self.height, self.effort = 0.0, 1.0, 0.0

    @property
    def root_entity(self) -> Any:
        """The floor."""
        return self._arena

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        """Puts the walker near home, its lowest foot on the floor."""
        walker = self._walker
        walker.reinitialize_pose(physics, random_state)
        # The file may have put it higher than its legs reach at home.
        self._put_down(physics)
        self._home_height = float(walker.get_pose(physics)[0][2])
        joints = physics.bind(walker.observable_joints)
        joints.qpos = joints.qpos + random_state.uniform(-JOINTS, JOINTS, len(joints.qpos))
        tilt = np.append(random_state.uniform(-TILT, TILT, 2), 0.0)
        turn = np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, tilt / np.linalg.norm(tilt), float(np.linalg.norm(tilt)))
        walker.shift_pose(physics, quaternion=turn)
        self._put_down(physics)
        self.tilt, self.height, self.effort = 0.0, 1.0, 0.0

    def _put_down(self, physics: Any) -> None:
        """Lets the lowest foot touch the floor."""
        model, data = physics.model.ptr, physics.data.ptr
        mujoco.mj_kinematics(model, data)
        ground = int(physics.bind(self._arena.ground_geoms[0]).element_id)
        feet = np.atleast_1d(physics.bind(self._walker.ground_contact_geoms).element_id)
        gap = min(
            mujoco.mj_geomDistance(model, data, int(foot), ground, 1.0, None) for foot in feet
        )
        self._walker.shift_pose(physics, position=[0.0, 0.0, -gap])

    def before_step(self, physics: Any, action: Any, random_state: Any) -> None:
        """Hands the action to the walker."""
        self._walker.apply_action(physics, action, random_state)

    def after_substep(self, physics: Any, random_state: Any) -> None:
        """Keeps the worst."""
        del random_state
        root = physics.bind(self._walker.root_body)
        self.height = min(self.height, float(root.xpos[2]) / self._home_height)
        self.tilt = max(self.tilt, float(np.arccos(np.clip(root.xmat[8], -1.0, 1.0))))
        asked = np.abs(self._walker.actuator_group.computed_effort)
        self.effort = max(
            self.effort, float((asked / self._walker.drivetrain.joints.efforts).max())
        )

    def get_reward(self, physics: Any) -> float:
        """None."""
        del physics
        return 0.0
