"""The motors of the rehearsal robot: what they make of the effort that is asked of them.

    motor = Motor(drives, hidden, step=2.5e-4, start=lead)
    reported = motor.made(asked, speed)            # what the drive believes it delivers
    torque = motor.delivered(reported, angle)      # what its shaft gives, after the same call

A motor runs out of voltage at speed and when its neighbours draw power, makes less of a lower
supply, answers late and with a lag; that shows in the effort that its drive reports. Weak magnets,
their cogging, the commutation's ripple and a bias do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from walkerkit.gap.rehearsal.hardware_drive import Array, Drives, limited
from walkerkit.gap.rehearsal.hidden import HiddenEffect, total

SUPPLY: Final = 24.0
"""Voltage of the supply for which the drives are made, V."""

_CONSUMERS = (0.31, 0.83)  # Hz, at which others come and go
_EMPTY = 1e-6  # of its limits, what a drained supply leaves


class Motor:
    """The motors of all joints of several simulations."""

    def __init__(
        self,
        drives: Drives,
        hidden: Sequence[HiddenEffect],
        *,
        step: float,
        start: int,
    ) -> None:
        """Motors that have just been switched on.

        Args:
            drives: the drives with what is hidden in them.
            hidden: effects; those that are no motor's are left alone.
            step: time between two calls, s.
            start: calls before the log begins; from there on they warm up.
        """
        names = drives.joints
        self._drives = drives
        self._lines = [
            [e.spread(p, names, elsewhere=np.inf) for p in ("saturation_effort", "velocity_limit")]
            for e in hidden
            if e.effect == "torque_speed_limit"
        ]
        self._sag = float(total(hidden, "supply_sag", "sag", names).max(initial=0.0))
        self._swing = swing_of(hidden)
        self._step = step
        memory = total(hidden, "actuator_lag", "time_constant", names) / step
        self._stay = np.exp(-1.0 / np.maximum(memory, 1e-9))
        self._lags = bool(memory.any())
        self._current: Array | None = None
        self._wait = float(total(hidden, "loop_delay", "delay", names).max(initial=0.0)) / step
        self._past: list[Array] = []
        self._weakening = total(hidden, "strength_drift", "rate", names) * step
        self._weakens = bool(self._weakening.any())
        self._warm = -start
        self._ripples, self._cogs = (
            [waves(e, names) for e in hidden if e.effect == name]
            for name in ("torque_ripple", "cogging")
        )

    def made(self, asked: Array, speed: Array) -> Array:
        """The effort that the drives believe they deliver, N·m; to be called once a step.

        Args:
            asked: what is asked for, shape (n_sims, n_joints), N·m.
            speed: of the motors, at the joints, shape as `asked`, rad/s.
        """
        effort, full = asked, 1.0
        if self._swing:
            full = float(supply(self._warm * self._step, self._swing)) / SUPPLY
            effort = effort * full
        for stall, free in self._lines:
            # The supply's voltage less what the motor induces drives the current.
            induced = speed / free
            low, high = (np.clip(s * full - induced, -full, full) * stall for s in (-1.0, 1.0))
            effort = limited(effort, low, high)
        if self._sag:
            power = np.abs(effort * speed).sum(axis=1, keepdims=True)
            limit = self._drives.effort_range[1] * np.maximum(1.0 - self._sag * power, _EMPTY)
            effort = limited(effort, -limit, limit)
        if self._wait:
            effort = self._later(effort)
        if self._lags:
            before = effort if self._current is None else self._current
            effort = self._current = effort + self._stay * (before - effort)
        self._warm += 1
        return effort

    def delivered(self, made: Array, angle: Array) -> Array:
        """The effort of the motors' shafts, at the joints, N·m.

        Args:
            made: what the drives believe, shape (n_sims, n_joints), N·m.
            angle: of the motors, at the joints, shape as `made`, rad.
        """
        drives = self._drives
        effort = drives.strength * made
        if self._weakens:
            effort = effort * np.maximum(1.0 - self._weakening * max(self._warm, 0), 0.0)
        for amplitude, periods, phase in self._ripples:
            effort = effort * (1.0 + amplitude * np.sin(periods * angle + phase))
        for amplitude, periods, phase in self._cogs:
            effort = effort + amplitude * np.sin(periods * angle + phase)
        return effort + drives.torque_bias

    def _later(self, effort: Array) -> Array:
        """The effort of `wait` steps ago, the fraction of a step interpolated."""
        whole = int(self._wait)
        if not self._past:
            self._past = [effort] * (whole + 2)
        self._past.append(effort)
        self._past.pop(0)
        part = self._wait - whole
        return (1.0 - part) * self._past[-1 - whole] + part * self._past[-2 - whole]


def swing_of(hidden: Sequence[HiddenEffect]) -> float:
    """By which part of itself the supply's voltage goes up and down."""
    return sum(e.value("swing") for e in hidden if e.effect == "supply_voltage")


def supply(time: float | Array, swing: float) -> Array:
    """Voltage of the supply, while other consumers come and go [V].

    Args:
        time: since the log's beginning [s].
        swing: by which part of itself it goes up and down.
    """
    slow, fast = (np.sin(2 * np.pi * rate * np.asarray(time)) for rate in _CONSUMERS)
    volts: Array = SUPPLY * (1.0 + swing * (0.6 * slow + 0.4 * fast))
    return volts


def waves(effect: HiddenEffect, names: Sequence[str]) -> tuple[Array, Array, Array]:
    """Amplitude, periods and phase of a sine over the pose, shape (n_joints,) each."""
    return (
        effect.spread("amplitude", names),
        effect.spread("periods", names),
        effect.spread("phase", names),
    )
