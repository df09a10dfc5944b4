"""The room that an excitation may move in: when, between which targets, and how fast.

A signal draws its shape in [-1, 1]; the room lays it out between the joints' limits and slows it
down to the allowed velocity.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

FADE: Final = 1.0
"""Seconds over which a signal swells at the start and dies away at the end."""

_SHARE: Final = 0.35
"""Part of a joint's range that `room_about` takes."""
_REACH: Final = 0.5
"""How far it goes to either side where a joint has no range, rad (m for slide joints)."""


def room_about(home: ArrayLike, ranges: ArrayLike) -> tuple[Array, Array]:
    """Limits of targets around a pose, far from the ends of the joints where there are any.

    Args:
        home: the pose, shape (n_joints,), rad.
        ranges: lower and upper position, shape (n_joints, 2), rad, infinite where there is none.

    Returns:
        Lowest and highest targets, shape (n_joints,) each, rad.
    """
    middle = np.asarray(home, dtype=float)
    low, high = np.asarray(ranges, dtype=float).reshape(-1, 2).T
    width = high - low
    reach = np.where(np.isfinite(width), _SHARE / 2 * width, _REACH)
    return np.maximum(low, middle - reach), np.minimum(high, middle + reach)


class Room:
    """Sample times and the limits of every joint's target, checked.

    Attributes:
        time: sample times from the first one, shape (T,), s.
        duration: time from the first sample to the last, s.
        lower: lowest targets, shape (n_joints,), rad.
        upper: highest targets, shape (n_joints,), rad.
        half: half the room between them, shape (n_joints,), rad.
        joints: number of joints.
        max_velocity: bound of the targets' slope, scalar or shape (n_joints,), rad/s, or None.
    """

    def __init__(
        self, time: ArrayLike, lower: ArrayLike, upper: ArrayLike, max_velocity: ArrayLike | None
    ) -> None:
        """Takes the arguments of `walkerkit.tasks.excitation.Signal`; raises what it raises."""
        clock = np.asarray(time, dtype=float)
        if clock.ndim != 1 or clock.size < 2 or not np.all(np.diff(clock) > 0):
            raise ValueError(
                f"time of shape {clock.shape} must be one row of two or more increasing seconds, "
                "such as np.arange(0.0, 12.0, 0.002)"
            )
        self.lower, self.upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
        if self.lower.ndim != 1 or self.lower.size == 0 or self.lower.shape != self.upper.shape:
            raise ValueError(
                f"lower of shape {self.lower.shape} and upper of shape {self.upper.shape} must "
                "both be (n_joints,)"
            )
        room = self.upper - self.lower
        if not np.all(np.isfinite(room) & (room > 0)):
            raise ValueError(
                f"lower {self.lower} must be below upper {self.upper} for every joint, and both "
                "finite; give an unlimited joint limits of its own"
            )
        self.max_velocity: Array | None = None
        if max_velocity is not None:
            self.max_velocity = np.asarray(max_velocity, dtype=float)
            if self.max_velocity.shape not in ((), room.shape) or not np.all(self.max_velocity > 0):
                raise ValueError(
                    f"max_velocity is {max_velocity}; it must be positive, one number or one for "
                    f"each of the {room.size} joints, or None for no bound"
                )
        self.time = clock - clock[0]
        self.duration = float(self.time[-1])
        self.half = room / 2
        self.joints = room.size

    def phases(self, rng: np.random.Generator) -> Array:
        """One phase for each joint, evenly spread from a random start, in cycles, shape (n,)."""
        spread: Array = rng.permutation(self.joints) / self.joints + rng.uniform()
        return spread

    def envelope(self) -> Array:
        """Rises from 0 to 1 and falls back with no jump in acceleration, shape (T, 1)."""
        fade = min(FADE, self.duration / 4)
        edge = np.minimum(self.time, self.duration - self.time) / fade
        x = np.clip(edge, 0.0, 1.0)
        smooth: Array = x**3 * (10 - 15 * x + 6 * x**2)
        return smooth[:, None]

    def fill(self, shape: Array, *, ramp: bool = False) -> Array:
        """Lays a signal out in the room, no faster than allowed.

        Args:
            shape: the signal, shape (T, n_joints), in [-1, 1].
            ramp: whether to run late where the signal is too fast, rather than to shrink it.

        Returns:
            Targets, shape (T, n_joints), rad.
        """
        moved = self.half * shape
        if self.max_velocity is not None:
            moved = self._follow(moved) if ramp else self._shrink(moved, self.max_velocity)
        # Rounding may leave the room by its last digit.
        targets: Array = np.clip((self.lower + self.upper) / 2 + moved, self.lower, self.upper)
        return targets

    def _shrink(self, moved: Array, limit: Array) -> Array:
        peak = np.max(np.abs(np.diff(moved, axis=0)) / np.diff(self.time)[:, None], axis=0)
        shrunk: Array = moved / np.maximum(1.0, peak / limit)
        return shrunk

    def _follow(self, moved: Array) -> Array:
        reach = self.max_velocity * np.diff(self.time)[:, None] * np.ones(self.joints)
        followed = moved.copy()
        for k, most in enumerate(reach):
            followed[k + 1] = followed[k] + np.clip(moved[k + 1] - followed[k], -most, most)
        return followed
