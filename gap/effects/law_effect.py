"""Effects that MuJoCo has no field for: drivetrain laws, one of `walkerkit.actuators.drivetrain`.

    class SlewLimit(LawEffect):
        law = laws.SlewLimit
        name = "slew_limit"
        ...
        def parameters(self, robot, site):
            return (Parameter(name="rate", zero=self.known(robot, site)["rate"], ...),)

Its parameters bear the names of the law's, and their values are the law's own, not increments. At
the zeros of all of them the law stays as the robot has it, mostly absent; a zero may therefore be
a value so large that it does nothing on this robot, or mean nothing of its own, such as a phase.
One more parameter, `frictionloss`, is dry friction to add to the model's.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import ClassVar

from walkerkit.actuators.drivetrain import DrivetrainLaw
from walkerkit.gap.effects import fields
from walkerkit.gap.effects.added_dry_friction import stiffen_dry_friction
from walkerkit.gap.effects.effect import FloatArray, JointEffect
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials


class LawEffect(JointEffect):
    """A drivetrain law at a joint.

    Attributes:
        law: the law; it has the parameters that `parameters` names, and maybe more, which stay
            neutral.
        driven: a law of the joint that acts on the effort of its drive.
        dry: a law that adds dry friction.
    """

    law: ClassVar[type[DrivetrainLaw]]
    driven: ClassVar[bool] = False
    dry: ClassVar[bool] = False
    added_as = "drivetrain law in actuators.json"

    def __init_subclass__(cls, *, listed: bool = True) -> None:
        super().__init_subclass__(listed=listed)
        if "law" in vars(cls):
            own = {name: fields.law(cls.law, name) for name in cls.law.parameter_names()}
            own["frictionloss"] = fields.joint("frictionloss", "dof_frictionloss")
            cls.fields = MappingProxyType(own)

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Joints with the position servo, the drive or nothing that a law of its stage changes."""
        drives = robot.joints[joint].drives
        if self.law.stage == "controller":
            return is_servo(robot, joint)
        return bool(drives) or (self.law.stage == "joint" and not self.driven)

    def known(self, robot: Robot, joint: str) -> dict[str, float]:
        """The law's parameters at a joint of the robot as it is, neutral where it has no such."""
        return {**self.law.neutral, **robot.laws.get(joint, {}).get(self.law.name, {})}

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Writes the law's parameters, in the variants where one of them is not at its zero."""
        parameters = self.parameters(trials.robot, site)
        changed = (values != [parameter.zero for parameter in parameters]).any(axis=1)
        own = trials.law(self.law, site)
        for parameter, column in zip(parameters, values.T, strict=True):
            if parameter.name == "frictionloss":
                dof = trials.robot.joints[site].dof
                trials.field("dof_frictionloss")[changed, dof] += column[changed]
            else:
                own[parameter.name][changed] = column[changed]
        if self.dry:
            stiffen_dry_friction(trials, site, changed)


def is_servo(robot: Robot, joint: str) -> bool:
    """Whether what drives a joint pulls it to a position; one that drives it away is none."""
    drives = robot.joints[joint].drives
    return bool(drives) and drives[0].kind == "position" and drives[0].stiffness > 0
