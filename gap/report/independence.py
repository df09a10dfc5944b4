"""How large an explanation's errors are, and for how long they stay alike.

Errors of a simulation are not noise from sample to sample: a joint that lags does so for a while.
The integrated autocorrelation time (Sokal, in Functional Integration, 1997, §3) is how long one has
to wait for a sample that says something new.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit
from walkerkit.gap.simulation.channel import Channel

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Independence:
    """The errors of one channel.

    Attributes:
        std: their root mean square, never below the measurement's noise, in the channel's unit.
        seconds: from one independent error to the next [s].
    """

    std: float
    seconds: float


def independence(problem: Problem, fit: Fit) -> Mapping[Channel, Independence]:
    """The errors that a fit leaves of the recordings that are held out, by scored channel."""
    squares = dict.fromkeys(problem.channels, 0.0)
    count = dict.fromkeys(problem.channels, 0)
    waits: dict[Channel, list[tuple[float, float]]] = {c: [] for c in problem.channels}
    for replay in problem.held.objective.replays:
        predicted = replay.predict(fit.structure.trials(replay.robot, fit.values[None]))[0]
        for channel in problem.channels:
            column = replay.channels.index(channel)
            error = predicted[:, column] - replay.measured[:, column]
            for s, segment in enumerate(replay.segments):
                own = error[replay.segment_of_row == s]
                if not np.isfinite(own).all():
                    continue
                squares[channel] += float(own @ own)
                count[channel] += len(own)
                step = segment.duration / (len(own) - 1)
                waits[channel].append((float(own @ own), step * correlated_samples(own)))
    found = {}
    for channel, noise in zip(problem.channels, problem.noise, strict=True):
        std = float(np.sqrt(squares[channel] / count[channel])) if count[channel] else 0.0
        size = sum(weight for weight, _ in waits[channel])
        found[channel] = Independence(
            std=max(std, float(noise)),
            seconds=sum(weight * wait for weight, wait in waits[channel]) / size if size else 1.0,
        )
    return found


def correlated_samples(errors: FloatArray) -> float:
    """How many neighbouring errors say as much as one independent one, at least 1.

    Args:
        errors: (n,) in the order of time, evenly spaced. Their mean counts as error.
    """
    n = len(errors)
    spectrum = np.fft.rfft(errors, 2 * n)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    if correlation[0] <= 0:
        return float(n)
    correlation = correlation / correlation[0]
    negative = np.flatnonzero(correlation <= 0)
    last = int(negative[0]) if negative.size else n
    return float(min(n, 1 + 2 * correlation[1:last].sum()))
