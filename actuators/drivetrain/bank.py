"""Several drivetrain laws at work on the same joints, each with its parameters and its state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain.drivetrain_law import (
    DrivetrainLaw,
    Parameters,
    Stage,
    State,
    Step,
)
from walkerkit.actuators.drivetrain.registry import in_order

FloatArray = NDArray[np.float64]

_FEW = 0.75  # of the simulations; a law of more runs in all
_REPLACED = (  # by some laws
    *("target", "effort", "friction", "target_ahead", "effort_ahead"),
    "supply",
)


class LawBank:
    """Laws that act within their stage as `in_order` has them, whatever order they come in.

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
        self._laws: list[_AtWork] = []
        order = in_order(law for law, _ in laws)
        for law, p in sorted(laws, key=lambda of: order.index(of[0])):
            sims = _acting(law, p) if sparse else None
            own = p if sims is None else {name: values[sims] for name, values in p.items()}
            part = None if sims is None else _Part(sims)
            self._laws.append(_AtWork(law=law, p=law.prepared(own, dt), state={}, part=part))
        self._of_stage: dict[Stage, list[_AtWork]] = {
            stage: [one for one in self._laws if one.law.stage == stage]
            for stage in ("controller", "drive", "joint")
        }
        self.reset(None)

    def reset(self, rows: NDArray[np.intp] | None) -> None:
        """Forgets the past of all simulations, or of some rows."""
        for one in self._laws:
            law, state = one.law, one.state
            depth = law.depth(one.p, self._dt) if law.state else None
            joints, own = self._shape, rows
            if one.part is not None:
                sims = one.part.sims
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
        for one in self._laws:
            if one.law is law:
                one.state.update(
                    state
                    if one.part is None
                    else {name: values[one.part.sims].copy() for name, values in state.items()}
                )

    def run(self, stage: Stage, step: Step) -> None:
        """Lets the laws of a stage change the step."""
        for one in self._of_stage[stage]:
            if one.part is None:
                one.law.apply(step, one.p, one.state)
            else:
                one.law.apply(one.part.of(step), one.p, one.state)
                one.part.hand_back(step)

    def has(self, stage: Stage) -> bool:
        """There is a law of this stage."""
        return bool(self._of_stage[stage])

    @property
    def reads_held(self) -> bool:
        """A law reads what the constraints did in the last step."""
        return any(one.law.reads_held for one in self._laws)

    @property
    def reads_play(self) -> bool:
        """A law reads what gives way between joints and links."""
        return any(one.law.reads_play for one in self._laws)


class _Part:
    """The step of some of the simulations, as views of the whole one; made anew where that is new.

    Attributes:
        sims: the simulations.
    """

    def __init__(self, sims: slice):
        self.sims = sims
        self._step = object.__new__(Step)
        self._whole: dict[str, object] = {}  # what the views are of
        self._views: list[FloatArray] = []

    def of(self, step: Step) -> Step:
        """Their part of a step."""
        own, known, n = self._step.__dict__, self._whole, len(step.q)
        for name, value in step.__dict__.items():
            if known.get(name) is not value:
                known[name] = value
                own[name] = value if name == "dt" or len(value) != n else value[self.sims]
        self._views = [own[name] for name in _REPLACED]
        return self._step

    def hand_back(self, step: Step) -> None:
        """Puts what was replaced in it since into the step."""
        own = self._step.__dict__
        for name, view in zip(_REPLACED, self._views, strict=True):
            if own[name] is not view:
                del self._whole[name]  # the next step may have the same array again
                whole = getattr(step, name).copy()
                whole[self.sims] = own[name]
                setattr(step, name, whole)


@dataclass(frozen=True, kw_only=True, eq=False)
class _AtWork:
    """A law, its parameters as prepared, what it remembers, and where it acts; None for all."""

    law: type[DrivetrainLaw]
    p: Parameters
    state: State
    part: _Part | None


def _acting(law: type[DrivetrainLaw], p: Parameters) -> slice | None:
    """The simulations in which a law does anything, and those between; None for nearly all."""
    acting = np.flatnonzero(law.acting(p).any(axis=1))
    n = len(next(iter(p.values())))
    if not acting.size or acting[-1] + 1 - acting[0] > _FEW * n:
        return None
    return slice(int(acting[0]), int(acting[-1]) + 1)
