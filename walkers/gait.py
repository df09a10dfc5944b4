"""An open-loop trot: the joint targets of a quadruped as a function of time alone.

    trot = Trot(stride=0.12)
    walker.command = ActuatorCmd(position_target=trot(time))   # or walker.action_for(...)

Diagonal pairs of legs (FL with RR, FR with RL) swing in turns, half a cycle each. On the ground a
foot moves backwards at the speed at which the trunk shall go forward, in the air it returns on a
cycloid. Foot positions are in the frame of the leg's hip: its origin where the axes of hip and
thigh meet the trunk's side, its axes the trunk's, x forward, y left, z up.

It does not look at the robot, so it neither balances nor keeps a heading: it is good for flat
ground and moderate speed, and for a robot that moves before a policy is trained.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.arguments import check_number

FloatArray = NDArray[np.float64]

_PHASE = np.array([0.0, 0.5, 0.5, 0.0])  # FL, FR, RL, RR, in cycles
_LEFT = np.array([1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True, kw_only=True)
class LegGeometry:
    """A leg of three hinges: about x, then two about y, in a row.

    Attributes:
        hip: from the hip's axis to the plane in which the leg swings [m].
        thigh: from the thigh's axis to the calf's [m].
        calf: from the calf's axis to the foot's centre [m].
    """

    hip: float = 0.08
    thigh: float = 0.21
    calf: float = 0.21

    def __post_init__(self) -> None:
        check_number("hip", self.hip, at_least=0)
        check_number("thigh", self.thigh, above=0)
        check_number("calf", self.calf, above=0)

    def angles(self, foot: ArrayLike, left: ArrayLike) -> FloatArray:
        """Joint positions that put a foot somewhere, with the knee pointing backwards.

        Args:
            foot: where, in the hip's frame, (..., 3) [m].
            left: 1 for a leg on the left, -1 on the right, (...).

        Returns:
            Hip, thigh and calf, (..., 3) [rad].

        Raises:
            ValueError: it is out of reach.
        """
        x, y, z = np.moveaxis(np.asarray(foot, dtype=np.float64), -1, 0)
        side = self.hip * np.asarray(left, dtype=np.float64)
        down = np.sqrt(np.maximum(y**2 + z**2 - side**2, 0.0))
        reach2 = x**2 + down**2
        fold = (reach2 - self.thigh**2 - self.calf**2) / (2 * self.thigh * self.calf)
        if not (np.abs(fold) <= 1).all() or not (y**2 + z**2 >= side**2).all():
            raise ValueError(
                f"the foot is asked to be up to {np.sqrt(np.max(reach2)):.3g} m from the thigh's "
                f"axis, the leg reaches from {abs(self.thigh - self.calf):.3g} to "
                f"{self.thigh + self.calf:.3g} m: lower `height`, `stride` or `lift`"
            )
        hip = np.arctan2(y * down + z * side, y * side - z * down)
        calf = -np.arccos(fold)
        thigh = np.arctan2(-x, down) - np.arctan2(
            self.calf * np.sin(calf), self.thigh + self.calf * np.cos(calf)
        )
        return np.stack([hip, thigh, calf], axis=-1)


@dataclass(frozen=True, kw_only=True)
class Trot:
    """Joint targets of a quadruped that trots straight ahead.

    Attributes:
        stride: way of a foot on the ground [m]; negative walks backwards.
        frequency: cycles of a leg [Hz]; a leg is on the ground half of a cycle.
        lift: height of a foot's way through the air [m].
        height: of the hip's axes above the feet's centres [m].
        fade: seconds over which stride and lift grow from nothing.
        leg: the robot's legs.

    Raises:
        TypeError: one of them is not a number.
        ValueError: one is out of its bounds, or a foot out of reach.
    """

    stride: float = 0.12
    frequency: float = 2.5
    lift: float = 0.07
    height: float = 0.261
    fade: float = 1.0
    leg: LegGeometry = LegGeometry()

    def __post_init__(self) -> None:
        for name, bounds in {
            "stride": {},
            "frequency": {"above": 0},
            "lift": {"at_least": 0},
            "height": {"above": 0},
            "fade": {"at_least": 0},
        }.items():
            check_number(name, getattr(self, name), **bounds)
        self(self.fade + np.linspace(0.0, 1.0 / self.frequency, 101))  # within reach throughout

    @property
    def speed(self) -> float:
        """At which the feet on the ground ask the trunk to go forward [m/s]."""
        return 2 * self.stride * self.frequency

    def feet(self, time: ArrayLike) -> FloatArray:
        """Where the feet shall be.

        Args:
            time: since the gait began [s], (...).

        Returns:
            (..., 4, 3), of FL, FR, RL, RR, each in the frame of its hip [m].
        """
        seconds = np.asarray(time, dtype=np.float64)[..., None]
        phase = (self.frequency * seconds + _PHASE) % 1.0
        ground = 2 * np.minimum(phase, 0.5)  # 0 to 1 on the ground, and then
        air = 2 * np.maximum(phase - 0.5, 0.0)  # 0 to 1 in the air
        way = 0.5 - ground + air - np.sin(2 * np.pi * air) / (2 * np.pi)
        up = (1 - np.cos(2 * np.pi * air)) / 2
        grown = np.clip(seconds / self.fade, 0.0, 1.0) if self.fade else 1.0
        return np.stack(
            [
                grown * self.stride * way,
                np.broadcast_to(self.leg.hip * _LEFT, way.shape),
                grown * self.lift * up - self.height,
            ],
            axis=-1,
        )

    def __call__(self, time: ArrayLike) -> FloatArray:
        """Joint targets.

        Args:
            time: since the gait began [s], (...).

        Returns:
            (..., 12) [rad]: hip, thigh and calf of FL, FR, RL, RR.
        """
        angles = self.leg.angles(self.feet(time), _LEFT)
        return angles.reshape(*angles.shape[:-2], 12)
