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
        dt: the step of the simulation [s].
    """

    def __init__(
        self,
        laws: Sequence[tuple[type[DrivetrainLaw], Parameters]],
        shape: tuple[int, ...],
        dt: float,
    ):
        self._shape = shape
        self._dt = dt
        self._laws = [(law, law.prepared(p, dt)) for law, p in laws]
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
        for (law, p), state in zip(self._laws, self._states, strict=True):
            depth = law.depth(p, self._dt) if law.state else None
            for name in law.state:
                if rows is None or name not in state:
                    shape = self._shape if depth is None else (*self._shape, depth)
                    state[name] = np.full(shape, np.nan)
                else:
                    state[name][rows] = np.nan

    def remember(self, law: type[DrivetrainLaw], state: State) -> None:
        """Tells a law what it remembers; see its `state`."""
        for (other, _), own in zip(self._laws, self._states, strict=True):
            if other is law:
                own.update(state)

    def run(self, stage: Stage, step: Step) -> None:
        """Lets the laws of a stage change the step."""
        for law, p, state in self._of_stage[stage]:
            law.apply(step, p, state)

    def has(self, stage: Stage) -> bool:
        """There is a law of this stage."""
        return bool(self._of_stage[stage])

    @property
    def reads_held(self) -> bool:
        """A law reads what the constraints did in the last step."""
        return any(law.reads_held for law, _ in self._laws)

    @property
    def reads_play(self) -> bool:
        """A law reads what gives way between joints and links."""
        return any(law.reads_play for law, _ in self._laws)
