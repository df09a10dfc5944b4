"""Actuators that MuJoCo has, added to the model by their config.

    BuiltinPositionActuatorCfg(
        joint_names_expr=(".*_knee",), stiffness=80.0, damping=2.0, effort_limit=45.0
    )

They are `<general>` elements with every attribute set that a default class could leak into.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.affine import AffineActuator, Kind
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.config_fields import number
from walkerkit.actuators.general import add_general
from walkerkit.actuators.selection import Numbers

FloatArray = NDArray[np.float64]

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
IMPLICIT = 'the integrator "implicitfast"'
"""What takes an actuator of MuJoCo's over the bound of explicit integration."""


@dataclass(frozen=True, kw_only=True)
class BuiltinActuatorCfg(TargetedActuatorCfg):
    """A config whose actuator is one that MuJoCo has.

    Attributes:
        effort_limit: the most that it makes [N·m; N]; None for no limit.
    """

    kind: ClassVar[Kind]
    effort_limit: Numbers | None = number(default=None, above=0)

    def build(self) -> BuiltinActuator:
        """The actuator."""
        return BuiltinActuator(self)

    @abc.abstractmethod
    def affine(self, numbers: Mapping[str, float]) -> dict[str, Any]:
        """Attributes of `<general>` with the law of one joint."""


@dataclass(frozen=True, kw_only=True)
class BuiltinPositionActuatorCfg(BuiltinActuatorCfg):
    """MuJoCo's `<position>`: τ = kp (q* − q) − kd q̇, the damping integrated implicitly.

    Attributes:
        stiffness: kp [N·m/rad; N/m].
        damping: kd [N·m·s/rad; N·s/m].
    """

    kind: ClassVar[Kind] = "position"
    stiffness: Numbers = number(at_least=0)
    damping: Numbers = number(at_least=0)

    def affine(self, numbers: Mapping[str, float]) -> dict[str, Any]:
        """As in `BuiltinActuatorCfg`."""
        kp, kd = numbers["stiffness"], numbers["damping"]
        return {"biastype": "affine", "gainprm": [kp], "biasprm": [0, -kp, -kd]}


@dataclass(frozen=True, kw_only=True)
class BuiltinVelocityActuatorCfg(BuiltinActuatorCfg):
    """MuJoCo's `<velocity>`: τ = kd (q̇* − q̇), integrated implicitly.

    Attributes:
        damping: kd [N·m·s/rad; N·s/m].
    """

    kind: ClassVar[Kind] = "velocity"
    damping: Numbers = number(at_least=0)

    def affine(self, numbers: Mapping[str, float]) -> dict[str, Any]:
        """As in `BuiltinActuatorCfg`."""
        kd = numbers["damping"]
        return {"biastype": "affine", "gainprm": [kd], "biasprm": [0, 0, -kd]}


@dataclass(frozen=True, kw_only=True)
class BuiltinMotorActuatorCfg(BuiltinActuatorCfg):
    """MuJoCo's `<motor>`: τ = τ*."""

    kind: ClassVar[Kind] = "effort"

    def affine(self, numbers: Mapping[str, float]) -> dict[str, Any]:
        """As in `BuiltinActuatorCfg`."""
        return {}


@dataclass(frozen=True, kw_only=True)
class BuiltinPdActuatorCfg(BuiltinPositionActuatorCfg):
    """PD control of position and velocity targets with feed-forward effort, run by MuJoCo.

    τ = kp (q* − q) + kd (q̇* − q̇) + τ*: the control is kp q* + kd q̇* + τ*, the rest is the
    actuator's bias, whose damping MuJoCo integrates implicitly. The stable form of
    `IdealPdActuatorCfg`.
    """

    kind: ClassVar[Kind] = "pd"

    def affine(self, numbers: Mapping[str, float]) -> dict[str, Any]:
        """As in `BuiltinActuatorCfg`."""
        kp, kd = numbers["stiffness"], numbers["damping"]
        return {"biastype": "affine", "gainprm": [1], "biasprm": [0, -kp, -kd]}


class BuiltinActuator(AffineActuator):
    """An affine actuator that its config adds to the model, its control in units of the joint."""

    cfg: BuiltinActuatorCfg

    def __init__(self, cfg: BuiltinActuatorCfg):
        super().__init__(cfg, cfg.kind)

    def _element(self, target: Any, name: str, numbers: Mapping[str, float]) -> Any:
        gear = {"gear": self.cfg.gear} if self.cfg.gear else {}
        return add_general(
            target,
            self.cfg.transmission,
            **self.cfg.affine(numbers),
            **limited(numbers.get("effort_limit")),
            **gear,
            **self._delay(target.root),
        )

    def _bind(self) -> None:
        super()._bind()
        model = self.simulation.model
        if model.opt.integrator == _EULER and self.cfg.transmission == "joint":
            own = self._own()
            none = np.zeros(len(self.joint_names))
            self.warn_unstable(own.get("stiffness", none), own.get("damping", none), IMPLICIT)

    def _scale(self, model: mujoco.MjModel) -> tuple[FloatArray, FloatArray]:
        n = len(self.joint_names)
        return np.ones(n), np.zeros(n)


def limited(effort_limit: float | None) -> dict[str, Any]:
    """Attributes of `<general>` that keep its force within ±effort_limit."""
    if effort_limit is None:
        return {}
    return {"forcelimited": True, "forcerange": [-effort_limit, effort_limit]}
