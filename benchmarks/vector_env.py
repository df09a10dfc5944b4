"""Environment steps per second: copies in lock-step beside Gymnasium's vector environments.

The quadruped is asked for a velocity; its DC motors' laws run in Python behind a delay of two
steps, ten physics steps to each control step. `WalkerVectorEnv` steps 64 copies; `SyncVectorEnv`
and `AsyncVectorEnv` step 64 composer environments through Shimmy, which keep their compiled model
at a reset. All take the same actions, in turns.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from dm_control import composer
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv
from shimmy import DmControlCompatibilityV0

from benchmarks import Row
from benchmarks.measured.timing import in_turns, ratio
from walkerkit.actuators import DelayedActuatorCfg
from walkerkit.tasks import JointPositionAction, TrackVelocity
from walkerkit.tasks.vector import WalkerVectorEnv
from walkerkit.walkers import Quadruped
from walkerkit.walkers.quadruped import QUADRUPED_DRIVES

LAG, TIME_LIMIT, REQUIRED = 2, 20.0, 4.0


def run(*, quick: bool) -> list[Row]:
    """Steps all three in turns."""
    n, rounds = (8, 3) if quick else (64, 20)
    # Workers are forked before there are threads.
    others: dict[str, VectorEnv[Any, Any, Any]] = {
        "AsyncVectorEnv": AsyncVectorEnv([_single] * n),
        "SyncVectorEnv": SyncVectorEnv([_single] * n),
    }
    environments = [WalkerVectorEnv(_task, n, time_limit=TIME_LIMIT, n_threads=2), *others.values()]
    actions = np.random.default_rng(0).uniform(-1, 1, (n, 12))
    for environment in environments:
        environment.reset(seed=0)
        environment.step(actions)
    seconds = in_turns(
        [lambda e=e: e.step(actions) for e in environments],  # type: ignore[misc]
        rounds=rounds,
        repeat=2,
    )
    for environment in environments:
        environment.close()
    rates = n / seconds.min(axis=0)
    faster = 1 + int(np.argmax(rates[1:]))
    fastest, median = ratio(seconds, of=faster, to=0)
    reference = ", ".join(
        f"{name} {rate:.0f}/s" for name, rate in zip(others, rates[1:], strict=True)
    )
    print(f"  {n} copies: {rates[0]:.0f} steps/s, {reference}")
    return [
        Row(
            what=f"steps of {n} quadrupeds with DC motors in Python, two threads",
            result=f"{rates[0]:.0f}/s, {fastest:.1f}x (median of rounds {median:.1f}x)",
            reference=reference,
            required=f">= {REQUIRED:g}x the faster",
        )
    ]


def _task() -> TrackVelocity:
    late = [
        DelayedActuatorCfg(base_cfg=drive, delay_min_lag=LAG, delay_max_lag=LAG)
        for drive in QUADRUPED_DRIVES
    ]
    action = JointPositionAction(joint_names_expr=(".*",), scale=0.1)
    return TrackVelocity(Quadruped(actuators=late, action=action))


def _single() -> DmControlCompatibilityV0:
    environment = composer.Environment(
        _task(), time_limit=TIME_LIMIT, recompile_mjcf_every_episode=False
    )
    return DmControlCompatibilityV0(environment)
