"""Stands the quadruped and the biped, and prints what that costs each joint.

    python examples/stand.py [SECONDS]

They hold their home pose by PD control through their DC motors, whose targets arrive 0 to 4 ms
late. The table has each joint's effort: its root mean square, its peak, the motor's limit.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

os.environ.setdefault("MUJOCO_GL", "disable")

import numpy as np
from _arguments import argument
from dm_control import composer
from numpy.typing import NDArray

from walkerkit.actuators import DelayedActuatorCfg
from walkerkit.tasks import Stand
from walkerkit.walkers import Biped, MjcfWalker, Quadruped
from walkerkit.walkers.biped import BIPED_DRIVES
from walkerkit.walkers.quadruped import QUADRUPED_DRIVES

ROBOTS = {"quadruped": (Quadruped, QUADRUPED_DRIVES), "biped": (Biped, BIPED_DRIVES)}
LATEST = 2  # physics steps, of 2 ms


@dataclass(frozen=True, kw_only=True)
class Stood:
    """What standing took.

    Attributes:
        seconds: how long it stood [s].
        fell: why it counts as fallen; empty if it stands.
        joints: names, (n_joints,).
        efforts: applied efforts at the end of each control step [N·m], (n_steps, n_joints).
        limits: of the efforts [N·m], (n_joints,).
    """

    seconds: float
    fell: tuple[str, ...]
    joints: tuple[str, ...]
    efforts: NDArray[np.float64]
    limits: NDArray[np.float64]


def stand(walker: MjcfWalker, seconds: float) -> Stood:
    """Lets a walker hold its home pose."""
    task = Stand(walker)
    environment = composer.Environment(task, time_limit=seconds, random_state=0)
    step = environment.reset()
    efforts = []
    while not step.last():
        step = environment.step(walker.action_for())
        efforts.append(walker.actuator_group.applied_effort)
    stood = Stood(
        seconds=environment.physics.time(),
        fell=tuple(task.fallen),
        joints=walker.drivetrain.joints.names,
        efforts=np.array(efforts),
        limits=walker.drivetrain.joints.efforts,
    )
    environment.close()
    return stood


def main(seconds: float = 10.0) -> dict[str, Stood]:
    """Lets both stand."""
    results = {}
    for name, (robot, drives) in ROBOTS.items():
        late = [DelayedActuatorCfg(base_cfg=drive, delay_max_lag=LATEST) for drive in drives]
        stood = results[name] = stand(robot(actuators=late), seconds)
        verdict = f"fell: {', '.join(stood.fell)}" if stood.fell else "stands"
        print(f"{name}: {verdict} after {stood.seconds:.1f} s")
        rms, peak = np.sqrt(np.mean(stood.efforts**2, axis=0)), np.abs(stood.efforts).max(axis=0)
        print(f"  {'joint':18} {'RMS':>8} {'peak':>8} {'limit':>8}  N·m")
        for row in zip(stood.joints, rms, peak, stood.limits, strict=True):
            print("  {:18} {:8.2f} {:8.2f} {:8.2f}".format(*row))
    return results


if __name__ == "__main__":
    main(argument(__doc__, "SECONDS", 10.0))
