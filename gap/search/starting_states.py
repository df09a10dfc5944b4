"""The measured state that segments start from, whose error is a nuisance of every prediction.

A joint's velocity is known from the noisy positions around an instant, but half a second of a
simulation that starts from it is compared with all positions of that time, which tell it better. So
each segment's starting state is free within what the measurement leaves open: what it changes is
taken out by ridge regression (Hoerl and Kennard, Technometrics 12, 1970), whose prior is the error
of the measured state. Where a gap is larger than what noise makes of it, little is taken out, as
then something else is missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_Float = TypeVar("_Float", np.float32, np.float64)

ALIKE = 0.1  # s, for which the errors of a simulation stay alike


def start_errors(joints: Sequence[str]) -> Mapping[str, FloatArray]:
    """Trials that each start one joint's position, or its velocity, off by its standard deviation.

    Returns:
        Joint to (2 n_joints, 2) standard deviations.
    """
    every = np.eye(2 * len(joints)).reshape(-1, len(joints), 2)
    return {joint: every[:, k] for k, joint in enumerate(joints)}


class Starts:
    """What errors in the starting states of segments change, and how residuals are freed of them.

    Args:
        spans: the rows of each segment.
        durations: (n_segments,) of the segments [s].
        changes: (k, rows, n_scored) of residuals, by one standard deviation of each number of the
            starting state.
        variance: (n_scored,) of what is left of the residuals.
    """

    def __init__(
        self,
        spans: Sequence[slice],
        durations: FloatArray,
        changes: FloatArray,
        variance: FloatArray,
    ):
        self._parts = []
        for span, duration in zip(spans, durations, strict=True):
            own = changes[:, span]
            weights = max(1.0, duration / ALIKE) / own.shape[1] / variance
            weighted = (own * weights).reshape(len(own), -1)
            own = own.reshape(len(own), -1)
            gain = np.linalg.solve(np.eye(len(own)) + weighted @ own.T, weighted)
            self._parts.append((span, gain.T, own))

    def free(self, residuals: NDArray[_Float]) -> None:
        """Takes out of (n, rows, n_scored) residuals, or changes of them, what starts can make."""
        for span, gain, own in self._parts:
            part = residuals[:, span]
            rows = part.reshape(len(part), len(gain))
            residuals[:, span] = (rows - (rows @ gain) @ own).reshape(part.shape)
