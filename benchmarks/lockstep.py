"""What actuators in Python cost a lock-step batch of 256 quadrupeds, as a ratio.

They stand on a floor in `mujoco.batch` on two threads. The reference steps the same states with the
same controls, which the law has written before, and computes nothing: what is beyond 1 is the law.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from dm_control import composer
from dm_control.locomotion.arenas import floors
from mujoco.batch import Batch

from benchmarks import Row
from benchmarks.measured.timing import in_turns, ratio, told
from walkerkit.actuators import (
    ActuatorCfg,
    ActuatorCmd,
    ActuatorGroup,
    DelayedActuatorCfg,
    LearnedMlpActuatorCfg,
)
from walkerkit.actuators.networks.mlp import Mlp
from walkerkit.walkers import Quadruped
from walkerkit.walkers.quadruped import QUADRUPED_DRIVES

N_SIMS, N_THREADS, LAG, TIMESTEP = 256, 2, 2, 0.002
LAYERS = (6, 32, 32, 1)


def run(*, quick: bool) -> list[Row]:
    """Steps with and without each law, in turns."""
    rounds = 20 if quick else 200
    rows: list[Row] = []
    with TemporaryDirectory() as folder:
        laws: list[tuple[str, float, list[ActuatorCfg]]] = [
            ("PD + DC motor + delay", 1.25, _motors()),
            ("6-32-32-1 MLP per joint", 1.6, [_learned(Path(folder))]),
        ]
        for what, required, cfgs in laws:
            with_law, without = _steps(cfgs)
            seconds = in_turns([with_law, without], rounds=rounds)
            both = ratio(seconds)
            reference = seconds[:, 1].min() * 1e6
            print(f"  {what}: {told(both)} of {reference:.0f} µs")
            rows.append(
                Row(
                    what=f"{N_SIMS} quadrupeds, {what} in Python, a physics step",
                    result=told(both),
                    reference=f"mujoco.batch alone: {reference:.0f} µs",
                    required=f"<= {required:g}x",
                )
            )
    return rows


def _motors() -> list[ActuatorCfg]:
    return [
        DelayedActuatorCfg(base_cfg=drive, delay_min_lag=LAG, delay_max_lag=LAG)
        for drive in QUADRUPED_DRIVES
    ]


def _learned(folder: Path) -> ActuatorCfg:
    """A network of the size that is asked for, whose robot goes limp."""
    rng = np.random.default_rng(0)
    pairs = list(pairwise(LAYERS))
    Mlp(
        weights=[rng.normal(size=(out, n)) / np.sqrt(n) for n, out in pairs],
        biases=[np.zeros(out) for _, out in pairs],
        activations=["softsign", "softsign", "identity"],
    ).save(folder / "mlp.npz")
    return LearnedMlpActuatorCfg(
        joint_names_expr=(".*",),
        network_file=folder / "mlp.npz",
        history_length=LAYERS[0] // 2,
        pos_scale=1.0,
        vel_scale=1.0,
        torque_scale=1.0,
        saturation_effort=35.0,
        velocity_limit=30.0,
        effort_limit=20.0,
    )


def _steps(cfgs: list[ActuatorCfg]) -> tuple[Callable[[], None], Callable[[], None]]:
    """A step with the law, and one from the same state with the same controls."""
    walker = Quadruped(actuators=cfgs)
    arena = floors.Floor()
    walker.create_root_joints(arena.attach(walker))
    arena.mjcf_model.option.timestep = TIMESTEP
    task = composer.NullTask(arena)
    task.set_timesteps(control_timestep=TIMESTEP, physics_timestep=TIMESTEP)
    environment = composer.Environment(task, random_state=0)
    environment.reset()
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    batches = [Batch(model, N_SIMS, N_THREADS) for _ in range(2)]
    state = np.empty(batches[0].nstate)
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    group: ActuatorGroup = walker.actuator_group
    rest = walker.drivetrain.rest
    for batch in batches:
        batch.state[...] = state
    group.initialize(batches[0])
    group.reset()
    cmd = ActuatorCmd(position_target=np.tile(np.array(rest.position_target), (N_SIMS, 1)))
    law_ctrl, ctrl = (batch.bind("ctrl") for batch in batches)

    def with_law() -> None:
        group.apply(cmd)
        batches[0].step()

    def without() -> None:
        ctrl[...] = law_ctrl
        batches[1].step()

    with_law()
    without()
    return with_law, without
