"""Actuators that the robot's XML already has, taken over as they are.

    XmlActuatorCfg(joint_names_expr=("hip_joint",))            # whatever it is
    XmlPositionActuatorCfg(joint_names_expr=("knee_joint",))   # refused if it is something else

Targets are in units of the joint. Gears and affine scaling, as of dm_control's scaled actuators,
are read from the compiled model and undone; a control that the XML limits stays limited.
Where its gains were mended they say no longer what a control means; `slope` and `offset` do then.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.affine import AffineActuator, Kind
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.config_fields import choice, number
from walkerkit.actuators.drive import Drive, read_drive
from walkerkit.actuators.messages import listed
from walkerkit.actuators.selection import Numbers
from walkerkit.actuators.targeted import actuators_of

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class XmlActuatorCfg(TargetedActuatorCfg):
    """Takes over the one actuator that each of its joints has, all of one kind.

    The kind is found when the model is compiled: whether they take a position, a velocity or an
    effort. The three configs below also say which it has to be.

    Attributes:
        slope: control per unit of target; None to read it, and `offset`, from the XML.
        offset: control at a target of zero.
    """

    kind: ClassVar[Kind] = "unknown"
    slope: Numbers | None = number(default=None)
    offset: Numbers | None = number(default=None)

    def check(self) -> None:
        """As in `ActuatorCfg`."""
        if (self.slope is None) != (self.offset is None):
            raise ValueError(
                f"slope={self.slope!r} and offset={self.offset!r}: a control is slope · target + "
                "offset, so give both, or leave both out to have them read from the XML"
            )
        if self.transmission == "site":
            raise ValueError(
                "transmission='site': sites are driven in six directions, so there is no target "
                "to translate; drive the site with BuiltinMotorActuatorCfg"
            )

    def build(self) -> XmlActuator:
        """The actuator."""
        return XmlActuator(self)


@dataclass(frozen=True, kw_only=True)
class XmlPositionActuatorCfg(XmlActuatorCfg):
    """Takes over `<position>` actuators, or `<general>` ones that pull towards a position."""

    kind: ClassVar[Kind] = "position"


@dataclass(frozen=True, kw_only=True)
class XmlVelocityActuatorCfg(XmlActuatorCfg):
    """Takes over `<velocity>` actuators, or `<general>` ones that pull towards a velocity."""

    kind: ClassVar[Kind] = "velocity"


@dataclass(frozen=True, kw_only=True)
class XmlMotorActuatorCfg(XmlActuatorCfg):
    """Takes over `<motor>` actuators, or `<general>` ones whose force is that of the control.

    Attributes:
        bias: what a constant bias in the XML is: an `offset` of the control, as where an effort
            range that is not symmetric is mapped onto it, or an `effort` that the drive really
            makes besides. Only needed where there is one.
    """

    kind: ClassVar[Kind] = "effort"
    bias: Literal["offset", "effort"] | None = choice("offset", "effort", default=None)


class XmlActuator(AffineActuator):
    """An affine actuator that was in the model before."""

    cfg: XmlActuatorCfg
    adds_elements = False

    def __init__(self, cfg: XmlActuatorCfg):
        super().__init__(cfg, cfg.kind)

    def _element(self, target: Any, name: str, numbers: Mapping[str, float]) -> Any:
        del numbers
        found = actuators_of(target)
        if len(found) != 1:
            which = f": {listed(str(e.name) for e in found)}" if found else ""
            raise ValueError(
                f"joint_names_expr={self.cfg.joint_names_expr}: {self.cfg.transmission} {name!r} "
                f"has {len(found)} actuators in the XML{which}; an Xml… config needs just one: "
                + (
                    "leave the joint out, remove all but one, or take all of them over with "
                    "XmlInputsActuatorCfg"
                    if found
                    else "leave the joint out, or add one with a Builtin… config"
                )
            )
        return found[0]

    def _scale(self, model: mujoco.MjModel) -> tuple[FloatArray, FloatArray]:
        if self.cfg.kind == "unknown":
            self._kind = self._found(model)
        if "slope" in self._numbers:
            return self._numbers["slope"], self._numbers["offset"]
        drives = [
            self._drive(model, name, int(actuator), float(bias))
            for name, actuator, bias in zip(
                self.joint_names, self._actuator_ids, self._bias0[:, 0], strict=True
            )
        ]
        slope = np.array([drive.slope for drive in drives])
        offset = np.array([drive.offset for drive in drives])
        if getattr(self.cfg, "bias", None) == "offset":
            offset = offset - self._bias0[:, 0] / self._gain0
        return slope, offset

    def _found(self, model: mujoco.MjModel) -> Kind:
        """The one kind of all its actuators."""
        kinds: dict[Any, list[str]] = {}  # `read_drive` knows no voltages
        for name, actuator in zip(self.joint_names, self._actuator_ids, strict=True):
            kind = self._read_drive(model, name, int(actuator)).kind
            if kind != "voltage":  # which no affine law takes
                kinds.setdefault(kind, []).append(name)
        if len(kinds) > 1:
            of_kind = "; ".join(
                f"{_A[kind]}: {_CONFIG[kind]}(joint_names_expr={tuple(map(re.escape, names))})"
                for kind, names in kinds.items()
            )
            raise ValueError(
                f"joint_names_expr={self.cfg.joint_names_expr}: their actuators take targets of "
                f"several kinds; use a config for each, {of_kind}"
            )
        return next(iter(kinds))

    def _read_drive(self, model: mujoco.MjModel, name: str, actuator: int) -> Drive:
        drive = read_drive(model, actuator)
        if drive is None:
            raise ValueError(
                f"joint_names_expr={self.cfg.joint_names_expr}: the actuator of {name!r} has a law "
                "that is not affine in its control: leave the joint out, or replace its actuator"
            )
        return drive

    def _drive(self, model: mujoco.MjModel, name: str, actuator: int, bias: float) -> Drive:
        drive = self._read_drive(model, name, actuator)
        which = f"joint_names_expr={self.cfg.joint_names_expr}: the actuator of {name!r}"
        if drive.kind != self._kind:
            raise ValueError(
                f"{which} takes {_A[drive.kind]}, this config {_A[self.cfg.kind]}: use "
                f"{_CONFIG[drive.kind]}"
            )
        if drive.kind == "effort" and bias and getattr(self.cfg, "bias", None) is None:
            raise ValueError(
                f"{which} has a constant bias of {bias:g}: use XmlMotorActuatorCfg and say "
                "bias='offset' if it only shifts the control, as where an effort range was mapped "
                "onto it, or bias='effort' if the drive makes it besides"
            )
        return drive


_A = {"position": "a position", "velocity": "a velocity", "effort": "an effort"}
_CONFIG = {
    "position": "XmlPositionActuatorCfg",
    "velocity": "XmlVelocityActuatorCfg",
    "effort": "XmlMotorActuatorCfg",
}
