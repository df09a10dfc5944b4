"""Several drivetrain laws at work on the same joints, each with its parameters and its state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain.law import DrivetrainLaw, Parameters, Stage, State, Step

FloatArray = NDArray[np.float64]

_FEW = 0.75  # of the simulations; a law of more runs in all
_REPLACED = ("target", "effort", "friction", "target_ahead", "effort_ahead")  # by some laws
_At = tuple[type[DrivetrainLaw], Parameters, State, slice | None]  # the simulations, None for all


class LawBank:
    """Laws in the order in which they act within their stage.

    Args:
        laws: classes of the laws, each with its parameters, (n_joints,) or (n_sims, n_joints);
            joints that do not have a law have its neutral parameters.
        shape: of the joints' arrays, (n_joints,) or (n_sims, n_joints).
        dt: the step of the simulation [s].
        sparse: many simulations, few of which have any one law, with parameters of their own that
            stay as they are: do not run a law where it does nothing.
    """

    def __init__(
        self,
        laws: Sequence[tuple[type[DrivetrainLaw], Parameters]],
        shape: tuple[int, ...],
        dt: float,
        *,
        sparse: bool = False,
    ):
        self._shape = shape
        self._dt = dt
        self._laws: list[_At] = []
        for law, p in laws:
            sims = _acting(law, p) if sparse else None
            own = p if sims is None else {name: values[sims] for name, values in p.items()}
            self._laws.append((law, law.prepared(own, dt), {}, sims))
        self._of_stage: dict[Stage, list[_At]] = {
            stage: [one for one in self._laws if one[0].stage == stage]
            for stage in ("controller", "drive", "joint")
        }
        self.reset(None)

    def reset(self, rows: NDArray[np.intp] | None) -> None:
        """Forgets the past of all simulations, or of some rows."""
        for law, p, state, sims in self._laws:
            depth = law.depth(p, self._dt) if law.state else None
            joints, own = self._shape, rows
            if sims is not None:
                joints = (sims.stop - sims.start, *self._shape[1:])
                if rows is not None:
                    own = rows[(rows >= sims.start) & (rows < sims.stop)] - sims.start
            for name in law.state:
                if own is None or name not in state:
                    shape = joints if depth is None else (*joints, depth)
                    state[name] = np.full(shape, np.nan)
                else:
                    state[name][own] = np.nan

    def remember(self, law: type[DrivetrainLaw], state: State) -> None:
        """Tells a law what it remembers of every simulation; see its `state`."""
        for other, _, own, sims in self._laws:
            if other is law:
                own.update(
                    state if sims is None else {name: v[sims].copy() for name, v in state.items()}
                )

    def run(self, stage: Stage, step: Step) -> None:
        """Lets the laws of a stage change the step."""
        for law, p, state, sims in self._of_stage[stage]:
            if sims is None:
                law.apply(step, p, state)
                continue
            part = step.of(sims)
            views = [getattr(part, name) for name in _REPLACED]
            law.apply(part, p, state)
            for name, view in zip(_REPLACED, views, strict=True):
                found = getattr(part, name)
                if found is not view:
                    whole = getattr(step, name).copy()
                    whole[sims] = found
                    setattr(step, name, whole)

    def has(self, stage: Stage) -> bool:
        """There is a law of this stage."""
        return bool(self._of_stage[stage])

    @property
    def reads_held(self) -> bool:
        """A law reads what the constraints did in the last step."""
        return any(law.reads_held for law, *_ in self._laws)

    @property
    def reads_play(self) -> bool:
        """A law reads what gives way between joints and links."""
        return any(law.reads_play for law, *_ in self._laws)


def _acting(law: type[DrivetrainLaw], p: Parameters) -> slice | None:
    """The simulations in which a law does anything, and those between; None for nearly all."""
    acting = np.flatnonzero(law.acting(p).any(axis=1))
    n = len(next(iter(p.values())))
    if not acting.size or acting[-1] + 1 - acting[0] > _FEW * n:
        return None
    return slice(int(acting[0]), int(acting[-1]) + 1)
