"""Actuators whose law runs in Python, before every physics step, and works through a motor.

MuJoCo's integrator does not see how such an effort depends on velocity, so a gain that a native
actuator bears can be too much for an explicit one: `initialize` warns where that is so.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Random, Rows
from walkerkit.actuators.builtin import IMPLICIT
from walkerkit.actuators.command import TARGETS
from walkerkit.actuators.config import ActuatorCfg, TargetedActuatorCfg
from walkerkit.actuators.config_fields import number
from walkerkit.actuators.general import add_general
from walkerkit.actuators.laws.dc_motor import DcMotorLaw
from walkerkit.actuators.laws.law import Law
from walkerkit.actuators.laws.pd import PdLaw
from walkerkit.actuators.laws.remotized import RemotizedPdLaw
from walkerkit.actuators.limits import least, range_behind
from walkerkit.actuators.selection import Numbers
from walkerkit.actuators.targeted import TargetedActuator, actuators_of

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ExplicitActuatorCfg(TargetedActuatorCfg):
    """A config whose actuator computes efforts and sends them through a `<motor>`."""

    def build(self) -> ExplicitActuator:
        """The actuator."""
        return ExplicitActuator(self)

    @abc.abstractmethod
    def law(self, numbers: Mapping[str, FloatArray]) -> Law:
        """The law of its joints.

        Args:
            numbers: the config's numbers, (n_joints,) each; what is None is left out.
        """


@dataclass(frozen=True, kw_only=True)
class IdealPdActuatorCfg(ExplicitActuatorCfg):
    """Ideal PD control: τ = clip(kp (q* − q) + kd (q̇* − q̇) + τ*, ±effort_limit).

    Attributes:
        stiffness: kp [N·m/rad; N/m].
        damping: kd [N·m·s/rad; N·s/m].
        effort_limit: the most that it makes [N·m; N]; None for no limit.
    """

    stiffness: Numbers = number(at_least=0)
    damping: Numbers = number(at_least=0)
    effort_limit: Numbers | None = number(default=None, above=0)

    def law(self, numbers: Mapping[str, FloatArray]) -> Law:
        """As in `ExplicitActuatorCfg`."""
        return PdLaw(pd_parameters(numbers))


@dataclass(frozen=True, kw_only=True)
class DcMotorActuatorCfg(IdealPdActuatorCfg):
    """PD control through a DC motor, which is weaker the faster it turns (`laws.dc_motor`).

    Attributes:
        effort_limit: what it makes for long (continuous torque), needed here and at most
            `saturation_effort` [N·m; N].
        saturation_effort: what it makes for a moment at standstill (stall torque) [N·m; N].
        velocity_limit: how fast it turns without load [rad/s; m/s].
    """

    saturation_effort: Numbers = number(above=0)
    velocity_limit: Numbers = number(above=0)

    def check(self) -> None:
        """As in `ActuatorCfg`."""
        check_torques(self.effort_limit, self.saturation_effort)

    def law(self, numbers: Mapping[str, FloatArray]) -> Law:
        """As in `ExplicitActuatorCfg`."""
        motor = {name: numbers[name] for name in ("saturation_effort", "velocity_limit")}
        return DcMotorLaw({**pd_parameters(numbers), **motor})


def check_torques(continuous: Numbers | None, stall: Numbers) -> None:
    """Refuses torques that no motor has, or that are in each other's place.

    Args:
        continuous: `effort_limit`, one number or one per expression.
        stall: `saturation_effort`.

    Raises:
        ValueError: one is missing, or a motor makes more for long than for a moment.
    """
    if continuous is None:
        raise ValueError(
            "effort_limit is missing: while it brakes, the torque–speed line alone lets a motor "
            "make twice its stall torque and more; give its continuous torque, or "
            f"effort_limit={stall!r}, the saturation_effort, where the datasheet has none"
        )
    for one, more, less in _pairs(continuous, stall):
        if more > less:
            where = "" if one is None else f"[{one!r}]"
            raise ValueError(
                f"effort_limit{where}={more:g} is above saturation_effort{where}={less:g}: a motor "
                "makes at most its stall torque (saturation_effort) for a moment and its "
                "continuous torque (effort_limit) for long; exchange the two, or lower the former"
            )


def _pairs(one: Numbers, other: Numbers) -> Iterator[tuple[str | None, float, float]]:
    """The numbers that are of the same joints for sure, each with the expression."""
    if isinstance(one, Mapping):
        for key, first in one.items():
            second = other.get(key) if isinstance(other, Mapping) else other
            if second is not None:
                yield key, first, second
    elif isinstance(other, Mapping):
        yield from ((key, one, second) for key, second in other.items())
    else:
        yield None, one, other


@dataclass(frozen=True, kw_only=True)
class AdoptedMotorCfg(ActuatorCfg):
    """The law of another config through the motors that the model has at its joints already.

    Attributes:
        law_cfg: the config.
    """

    law_cfg: ExplicitActuatorCfg

    @property
    def joint_names_expr(self) -> tuple[str, ...]:
        """The config's expressions."""
        return self.law_cfg.joint_names_expr

    def build(self) -> ExplicitActuator:
        """The actuator."""
        return AdoptedMotorActuator(self.law_cfg)


def _lookup(name: str, value: Any) -> tuple[tuple[float, float], ...]:
    try:
        rows = tuple((float(angle), float(limit)) for angle, limit in value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} should be rows of (angle, effort limit), got {value!r}") from None
    angles = [angle for angle, _ in rows]
    if len(rows) < 2 or not np.isfinite(rows).all() or not (np.diff(angles) > 0).all():
        raise ValueError(
            f"{name} should have two or more rows of finite numbers with rising angles, got "
            f"{value!r}"
        )
    negative = [row for row in rows if row[1] < 0]
    if negative:
        raise ValueError(f"{name} has the negative effort limit {negative[0][1]}: limits are ≥ 0")
    return rows


@dataclass(frozen=True, kw_only=True)
class RemotizedPdActuatorCfg(IdealPdActuatorCfg):
    """PD control through a linkage: what it can make depends on its angle (`laws.remotized`).

    Attributes:
        effort_lookup: rows of (angle [rad; m], effort limit [N·m; N]), angles rising; between them
            the limit is interpolated, beyond them it is that of the nearest row. `effort_limit`
            limits it further.
    """

    effort_lookup: tuple[tuple[float, float], ...] = field(metadata={"check": _lookup})

    def law(self, numbers: Mapping[str, FloatArray]) -> Law:
        """As in `ExplicitActuatorCfg`."""
        angles, limits = zip(*self.effort_lookup, strict=True)
        return RemotizedPdLaw(pd_parameters(numbers), angles, limits)


def pd_parameters(numbers: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Stiffness, damping and effort limit, which is infinite where there is none."""
    kp = numbers["stiffness"]
    return {
        "stiffness": kp,
        "damping": numbers["damping"],
        "effort_limit": numbers.get("effort_limit", np.full(kp.shape, np.inf)),
    }


class ExplicitActuator(TargetedActuator):
    """Runs a law and sends what it makes through a motor."""

    cfg: ExplicitActuatorCfg

    def __init__(self, cfg: ExplicitActuatorCfg):
        super().__init__(cfg)
        self._law: Law | None = None
        self._strength: FloatArray | None = None
        self._efforts: list[FloatArray] = [np.zeros(0), np.zeros(0)]
        self._columns: Any = ...
        self._behind: FloatArray | None = None
        self.on_change: Callable[[], None] | None = None
        """Is called when parameters have changed, or when efforts are no longer shared."""

    def _element(self, target: Any, name: str, numbers: Mapping[str, float]) -> Any:
        gear = {"gear": self.cfg.gear} if self.cfg.gear else {}
        return add_general(target, self.cfg.transmission, **gear)

    def _bind(self) -> None:
        behind = range_behind(self.simulation.model, self._actuator_ids)
        self._behind = behind if np.isfinite(behind).any() else None
        self._law = self.cfg.law(self._within(self._numbers))
        self._law.allocate(self.shape)
        self._strength = None
        self._note(np.zeros(self.shape), np.zeros(self.shape))
        if self.cfg.transmission == "joint" and {"stiffness", "damping"} <= {*self._law.names}:
            same = f"BuiltinPdActuatorCfg with {IMPLICIT}" if type(self._law) is PdLaw else None
            self.warn_unstable(self._law.get("stiffness"), self._law.get("damping"), same)

    def _within(self, numbers: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
        """The config's numbers, with no effort limit above that of the joint."""
        if self._behind is None or "effort_limit" not in {item.name for item in fields(self.cfg)}:
            return numbers
        behind = np.abs(self._behind).max(axis=1)
        return {**numbers, "effort_limit": np.minimum(numbers.get("effort_limit", behind), behind)}

    def control(
        self,
        position_target: FloatArray | None,
        velocity_target: FloatArray | None,
        effort_target: FloatArray | None,
    ) -> FloatArray:
        """As in `Actuator`."""
        q, qd = self.state()
        computed, applied = self.law.effort(position_target, velocity_target, effort_target, q, qd)
        if self._strength is not None:
            applied *= self._strength
        self._note(computed, applied)
        return applied

    def share(self, efforts: list[FloatArray], columns: Any) -> None:
        """Has the efforts of each step in common with other actuators, until it makes its own.

        Args:
            efforts: before any limit and after the limits [N·m; N], of these joints and of others;
                arrays take each other's place in it, but nobody may write to them.
            columns: what indexes these joints in them.
        """
        self._efforts, self._columns = efforts, columns

    def _note(self, computed: FloatArray, applied: FloatArray) -> None:
        self._efforts, self._columns = [computed, applied], ...
        if self.on_change is not None:
            self.on_change()

    @property
    def law(self) -> Law:
        """Its law, with the state of every joint."""
        if self._law is None:
            raise RuntimeError(f"call initialize(physics) on the actuator of {self.cfg} first")
        return self._law

    @property
    def strength(self) -> FloatArray | None:
        """Factor on what the limits leave, None where it is 1 everywhere."""
        return self._strength

    @property
    def takes(self) -> frozenset[str]:
        """As in `Actuator`; until it knows its physics, whatever a law may take."""
        return frozenset(TARGETS) if self._law is None else self._law.takes

    @property
    def needs(self) -> frozenset[str]:
        """As in `Actuator`."""
        return self.law.needs

    @property
    def holds(self) -> bool:
        """As in `Actuator`."""
        return False

    @property
    def computed_effort(self) -> FloatArray:
        """As in `Actuator`."""
        return np.array(self._efforts[0][self._columns])

    @property
    def applied_effort(self) -> FloatArray:
        """As in `Actuator`."""
        applied = np.array(self._efforts[1][self._columns])
        if self._behind is not None:
            np.clip(applied, self._behind[:, 0], self._behind[:, 1], out=applied)
        return applied

    def _asked(self, target: str) -> FloatArray:
        if target == "effort_target":
            return self.effort_range
        limit = self._limit("velocity_limit") if target == "velocity_target" else np.inf
        return limit * np.tile([-1.0, 1.0], (len(self.joint_names), 1))

    @property
    def effort_range(self) -> FloatArray:
        """As in `Actuator`."""
        own = self._limit("effort_limit") * np.tile([-1.0, 1.0], (len(self.joint_names), 1))
        return own if self._behind is None else least(own, self._behind)

    def _limit(self, name: str) -> Any:
        """One of the law's limits as configured, (n_joints, 1), or an infinite one."""
        return self.nominal(name)[:, None] if name in self.parameters else np.inf

    def _reset(self, rows: Rows, random_state: Random | None) -> None:
        del random_state
        self.law.reset(rows)
        at = slice(None) if rows is None else rows
        # Not in place: what `compute` returned belongs to whoever asked for it.
        computed, applied = self.computed_effort, self.applied_effort
        computed[at] = applied[at] = 0.0
        self._note(computed, applied)

    def _own(self) -> Mapping[str, FloatArray]:
        one = np.ones(len(self.joint_names))
        return {**{name: self.law.get(name) for name in self.law.names}, "strength": one}

    def _read(self, name: str) -> FloatArray:
        if name == "strength":
            return np.ones(self.shape) if self._strength is None else self._strength
        return self.law.get(name)

    def _write(self, name: str, values: FloatArray, rows: Rows) -> None:
        if self.on_change is not None:
            self.on_change()
        if name != "strength":
            self.law.set(name, values, rows)
            return
        strength = np.array(np.broadcast_to(self._read(name), self.shape))
        strength[slice(None) if rows is None else rows] = values
        self._strength = strength


class AdoptedMotorActuator(ExplicitActuator):
    """Sends what its law makes through a motor that is there, whatever the motor makes of it."""

    adds_elements = False

    def _element(self, target: Any, name: str, numbers: Mapping[str, float]) -> Any:
        found = actuators_of(target)
        if len(found) != 1:
            raise ValueError(
                f"joint {name!r} has {len(found)} actuators, where the law of "
                f"{type(self.cfg).__name__} needs the motor that the gap workflow has left there"
            )
        return found[0]
