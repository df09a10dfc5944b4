"""What actuators in Python cost a whole environment step, as a ratio.

A quadruped stands on a floor, twelve joints and ten physics steps to each environment step: PD
control through DC motors behind a delay of two steps in Python, against position servos of MuJoCo
with the same gains, in turns. Nothing is observed, which is the hardest case for the ratio; then
with what dm_control's tasks observe of a walker.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from dm_control import composer
from dm_control.locomotion.arenas import floors

from benchmarks import Row
from benchmarks.measured.timing import in_turns, ratio, told
from walkerkit.actuators import (
    ActuatorCfg,
    BuiltinPositionActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
)
from walkerkit.walkers import Quadruped
from walkerkit.walkers.actions import JointPositionAction
from walkerkit.walkers.quadruped import QUADRUPED_DRIVES

SUBSTEPS, TIMESTEP, LAG = 10, 0.002, 2


class _Hold(composer.Task):  # type: ignore[misc]
    """The walker on a floor, and nothing else."""

    def __init__(self, walker: Quadruped):
        self._walker, self._arena = walker, floors.Floor()
        walker.create_root_joints(self._arena.attach(walker))
        self.set_timesteps(control_timestep=SUBSTEPS * TIMESTEP, physics_timestep=TIMESTEP)

    @property
    def root_entity(self) -> composer.Entity:
        return self._arena

    def before_step(self, physics, action, random_state) -> None:  # type: ignore[no-untyped-def]
        self._walker.apply_action(physics, action, random_state)

    def get_reward(self, physics) -> float:  # type: ignore[no-untyped-def]
        return 0.0


def run(*, quick: bool) -> list[Row]:
    """Times environment steps of both, in turns."""
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 12))
    rows = []
    for observed, what in (
        (False, "nothing observed"),
        (True, "observed as by dm_control's tasks"),
    ):
        both = [_environment(cfgs, observed=observed) for cfgs in (_explicit(), _native())]
        seconds = in_turns(
            [partial(_run, environment, actions) for environment in both],
            rounds=40 if quick else 300,
        )
        ours, native = seconds.min(axis=0) / len(actions) * 1e6
        ratios = told(ratio(seconds))
        rows.append(
            Row(
                what=f"env.step, PD + DC motor + delay in Python, {what}",
                result=f"{ours:.0f} µs, {ratios}",
                reference=f"MuJoCo's position servos: {native:.0f} µs",
                required="<= 1.15x",
            )
        )
        print(f"  {what}: {ours:.0f} against {native:.0f} µs, {ratios}")
    return rows


def _explicit() -> list[ActuatorCfg]:
    return [
        DelayedActuatorCfg(base_cfg=drive, delay_min_lag=LAG, delay_max_lag=LAG)
        for drive in QUADRUPED_DRIVES
    ]


def _native() -> list[ActuatorCfg]:
    return [_servo(drive) for drive in QUADRUPED_DRIVES]


def _servo(drive: DcMotorActuatorCfg) -> BuiltinPositionActuatorCfg:
    return BuiltinPositionActuatorCfg(
        joint_names_expr=drive.joint_names_expr,
        stiffness=drive.stiffness,
        damping=drive.damping,
        effort_limit=drive.effort_limit,
    )


def _environment(cfgs: list[ActuatorCfg], *, observed: bool) -> composer.Environment:
    action = JointPositionAction(joint_names_expr=(".*",), scale=0.1)
    walker = Quadruped(actuators=cfgs, action=action)
    if observed:
        for item in (*walker.observables.proprioception, *walker.observables.kinematic_sensors):
            item.enabled = True
    environment = composer.Environment(_Hold(walker), random_state=0)
    environment.reset()
    return environment


def _run(environment: composer.Environment, actions: np.ndarray) -> None:
    for action in actions:
        environment.step(action)
