"""What a long training run would find out: memory that grows, delays that drift, resets that leak.

A servo bench under PD control in Python behind a delay of three steps takes a million environment
steps of one physics step each. Every target that the controller is given late is worked out from
the effort it asks for and compared with the one that was sent then. Then environments are reset
again and again, each time with a model compiled anew.
"""

from __future__ import annotations

import collections
import gc
import time
from pathlib import Path

import numpy as np
from dm_control import composer

from benchmarks import Row
from walkerkit.actuators import DelayedActuatorCfg, IdealPdActuatorCfg
from walkerkit.walkers import Quadruped, ServoBench
from walkerkit.walkers.mjcf_walker import MjcfWalker

STEPS, RESETS = 1_000_000, 500
QUICK_STEPS, QUICK_RESETS = 20_000, 20
TIMESTEP, LAG, STIFFNESS = 0.002, 3, 8.0
_PAGE = 4096  # bytes
_WARM = 0.1  # of the steps or resets, after which memory is counted


class _Hold(composer.Task):  # type: ignore[misc]
    """A walker alone, whose actions are its targets."""

    def __init__(self, walker: MjcfWalker):
        self._walker = walker
        self.set_timesteps(control_timestep=TIMESTEP, physics_timestep=TIMESTEP)

    @property
    def root_entity(self) -> composer.Entity:
        return self._walker

    def before_step(self, physics, action, random_state) -> None:  # type: ignore[no-untyped-def]
        self._walker.apply_action(physics, action, random_state)

    def get_reward(self, physics) -> float:  # type: ignore[no-untyped-def]
        return 0.0


def run(*, quick: bool) -> list[Row]:
    """Steps and resets, and says what has grown meanwhile."""
    steps, resets = (QUICK_STEPS, QUICK_RESETS) if quick else (STEPS, RESETS)
    start = time.perf_counter()
    drift, stepped = step_on(steps)
    print(f"  {steps} steps: {time.perf_counter() - start:.0f} s, {stepped / 1024:+.0f} KiB")
    start = time.perf_counter()
    leaked = reset_again(resets)
    print(f"  {resets} resets: {time.perf_counter() - start:.0f} s, {leaked / 1024:+.0f} KiB")
    return [
        Row(
            what=f"{steps:,} env.steps: drift of a delay of {LAG} steps",
            result=f"{drift:.1e} rad",
            reference="0",
        ),
        Row(
            what=f"{steps:,} env.steps: growth of memory",
            result=f"{stepped / 1024:.0f} KiB",
            reference="0",
        ),
        Row(
            what=f"{resets} resets with recompilation: growth of memory",
            result=f"{leaked / 1024 / resets:.1f} KiB a reset",
            reference="0",
        ),
    ]


def step_on(steps: int) -> tuple[float, int]:
    """Takes environment steps without a reset.

    Returns:
        The largest difference between a late target and the one sent then [rad], and by how much
        memory grew after the first tenth of the steps [bytes].
    """
    servo = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=STIFFNESS, damping=0.0)
    late = DelayedActuatorCfg(base_cfg=servo, delay_min_lag=LAG, delay_max_lag=LAG)
    walker = ServoBench(actuators=[late])
    environment = composer.Environment(_Hold(walker), random_state=0, time_limit=float("inf"))
    environment.reset()
    joint = environment.physics.bind(walker.mjcf_model.find("joint", "shaft"))
    lower, upper = np.asarray(joint.range)
    drawn = np.random.default_rng(0)
    sent = collections.deque[float](maxlen=LAG + 1)
    drift, before = 0.0, memory()
    for k in range(steps):
        if k == int(_WARM * steps):
            before = memory()
        action = drawn.uniform(-0.2, 0.2, 1)
        sent.append(float(lower + (action[0] + 1) / 2 * (upper - lower)))
        position = float(joint.qpos[0])
        environment.step(action)
        if len(sent) > LAG:
            asked = float(walker.actuator_group.computed_effort[0])
            drift = max(drift, abs(asked / STIFFNESS + position - sent[0]))
    return drift, memory() - before


def reset_again(resets: int) -> int:
    """Resets an environment, which compiles its model anew; returns how memory grew [bytes]."""
    environment = composer.Environment(_Hold(Quadruped()), random_state=0)
    before = memory()
    for k in range(resets):
        if k == int(_WARM * resets) + 1:
            before = memory()
        environment.reset()
        environment.step(np.zeros(environment.action_spec().shape))
    return memory() - before


def memory() -> int:
    """What the process has of the machine's memory [bytes]."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE
