"""What happens to whole signals of the simulated hardware on their way, before or after the run.

    late = delayed(signal, lag)                        # lag in steps, per joint
    stairs = held(signal, steps, start=lead)
    round_ = filtered(signal, steps)
    slow = slewed(signal, most)

Signals have shape (n_steps, n_sims, n_joints); before its first sample a signal is taken to have
been constant.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

_ROUNDING = 9  # decimals of a step
_LEAST = 1e-9  # of a step; a filter that is quicker passes its input


def delayed(signal: Array, lag: Array) -> Array:
    """A signal as it arrives late.

    Args:
        signal: shape (n_steps, n_sims, n_joints).
        lag: of each joint, shape (n_joints,), steps; the fraction of a step is interpolated.

    Returns:
        The signal, shape as given.
    """
    if not np.any(lag):
        return signal
    return read(signal, np.arange(len(signal))[:, None] - np.round(lag, _ROUNDING))


def read(signal: Array, at: Array) -> Array:
    """A signal between its steps.

    Args:
        signal: shape (n_steps, n_sims, n_joints).
        at: steps to read it at, shape (n, n_joints) or (n, 1); a fraction is interpolated.

    Returns:
        What is read, shape (n, n_sims, n_joints).
    """
    early = np.floor(at).astype(int)
    late_share = (at - early)[:, None, :]
    last = len(signal) - 1

    def take(index: NDArray[np.intp]) -> Array:
        return np.take_along_axis(signal, np.clip(index, 0, last)[:, None, :], axis=0)

    between: Array = (1.0 - late_share) * take(early) + late_share * take(early + 1)
    return between


def held(signal: Array, period: Array, *, start: int) -> Array:
    """A signal that is looked at now and then, and held in between.

    Args:
        signal: shape (n_steps, n_sims, n_joints).
        period: from one look to the next, shape (n_joints,), steps; below one it passes.
        start: a step at which everybody looks.

    Returns:
        Stairs, shape as given.
    """
    if not np.any(period > 1):
        return signal
    every = np.maximum(period, 1.0)
    looks = np.floor((np.arange(len(signal))[:, None] - start) / every + 10.0**-_ROUNDING)
    seen = np.ceil(looks * every - 10.0**-_ROUNDING).astype(int) + start
    return np.take_along_axis(signal, np.maximum(seen, 0)[:, None, :], axis=0)


def filtered(signal: Array, time_constant: Array) -> Array:
    """A signal behind a first-order filter, exact for inputs that are held for a step.

    Args:
        signal: shape (n_steps, n_sims, n_joints).
        time_constant: of each joint, shape (n_joints,), steps.

    Returns:
        The filter's state at each step, shape as given.
    """
    out = signal.copy()
    for j, steps in enumerate(time_constant):
        if steps > _LEAST:
            stay = np.exp(-1.0 / steps)
            out[..., j] -= signal[0, :, j]
            out[..., j] = lfilter([0.0, 1.0 - stay], [1.0, -stay], out[..., j], axis=0)
            out[..., j] += signal[0, :, j]
    return out


def slewed(signal: Array, most: Array) -> Array:
    """A signal that follows no faster than it may.

    Args:
        signal: shape (n_steps, n_sims, n_joints).
        most: largest change of each joint in a step, shape (n_joints,), infinite for any.

    Returns:
        The follower, shape as given.
    """
    if not np.any(np.isfinite(most)):
        return signal
    out = signal.copy()
    for k in range(1, len(out)):
        before = out[k - 1]
        np.minimum(np.maximum(signal[k], before - most), before + most, out=out[k])
    return out
