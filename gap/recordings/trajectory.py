"""Trajectories of ROS 2 as targets over time, as its joint_trajectory_controller takes them.

    told = targets_of(message)                  # joint → kind of target → Course
    course = told["knee"]["position"].begun(0.1)
    course.at(np.array([0.0, 0.5]))             # targets 0 and 0.5 s after it was given

From point to point goes the polynomial that the points determine: a line where they have positions
only, a cubic with velocities, a quintic with accelerations. The last point holds. A first point
that is for later is approached from where the target was.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

FloatArray = NDArray[np.float64]
TargetKind = Literal["position", "velocity", "effort"]

_MOTION = ("positions", "velocities", "accelerations")


@dataclass(frozen=True, kw_only=True)
class Course:
    """One target of a joint from when it was given.

    Attributes:
        time: of its points, since then [s]; increasing.
        points: at each of them a value and as many of its derivatives as are known.
        order: 0 where the values are the target, 1 where their slope is.
    """

    time: tuple[float, ...]
    points: tuple[tuple[float, ...], ...]
    order: int = 0

    @property
    def known(self) -> bool:
        """Whether all of its values are numbers."""
        return bool(np.isfinite([value for point in self.points for value in point]).all())

    @property
    def moves(self) -> bool:
        """Whether there is more to it than one value for at once."""
        return len(self.time) > 1 or self.time[0] > 0

    def begun(self, value: float) -> Course:
        """The same from a value on, unless its first point is for at once or the value is NaN."""
        if self.time[0] <= 0 or np.isnan(value):
            return self
        return replace(self, time=(0.0, *self.time), points=((value,), *self.points))

    def at(self, elapsed: FloatArray) -> FloatArray:
        """(n,) the target at (n,) times since it was given [s]."""
        if len(self.time) == 1:
            return np.full(elapsed.shape, self.points[0][self.order])
        curve = BPoly.from_derivatives(self.time, self.points)
        target: FloatArray = curve(np.clip(elapsed, self.time[0], self.time[-1]), nu=self.order)
        return target


def targets_of(message: Any) -> dict[str, dict[TargetKind, Course]]:
    """Joint to kind of target to its course, of a `trajectory_msgs/JointTrajectory`.

    Raises:
        ValueError: the times of its points do not increase.
    """
    starts = (point.time_from_start for point in message.points)
    time = tuple(start.sec + 1e-9 * start.nanosec for start in starts)
    if any(after <= before for before, after in itertools.pairwise(time)):
        raise ValueError(f"points at {', '.join(f'{t:g}' for t in time)} s from its start")
    return {
        joint: dict(_targets(time, message.points, k))
        for k, joint in enumerate(message.joint_names if time else ())
    }


def _targets(
    time: tuple[float, ...], points: Sequence[Any], joint: int
) -> Iterator[tuple[TargetKind, Course]]:
    def course(*fields: str, order: int = 0) -> Course | None:
        """Of fields that all points have."""
        given = [[getattr(point, field) for field in fields] for point in points]
        if any(joint >= len(values) for point in given for values in point):
            return None
        return Course(
            time=time,
            points=tuple(tuple(float(values[joint]) for values in point) for point in given),
            order=order,
        )

    smooth = [course(*_MOTION[:n]) for n in (3, 2, 1)]
    position = next((one for one in smooth if one is not None and one.known), smooth[-1])
    if position is not None:
        yield "position", position
    velocity = course("velocities")
    if velocity is not None:
        if position is not None and position.known and len(position.points[0]) > 1:
            velocity = replace(position, order=1)
        yield "velocity", velocity
    effort = course("effort")
    if effort is not None:
        yield "effort", effort
