"""Motor datasheets: from the maker's numbers to those of an actuator, at the joint and in SI units.

knee = MOTORS["unitree_7520_14"].actuator()
gains = gains_from_bandwidth(knee.reflected_inertia, 2 * math.pi * 10, damping_ratio=2.0)
BuiltinPositionActuatorCfg(
    joint_names_expr=(".*_knee",),
    stiffness=gains.stiffness,
    damping=gains.damping,
    effort_limit=knee.effort_limit,
    armature=knee.reflected_inertia,
)
"""

from walkerkit.actuators.motors.electric import ElectricActuator, Gains, gains_from_bandwidth
from walkerkit.actuators.motors.gears import (
    reflected_inertia,
    reflected_inertia_from_two_stage_planetary,
    rotary_to_linear,
    rpm_to_rad,
)
from walkerkit.actuators.motors.linkage import linkage_matrix, parallel_linkage
from walkerkit.actuators.motors.table import MOTORS, Motor

__all__ = [
    "MOTORS",
    "ElectricActuator",
    "Gains",
    "Motor",
    "gains_from_bandwidth",
    "linkage_matrix",
    "parallel_linkage",
    "reflected_inertia",
    "reflected_inertia_from_two_stage_planetary",
    "rotary_to_linear",
    "rpm_to_rad",
]
