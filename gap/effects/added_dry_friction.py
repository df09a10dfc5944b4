"""Dry friction that effects add."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.simulation.dry_friction import IMPEDANCE, reference
from walkerkit.gap.simulation.trials import Trials


def stiffen_dry_friction(trials: Trials, joint: str, rows: NDArray[np.bool_]) -> None:
    """Makes the dry friction of a joint as dry as it goes where the model has none of its own.

    Args:
        trials: variants, written to.
        joint: name of the joint.
        rows: (n,) the variants that add dry friction.
    """
    model, dof = trials.robot.model, trials.robot.joints[joint].dof
    if model.dof_frictionloss[dof] == 0:
        trials.field("dof_solref")[rows, dof] = reference(model.opt.timestep)
        trials.field("dof_solimp")[rows, dof] = np.array(IMPEDANCE)
