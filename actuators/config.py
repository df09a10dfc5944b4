"""What every actuator config is, and how its numbers are checked.

A config is a frozen dataclass of plain values, written once per kind of motor and not per joint:

    IdealPdActuatorCfg(joint_names_expr=(".*_hip_.*",), stiffness=80.0, damping=2.0)

Where joints of one kind differ, a number may be `{expression: number}`. Whatever can be judged
without the robot is judged here, so that a wrong number never waits for a robot to fall over.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, Self, get_args

from walkerkit.actuators.config_fields import choice, direction, names, number
from walkerkit.actuators.selection import Numbers
from walkerkit.actuators.wrong_fields import raise_wrong

if TYPE_CHECKING:
    from walkerkit.actuators.actuator import Actuator

Transmission = Literal["joint", "tendon", "site"]
TRANSMISSIONS: tuple[Transmission, ...] = get_args(Transmission)


@dataclass(frozen=True, kw_only=True)
class ActuatorCfg(abc.ABC):
    """Anything that `build` makes an actuator of."""

    def __new__(cls, *args: Any, **given: Any) -> Self:
        """Says of wrong arguments more than Python does, before it looks at them."""
        if args:
            raise TypeError(
                f"{cls.__name__} takes no positional arguments, got {args!r}: name each, as in "
                f"{cls.__name__}({next(item.name for item in fields(cls) if item.init)}=...)"
            )
        raise_wrong(cls, ActuatorCfg, given)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for item in fields(self):
            if "check" in item.metadata:
                value = getattr(self, item.name)
                object.__setattr__(self, item.name, item.metadata["check"](item.name, value))
        self.check()

    def check(self) -> None:  # noqa: B027  most configs have nothing to add
        """Refuses numbers that are right one by one and wrong together.

        Raises:
            ValueError: such numbers, named with the remedy.
        """

    @abc.abstractmethod
    def build(self) -> Actuator:
        """The actuator, which does not know its robot yet."""


@dataclass(frozen=True, kw_only=True)
class TargetedActuatorCfg(ActuatorCfg):
    """What an actuator drives, and what it brings along to the joint.

    Attributes:
        joint_names_expr: full-match regular expressions of the names of the joints (or tendons, or
            sites) that it drives, each with an actuator of its own. A joint that follows another by
            an equality constraint gets one only from an expression that leaves that other out.
        transmission: what these are names of: `joint`, `tendon` or `site`. On a tendon "position"
            is its length [m], on a site the length that MuJoCo gives it (zero but with `refsite`).
        gear: with `transmission="site"`, the direction in which it pushes and turns, in the site's
            frame: six numbers.
        armature: rotor inertia as the joint feels it [kg·m²; kg on slide joints]. None keeps what
            the XML says, here and in the next two; 0.0 overrides it.
        frictionloss: dry friction [N·m; N].
        viscous_damping: damping of the joint itself [N·m·s/rad; N·s/m].
    """

    joint_names_expr: tuple[str, ...] = names()
    transmission: Transmission = choice(*TRANSMISSIONS, default="joint")
    gear: tuple[float, ...] | None = direction()
    armature: Numbers | None = number(default=None, at_least=0)
    frictionloss: Numbers | None = number(default=None, at_least=0)
    viscous_damping: Numbers | None = number(default=None, at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        on_site = self.transmission == "site"
        if on_site != (self.gear is not None):
            raise ValueError(
                f"gear={self.gear!r} with transmission={self.transmission!r}: "
                + (
                    "a site needs six numbers, the direction of force and torque in its frame"
                    if on_site
                    else "only a site takes one; leave it out"
                )
            )
        for name in JOINT_ATTRIBUTES:
            if on_site and getattr(self, name) is not None:
                raise ValueError(f"{name}={getattr(self, name)!r}: a site has none; leave it out")

    def numbers(self) -> Mapping[str, Numbers]:
        """The fields that are one number per joint, by name; those that are None left out."""
        return {
            item.name: getattr(self, item.name)
            for item in fields(self)
            if item.metadata.get("per_joint") and getattr(self, item.name) is not None
        }


JOINT_ATTRIBUTES = {
    "armature": "armature",
    "frictionloss": "frictionloss",
    "viscous_damping": "damping",
}
"""Config field to the attribute of `<joint>` and of tendons."""
