"""Logs of a simulated hopper whose knee motor saturates, in place of those of the real one.

`python -m hopper.bench logs` writes three of them into a folder.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from dm_control import composer
from walkerkit import gap
from walkerkit.tasks import TrackJoints
from walkerkit.walkers import MjcfWalker

from hopper.robot import on_stand
from hopper.saturation import IronSaturation

HIDDEN = IronSaturation(joint_names_expr=("knee",), bend=0.08)
NOISE = {"position": 2e-4, "velocity": 0.01, "effort": 0.02}
"""Standard deviations of what is measured [rad, rad/s, N·m]."""


def steps(leg: MjcfWalker, seed: int, seconds: float = 1.0) -> gap.Recording:
    """The log of a leg whose targets jump.

    Args:
        leg: the leg, with its drives.
        seed: of the jumps.
        seconds: how long it runs [s].
    """
    task = TrackJoints(leg, excitation="steps", seconds=seconds, max_velocity=20.0)
    environment = composer.Environment(task, random_state=seed)
    return gap.record(environment, name=f"steps_{seed}", every="physics_step")


def logs(seeds: Sequence[int]) -> list[gap.Recording]:
    """Logs, with noise, of a leg with the law that its model lacks, one of each seed."""
    found = []
    for seed in seeds:
        log, random = steps(on_stand(laws=[HIDDEN]), seed), np.random.default_rng(seed)
        columns = {
            name: values + random.normal(0.0, NOISE.get(name.partition("/")[2], 0.0), len(values))
            for name, values in log.columns.items()
        }
        found.append(gap.Recording(name=log.name, time=log.time, columns=columns))
    return found


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for log in logs(range(3)):
        log.save(folder / f"{log.name}.csv")
