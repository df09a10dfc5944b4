"""The log of the rehearsal robot: when its encoders are read, and what is then written down.

log = Log(drives, hidden, step=2.5e-4, stride=8, start=lead)
rows = log.rows(position, speed, effort, count=6000)        # without noise
position, speed, effort = readings(rows[:, :, 0], rng)      # of the first experiment
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from walkerkit.gap.rehearsal.hardware_drive import Array, Drives
from walkerkit.gap.rehearsal.hardware_motor import supply, waves
from walkerkit.gap.rehearsal.hardware_signals import read
from walkerkit.gap.rehearsal.hidden import HiddenEffect

COUNTS: Final = 16384
"""Encoder counts of a turn (of 2π m on a slide joint)."""
POSITION_NOISE: Final = 1e-4
"""Of the position before it is quantised, rad (m for slide joints)."""
VELOCITY_NOISE: Final = 0.01
"""Of the velocity, rad/s."""
EFFORT_NOISE: Final = 0.02
"""Of the reported effort, N·m."""
VOLTAGE_NOISE: Final = 0.02
"""Of the supply's voltage, V."""


class Log:
    """How the signals of the robot become rows."""

    def __init__(
        self,
        drives: Drives,
        hidden: Sequence[HiddenEffect],
        *,
        step: float,
        stride: int,
        start: int,
        reads_first: bool = False,
    ) -> None:
        """A log.

        Args:
            drives: the drives.
            hidden: effects; those that are no log's are left alone.
            step: time from one value of the signals to the next, s.
            stride: values from one row to the next.
            start: value at which the log begins.
            reads_first: a row's effort is that of the value before it.
        """
        self._late: Array = drives.sensor_delay / step
        self._stride, self._start, self._step = stride, start, step
        self._effort_age = int(reads_first)
        self._errors = [waves(e, drives.joints) for e in hidden if e.effect == "kinematic_error"]
        fast = (1.0 + e.value("skew") for e in hidden if e.effect == "clock_skew")
        self._clock = math.prod(fast)

    def values(self, rows: int) -> int:
        """How many values of the signals so many rows take."""
        return self._start + math.ceil((rows - 1) * self._stride / min(self._clock, 1.0)) + 1

    def rows(self, position: Array, speed: Array, effort: Array, *, count: int) -> Array:
        """What the rows show.

        Args:
            position: readings of the encoders, shape (n_values, n_sims, n_joints), rad.
            speed: their speeds, shape as `position`, rad/s.
            effort: what the drives report, shape as `position`, N·m.
            count: number of rows.

        Returns:
            Position, speed and effort, shape (3, count, n_sims, n_joints).
        """
        at = self._instants(count)
        shown, slope = position, np.ones_like(speed)
        for amplitude, periods, phase in self._errors:
            angle = periods * position + phase
            shown = shown + amplitude * np.sin(angle)
            slope += amplitude * periods * np.cos(angle)
        late = at - np.round(self._late, 9)
        made = read(effort, at - self._effort_age + 0 * late)
        return np.stack([read(shown, late), read(slope * speed, late), made])

    def voltage(self, count: int, swing: float, rng: np.random.Generator) -> Array:
        """What the rows show of a supply that goes up and down, (count,) V.

        Args:
            count: number of rows.
            swing: by which part of itself it does.
            rng: source of the noise.
        """
        times = (self._instants(count)[:, 0] - self._start) * self._step
        return supply(times, swing) + VOLTAGE_NOISE * rng.standard_normal(count)

    def base_rows(self, states: Array, *, count: int) -> Array:
        """What the rows show of the base, (n_values, n_sims, n) → (count, n_sims, n)."""
        return read(states, self._instants(count))

    def _instants(self, count: int) -> Array:
        """The values at which the rows are, shape (count, 1)."""
        # A clock that is fast by 1 % has counted 1 s when 0.99 s have passed.
        instants: Array = self._start + np.arange(count)[:, None] * self._stride / self._clock
        return instants


def readings(rows: Array, rng: np.random.Generator) -> Array:
    """Rows with the noise of the sensors and the steps of the encoders.

    Args:
        rows: position, speed and effort without, shape (3, T, n_joints).
        rng: source of the noise.

    Returns:
        The readings, shape as `rows`.
    """
    spread = np.array([POSITION_NOISE, VELOCITY_NOISE, EFFORT_NOISE])
    noisy: Array = rows + spread[:, None, None] * rng.standard_normal(rows.shape)
    count = 2 * np.pi / COUNTS
    noisy[0] = np.round(noisy[0] / count) * count
    return noisy
