"""What an actuator is asked for.

    cmd = ActuatorCmd(position_target=np.zeros(12), effort_target=gravity)
    controls = actuator.compute(cmd)

A command is checked once, when it is made, and cannot change afterwards: one command serves every
physics step until the next one.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ActuatorCmd:
    """Targets of n joints, of one robot `(n_joints,)` or of a batch `(n_sims, n_joints)`.

    Attributes:
        position_target: [rad; m on slide joints], or None where no position is asked for.
        velocity_target: [rad/s; m/s], or None.
        effort_target: [N·m; N], or None; beside another target it is feed-forward effort.

    Raises:
        TypeError: a target is not made of numbers.
        ValueError: a target is a scalar or not finite, or two targets differ in shape.
    """

    position_target: FloatArray | None = None
    velocity_target: FloatArray | None = None
    effort_target: FloatArray | None = None

    def __post_init__(self) -> None:
        shape: tuple[int, ...] | None = None
        for name in TARGETS:
            value = getattr(self, name)
            if value is None:
                continue
            array = _checked(name, value)
            if shape is None:
                shape, first = array.shape, name
            elif array.shape != shape:
                raise ValueError(
                    f"{name} has shape {array.shape}, {first} has {shape}: give every target one "
                    "number per joint, in the same order"
                )
            object.__setattr__(self, name, array)

    @property
    def shape(self) -> tuple[int, ...] | None:
        """Shape of the targets; None where nothing is asked for."""
        for name in TARGETS:
            value = getattr(self, name)
            if value is not None:
                return value.shape  # type: ignore[no-any-return]
        return None

    def select(self, joints: Any) -> ActuatorCmd:
        """The command of some of the joints.

        Args:
            joints: what indexes the last axis.
        """
        targets = (self.position_target, self.velocity_target, self.effort_target)
        return ActuatorCmd.of_finite(
            # A vector is indexed by them alone, which takes a fraction of the time.
            *(
                target if target is None else target[joints if target.ndim == 1 else (..., joints)]
                for target in targets
            )
        )

    @classmethod
    def of_finite(
        cls,
        position_target: FloatArray | None = None,
        velocity_target: FloatArray | None = None,
        effort_target: FloatArray | None = None,
    ) -> ActuatorCmd:
        """A command of targets that are known to be right, which are its own from now on.

        Args:
            position_target: finite, and of the others' shape, as the next two.
            velocity_target: or None.
            effort_target: or None.
        """
        cmd = object.__new__(cls)
        for name, target in zip(
            TARGETS, (position_target, velocity_target, effort_target), strict=True
        ):
            if target is not None:
                target.flags.writeable = False
            object.__setattr__(cmd, name, target)
        return cmd


TARGETS = tuple(field.name for field in fields(ActuatorCmd))


def _checked(name: str, value: ArrayLike) -> FloatArray:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(
            f"{name} should be an array of numbers, one per joint, got {value!r}"
        ) from None
    if array.ndim == 0:
        raise ValueError(f"{name} should be an array with one number per joint, got {value!r}")
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        index = where[0] if len(where) == 1 else where
        raise ValueError(
            f"{name}[{index}] is {array[where]}: a target must be finite; check the policy or the "
            "log that it came from"
        )
    array.flags.writeable = False
    return array
