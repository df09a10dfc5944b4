"""The computer beside a rehearsal robot whose drives take efforts or speeds: it goes for positions.

    companion = Companion(drives, start=lead, stride=8, shape=sent.shape)
    told = companion.arrived(k, wanted, position, speed)    # at the drives, at step k
    companion.rows(count)                                   # what it sent, as the log has it

Once a row it reads the encoders, compares with where it wants the joints to be, and sends an effort
or a speed that is held until the next; so do the computers of torque-controlled robots. It is no
part of the robot and none of the model's: the log says what was sent. Servos get the positions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from walkerkit.gap.rehearsal.hardware_drive import Array, Drives, limited
from walkerkit.gap.rehearsal.hardware_signals import read
from walkerkit.gap.rehearsal.hidden import HiddenEffect, total

_ROUNDING = 1e-9  # of a step


class Companion:
    """Commands of several simulations, as they are sent and as they arrive."""

    def __init__(
        self,
        drives: Drives,
        hidden: Sequence[HiddenEffect],
        *,
        step: float,
        start: int,
        stride: int,
        shape: tuple[int, int, int],
    ) -> None:
        """A computer that has sent nothing yet.

        Args:
            drives: what it sends to.
            hidden: effects; those that are not of commands on their way are left alone.
            step: time between two steps, s.
            start: the step at which the log begins.
            stride: steps from one row to the next.
            shape: n_steps, n_sims, n_joints.
        """
        self._drives = drives
        self._start, self._stride = start, stride
        self._late: Array = np.round(drives.command_delay / step, 9)
        period = total(hidden, "sample_and_hold", "period", drives.joints) / step
        self._every = np.maximum(period, 1.0)
        self._sent = np.zeros(shape)
        self._low, self._high = drives.command_range

    def arrived(self, k: int, wanted: Array, position: Array, speed: Array) -> Array:
        """What the drives have been told by a step.

        Args:
            k: number of the step; every step is asked for once, in order.
            wanted: where the joints should be, shape (n_sims, n_joints), rad.
            position: readings of the encoders, shape as `wanted`, rad.
            speed: their speeds, shape as `wanted`, rad/s.
        """
        if k and (k - self._start) % self._stride:
            self._sent[k] = self._sent[k - 1]
        else:
            told = self._drives.command(wanted, position, speed)
            self._sent[k] = limited(told, self._low, self._high)
        looks = np.floor((k - self._start) / self._every + _ROUNDING)
        seen = np.ceil(looks * self._every - _ROUNDING) + self._start
        arrived: Array = read(self._sent[: k + 1], (seen - self._late)[None])[0]
        return arrived

    def rows(self, count: int) -> Array:
        """What was sent at each row, shape (count, n_sims, n_joints)."""
        return self._sent[self._start :: self._stride][:count]
