"""What action terms are made of: the joints that they know, and a term made ready for these."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Joints:
    """What action terms know of the joints that a walker actuates.

    Attributes:
        names: their names, in the order of the command.
        default: default pose [rad; m], (n_joints,).
        ranges: lower and upper position [rad; m], (n_joints, 2), infinite where there is none.
        takes: the targets that each one's actuator can follow.
        speeds: no-load speeds [rad/s; m/s], (n_joints,), infinite where none is stated.
        efforts: effort limits [N·m; N], (n_joints,), infinite where none is stated.
        apart: the targets of each that have a control of their own besides its first.
        reach: {target: least and greatest that its actuators can be asked for, (n_joints, 2)}; by
            default the three above, alike both ways.
    """

    names: tuple[str, ...]
    default: FloatArray
    ranges: FloatArray
    takes: tuple[frozenset[str], ...]
    speeds: FloatArray
    efforts: FloatArray
    apart: tuple[frozenset[str], ...] = ()
    reach: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        stated = {
            "position_target": self.ranges,
            "velocity_target": np.stack([-self.speeds, self.speeds], axis=-1),
            "effort_target": np.stack([-self.efforts, self.efforts], axis=-1),
        }
        object.__setattr__(self, "reach", {**stated, **self.reach})


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundTerm:
    """A term made ready for the joints of one walker.

    target = clip(offset + scale · action, low, high) − bias, counted from where the joint is if the
    term is relative.

    Attributes:
        names: what each number of the action moves.
        target: which target it sets.
        columns: of these joints in the command.
        scale: target per unit of action.
        offset: target at an action of zero.
        low: least target, before the bias.
        high: greatest target.
        bias: what is taken off the target in the end; None for nothing.
        normalised: actions outside [-1, 1] are clipped to it.
        relative: targets are counted from the present positions.
    """

    names: tuple[str, ...]
    target: str
    columns: NDArray[np.intp]
    scale: FloatArray
    offset: FloatArray
    low: FloatArray
    high: FloatArray
    bias: FloatArray | None = None
    normalised: bool = False
    relative: bool = False

    def targets(self, action: FloatArray, positions: FloatArray | None = None) -> FloatArray:
        """The targets that an action asks for, (..., n).

        Args:
            action: (..., n), finite.
            positions: of these joints, which a relative term needs.

        Raises:
            ValueError: the action is so large that a target is not finite.
        """
        # np.maximum and np.minimum take a fraction of np.clip, which counts at every control step.
        if self.normalised:
            action = np.minimum(np.maximum(action, -1.0), 1.0)
            targets = self.scale * action
        else:
            with np.errstate(over="ignore"):
                targets = self.scale * action
        targets += self.offset
        np.maximum(targets, self.low, out=targets)
        np.minimum(targets, self.high, out=targets)
        if not self.normalised and not np.isfinite(targets).all():
            at = tuple(int(i) for i in np.argwhere(~np.isfinite(targets))[0])
            raise ValueError(
                f"the action {action[at]:g} for {self.names[at[-1]]!r} asks for a {self.target} of "
                f"{targets[at]:g}: check the policy that it came from, or give the action term a "
                "clip"
            )
        if self.bias is not None:
            targets -= self.bias
        if self.relative:
            targets += self._present(positions)
        return targets

    def action(self, targets: FloatArray, positions: FloatArray | None = None) -> FloatArray:
        """The action that asks for these targets, (n,); zero where none makes a difference.

        Args:
            targets: (n,).
            positions: as in `targets`.
        """
        moves = self.scale != 0
        asked = targets - self.offset
        if self.bias is not None:
            asked = asked + self.bias
        if self.relative:
            asked = asked - self._present(positions)
        return np.where(moves, asked / np.where(moves, self.scale, 1.0), 0.0)

    def _present(self, positions: FloatArray | None) -> FloatArray:
        if positions is None:
            raise ValueError(
                f"the targets of {list(self.names)} are counted from where the joints are: give "
                "their positions"
            )
        return positions


class ActionTerm(abc.ABC):
    """A part of the action that sets one kind of target."""

    @abc.abstractmethod
    def bind(self, joints: Joints) -> Sequence[BoundTerm]:
        """Makes it ready for a walker.

        Raises:
            ValueError: an expression matches none of the joints, or a joint's actuator cannot
                follow such a target.
        """


def checked_action(
    action: ArrayLike, names: Sequence[str], batch_shape: tuple[int, ...] = ()
) -> FloatArray:
    """The action as a new array of floats.

    Args:
        action: one number per name, of each simulation in a batch.
        names: what each number moves.
        batch_shape: (n_sims,) for actions of a batch.

    Raises:
        ValueError: it has not one finite number per name.
    """
    values = np.array(action, dtype=np.float64)
    expected = (*batch_shape, len(names))
    if values.shape != expected:
        raise ValueError(
            f"the action has shape {values.shape}, the walker takes {expected}: one number "
            f"for each of {list(names)}"
        )
    if not np.isfinite(values).all():
        bad = tuple(int(i) for i in np.argwhere(~np.isfinite(values))[0])
        of = f" of simulation {bad[0]}" if batch_shape else ""
        raise ValueError(
            f"the action is {values[bad]} for {names[bad[-1]]!r}{of}: check the policy that it "
            "came from"
        )
    return values
