"""Action terms: how a policy's action becomes the command of a walker's actuators.

    JointPositionAction(joint_names_expr=(".*_hip", ".*_knee"), scale=0.5, clip=(-1.0, 1.0))

asks for the default pose plus half a radian per unit of action, between -1 and 1 rad. Without
`clip` nothing bounds the target: policies that others trained ask for more than one unit. Only
`FullRangeAction`, the default, takes actions in [-1, 1] and clips what lies outside. An action that
is not finite is refused. Several terms share an action, one after the other; joints that no term
moves are asked for their default pose.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import groupby
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators import ActuatorCmd
from walkerkit.actuators.config_fields import names, number
from walkerkit.actuators.messages import listed
from walkerkit.actuators.selection import Numbers, narrowed, per_joint, select
from walkerkit.walkers.terms import ActionTerm, BoundTerm, Joints, checked_action

FloatArray = NDArray[np.float64]

__all__ = [
    "ActionTerm",
    "BoundTerm",
    "Commander",
    "FullRangeAction",
    "JointEffortAction",
    "JointPositionAction",
    "JointVelocityAction",
    "Joints",
    "RelativeJointPositionAction",
    "checked_action",
]

_DEFAULT_SPEED = 10.0  # rad/s or m/s, where no actuator states a limit
_DEFAULT_EFFORT = 1.0  # N·m or N


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
        clip: (low, high) bounds of offset + scale · action, or {expression: (low, high)}; None for
            none.
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

    def _bound(self, joints: Joints) -> BoundTerm:
        """The term for these joints, without what is special of a kind."""
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
        return BoundTerm(
            names=moved,
            target=self.target,
            columns=columns,
            scale=per_joint(self.scale, moved, field="scale"),
            offset=per_joint(self.offset, moved, field="offset") + self._start(joints)[columns],
            low=low,
            high=high,
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
        encoder_bias: how much more than its position the encoder of a joint reads [rad; m], or
            {expression: bias}. The target is what the encoder is to read, so the joint is asked for
            that much less.
    """

    target: ClassVar[str] = "position_target"
    use_default_offset: bool = True
    encoder_bias: Numbers = number(default=0.0)

    def bind(self, joints: Joints) -> Sequence[BoundTerm]:
        """As in `ActionTerm`."""
        term = self._bound(joints)
        bias = per_joint(self.encoder_bias, term.names, field="encoder_bias")
        return (replace(term, bias=bias) if bias.any() else term,)

    def _start(self, joints: Joints) -> FloatArray:
        return joints.default if self.use_default_offset else np.zeros(len(joints.names))


@dataclass(frozen=True, kw_only=True)
class RelativeJointPositionAction(JointAction):
    """Sets position targets that are counted from where the joints are [rad; m].

    target = q + clip(offset + scale · action), with the position q before each physics step, as
    Isaac Lab and mjlab have it: the action says how hard the drive pulls, not where it ends.
    """

    target: ClassVar[str] = "position_target"

    def bind(self, joints: Joints) -> Sequence[BoundTerm]:
        """As in `ActionTerm`."""
        return (replace(self._bound(joints), relative=True),)

    def _start(self, joints: Joints) -> FloatArray:
        return np.zeros(len(joints.names))


@dataclass(frozen=True, kw_only=True)
class JointVelocityAction(JointAction):
    """Sets velocity targets [rad/s; m/s]."""

    target: ClassVar[str] = "velocity_target"

    def bind(self, joints: Joints) -> Sequence[BoundTerm]:
        """As in `ActionTerm`."""
        return (self._bound(joints),)

    def _start(self, joints: Joints) -> FloatArray:
        return np.zeros(len(joints.names))


@dataclass(frozen=True, kw_only=True)
class JointEffortAction(JointAction):
    """Sets effort targets [N·m; N]."""

    target: ClassVar[str] = "effort_target"

    def bind(self, joints: Joints) -> Sequence[BoundTerm]:
        """As in `ActionTerm`."""
        return (self._bound(joints),)

    def _start(self, joints: Joints) -> FloatArray:
        return np.zeros(len(joints.names))


class FullRangeAction(ActionTerm):
    """One number per joint, in kinematic order, that spans all that the joint can do; the default.

    A position target where the actuator follows one, else a velocity target, else an effort target:
    from the least to the greatest that file and config let it be asked for (`Actuator.reach`). What
    is outside is clipped. Where a builtin motor or velocity drive states nothing, the actuator of
    the file counts that it replaced. Where nothing is stated at all, the span is ±π about the
    default pose, ±10 rad/s or ±1 N·m. Joints with several controls have numbers for the others
    behind all of these.
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
            terms.append(
                BoundTerm(
                    names=tuple(joints.names[i] for i in chosen),
                    target=target,
                    columns=at,
                    scale=(high - low) / 2,
                    offset=(high + low) / 2,
                    low=low,
                    high=high,
                    normalised=True,
                )
            )
        return terms

    @staticmethod
    def _span(joints: Joints, target: str, at: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        low, high = joints.reach[target][at].T
        middle: FloatArray | float = 0.0
        half = _DEFAULT_SPEED if target == "velocity_target" else _DEFAULT_EFFORT
        if target == "position_target":
            middle, half = joints.default[at], np.pi
        limited = np.isfinite(low) & np.isfinite(high)
        return np.where(limited, low, middle - half), np.where(limited, high, middle + half)


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
        relative: some targets are counted from where the joints are.

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
        bound = [(term, one) for term in terms for one in term.bind(joints)]
        self._terms = [one for _, one in bound]
        self.names = tuple(name for term in self._terms for name in term.names)
        self.relative = any(term.relative for term in self._terms)
        for i, (term, one) in enumerate(bound):
            for other, before in bound[:i]:
                twice = set(before.names) & set(one.names)
                if twice and before.target == one.target:
                    raise _set_twice(other, before, term, one, twice)
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

    def command(
        self,
        action: ArrayLike,
        batch_shape: tuple[int, ...] = (),
        positions: FloatArray | None = None,
    ) -> ActuatorCmd:
        """The command that an action asks for.

        Args:
            action: (size,), or (n_sims, size).
            batch_shape: (n_sims,) for actions of a batch.
            positions: of all joints, where a term is relative, (..., n_joints) [rad; m].

        Raises:
            ValueError: it has another shape, is not finite, or asks for what is not.
        """
        return self.asked(checked_action(action, self.names, batch_shape), batch_shape, positions)

    def asked(
        self,
        values: FloatArray,
        batch_shape: tuple[int, ...] = (),
        positions: FloatArray | None = None,
    ) -> ActuatorCmd:
        """As `command`, of an action that `checked_action` has made, which is left as it is."""
        targets = self._at_rest(batch_shape)
        first = 0
        for term in self._terms:
            last = first + len(term.names)
            # A vector is indexed by the columns alone, which takes a ninth of the time.
            at = (..., term.columns) if batch_shape else term.columns
            present = positions[at] if term.relative and positions is not None else None
            targets[term.target][at] = term.targets(values[..., first:last], present)
            first = last
        return ActuatorCmd.of_finite(**targets)

    def _at_rest(self, batch_shape: tuple[int, ...]) -> dict[str, FloatArray]:
        if not batch_shape:
            return {name: rest.copy() for name, rest in self._rest.items()}
        return {name: np.tile(rest, (*batch_shape, 1)) for name, rest in self._rest.items()}

    def action(self, cmd: ActuatorCmd, positions: FloatArray | None = None) -> FloatArray:
        """The action that asks for a command, the inverse of `command`.

        Args:
            cmd: targets of all joints; those it leaves out are those of `rest`.
            positions: as in `command`, (n_joints,).

        Returns:
            (size,), not clipped: what is beyond ±1 is more than a `FullRangeAction` can ask for.
        """
        parts = []
        for term in self._terms:
            targets = getattr(cmd, term.target)
            wanted = self._rest[term.target] if targets is None else np.asarray(targets)
            present = None if positions is None else positions[term.columns]
            parts.append(term.action(wanted[term.columns], present))
        return np.concatenate([np.zeros(0), *parts])


def _set_twice(
    term: ActionTerm, one: BoundTerm, other: ActionTerm, two: BoundTerm, twice: set[str]
) -> ValueError:
    """The error for two terms that set the same target of joints."""
    wider, bound = (term, one) if len(one.names) >= len(two.names) else (other, two)
    expressions = getattr(wider, "joint_names_expr", (".*",))
    rest = narrowed(expressions, bound.names, twice)
    remedy = (
        f"make the {type(wider).__name__} narrower, joint_names_expr={rest}"
        if rest and hasattr(wider, "joint_names_expr")
        else "leave one of the two out"
    )
    return ValueError(f"two action terms set the {one.target} of {listed(sorted(twice))}: {remedy}")
