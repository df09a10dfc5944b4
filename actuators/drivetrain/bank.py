"""Several drivetrain laws at work on the same joints, each with its parameters and its state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain.law import DrivetrainLaw, Parameters, Stage, State, Step

FloatArray = NDArray[np.float64]


class LawBank:
    """Laws in the order in which they act within their stage.

    Args:
        laws: classes of the laws, each with its parameters, (n_joints,) or (n_sims, n_joints);
            joints that do not have a law have its neutral parameters.
        shape: of the joints' arrays, (n_joints,) or (n_sims, n_joints).
    """

    def __init__(
        self, laws: Sequence[tuple[type[DrivetrainLaw], Parameters]], shape: tuple[int, ...]
    ):
        self._shape = shape
        self._laws = list(laws)
        self._states: list[State] = [{} for _ in self._laws]
        self._of_stage: dict[Stage, list[tuple[type[DrivetrainLaw], Parameters, State]]] = {
            stage: [
                (law, p, state)
                for (law, p), state in zip(self._laws, self._states, strict=True)
                if law.stage == stage
            ]
            for stage in ("controller", "drive", "joint")
        }
        self.reset(None)

    def reset(self, rows: NDArray[np.intp] | None) -> None:
        """Forgets the past of all simulations, or of some rows."""
        for (law, _), state in zip(self._laws, self._states, strict=True):
            for name in law.state:
                if rows is None or name not in state:
                    state[name] = np.full(self._shape, np.nan)
                else:
                    state[name][rows] = np.nan

    def run(self, stage: Stage, step: Step) -> None:
        """Lets the laws of a stage change the step."""
        for law, p, state in self._of_stage[stage]:
            law.apply(step, p, state)

    def has(self, stage: Stage) -> bool:
        """There is a law of this stage."""
        return bool(self._of_stage[stage])
