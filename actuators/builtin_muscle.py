"""MuJoCo's muscle: it pulls only, harder or softer with its length and speed, and with a delay.

    BuiltinMuscleActuatorCfg(joint_names_expr=("biceps",), transmission="tendon", force=600.0)

Its command is the excitation of the nerve, from 0 to 1, as `effort_target`. A joint takes one
muscle; antagonists pull on tendons of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Rows
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.config_fields import number
from walkerkit.actuators.general import add_general
from walkerkit.actuators.selection import Numbers
from walkerkit.actuators.stateful import StatefulActuator

FloatArray = NDArray[np.float64]

_FROM_SCALE = -1.0  # the force with which MuJoCo derives the peak from `scale`
_CURVES = ("lmin", "lmax", "vmax", "fpmax", "fvmax")
_SIZE = slice(2, 4)  # force and scale, in gain and bias


def _rising(name: str, value: Any) -> tuple[float, float] | None:
    if value is None:
        return None
    try:
        low, high = (float(one) for one in value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} should be two numbers, the lower first, got {value!r}") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ValueError(f"{name} should be two finite numbers, the lower first, got {value!r}")
    return low, high


@dataclass(frozen=True, kw_only=True)
class BuiltinMuscleActuatorCfg(TargetedActuatorCfg):
    """MuJoCo's `<muscle>`: F = F₀ (a FL(l) FV(v) + FP(l)), which shortens it.

    F₀ is the peak force, a the activation, l and v length and speed as shares of the optimal
    length L₀ (per second). The activation follows the excitation u, which `effort_target` is: **no
    force but a number from 0 (at rest) to 1**, beyond which it is clipped. `applied_effort` is the
    effort at the joint, or tendon, that came of it; a muscle shortens, so it is negative.

    Attributes:
        moment_arm: lever on a joint [m; 1 on tendons and slide joints]; a negative one makes the
            muscle shorten as the joint's position grows.
        force: F₀ [N]; None for what `scale` asks for.
        scale: how fast F₀ moves the joints from rest where `force` is None [rad/s²; m/s²].
        activation_time: time constant of rising activation [s].
        deactivation_time: time constant of falling activation [s].
        tausmooth: width over which one time constant turns into the other [1]; 0 for a jump.
        range: lengths at the ends of `lengthrange`, as shares of L₀.
        lmin: length at which the active force ends, as a share of L₀.
        lmax: length at which it ends on the other side, as a share of L₀.
        vmax: speed of shortening at which the active force ends [L₀/s].
        fpmax: twice the passive force at length (1 + lmax)/2, as a share of F₀.
        fvmax: force while lengthening fast, as a share of F₀.
        lengthrange: least and greatest length that the body allows [m], of all the muscles alike;
            None lets MuJoCo find them, from the limits of the joint or tendon or by trying.
    """

    moment_arm: Numbers = number(default=1.0)
    force: Numbers | None = number(default=None, above=0)
    scale: Numbers = number(default=200.0, above=0)
    activation_time: Numbers = number(default=0.01, above=0)
    deactivation_time: Numbers = number(default=0.04, above=0)
    tausmooth: Numbers = number(default=0.0, at_least=0)
    range: tuple[float, float] = field(default=(0.75, 1.05), metadata={"check": _rising})
    lmin: Numbers = number(default=0.5, above=0, at_most=1)
    lmax: Numbers = number(default=1.6, at_least=1)
    vmax: Numbers = number(default=1.5, above=0)
    fpmax: Numbers = number(default=1.3, at_least=0)
    fvmax: Numbers = number(default=1.2, at_least=1)
    lengthrange: tuple[float, float] | None = field(default=None, metadata={"check": _rising})

    def check(self) -> None:
        """As in `ActuatorCfg`."""
        if self.transmission == "site":
            raise ValueError(
                "transmission='site': a muscle pulls along a length, which a site does not have; "
                "span a tendon between two sites"
            )
        arms = self.moment_arm
        for arm in arms.values() if isinstance(arms, Mapping) else (arms,):
            if arm == 0:
                raise ValueError(f"moment_arm={arms!r}: a muscle without a lever moves nothing")
        if self.range is None or self.range[0] < 0:
            raise ValueError(f"range={self.range!r} should be two lengths of a muscle, above 0")

    def build(self) -> BuiltinMuscleActuator:
        """The actuator."""
        return BuiltinMuscleActuator(self)


class BuiltinMuscleActuator(StatefulActuator):
    """A muscle that MuJoCo runs. Its own parameter is `strength`, a factor of the peak force."""

    cfg: BuiltinMuscleActuatorCfg

    def __init__(self, cfg: BuiltinMuscleActuatorCfg):
        super().__init__(cfg)
        self._strength: FloatArray = np.ones(0)
        self._size: FloatArray = np.zeros((0, 2))

    def _element(self, target: Any, name: str, numbers: Mapping[str, float]) -> Any:
        del name
        muscle = [
            *self.cfg.range,
            numbers.get("force", _FROM_SCALE),
            numbers["scale"],
            *(numbers[curve] for curve in _CURVES),
            0.0,
        ]
        times = [numbers[name] for name in ("activation_time", "deactivation_time", "tausmooth")]
        return add_general(
            target,
            self.cfg.transmission,
            gear=[numbers["moment_arm"], 0, 0, 0, 0, 0],
            dyntype="muscle",
            gaintype="muscle",
            biastype="muscle",
            dynprm=[*times, 0, 0, 0, 0, 0, 0, 0],
            gainprm=muscle,
            biasprm=muscle,
            lengthrange=self.cfg.lengthrange or [0, 0],
            **self._delay(target.root),
        )

    def _bind(self) -> None:
        super()._bind()
        self._strength = np.ones(len(self.joint_names))
        force = self._numbers.get("force", np.full(len(self.joint_names), _FROM_SCALE))
        self._size = np.stack([force, self._numbers["scale"]], axis=-1)

    @property
    def takes(self) -> frozenset[str]:
        """As in `Actuator`."""
        return frozenset({"effort_target"})

    @property
    def needs(self) -> frozenset[str]:
        """As in `Actuator`."""
        return self.takes

    @property
    def _gear(self) -> FloatArray:
        return self._numbers["moment_arm"]

    def _command(
        self, position: FloatArray | None, velocity: FloatArray | None, effort: FloatArray | None
    ) -> FloatArray:
        del position, velocity
        return np.asarray(np.clip(np.asarray(effort), 0.0, 1.0))

    def _asked(self, target: str) -> FloatArray:
        most = [0.0, 1.0] if target == "effort_target" else [-np.inf, np.inf]
        return np.tile(most, (len(self.joint_names), 1))

    @property
    def effort_range(self) -> FloatArray:
        """As in `Actuator`."""
        return self._behind.copy()

    @property
    def activation(self) -> FloatArray:
        """How far each muscle is activated, from 0 to 1, (..., n_joints), a copy."""
        act: FloatArray = self.simulation.state("act")[..., self._act_ids[:, 0]]
        return act

    def _own(self) -> Mapping[str, FloatArray]:
        return {"strength": np.ones(len(self.joint_names))}

    def _read(self, name: str) -> FloatArray:
        return self._strength

    def _write(self, name: str, values: FloatArray, rows: Rows) -> None:
        every = np.array(np.broadcast_to(self._strength, self.shape))
        every[slice(None) if rows is None else rows] = values
        self._strength = every
        for prm in ("actuator_gainprm", "actuator_biasprm"):
            self.simulation.parameter(prm)[..., self._actuator_ids, _SIZE] = (
                self._size * every[..., None]
            )
