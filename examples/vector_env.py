"""Learns a gait by the cross-entropy method, on 64 quadrupeds at once.

    pip install 'walkerkit[gymnasium]'
    python examples/vector_env.py [GENERATIONS]

Each quadruped tries a gait of its own: every joint swings about its home, all at one frequency, the
diagonal legs alike. The next generation is drawn around the best. A few generations are too few to
walk well; they show how fast 64 environments are in one process.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

os.environ.setdefault("MUJOCO_GL", "disable")

import numpy as np
from _arguments import argument
from numpy.typing import NDArray

from walkerkit.actuators import DelayedActuatorCfg
from walkerkit.tasks import JointPositionAction, TrackVelocity
from walkerkit.tasks.vector import WalkerVectorEnv
from walkerkit.walkers import Quadruped
from walkerkit.walkers.quadruped import QUADRUPED_DRIVES

FORWARD = 0.4  # m/s
ELITE = 0.2  # of a generation
DIAGONALS = (0, 1, 1, 0)  # of the legs FL, FR, RL, RR


@dataclass(frozen=True, kw_only=True)
class Learned:
    """How it went.

    Attributes:
        returns: mean reward of each quadruped, (n_generations, n_quadrupeds).
        steps_per_second: environment steps of all quadrupeds together.
    """

    returns: NDArray[np.float64]
    steps_per_second: float


def task() -> TrackVelocity:
    """Straight on at one speed, with motors that are 2 to 6 ms late."""
    late = [
        DelayedActuatorCfg(base_cfg=drive, delay_min_lag=1, delay_max_lag=3)
        for drive in QUADRUPED_DRIVES
    ]
    walker = Quadruped(
        actuators=late, action=JointPositionAction(joint_names_expr=(".*",), scale=0.5)
    )
    straight = {"forward": (FORWARD, FORWARD), "left": (0.0, 0.0), "yaw_rate": (0.0, 0.0)}
    return TrackVelocity(walker, **straight)


def actions(gaits: NDArray[np.float64], seconds: float) -> NDArray[np.float64]:
    """What gaits ask for at a time, (n, 12).

    Args:
        gaits: (n, 7): amplitude and phase of hip, thigh and calf, and a step's frequency.
        seconds: since the start.
    """
    frequency = 2.0 + gaits[:, 6:]
    cycles = frequency * seconds + 0.5 * np.array(DIAGONALS)
    swings = [
        0.3 * gaits[:, [joint]] * np.sin(2 * np.pi * (cycles + gaits[:, [3 + joint]]))
        for joint in range(3)
    ]
    return np.stack(swings, axis=-1).reshape(len(gaits), 12)


def main(generations: int = 5, *, n: int = 64, seconds: float = 2.0) -> Learned:
    """Learns, and prints how good each generation was."""
    environments = WalkerVectorEnv(task, num_envs=n, time_limit=seconds)
    dt = environments.copies.task.control_timestep
    rng = np.random.default_rng(0)
    mean, spread = np.zeros(7), np.full(7, 0.5)
    returns, start, steps = [], time.perf_counter(), 0
    for generation in range(generations):
        gaits = rng.normal(mean, spread, (n, 7))
        environments.reset(seed=0)
        total, alive = np.zeros(n), np.ones(n, dtype=bool)
        for step in range(round(seconds / dt)):
            _, rewards, terminated, *_ = environments.step(actions(gaits, step * dt))
            total += rewards * alive
            alive &= ~terminated
            steps += n
        returns.append(total / round(seconds / dt))
        best = gaits[np.argsort(returns[-1])[-max(round(ELITE * n), 2) :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02
        print(
            f"generation {generation}: mean reward {returns[-1].mean():.3f}, best "
            f"{returns[-1].max():.3f}, {alive.sum()} of {n} stand"
        )
    environments.close()
    rate = steps / (time.perf_counter() - start)
    print(f"{rate:.0f} environment steps/s")
    return Learned(returns=np.array(returns), steps_per_second=rate)


if __name__ == "__main__":
    main(argument(__doc__, "GENERATIONS", 5))
