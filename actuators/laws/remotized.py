"""A joint driven through a linkage, whose leverage changes with its angle.

    |τ| ≤ effort limit at q, interpolated between the rows of a table

As in `RemotizedPDActuator` of Isaac Lab. Outside the table the limit is that of its nearest end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.laws.pd import PdBase, clipped

FloatArray = NDArray[np.float64]


class RemotizedPdLaw(PdBase):
    """PD control with a limit that depends on the angle.

    Args:
        parameters: stiffness, damping and effort_limit, (n_joints,) each.
        angles: rising angles [rad; m].
        limits: the most that it makes at each [N·m; N].
    """

    def __init__(
        self,
        parameters: Mapping[str, FloatArray],
        angles: Sequence[float],
        limits: Sequence[float],
    ):
        super().__init__(parameters)
        self._angles, self._limits = np.array(angles), np.array(limits)

    def _limited(self, effort: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        limit = np.minimum(
            np.interp(q, self._angles, self._limits), self._parameters["effort_limit"]
        )
        return clipped(effort, limit)
