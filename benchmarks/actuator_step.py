"""What the actuators of a quadruped cost before each physics step, in microseconds.

Twelve joints, PD control through DC motors behind a delay of two steps: by our actuators, and the
same law on PyMJCF bindings, `physics.bind(joints).qpos` and `physics.bind(actuators).ctrl`, as a
dm_control walker would write it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from dm_control import mjcf

from benchmarks import Row
from benchmarks.measured.timing import in_turns, ratio
from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
)
from walkerkit.actuators.laws.dc_motor import dc_motor_clip
from walkerkit.actuators.laws.pd import pd_effort

N_JOINTS, LAG = 12, 2
KP, KD, STALL, NO_LOAD, LIMIT = 30.0, 0.5, 12.0, 30.0, 8.0


def run(*, quick: bool) -> list[Row]:
    """Times all in turns."""
    physics, group = _robot()
    cmd = ActuatorCmd(position_target=np.linspace(-0.3, 0.3, N_JOINTS))
    bound = _by_bind(physics, group, np.array(cmd.position_target))
    fresh = np.array(cmd.position_target)
    seconds = in_turns(
        [
            lambda: group.apply(cmd),
            bound,
            lambda: group.apply(ActuatorCmd(position_target=fresh)),
        ],
        rounds=20 if quick else 200,
        repeat=100,
    )
    ours, reference, with_command = seconds.min(axis=0) * 1e6
    fastest, median = ratio(seconds, of=1, to=0)
    return [
        Row(
            what="PD + DC motor + delay of 12 joints, beside the same law through physics.bind",
            result=f"{ours:.1f} µs a substep, {fastest:.1f}x faster (median of rounds "
            f"{median:.1f}x)",
            reference=f"by bind(): {reference:.1f} µs",
            required=">= 2x",
        ),
        Row(
            what="the same, with a new command before each substep",
            result=f"{with_command:.1f} µs, {reference / with_command:.1f}x faster",
            reference="as above",
        ),
    ]


def _robot() -> tuple[mjcf.Physics, ActuatorGroup]:
    root = mjcf.RootElement()
    for leg in range(4):
        body = root.worldbody
        for joint in range(3):
            body = body.add("body", pos=[0, 0.2 * leg if joint == 0 else 0, -0.2])
            body.add("joint", name=f"{leg}_{joint}", axis=[0, 1, 0])
            body.add("geom", size=[0.05], mass=0.5, contype=0, conaffinity=0)
    group = ActuatorGroup(
        DelayedActuatorCfg(
            base_cfg=DcMotorActuatorCfg(
                joint_names_expr=(".*",),
                stiffness=KP,
                damping=KD,
                saturation_effort=STALL,
                velocity_limit=NO_LOAD,
                effort_limit=LIMIT,
                armature=0.01,
            ),
            delay_min_lag=LAG,
            delay_max_lag=LAG,
        )
    )
    group.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    group.initialize(physics)
    group.reset()
    return physics, group


def _by_bind(
    physics: mjcf.Physics, group: ActuatorGroup, target: np.ndarray
) -> Callable[[], object]:
    joints = [element.joint for element in group.elements]
    past = deque([target] * (LAG + 1), maxlen=LAG + 1)
    kp, kd = np.full(N_JOINTS, KP), np.full(N_JOINTS, KD)
    motor = [np.full(N_JOINTS, number) for number in (STALL, NO_LOAD, LIMIT)]

    def step() -> None:
        bound = physics.bind(joints)
        q, qd = bound.qpos, bound.qvel
        past.append(target)
        effort = pd_effort(past[0], None, None, q, qd, kp, kd)
        physics.bind(group.elements).ctrl = dc_motor_clip(effort, qd, *motor)

    return step
