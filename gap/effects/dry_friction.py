"""MuJoCo's dry friction, made as dry as it goes.

`frictionloss` is a regularised constraint. With its default time constant of 20 ms the friction
lags behind a reversal and a loaded joint creeps; the shortest that is stable (twice the timestep)
and an impedance near one come closest to dry friction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.simulation.trials import Trials

_IMPEDANCE = (0.99, 0.99, 0.001, 0.5, 2.0)


def stiffen_dry_friction(trials: Trials, joint: str, rows: NDArray[np.bool_]) -> None:
    """Makes the dry friction of a joint stiff where the model has none of its own.

    Args:
        trials: variants, written to.
        joint: name of the joint.
        rows: (n,) the variants that add dry friction.
    """
    model, dof = trials.robot.model, trials.robot.joints[joint].dof
    if model.dof_frictionloss[dof] == 0:
        trials.field("dof_solref")[rows, dof] = (2 * model.opt.timestep, 1.0)
        trials.field("dof_solimp")[rows, dof] = np.array(_IMPEDANCE)
