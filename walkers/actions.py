"""Action terms: how a policy's normalised action becomes the command of a walker's actuators.

    JointPositionAction(joint_names_expr=(".*_hip", ".*_knee"), scale=0.5)

asks for the default pose plus half a radian at most. An action is in [-1, 1]; what lies outside is
clipped to it, and one that is not finite is refused. Several terms share an action, one after the
other; joints that no term moves are asked for their default pose.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import groupby
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators import ActuatorCmd
from walkerkit.actuators.fields import names, number
from walkerkit.actuators.selection import Numbers, per_joint, select

FloatArray = NDArray[np.float64]

_DEFAULT_SPEED = 10.0  # rad/s or m/s, where no actuator states a limit
_DEFAULT_EFFORT = 1.0  # N·m or N


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
        spans: target to the range that reaches the joints' controls, (n_joints, 2), infinite where
            none is known.
    """

    names: tuple[str, ...]
    default: FloatArray
    ranges: FloatArray
    takes: tuple[frozenset[str], ...]
    speeds: FloatArray
    efforts: FloatArray
    apart: tuple[frozenset[str], ...] = ()
    spans: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundTerm:
    """A term made ready for the joints of one walker: target = offset + scale · action.

    Attributes:
        names: what each number of the action moves.
        target: which target it sets.
        columns: of these joints in the command.
        scale: target per unit of action.
        offset: target at an action of zero.
        low: least target.
        high: greatest target.
    """

    names: tuple[str, ...]
    target: str
    columns: NDArray[np.intp]
    scale: FloatArray
    offset: FloatArray
    low: FloatArray
    high: FloatArray

    def targets(self, action: FloatArray) -> FloatArray:
        """The targets that an action in [-1, 1] asks for, (n,)."""
        targets = self.scale * action
        targets += self.offset
        # A fraction of what np.clip takes, which counts at every control step.
        np.maximum(targets, self.low, out=targets)
        return np.minimum(targets, self.high, out=targets)

    def action(self, targets: FloatArray) -> FloatArray:
        """The action that asks for these targets, (n,); zero where none makes a difference."""
        moves = self.scale != 0
        return np.where(moves, (targets - self.offset) / np.where(moves, self.scale, 1.0), 0.0)


class ActionTerm(abc.ABC):
    """A part of the action that sets one kind of target."""

    @abc.abstractmethod
    def bind(self, joints: Joints) -> Sequence[BoundTerm]:
        """Makes it ready for a walker.

        Raises:
            ValueError: an expression matches none of the joints, or a joint's actuator cannot
                follow such a target.
        """


def _clip(name: str, value: Any) -> Any:
    if value is None:
        return None
    pairs = value if isinstance(value, Mapping) else {"": value}
    for key, pair in pairs.items():
        where = f"{name}[{key!r}]" if key else name
        try:
            low, high = (float(one) for one in pair)
        except (TypeError, ValueError):
            raise TypeError(f"{where} should be (low, high), got {pair!r}") from None
        if not low < high:
            raise ValueError(f"{where} should rise from low to high, got {pair!r}")
    return dict(value) if isinstance(value, Mapping) else tuple(value)


@dataclass(frozen=True, kw_only=True)
class JointAction(ActionTerm):
    """target = clip(offset + scale · action), one number of the action per joint.

    Attributes:
        joint_names_expr: full-match regular expressions of the joints that it moves.
        scale: target per unit of action [rad, rad/s or N·m; m, m/s or N], or {expression: number}.
        offset: target at an action of zero, or {expression: number}.
        clip: (low, high) bounds of the target, or {expression: (low, high)}; None for none.
    """

    target: ClassVar[str]
    joint_names_expr: tuple[str, ...] = names()
    scale: Numbers = number(default=1.0)
    offset: Numbers = number(default=0.0)
    clip: tuple[float, float] | Mapping[str, tuple[float, float]] | None = field(
        default=None, metadata={"check": _clip}
    )

    def __post_init__(self) -> None:
        for item in fields(self):
            if "check" in item.metadata:
                value = item.metadata["check"](item.name, getattr(self, item.name))
                object.__setattr__(self, item.name, value)

    def bind(self, joints: Joints) -> Sequence[BoundTerm]:
        """As in `ActionTerm`."""
        chosen = select(self.joint_names_expr, joints.names)
        moved = tuple(joints.names[i] for i in chosen)
        for i, name in zip(chosen, moved, strict=True):
            if self.target not in joints.takes[i]:
                raise ValueError(
                    f"{type(self).__name__}: the actuator of {name!r} cannot follow a "
                    f"{self.target}, it takes {sorted(joints.takes[i])}; leave the joint out or "
                    "use another action term"
                )
        columns = np.array(chosen, dtype=np.intp)
        low, high = self._bounds(moved)
        return (
            BoundTerm(
                names=moved,
                target=self.target,
                columns=columns,
                scale=per_joint(self.scale, moved, field="scale"),
                offset=per_joint(self.offset, moved, field="offset") + self._start(joints)[columns],
                low=low,
                high=high,
            ),
        )

    def _bounds(self, moved: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        low, high = np.full(len(moved), -np.inf), np.full(len(moved), np.inf)
        pairs = self.clip if isinstance(self.clip, Mapping) else {".*": self.clip}
        for expression, pair in pairs.items():
            if pair is not None:
                at = list(select((expression,), moved, field="clip"))
                low[at], high[at] = pair
        return low, high

    @abc.abstractmethod
    def _start(self, joints: Joints) -> FloatArray:
        """What the offset is counted from, (n_joints,)."""


@dataclass(frozen=True, kw_only=True)
class JointPositionAction(JointAction):
    """Sets position targets [rad; m].

    Attributes:
        use_default_offset: count the offset from the default pose, rather than from zero.
    """

    target: ClassVar[str] = "position_target"
    use_default_offset: bool = True

    def _start(self, joints: Joints) -> FloatArray:
        return joints.default if self.use_default_offset else np.zeros(len(joints.names))


@dataclass(frozen=True, kw_only=True)
class JointVelocityAction(JointAction):
    """Sets velocity targets [rad/s; m/s]."""

    target: ClassVar[str] = "velocity_target"

    def _start(self, joints: Joints) -> FloatArray:
        return np.zeros(len(joints.names))


@dataclass(frozen=True, kw_only=True)
class JointEffortAction(JointAction):
    """Sets effort targets [N·m; N]."""

    target: ClassVar[str] = "effort_target"

    def _start(self, joints: Joints) -> FloatArray:
        return np.zeros(len(joints.names))


class FullRangeAction(ActionTerm):
    """One number per joint, in kinematic order, that spans all that the joint can do; the default.

    A position target where the actuator follows one, from end to end of the joint's range (±π about
    the default pose where it has none); else a velocity target within ± its no-load speed (10 rad/s
    where none is stated); else an effort target within ± its limit (1 N·m where none is stated).
    Joints with several controls have numbers for the others behind all of these.
    """

    def bind(self, joints: Joints) -> Sequence[BoundTerm]:
        """As in `ActionTerm`."""
        terms = []
        widest = [_widest(takes) for takes in joints.takes]
        runs = [(t, list(run)) for t, run in groupby(range(len(widest)), widest.__getitem__)]
        for target in ("velocity_target", "effort_target"):
            more = [i for i, apart in enumerate(joints.apart) if target in apart]
            runs += [(target, more)] if more else []
        for target, chosen in runs:
            at = np.array(chosen, dtype=np.intp)
            low, high = self._span(joints, target, at)
            known = joints.spans.get(target, np.full((len(joints.names), 2), np.inf))[at]
            limited = np.isfinite(known).all(axis=1)
            low, high = (np.where(limited, k, e) for k, e in zip(known.T, (low, high), strict=True))
            terms.append(
                BoundTerm(
                    names=tuple(joints.names[i] for i in chosen),
                    target=target,
                    columns=at,
                    scale=(high - low) / 2,
                    offset=(high + low) / 2,
                    low=low,
                    high=high,
                )
            )
        return terms

    @staticmethod
    def _span(joints: Joints, target: str, at: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        if target == "position_target":
            limited = np.isfinite(joints.ranges[at]).all(axis=1)
            low = np.where(limited, joints.ranges[at, 0], joints.default[at] - np.pi)
            high = np.where(limited, joints.ranges[at, 1], joints.default[at] + np.pi)
            return low, high
        limit, default = (
            (joints.speeds, _DEFAULT_SPEED)
            if target == "velocity_target"
            else (joints.efforts, _DEFAULT_EFFORT)
        )
        most = np.where(np.isfinite(limit[at]), limit[at], default)
        return -most, most


def _widest(takes: frozenset[str]) -> str:
    """The target that says most of those which an actuator follows."""
    return next(t for t in ("position_target", "velocity_target", "effort_target") if t in takes)


class Commander:
    """Turns actions into commands.

    Args:
        terms: the action terms, in the order in which they share the action.
        joints: the joints that are commanded.

    Attributes:
        names: what each number of the action moves.

    Raises:
        TypeError: something is not an action term.
        ValueError: two terms set the same target of one joint.
    """

    def __init__(self, terms: Sequence[ActionTerm], joints: Joints):
        for given in terms:
            if not isinstance(given, ActionTerm):
                raise TypeError(
                    f"action should be an action term or several, got {given!r}; for instance "
                    'JointPositionAction(joint_names_expr=(".*",), scale=0.5)'
                )
        self._terms = [bound for term in terms for bound in term.bind(joints)]
        self.names = tuple(name for term in self._terms for name in term.names)
        set_by: set[tuple[str, str]] = set()
        for term in self._terms:
            for name in term.names:
                if (name, term.target) in set_by:
                    raise ValueError(
                        f"two action terms set the {term.target} of {name!r}: make the expressions "
                        "of one of them narrower"
                    )
                set_by.add((name, term.target))
        positioned = [i for i, takes in enumerate(joints.takes) if "position_target" in takes]
        self._rest: dict[str, FloatArray] = {}
        if positioned:
            self._rest["position_target"] = np.zeros(len(joints.names))
            self._rest["position_target"][positioned] = joints.default[positioned]
        for target in ("velocity_target", "effort_target"):
            needed = any(
                target in takes and "position_target" not in takes for takes in joints.takes
            )
            if needed or any(term.target == target for term in self._terms):
                self._rest[target] = np.zeros(len(joints.names))

    @property
    def size(self) -> int:
        """Numbers in an action."""
        return len(self.names)

    def rest(self, batch_shape: tuple[int, ...] = ()) -> ActuatorCmd:
        """The command to hold the default pose.

        Args:
            batch_shape: (n_sims,) for a command of a batch.
        """
        return ActuatorCmd(**self._at_rest(batch_shape))

    def command(self, action: ArrayLike, batch_shape: tuple[int, ...] = ()) -> ActuatorCmd:
        """The command that an action asks for.

        Args:
            action: (size,), or (n_sims, size), in [-1, 1]; what is outside is clipped.
            batch_shape: (n_sims,) for actions of a batch.

        Raises:
            ValueError: it has another shape, or is not finite.
        """
        return self.asked(checked_action(action, self.names, batch_shape), batch_shape)

    def asked(self, values: FloatArray, batch_shape: tuple[int, ...] = ()) -> ActuatorCmd:
        """As `command`, of an action that `checked_action` has made, which is left as it is."""
        within = np.maximum(values, -1.0)
        np.minimum(within, 1.0, out=within)
        targets = self._at_rest(batch_shape)
        first = 0
        for term in self._terms:
            last = first + len(term.names)
            # A vector is indexed by the columns alone, which takes a ninth of the time.
            at = (..., term.columns) if batch_shape else term.columns
            targets[term.target][at] = term.targets(within[..., first:last])
            first = last
        return ActuatorCmd.of_finite(**targets)

    def _at_rest(self, batch_shape: tuple[int, ...]) -> dict[str, FloatArray]:
        if not batch_shape:
            return {name: rest.copy() for name, rest in self._rest.items()}
        return {name: np.tile(rest, (*batch_shape, 1)) for name, rest in self._rest.items()}

    def action(self, cmd: ActuatorCmd) -> FloatArray:
        """The action that asks for a command, the inverse of `command`.

        Args:
            cmd: targets of all joints; those it leaves out are those of `rest`.

        Returns:
            (size,), not clipped: what is beyond ±1 is more than the terms can ask for.
        """
        parts = []
        for term in self._terms:
            targets = getattr(cmd, term.target)
            wanted = self._rest[term.target] if targets is None else np.asarray(targets)
            parts.append(term.action(wanted[term.columns]))
        return np.concatenate([np.zeros(0), *parts])


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
