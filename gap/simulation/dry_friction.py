"""MuJoCo's dry friction, made as dry as it goes.

`frictionloss` is a regularised constraint. With its default time constant of 20 ms the friction
lags behind a reversal and a loaded joint creeps; the shortest that is stable (twice the timestep)
and an impedance near one come closest to dry friction.
"""

from __future__ import annotations

from typing import Final

IMPEDANCE: Final = (0.99, 0.99, 0.001, 0.5, 2.0)
"""Of the constraint, `solimpfriction`."""


def reference(timestep: float) -> tuple[float, float]:
    """Of the constraint, `solreffriction`: time constant [s] and damping ratio."""
    return 2 * timestep, 1.0
