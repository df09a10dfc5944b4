"""Actuators that differ from episode to episode, and from robot to robot.

    weaker = Randomization(parameter="strength", range=(0.7, 1.0), joint_names_expr=(".*_knee",))

    def initialize_episode(self, physics, random_state):           # of a composer task
        weaker.apply(self.actuators, random_state)

Every result is worked out from the nominal value, that of the config or of the XML: it does not
matter how often this is called, nor what was there before. Each joint of each simulation has a draw
of its own; `shared=True` gives all joints of a simulation the same one.

A range from which something impossible could come, as a negative gain or an effort limit of zero,
is refused at the first call, whatever is drawn there, and not in the thousandth episode. Only the
values of a composer variation, whose range nobody knows, are judged one by one. A refusal leaves
the actuators as they were.

The place for it is the start of an episode, before the `reset` of the actuators, which is when lags
are drawn within their new bounds. Gains may change between any two steps.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.actuator import Actuator, Random, Rows, rows_of
from walkerkit.actuators.config_fields import choice, names
from walkerkit.actuators.draws import (
    CUT,
    Distribution,
    Range,
    check_pair,
    draw,
    draw_whole,
    support,
    vary,
)
from walkerkit.actuators.group import ActuatorGroup
from walkerkit.actuators.messages import closest, listed
from walkerkit.actuators.selection import select

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
Operation = Literal["scale", "add", "abs"]
Change = tuple[Actuator, str, FloatArray]

_ABOVE_ZERO = frozenset({"effort_limit", "motor_constant"})
_LAG_BOUNDS = ("delay_min_lag", "delay_max_lag")


@dataclass(frozen=True, kw_only=True)
class Randomization:
    """How one parameter varies.

    Attributes:
        parameter: one of the actuators' `parameters`; or `delay`, of which each actuator draws one
            that moves both bounds of its lag [physics steps, rounded], within the `delay_max_lag`
            of its config.
        range: (low, high) of the draws, of a Gaussian (mean, standard deviation); in the unit of
            the parameter, with `scale` without one. Or a composer variation, which is called for
            each simulation with the nominal and the present values of the selected joints; what it
            returns is the draw.
        operation: `scale` multiplies the nominal value by the draw, `add` adds the two, `abs` takes
            the draw itself.
        distribution: `uniform`, `log_uniform` (uniform in the logarithm), or `gaussian`, which ends
            at three standard deviations.
        joint_names_expr: full-match regular expressions of the joints that vary. Those whose
            actuator does not have the parameter are passed over, if others have it.
        shared: one draw for all joints of a simulation, instead of one for each.

    Raises:
        TypeError: the range is neither two numbers nor a variation.
        ValueError: the numbers do not rise, or are not positive with `log_uniform`; a word is
            unknown; or the fields contradict each other.
    """

    parameter: str
    range: Range
    operation: Operation = choice("scale", "add", "abs", default="scale")
    distribution: Distribution = choice("uniform", "log_uniform", "gaussian", default="uniform")
    joint_names_expr: tuple[str, ...] = field(default=(".*",), metadata=names().metadata)
    shared: bool = False

    def __post_init__(self) -> None:
        for item in fields(self):
            if "check" in item.metadata:
                value = item.metadata["check"](item.name, getattr(self, item.name))
                object.__setattr__(self, item.name, value)
        if not isinstance(self.parameter, str):
            raise TypeError(f"parameter should be the name of one, got {self.parameter!r}")
        if self.parameter in _LAG_BOUNDS:
            raise ValueError(
                f"parameter={self.parameter!r}: the two bounds of a lag move together, or they "
                "would cross; use parameter='delay'"
            )
        if not callable(self.range):
            what = f"range of {self.parameter!r}"
            pair = check_pair(what, self.range, self.distribution)
            if self._whole and not all(number.is_integer() for number in pair):
                raise ValueError(
                    f"{what} should be whole physics steps with operation={self.operation!r}, got "
                    f"({pair[0]:g}, {pair[1]:g})"
                )
            object.__setattr__(self, "range", pair)
        elif self.shared or self.distribution != "uniform":
            given = "shared=True" if self.shared else f"distribution={self.distribution!r}"
            raise ValueError(
                f"{given} beside the variation {self.range!r}, which says itself how it is "
                "distributed and, with single_sample=True, that it is one for all: leave it out"
            )

    @property
    def _whole(self) -> bool:
        """The draws are lags, of which each is to be as likely as the next."""
        lags = self.parameter == "delay" and self.operation != "scale"
        return lags and self.distribution == "uniform"

    @property
    def _names(self) -> tuple[str, ...]:
        return _LAG_BOUNDS if self.parameter == "delay" else (self.parameter,)

    def apply(
        self,
        actuators: Actuator | ActuatorGroup,
        random_state: Random,
        env_ids: ArrayLike | None = None,
    ) -> None:
        """Draws, and sets the parameter.

        Args:
            actuators: initialized actuators.
            random_state: where the draws come from.
            env_ids: simulations of the batch, ids or a mask; None for all. The others keep their
                values bit for bit.

        Raises:
            TypeError: `actuators` or `random_state` is something else.
            RuntimeError: the actuators do not know their physics yet.
            ValueError: an expression matches no joint, no selected actuator has the parameter, a
                value would be impossible, or none would change.
        """
        set_all(self.changes(actuators, random_state, env_ids), env_ids)

    def changes(
        self,
        actuators: Actuator | ActuatorGroup,
        random_state: Random,
        env_ids: ArrayLike | None = None,
    ) -> list[Change]:
        """What `apply` sets, drawn and judged: actuators, parameters, values (..., n_joints)."""
        if not isinstance(random_state, np.random.Generator | np.random.RandomState):
            raise TypeError(
                f"random_state should be a numpy Generator or RandomState, got {random_state!r}: "
                "make one np.random.default_rng(seed) for all calls and keep it"
            )
        if not isinstance(actuators, Actuator | ActuatorGroup):
            raise TypeError(
                f"actuators should be an initialized Actuator or ActuatorGroup, got {actuators!r}"
            )
        batch_shape = actuators.simulation.batch_shape
        rows = rows_of(env_ids, batch_shape)
        parts = self._parts(actuators)
        self._refuse_idle(parts)
        shape = batch_shape if rows is None else (len(rows),)
        draws = self._draws(parts, shape, rows, random_state)
        changes = []
        for part in parts:
            drawn = draws[..., part.slots]
            if callable(self.range):
                self._refuse_impossible(part, drawn)
            for name in self._names:
                values = part.present(name, rows)
                values[..., part.columns] = self._result(part.nominal(name), drawn)
                changes.append((part.actuator, name, values))
        return changes

    def _draws(
        self, parts: list[_Part], shape: tuple[int, ...], rows: Rows, random_state: Random
    ) -> FloatArray:
        """One draw per slot, (*shape, n_slots)."""
        n_slots = 1 + max(int(part.slots.max()) for part in parts)
        if callable(self.range):
            initial, current = np.empty(n_slots), np.empty((*shape, n_slots))
            for part in parts:
                initial[part.slots] = part.nominal(self._names[-1])
                current[..., part.slots] = part.present(self._names[-1], rows)[..., part.columns]
            return vary(self.range, initial, current, random_state)
        for end in support(self.range, self.distribution):
            for part in parts:
                self._refuse_impossible(part, np.full(len(part.names), end))
        share = random_state.uniform(size=(*shape, n_slots))
        if self._whole:
            return draw_whole(self.range, share)
        return draw(self.range, self.distribution, share)

    def _result(self, nominal: FloatArray, draws: FloatArray) -> FloatArray:
        result = draws
        if self.operation != "abs":
            # What is unlimited stays so, even 0 times.
            unlimited = np.isinf(nominal)
            known = np.where(unlimited, 0.0, nominal)
            result = known * draws if self.operation == "scale" else known + draws
            result = np.where(unlimited, nominal, result)
        return np.rint(result) if self.parameter == "delay" else result

    # Which joints, and which draw is whose.

    def _parts(self, actuators: Actuator | ActuatorGroup) -> list[_Part]:
        every = actuators.actuators if isinstance(actuators, ActuatorGroup) else (actuators,)
        # A joint is known by its element: a tendon may have the name of a joint.
        in_order = [id(element) for element in actuators.elements]
        chosen = {in_order[i] for i in select(self.joint_names_expr, actuators.joint_names)}
        parts = [part for part in (_Part.of(a, chosen) for a in every) if part.names]
        having = [part for part in parts if {*self._names} <= {*part.actuator.parameters}]
        if not having:
            raise self._unknown(parts)
        owners = {joint: part for part in having for joint in part.joints}
        if self.parameter == "delay":
            for part in having:
                self._refuse_some(part)
        # In kinematic order, so that a draw does not depend on the order of the configs.
        keys = {
            joint: 0 if self.shared else id(owners[joint]) if self.parameter == "delay" else joint
            for joint in in_order
            if joint in owners
        }
        slot = {key: i for i, key in enumerate(dict.fromkeys(keys.values()))}
        for part in having:
            part.slots[:] = [slot[keys[joint]] for joint in part.joints]
        return having

    # What is refused.

    def _unknown(self, parts: list[_Part]) -> ValueError:
        hint = closest(self.parameter, {n for part in parts for n in part.actuator.parameters})
        if self.parameter == "delay":
            hint = (
                " (an actuator without delay, or with a constant one that MuJoCo runs, cannot vary "
                "it: use DelayedActuatorCfg with delay_min_lag below delay_max_lag)"
            )
        having = "; ".join(
            f"the actuator of {listed(part.names, 4)} has {list(part.actuator.parameters)}"
            for part in parts
        )
        return ValueError(
            f"parameter={self.parameter!r}: no selected actuator has it{hint}: {having}"
        )

    def _refuse_some(self, part: _Part) -> None:
        """Refuses some joints out of those that have one delay in common."""
        rest = [name for i, name in enumerate(part.actuator.joint_names) if i not in part.columns]
        if rest:
            raise ValueError(
                f"joint_names_expr={self.joint_names_expr}: the delay of {listed(part.names)} is "
                f"also that of {listed(rest)}; select all of them, or give them configs of their "
                "own"
            )

    def _refuse_idle(self, parts: list[_Part]) -> None:
        """Refuses what would change nothing and be believed to."""
        nominal = np.concatenate([part.nominal(self._names[-1]) for part in parts])
        unlimited = np.isinf(nominal)
        zero = (nominal == 0) & (self.operation == "scale")
        if self.operation == "abs" or not (unlimited | zero).all():
            return
        joints = listed(name for part in parts for name in part.names)
        what = "unlimited" if unlimited.all() else "0" if zero.all() else "0 or unlimited"
        raise ValueError(
            f"operation={self.operation!r} changes nothing: the nominal {self._names[-1]} of "
            f"{joints} is {what}; give it a value in the config or the XML, use operation='abs', "
            "or leave this out"
        )

    def _refuse_impossible(self, part: _Part, draws: FloatArray) -> None:
        for name in self._names:
            nominal = part.nominal(name)
            values = self._result(nominal, draws)
            for at in (int(values.argmin()), int(values.argmax())) if values.size else ():
                joint = at % len(nominal)
                value, was = float(values.flat[at]), float(nominal[joint])
                wrong = None if value == was == np.inf else part.complaint(name, value)
                if wrong:
                    far = f" (a gaussian ends {CUT:g} standard deviations from its mean)"
                    raise ValueError(
                        f"{part.names[joint]!r}: {wrong}; that is what {self.operation} "
                        f"{draws.flat[at]:g} makes of the nominal {was:g}: narrow the range "
                        f"{self.range!r}" + (far if self.distribution == "gaussian" else "")
                    )


@dataclass(frozen=True, kw_only=True)
class _Part:
    """The selected joints of one actuator.

    Attributes:
        actuator: the actuator.
        names: the joints, (n,).
        joints: what else tells them apart, (n,).
        columns: their places in the actuator's arrays, (n,).
        slots: their places among the draws, (n,).
    """

    actuator: Actuator
    names: tuple[str, ...]
    joints: tuple[int, ...]
    columns: IntArray
    slots: IntArray

    @classmethod
    def of(cls, actuator: Actuator, chosen: set[int]) -> _Part:
        """The chosen joints of an actuator."""
        joints = [id(element) for element in actuator.elements]
        columns = [i for i, joint in enumerate(joints) if joint in chosen]
        return cls(
            actuator=actuator,
            names=tuple(actuator.joint_names[i] for i in columns),
            joints=tuple(joints[i] for i in columns),
            columns=np.array(columns, dtype=np.intp),
            slots=np.zeros(len(columns), dtype=np.intp),
        )

    def nominal(self, name: str) -> FloatArray:
        """The nominal values of the selected joints, (n,)."""
        return self.actuator.nominal(name)[self.columns]

    def present(self, name: str, rows: Rows) -> FloatArray:
        """The present values of all joints, in some of the simulations."""
        values = self.actuator.get(name)
        return values if rows is None else values[rows]

    def complaint(self, name: str, value: float) -> str | None:
        """Why a value is impossible, if it is."""
        if name in _LAG_BOUNDS:
            room = self.nominal(_LAG_BOUNDS[1])[0]
            if 0 <= value <= room:
                return None
            return f"{name} should be from 0 to {room:g}, its config's delay_max_lag, got {value:g}"
        cfg: Any = getattr(self.actuator, "cfg", None)
        cfg = getattr(cfg, "base_cfg", cfg)
        for item in fields(cfg) if is_dataclass(cfg) else ():
            if item.name == name and "check" in item.metadata:
                try:
                    item.metadata["check"](name, value)
                except (TypeError, ValueError) as error:
                    return str(error)
                return None
        # A number of the XML, or one that no config has.
        if not np.isfinite(value) or value < 0 or (value == 0 and name in _ABOVE_ZERO):
            sign = "above 0" if name in _ABOVE_ZERO else "at least 0"
            return f"{name} should be finite and {sign}, got {value:g}"
        return None


def set_all(changes: list[Change], env_ids: ArrayLike | None) -> None:
    """Sets what `Randomization.changes` drew."""
    for actuator, name, values in changes:
        actuator.set(name, values, env_ids)
