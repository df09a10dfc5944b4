"""The torque–speed line of a direct-current motor.

With stall torque S, no-load speed V and continuous limit F, a motor at speed v can make at most

    hi = S (1 − v/V)   and   at least   lo = −S (1 + v/V),   both held within ±F,

which is as if v were held within ±V (1 + F/S). Faster than V it can only brake.
`DcMotorActuator` of mjlab and of Isaac Lab document the same curve.
"""

from __future__ import annotations

import numpy as np
from numpy import maximum, minimum, multiply, subtract  # looked up before every physics step
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
    shape = np.broadcast_shapes(np.shape(effort), np.shape(qd))
    return DcMotorClip(saturation_effort, velocity_limit, effort_limit, shape)(effort, qd)


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
        self._line = saturation_effort / velocity_limit
        self._stall, self._reverse = saturation_effort, -saturation_effort
        self._most, self._least = effort_limit, -effort_limit
        self._lost, self._bound = np.empty(shape), np.empty(shape)

    def __call__(self, effort: FloatArray, qd: FloatArray) -> FloatArray:
        """The effort that is left, a new array (..., n_joints) [N·m; N]."""
        # Held first by the line and then by the limit, which has the last word beyond them both:
        # the same as bounds that are held within the limit, in fewer calls. The speed is not
        # clipped, so that it is exact and symmetric.
        lost = multiply(qd, self._line, self._lost)
        bound = subtract(self._stall, lost, self._bound)
        left: FloatArray = minimum(effort, bound)
        bound = subtract(self._reverse, lost, self._bound)
        maximum(left, bound, out=left)
        minimum(left, self._most, out=left)
        maximum(left, self._least, out=left)
        return left


class DcMotorLaw(PdBase):
    """PD control through a DC motor; parameters those of both."""

    joinable = True

    def _refresh(self) -> None:
        super()._refresh()
        p = self._parameters
        self._clip = DcMotorClip(
            p["saturation_effort"], p["velocity_limit"], p["effort_limit"], self._shape
        )

    def _limited(self, effort: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        return self._clip(effort, qd)
