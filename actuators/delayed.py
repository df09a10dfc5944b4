"""Delays in front of any actuator.

    DelayedActuatorCfg(
        base_cfg=IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=80.0, damping=2.0),
        delay_target="position",
        delay_min_lag=2,
        delay_max_lag=5,
    )

Targets are late, feedback is not. Lags are counted in physics steps. Every target that the actuator
takes is late unless `delay_target` names some of them; each has lags of its own, or all share one
(`delay_shared`), as on a bus that delays the whole command. A constant delay of the one target of a
builtin actuator is left to MuJoCo's own `delay`, whose past is filled as ours is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.actuator import Actuator, Random, Rows, rows_of
from walkerkit.actuators.builtin import BuiltinActuatorCfg
from walkerkit.actuators.config import ActuatorCfg
from walkerkit.actuators.config_fields import number
from walkerkit.actuators.laws.lag import DelayLine, Lags, LagSchedule
from walkerkit.actuators.messages import listed
from walkerkit.actuators.native import NativeActuator
from walkerkit.actuators.simulation import Simulation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

WORDS = ("position", "velocity", "effort")


def _delay_targets(name: str, value: Any) -> tuple[str, ...] | None:
    if value is None:
        return None
    words = tuple(value) if isinstance(value, Iterable) and not isinstance(value, str) else (value,)
    if not words or any(words.count(word) > 1 or word not in WORDS for word in words):
        raise ValueError(f"{name} should be one or several of {list(WORDS)}, got {value!r}")
    return tuple(word for word in WORDS if word in words)


@dataclass(frozen=True, kw_only=True)
class DelayedActuatorCfg(ActuatorCfg):
    """Delays targets on their way to another actuator.

    Attributes:
        base_cfg: the actuator behind the delay.
        delay_target: which targets are late: `position`, `velocity`, `effort`, or several; None for
            all that the actuator takes.
        delay_min_lag: least lag [physics steps].
        delay_max_lag: greatest lag [physics steps].
        delay_hold_prob: probability that a redraw keeps the lag; 1 draws once, at each reset.
        delay_update_period: physics steps between redraws; 0 redraws at each.
        delay_shared: all of these targets have one lag, so that those of a command stay together;
            by default each has a delay line with lags of its own.
        delay_per_env_phase: each simulation redraws at steps of its own, drawn at the reset;
            by default all that are reset together redraw together.
        seed: of the lags; `reset` may bring its own source.

    Raises:
        TypeError: `base_cfg` is no config of an actuator without delay.
        ValueError: the bounds cross, the actuator does not take one of the targets, or there is no
            period to have a phase in.
    """

    base_cfg: ActuatorCfg
    delay_target: str | tuple[str, ...] | None = field(
        default=None, metadata={"check": _delay_targets}
    )
    delay_min_lag: int = number(default=0, at_least=0, whole=True, per_joint=False)
    delay_max_lag: int = number(default=0, at_least=0, whole=True, per_joint=False)
    delay_hold_prob: float = number(default=0.0, at_least=0, at_most=1, per_joint=False)
    delay_update_period: int = number(default=0, at_least=0, whole=True, per_joint=False)
    delay_shared: bool = False
    delay_per_env_phase: bool = False
    seed: int = number(default=0, at_least=0, whole=True, per_joint=False)

    def check(self) -> None:
        """As in `ActuatorCfg`."""
        if not isinstance(self.base_cfg, ActuatorCfg) or isinstance(
            self.base_cfg, DelayedActuatorCfg
        ):
            raise TypeError(
                f"base_cfg should be the config of an actuator without delay, got {self.base_cfg!r}"
            )
        if self.delay_min_lag > self.delay_max_lag:
            raise ValueError(
                f"delay_min_lag={self.delay_min_lag} is above delay_max_lag={self.delay_max_lag}: "
                "raise the latter or lower the former"
            )
        if self.delay_per_env_phase and (self.delay_update_period < 2 or not self.schedule.wanders):
            raise ValueError(
                f"delay_per_env_phase=True with delay_update_period={self.delay_update_period}, "
                f"delay_hold_prob={self.delay_hold_prob:g} and lags from {self.delay_min_lag} to "
                f"{self.delay_max_lag}: there are no redraws whose steps could differ; leave it "
                "out, or give different lags, a period of 2 or more and a probability below 1"
            )
        self.words(self.base_cfg.build().takes)

    def words(self, takes: frozenset[str]) -> tuple[str, ...]:
        """Which targets are late, of those that the actuator behind the delay takes.

        Args:
            takes: its targets, of `TARGETS`.

        Raises:
            ValueError: `delay_target` has one that it does not take.
        """
        able = tuple(word for word in WORDS if f"{word}_target" in takes)
        if self.delay_target is None:
            return able
        lost = [word for word in self.delay_target if word not in able]
        if lost:
            raise ValueError(
                f"delay_target={self.delay_target!r}: a {type(self.base_cfg).__name__} of "
                f"{getattr(self.base_cfg, 'joint_names_expr', ())} takes no "
                f"{' and no '.join(lost)} target that could be late; use delay_target="
                f"{able if len(able) > 1 else able[0]!r}, or leave it out to delay all that it "
                "takes"
            )
        return tuple(self.delay_target)

    @property
    def schedule(self) -> LagSchedule:
        """How lags are drawn."""
        return LagSchedule(
            min_lag=self.delay_min_lag,
            max_lag=self.delay_max_lag,
            hold_prob=self.delay_hold_prob,
            update_period=self.delay_update_period,
            phase=self.delay_per_env_phase,
        )

    @property
    def joint_names_expr(self) -> tuple[str, ...]:
        """The base's expressions."""
        return self.base_cfg.joint_names_expr  # type: ignore[attr-defined, no-any-return]

    def build(self) -> DelayedActuator:
        """The actuator."""
        return DelayedActuator(self)


class DelayedActuator(Actuator):
    """Pushes targets through delay lines before its base sees them.

    Attributes:
        base: the actuator behind the delay.
        native: MuJoCo runs the delay.
    """

    def __init__(self, cfg: DelayedActuatorCfg):
        super().__init__()
        self.cfg = cfg
        self.base = cfg.base_cfg.build()
        self._lines: dict[str, DelayLine] = {}
        self._shared: Lags | None = None
        seeds = np.random.SeedSequence(cfg.seed).spawn(len(WORDS))
        self._seeds = dict(zip(WORDS, seeds, strict=True))
        self.native = False
        base_cfg = cfg.base_cfg
        if (
            isinstance(base_cfg, BuiltinActuatorCfg)
            and isinstance(self.base, NativeActuator)
            and cfg.words(self.base.takes) == (base_cfg.kind,)
            and cfg.schedule.constant
            and cfg.delay_max_lag > 0
        ):
            self.native = True
            self.base.delay_natively(cfg.delay_max_lag)

    # Lifecycle.

    def targets(self, root: Any) -> list[Any]:
        """As in `Actuator`."""
        return self.base.targets(root)

    def edit_mjcf(self, root: Any) -> None:
        """As in `Actuator`."""
        self.base.edit_mjcf(root)

    def initialize(self, physics: Any) -> None:
        """As in `Actuator`."""
        self.base.initialize(physics)
        self._checked = None
        words = self.cfg.words(self.base.takes)
        if self.native:
            return
        schedule, batch_shape = self.cfg.schedule, self.base.simulation.batch_shape
        shape = (*batch_shape, len(self.base.joint_names))
        # Each line spawns new seeds: episodes that recompile the model do not repeat their lags.
        self._shared = (
            Lags(schedule, batch_shape, self._seeds[words[0]]) if self.cfg.delay_shared else None
        )
        self._lines = {
            word: DelayLine(schedule, shape, self._seeds[word], self._shared) for word in words
        }

    def _reset(self, rows: Rows, random_state: Random | None) -> None:
        if self._shared is not None:
            self._shared.reset(rows, random_state)
        for line in self._lines.values():
            line.reset(rows, random_state)
        self.base._reset(rows, random_state)

    def control(
        self,
        position_target: FloatArray | None,
        velocity_target: FloatArray | None,
        effort_target: FloatArray | None,
    ) -> FloatArray:
        """As in `Actuator`."""
        if self._shared is not None and self._shared.wanders:
            self._shared.step()
        lines = self._lines
        if position_target is not None and "position" in lines:
            position_target = lines["position"].push(position_target)
        if velocity_target is not None and "velocity" in lines:
            velocity_target = lines["velocity"].push(velocity_target)
        if effort_target is not None and "effort" in lines:
            effort_target = lines["effort"].push(effort_target)
        return self.base.control(position_target, velocity_target, effort_target)

    def look(self) -> None:
        """As in `Actuator`."""
        self.base.look()

    # What it is: its base, later.

    @property
    def lines(self) -> Mapping[str, DelayLine]:
        """The delay line of each target that is late; none where MuJoCo runs the delay."""
        return self._lines

    @property
    def lags(self) -> tuple[Lags, ...]:
        """The lags of each line, or the one that all of them share; none where MuJoCo delays."""
        if self._shared is not None:
            return (self._shared,)
        return tuple(line.lags for line in self._lines.values())

    @property
    def shared_lags(self) -> Lags | None:
        """The lags that all lines share, which go on by one step before each physics step."""
        return self._shared

    def set_lags(self, lags: ArrayLike, env_ids: ArrayLike | None = None) -> None:
        """Sets the present lag of every late target, until the next redraw or reset.

        Args:
            lags: from 0 to `delay_max_lag` [physics steps], a number or (n_ids,).
            env_ids: as in `reset`.

        Raises:
            ValueError: a lag is no whole number in these bounds, there are more or fewer of them
                than simulations, or the delay is a constant one that MuJoCo runs.
        """
        most = self.cfg.delay_max_lag
        if self.native:
            raise ValueError(
                f"the lag of {listed(self.joint_names, 4)} is always {most}, and MuJoCo runs the "
                "delay: give its DelayedActuatorCfg a delay_min_lag below its delay_max_lag, and "
                "delay_hold_prob=1 to have no lag drawn within an episode"
            )
        rows = rows_of(env_ids, self.simulation.batch_shape)
        shape = self.simulation.batch_shape if rows is None else (len(rows),)
        given = np.asarray(lags, dtype=np.float64)
        if given.shape not in ((), shape):
            raise ValueError(
                f"lags should be a number or {list(shape)} numbers, got the shape {given.shape}"
            )
        if not ((given == np.rint(given)) & (given >= 0) & (given <= most)).all():
            raise ValueError(
                f"lags should be whole physics steps from 0 to delay_max_lag={most}, got {lags!r}: "
                "raise the config's delay_max_lag for longer ones"
            )
        for one in self.lags:
            one.set(given.astype(np.intp), rows)

    def lag(self, target: str) -> IntArray:
        """The present lag of a target [physics steps], () or (n_sims,).

        Args:
            target: one of those that are late.

        Raises:
            KeyError: that target is not delayed.
        """
        words = self.cfg.words(self.base.takes)
        if target not in words:
            raise KeyError(f"{target!r} is not delayed, {list(words)} are")
        if self.native:
            return np.full(self.simulation.batch_shape, self.cfg.delay_max_lag, dtype=np.intp)
        return self._lines[target].lag

    @property
    def takes(self) -> frozenset[str]:
        """As in `Actuator`."""
        return self.base.takes

    @property
    def needs(self) -> frozenset[str]:
        """As in `Actuator`."""
        return self.base.needs

    @property
    def simulation(self) -> Simulation:
        """As in `Actuator`."""
        return self.base.simulation

    @property
    def joint_names(self) -> tuple[str, ...]:
        """As in `Actuator`."""
        return self.base.joint_names

    @property
    def joint_ids(self) -> IntArray:
        """As in `Actuator`."""
        return self.base.joint_ids

    @property
    def ctrl_ids(self) -> IntArray:
        """As in `Actuator`."""
        return self.base.ctrl_ids

    @property
    def elements(self) -> tuple[Any, ...]:
        """As in `Actuator`."""
        return self.base.elements

    @property
    def positions(self) -> FloatArray:
        """As in `Actuator`."""
        return self.base.positions

    @property
    def beside(self) -> tuple[Any, ...]:
        """As in `Actuator`."""
        return self.base.beside

    @property
    def apart(self) -> frozenset[str]:
        """As in `Actuator`."""
        return self.base.apart

    @property
    def computed_effort(self) -> FloatArray:
        """As in `Actuator`."""
        return self.base.computed_effort

    @property
    def applied_effort(self) -> FloatArray:
        """As in `Actuator`."""
        return self.base.applied_effort

    def reach(self, target: str) -> FloatArray:
        """As in `Actuator`."""
        return self.base.reach(target)

    @property
    def effort_range(self) -> FloatArray:
        """As in `Actuator`."""
        return self.base.effort_range

    @property
    def holds(self) -> bool:
        """As in `Actuator`."""
        return self.native and self.base.holds

    @property
    def parameters(self) -> tuple[str, ...]:
        """As in `Actuator`, and the bounds of the lag unless MuJoCo runs the delay."""
        own = () if self.native else ("delay_min_lag", "delay_max_lag")
        return (*self.base.parameters, *own)

    def nominal(self, name: str) -> FloatArray:
        """As in `Actuator`."""
        if name not in self._own():
            return self.base.nominal(name)
        return np.full(len(self.joint_names), self._own()[name], dtype=np.float64)

    def get(self, name: str) -> FloatArray:
        """As in `Actuator`."""
        if name not in self._own():
            return self.base.get(name)
        bound = np.asarray(self.lags[0].bounds[name == "delay_max_lag"], dtype=np.float64)
        shape = (*self.simulation.batch_shape, len(self.joint_names))
        return np.broadcast_to(bound[..., None], shape).copy()

    def set(self, name: str, values: ArrayLike, env_ids: ArrayLike | None = None) -> None:
        """As in `Actuator`; lags are whole, alike in all joints, and at most the config's."""
        if name not in self._own():
            self.base.set(name, values, env_ids)
            return
        rows = rows_of(env_ids, self.simulation.batch_shape)
        given = np.asarray(values, dtype=np.float64)
        steps = np.rint(given[..., 0] if given.ndim else given).astype(np.intp)
        at = ... if rows is None else rows
        for lags in self.lags:
            low, high = lags.bounds
            if name == "delay_min_lag":
                lags.narrow(np.broadcast_to(steps, low[at].shape), high[at], rows)
            else:
                lags.narrow(
                    np.minimum(low[at], steps), np.broadcast_to(steps, high[at].shape), rows
                )

    def _own(self) -> Mapping[str, int]:
        if self.native:
            return {}
        return {
            "delay_min_lag": self.cfg.delay_min_lag,
            "delay_max_lag": self.cfg.delay_max_lag,
        }
