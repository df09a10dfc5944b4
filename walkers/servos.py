"""What drives the joints of our robots: PD control through motors of which there is a datasheet.

    knees = motor_pd((".*_knee",), MOTORS["unitree_7520_22"].actuator(), frequency=25, ratio=1)
    taken_over = scaled_servos(root, [knees])

The second is the same drive left to MuJoCo: a position servo whose control spans the joint's range.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from walkerkit.actuators import (
    ActuatorCfg,
    DcMotorActuatorCfg,
    ElectricActuator,
    IdealPdActuatorCfg,
    XmlPositionActuatorCfg,
    add_position_actuator,
    gains_from_bandwidth,
)
from walkerkit.actuators.selection import per_joint, select
from walkerkit.actuators.targeted import candidates


def motor_pd(
    joint_names_expr: tuple[str, ...], motor: ElectricActuator, *, frequency: float, ratio: float
) -> DcMotorActuatorCfg:
    """PD control through a motor, with gains as for its own inertia.

    Where no stall torque is published it is taken to be the effort limit: the torque falls from
    there to nothing at the no-load speed, which is less than the motor really has.

    Args:
        joint_names_expr: the joints, as in any config; they keep the armature of the robot's file.
        motor: the motor of each.
        frequency: at which the motor's inertia alone would swing on the stiffness [Hz].
        ratio: its damping ratio [1]; links make it smaller, by the root of the inertia.
    """
    gains = gains_from_bandwidth(motor.reflected_inertia, 2 * math.pi * frequency, ratio)
    return DcMotorActuatorCfg(
        joint_names_expr=joint_names_expr,
        stiffness=gains.stiffness,
        damping=gains.damping,
        effort_limit=motor.effort_limit,
        saturation_effort=motor.saturation_effort or motor.effort_limit,
        velocity_limit=motor.velocity_limit,
    )


def scaled_servos(root: Any, drives: Sequence[IdealPdActuatorCfg]) -> XmlPositionActuatorCfg:
    """Adds MuJoCo's position servos with the gains and effort limits of these drives.

    Args:
        root: the robot's model, where none of these joints has an actuator.
        drives: PD drives.

    Returns:
        The config that takes them over. Their controls in [-1, 1] span the joints' ranges, as the
        actions do of a walker without action terms of its own.
    """
    joints = candidates(root, "joint")
    numbers: dict[str, tuple[float, ...]] = {}
    for drive in drives:
        names = [list(joints)[i] for i in select(drive.joint_names_expr, list(joints))]
        fields = {"effort_limit": math.inf, **drive.numbers()}
        columns = [
            per_joint(fields[field], names, field=field).tolist()
            for field in ("stiffness", "damping", "effort_limit")
        ]
        numbers.update(zip(names, zip(*columns, strict=True), strict=True))
    driven = [name for name in joints if name in numbers]
    for name in driven:
        kp, kv, limit = numbers[name]
        limited = {"forcerange": (-limit, limit)} if math.isfinite(limit) else {}
        add_position_actuator(joints[name], "joint", kp=kp, kv=kv, name=name, **limited)
    return XmlPositionActuatorCfg(joint_names_expr=tuple(driven))


def choose(
    root: Any,
    drives: Sequence[IdealPdActuatorCfg],
    actuators: ActuatorCfg | Iterable[ActuatorCfg] | None,
    position_controlled: bool,
) -> ActuatorCfg | Iterable[ActuatorCfg]:
    """The actuators of a robot of ours.

    Args:
        root: its model.
        drives: what it has by default.
        actuators: what it shall have instead; None for the default.
        position_controlled: whether the default is left to MuJoCo's scaled position servos.

    Raises:
        ValueError: both are asked for.
    """
    if not position_controlled:
        return drives if actuators is None else actuators
    if actuators is not None:
        raise ValueError(
            f"position_controlled=True and actuators={actuators!r}: the first brings actuators of "
            "its own, leave one of the two out"
        )
    return scaled_servos(root, drives)
