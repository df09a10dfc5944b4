"""Between motor and link."""

from __future__ import annotations

from types import MappingProxyType

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import FloatArray, JointEffect, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials


def _rest(robot: Robot, site: str, given: Robot) -> float | None:
    """Where the springs of a joint rest; None where it has none."""
    joint = robot.joints[site]
    stiff = robot.model.jnt_stiffness[joint.id] > 0
    return float(robot.model.qpos_spring[joint.qpos]) if stiff else None


class ParallelSpring(JointEffect):
    """A spring beside the drive: a counterbalance, a cable bundle, a rubber boot."""

    name = "parallel_spring"
    part = "pose"
    equation = "τ = −k (q − q₀), k: stiffness [N·m/rad], q₀: springref [rad]"
    symptom = "pose, independent of speed"
    added_as = "joint stiffness, springref"
    source = "MuJoCo XML reference, joint/stiffness"
    resembles = ("payload", "com_offset", "torque_constant")
    fields = MappingProxyType(
        {
            "stiffness": fields.joint("stiffness", "jnt_stiffness", "id"),
            "springref": fields.Field(path="joint/springref", read=_rest),
        }
    )

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Stiffness and rest position."""
        joint, excursion = robot.joints[site], robot.excursion(site)
        size = 0.2 * excursion.effort / excursion.range
        middle = 0.5 * (excursion.lower + excursion.upper)
        reach = 2 * excursion.range
        return (
            Parameter(
                name="stiffness",
                unit="N/m" if joint.slide else "N·m/rad",
                lower=0.0,
                upper=50 * size,
                scale=size,
                starts=(size, size, size, 4 * size),
            ),
            Parameter(
                name="springref",
                unit="m" if joint.slide else "rad",
                zero=middle,
                lower=middle - reach,
                upper=middle + reach,
                scale=0.3 * excursion.range,
                starts=(middle, excursion.lower, excursion.upper, middle),
                shape=not robot.model.jnt_stiffness[joint.id],
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to `jnt_stiffness` and moves `qpos_spring` to where both springs together rest."""
        joint = trials.robot.joints[site]
        stiffness = trials.field("jnt_stiffness")[:, joint.id]
        rest = trials.field("qpos_spring")[:, joint.qpos]
        k, q0 = values[:, 0], values[:, 1]
        acts = k > 0
        total = stiffness + k
        rest[acts] = ((stiffness * rest + k * q0)[acts]) / total[acts]
        stiffness += k
