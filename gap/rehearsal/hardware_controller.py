"""The processor of the rehearsal robot's drives: from targets and encoders to an effort asked for.

    controller = Controller(drives, hidden, step=2.5e-4, n_sims=3)
    arriving = controller.arriving(sent, start=lead)
    for target in arriving:
        effort = controller.asked(target, position, speed)   # as the encoders read them

What it may do besides the servo's own law: look at its targets late, now and then only, or through
a filter; follow them no faster than it may; leave small errors alone; add up errors; filter the
speed that it feeds back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from walkerkit.gap.rehearsal.hardware_drive import Array, Drives, limited
from walkerkit.gap.rehearsal.hardware_signals import delayed, filtered, held, slewed
from walkerkit.gap.rehearsal.hidden import HiddenEffect, total


class Controller:
    """The control loops of all drives of several simulations."""

    def __init__(
        self, drives: Drives, hidden: Sequence[HiddenEffect], *, step: float, n_sims: int
    ) -> None:
        """A controller that has just been switched on.

        Args:
            drives: the servos.
            hidden: effects; those that are no controller's are left alone.
            step: time between two calls, s.
            n_sims: number of simulations.
        """
        names = drives.joints
        self._drives = drives
        self._period = total(hidden, "sample_and_hold", "period", names) / step
        self._rounding = total(hidden, "setpoint_filter", "time_constant", names) / step
        rates = [e.spread("rate", names, elsewhere=np.inf) for e in hidden if _slews(e)]
        self._slew: Array = np.min([np.full(len(names), np.inf), *rates], axis=0) * step
        self._lag = drives.command_delay / step
        self._deadband = total(hidden, "controller_deadband", "width", names)
        self._integral_gain = total(hidden, "integral_action", "gain", names) * step
        memory = total(hidden, "velocity_filter", "time_constant", names) / step
        self._stay = np.exp(-1.0 / np.maximum(memory, 1e-9))
        self._has_deadband, self._filters, self._integrates = (
            bool(of.any()) for of in (self._deadband, memory, self._integral_gain)
        )
        self._speed: Array | None = None
        self._integral = np.zeros((n_sims, len(names)))
        self._low, self._high = drives.effort_range

    def arriving(self, sent: Array, *, start: int) -> Array:
        """Targets as the control law sees them.

        Args:
            sent: targets as they are sent, shape (n_steps, n_sims, n_joints), rad.
            start: the step at which the log begins.

        Returns:
            Targets, shape as given, rad.
        """
        late = held(delayed(sent, self._lag), self._period, start=start)
        low, high = self._drives.target_range
        followed = slewed(filtered(late, self._rounding), self._slew)
        return limited(followed, low, high)

    def asked(self, target: Array, position: Array, speed: Array) -> Array:
        """The effort that the loop asks for, within the drive's own limits, N·m.

        Args:
            target: target of this step, shape (n_sims, n_joints), rad.
            position: reading of the encoder, shape as `target`, rad.
            speed: reading of its speed, shape as `target`, rad/s.
        """
        if self._has_deadband:
            small = np.abs(target - position) < self._deadband
            target = np.where(small, position, target)
        if self._filters:
            before = speed if self._speed is None else self._speed
            speed = self._speed = speed + self._stay * (before - speed)
        effort = self._drives.asked(target, position, speed)
        if self._integrates:
            added = self._integral + self._integral_gain * (target - position)
            # What would only wind up against the limit is not added.
            self._integral = limited(added, self._low, self._high)
            effort = effort + self._integral
        return limited(effort, self._low, self._high)


def _slews(effect: HiddenEffect) -> bool:
    return effect.effect == "slew_limit"
