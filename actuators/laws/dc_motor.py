"""The torque–speed line of a direct-current motor.

With stall torque S, no-load speed V and continuous limit F, a motor at speed v can make at most

    hi = S (1 − v/V)   and   at least   lo = −S (1 + v/V),   both held within ±F,

which is as if v were held within ±V (1 + F/S). Faster than V it can only brake.
`DcMotorActuator` of mjlab and of Isaac Lab document the same curve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.laws.pd import PdBase

FloatArray = NDArray[np.float64]


def dc_motor_clip(
    effort: FloatArray,
    qd: FloatArray,
    saturation_effort: FloatArray,
    velocity_limit: FloatArray,
    effort_limit: FloatArray,
) -> FloatArray:
    """What a DC motor makes of an effort that it is asked for, a new array (..., n_joints).

    Args:
        effort: asked for [N·m; N].
        qd: velocity [rad/s; m/s].
        saturation_effort: S, at standstill [N·m; N].
        velocity_limit: V, without load [rad/s; m/s].
        effort_limit: F, what it may make for long [N·m; N].
    """
    line = saturation_effort / velocity_limit
    return _clip(effort, qd, saturation_effort, line, effort_limit, -effort_limit, None, None)


def _clip(
    effort: FloatArray,
    qd: FloatArray,
    stall: FloatArray,
    line: FloatArray,
    limit: FloatArray,
    other_limit: FloatArray,
    scratch: FloatArray | None,
    scratch2: FloatArray | None,
) -> FloatArray:
    # Bounds are held within the limits, and not the speed before them: exact, and symmetric.
    lost = np.multiply(qd, line, out=scratch)
    bound = np.subtract(stall, lost, out=scratch2)
    bound = np.maximum(bound, other_limit, out=scratch2)
    bound = np.minimum(bound, limit, out=scratch2)
    out: FloatArray = np.minimum(effort, bound)
    # The lower bound, with its sign turned.
    bound = np.add(stall, lost, out=scratch2)
    bound = np.maximum(bound, other_limit, out=scratch2)
    bound = np.minimum(bound, limit, out=scratch2)
    bound = np.negative(bound, out=scratch2)
    return np.maximum(out, bound, out=out)


class DcMotorClip:
    """`dc_motor_clip` for parameters that seldom change.

    Args:
        saturation_effort: S [N·m; N], (..., n_joints), as the next two.
        velocity_limit: V [rad/s; m/s].
        effort_limit: F [N·m; N].
        shape: of the efforts.
    """

    def __init__(
        self,
        saturation_effort: FloatArray,
        velocity_limit: FloatArray,
        effort_limit: FloatArray,
        shape: tuple[int, ...],
    ):
        line = saturation_effort / velocity_limit
        self._curve = saturation_effort, line, effort_limit, -effort_limit
        self._scratch = np.empty(shape), np.empty(shape)

    def __call__(self, effort: FloatArray, qd: FloatArray) -> FloatArray:
        """The effort that is left, a new array (..., n_joints) [N·m; N]."""
        return _clip(effort, qd, *self._curve, *self._scratch)


class DcMotorLaw(PdBase):
    """PD control through a DC motor; parameters those of both."""

    def _refresh(self) -> None:
        p = self._parameters
        self._clip = DcMotorClip(
            p["saturation_effort"], p["velocity_limit"], p["effort_limit"], self._shape
        )

    def _limited(self, effort: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        return self._clip(effort, qd)
