"""Troubles of the rehearsal robot that no catalogue names: pushes, and a cable that catches.

    troubles = Troubles(drives, hidden, step=2.5e-4, n_steps=5000, seeds=[7, 0])
    effort = troubles.effort(k, q)

What pushes is random and different in every experiment; where the cable catches is a pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from walkerkit.gap.rehearsal.hardware_drive import Array, Drives
from walkerkit.gap.rehearsal.hidden import HiddenEffect

PUSHES: Final = 1.0
"""How many pushes a second a joint gets on average."""

_SHORTEST, _LONGEST = 0.1, 0.4  # s, of one push
_LEAST = 0.3  # of the largest push


class Troubles:
    """What happens to the joints of several simulations besides."""

    def __init__(
        self,
        drives: Drives,
        hidden: Sequence[HiddenEffect],
        *,
        step: float,
        n_steps: int,
        seeds: Sequence[Sequence[int]],
    ) -> None:
        """Draws the pushes.

        Args:
            drives: the drives.
            hidden: effects; those of the catalogue are left alone.
            step: time between two steps, s.
            n_steps: number of steps.
            seeds: of the pushes of each simulation.
        """
        names = drives.joints
        bumps = [e for e in hidden if e.effect == "pose_bump"]
        self._bumps = [
            (
                e.spread("effort", names),
                e.spread("pose", names),
                e.spread("reach", names, elsewhere=1.0),
            )
            for e in bumps
        ]
        pushed = [e.spread("effort", names) for e in hidden if e.effect == "random_pushes"]
        self._pushes: Array | None = None
        if pushed:
            most = np.sum(pushed, axis=0)
            self._pushes = np.stack(
                [_pushes(np.random.default_rng(s), n_steps, step, most) for s in seeds], axis=1
            )
        self.any = bool(bumps or pushed)
        """There are some."""

    def effort(self, k: int, q: Array) -> Array:
        """Effort on the joints at a step, N·m.

        Args:
            k: number of the step.
            q: positions of the joints, shape (n_sims, n_joints), rad.
        """
        effort = np.zeros_like(q) if self._pushes is None else self._pushes[k].copy()
        for most, pose, reach in self._bumps:
            effort += most * np.exp(-(((q - pose) / reach) ** 2))
        return effort


def _pushes(rng: np.random.Generator, n_steps: int, step: float, most: Array) -> Array:
    """Half sines of either sign at random times, shape (n_steps, n_joints), N·m."""
    pushes = np.zeros((n_steps, most.size))
    for joint, largest in enumerate(most):
        for _ in range(rng.poisson(PUSHES * n_steps * step)):
            length = int(rng.uniform(_SHORTEST, _LONGEST) / step)
            first = int(rng.integers(n_steps))
            size = largest * rng.uniform(_LEAST, 1.0) * rng.choice([-1.0, 1.0])
            shape = size * np.sin(np.pi * np.arange(length) / length)
            part = pushes[first : first + length, joint]
            part += shape[: len(part)]
    return pushes
