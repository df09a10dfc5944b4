"""Intervals of what episodes with the same seeds differ in, and what they say against a margin.

loss = paired(given - mended, level=0.95)
finding(loss, margin)       # "breaks", "harmless" or "undecided"
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

FloatArray = NDArray[np.float64]
Verdict = Literal["breaks", "harmless", "undecided"]

LEVEL = 0.95


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A mean with its interval.

    Attributes:
        mean: the mean.
        low, high: the ends of the interval.
    """

    mean: float
    low: float
    high: float

    @property
    def half(self) -> float:
        """Half the width of the interval."""
        return (self.high - self.low) / 2

    def over(self, size: float) -> Interval:
        """The same in units of a size."""
        return Interval(mean=self.mean / size, low=self.low / size, high=self.high / size)

    def to_dict(self) -> dict[str, float]:
        """For a file."""
        return {"mean": self.mean, "low": self.low, "high": self.high}


def of_mean(values: FloatArray, level: float = LEVEL) -> Interval:
    """Student's interval of the mean of independent values.

    Args:
        values: (n,), two or more.
        level: of confidence.
    """
    mean = float(np.mean(values))
    error = float(np.std(values, ddof=1) / np.sqrt(len(values)))
    half = float(stats.t.ppf(0.5 + level / 2, len(values) - 1)) * error
    return Interval(mean=mean, low=mean - half, high=mean + half)


def of_share(count: int, n: int, level: float = LEVEL) -> Interval:
    """Wilson's interval of a share."""
    found = stats.binomtest(count, n).proportion_ci(confidence_level=level, method="wilson")
    return Interval(mean=count / n, low=float(found.low), high=float(found.high))


def finding(loss: Interval, margin: float) -> Verdict:
    """What a loss says of its cause.

    It breaks the policy where the whole interval is above the margin, and is harmless where the
    whole interval is below.
    """
    if loss.low > margin:
        return "breaks"
    return "harmless" if loss.high < margin else "undecided"
