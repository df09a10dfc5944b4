"""Actuators of ours on walkers that others wrote.

    walker = with_actuators(ant.Ant(), DcMotorActuatorCfg(joint_names_expr=(".*",), ...))

The walker stays what it was, in class, observables and pose; how its actions become effort is new.
What dm_control's class works out for its own actuators, such as `cmu_pose_to_actuation`, does not
hold for ours: `action_for` takes its place.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
from dm_control import composer
from dm_control.composer.observation import observable
from dm_control.locomotion.walkers import base

from walkerkit.actuators import ActuatorCfg
from walkerkit.actuators.drivetrain import DrivetrainLaw
from walkerkit.actuators.messages import closest
from walkerkit.actuators.targeted import candidates
from walkerkit.walkers.actions import ActionTerm
from walkerkit.walkers.actuated import Actuated
from walkerkit.walkers.drivetrain import Existing, Randomization

WalkerT = TypeVar("WalkerT", bound=base.Walker)


def with_actuators(
    walker: WalkerT,
    actuators: ActuatorCfg | Iterable[ActuatorCfg],
    *,
    action: ActionTerm | Sequence[ActionTerm] | None = None,
    existing: Existing = "replace",
    default: dict[str, float] | None = None,
    laws: Sequence[DrivetrainLaw] = (),
    randomizations: Sequence[Randomization] = (),
) -> WalkerT:
    """Puts actuators on a walker that is not attached to an arena yet.

    Args:
        walker: any dm_control walker; it is changed, and belongs to a subclass of its class then.
        actuators: configs of its actuators.
        action: action terms; by default an action in [-1, 1] spans what each joint can do.
        existing: `replace` the walker's own actuators of these joints, or `keep` them, which makes
            joints that have one an error. Those of other joints stay, and take the last numbers of
            an action.
        default: {joint: position} of the default pose [rad; m]; by default the walker's upright
            pose, else the reference pose.
        laws: drivetrain laws of its joints (`walkerkit.actuators.drivetrain`).
        randomizations: what changes the actuators at the start of each episode.

    Returns:
        The same walker.

    Raises:
        TypeError: it is no walker, or has actuators of ours already.
        ValueError: it is attached already, `default` has an unknown joint, or as
            `ActuatorGroup.edit_mjcf`.
    """
    _check_can_be_refitted(walker)
    root = walker.mjcf_model
    if root.compiler.angle is None:
        # Some leave to the arena what unit their angles have: all of dm_control's say radian.
        root.compiler.angle = "radian"
    before, cls = tuple(walker.observable_joints), type(walker)
    pose = _upright(walker) if default is None else _checked(root, default)
    walker.__class__ = _refitted(cls)  # type: ignore[arg-type]
    try:
        walker.put_on(
            root,
            actuators,
            action=action,
            default=pose,
            existing=existing,
            laws=laws,
            randomizations=randomizations,
        )
    except Exception:
        walker.__class__ = cls
        raise
    _forget_cached(walker)
    walker.observe(before)
    return walker


def _check_can_be_refitted(walker: Any) -> None:
    """Raises TypeError or ValueError where a walker can take no actuators of ours."""
    if not isinstance(walker, base.Walker):
        raise TypeError(f"walker should be a dm_control walker, got {walker!r}")
    if isinstance(walker, Actuated):
        raise TypeError(
            f"{type(walker).__name__} has actuators of ours already: give them when it is made"
        )
    attached_to = walker.mjcf_model.parent_model
    if attached_to is not None:
        raise ValueError(
            f"{type(walker).__name__} is attached to {attached_to.model!r} already: put "
            "actuators on it first, then attach it"
        )


class _Refitted(Actuated):
    """A walker that others wrote."""

    def observe(self, before: Sequence[Any]) -> None:
        """Observes the joints that it did before, then the others that it drives by now.

        Args:
            before: the joints that it did.
        """
        driven = (getattr(element, "joint", None) for element in self.actuator_group.elements)
        more = (joint for joint in driven if joint is not None and joint not in before)
        self._observed = (*before, *more)
        for item in self.observables.as_dict(fully_qualified=False).values():  # type: ignore[attr-defined]
            observed = getattr(item, "_mjcf_element", None)
            if not isinstance(item, observable.MJCFFeature) or not isinstance(
                observed, list | tuple
            ):
                continue
            left = tuple(element for element in observed if not element.is_removed)
            if len(left) < len(observed) and observed[0].spec.namespace == "actuator":
                item._mjcf_element = self.actuators
            else:
                item._mjcf_element = self._observed if left == tuple(before) else left

    @property
    def observable_joints(self) -> tuple[Any, ...]:
        """The joints that it observes, in the order in which it did before."""
        return self._observed


@functools.cache
def _refitted(cls: Any) -> type[Any]:
    return type(f"Actuated{cls.__name__}", (_Refitted, cls), {"__module__": __name__})


def _checked(root: Any, default: dict[str, float]) -> dict[str, float]:
    names = list(candidates(root, "joint"))
    for name, position in default.items():
        if name not in names:
            raise ValueError(
                f"default: there is no hinge or slide joint {name!r}{closest(name, names)}"
            )
        if not np.isfinite(position):
            raise ValueError(f"default[{name!r}] should be finite, got {position!r}")
    return default


def _forget_cached(walker: Any) -> None:
    """Drops what the walker worked out of its actuators while it was built."""
    for cls in type(walker).__mro__:
        for name, member in vars(cls).items():
            if isinstance(member, composer.cached_property):
                walker.__dict__.pop(name, None)


def _upright(walker: Any) -> dict[str, float]:
    """Positions of the joints in the walker's upright pose, where it has one."""
    pose = getattr(walker, "upright_pose", None)
    if pose is None or pose.qpos is None:
        return {}
    root = walker.mjcf_model
    joints = root.find_all("joint")
    if len(pose.qpos) != len(joints):
        return {}
    return {
        joint.prefixed_identifier(prefix_root=root.namescope): float(position)
        for joint, position in zip(joints, pose.qpos, strict=True)
    }
