"""Actuators of ours on walkers that others wrote.

    walker = with_actuators(ant.Ant(), DcMotorActuatorCfg(joint_names_expr=(".*",), ...))

The walker stays what it was, in class, observables and pose; how its actions become effort is new.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

from dm_control import composer
from dm_control.composer.observation import observable
from dm_control.locomotion.walkers import base

from walkerkit.actuators import ActuatorCfg
from walkerkit.actuators.drivetrain import DrivetrainLaw
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
        ValueError: as `ActuatorGroup.edit_mjcf`.
    """
    if not isinstance(walker, base.Walker):
        raise TypeError(f"walker should be a dm_control walker, got {walker!r}")
    if isinstance(walker, Actuated):
        raise TypeError(
            f"{type(walker).__name__} has actuators of ours already: give them when it is made"
        )
    root = walker.mjcf_model
    pose = _upright(walker) if default is None else default
    walker.__class__ = _actuated(type(walker))  # type: ignore[arg-type]
    walker.put_on(
        root,
        actuators,
        action=action,
        default=pose,
        existing=existing,
        laws=laws,
        randomizations=randomizations,
    )
    _forget_cached(walker)
    _observe_new(walker)
    return walker


@functools.cache
def _actuated(cls: Any) -> type[Any]:
    return type(f"Actuated{cls.__name__}", (Actuated, cls), {"__module__": __name__})


def _forget_cached(walker: Any) -> None:
    """Drops what the walker worked out of its actuators while it was built."""
    for cls in type(walker).__mro__:
        for name, member in vars(cls).items():
            if isinstance(member, composer.cached_property):
                walker.__dict__.pop(name, None)


def _observe_new(walker: Any) -> None:
    """Lets observables of the actuators that were removed observe those in their place."""
    for item in walker.observables.as_dict(fully_qualified=False).values():
        observed = getattr(item, "_mjcf_element", None)
        if not isinstance(item, observable.MJCFFeature) or not isinstance(observed, list | tuple):
            continue
        left = [element for element in observed if not element.is_removed]
        if len(left) < len(observed):
            item._mjcf_element = [*left, *walker.actuator_group.elements]


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
