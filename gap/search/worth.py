"""What decides between explanations: whether one is worth it, which are as good, how sure one is.

Scores are means over the measured channels. A joint's effect shows in the few channels of that
joint, however many others there are, so what counts is judged per joint, or summed over channels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.evidence import Evidence
from walkerkit.gap.search.problem import Problem

FloatArray = NDArray[np.float64]

_MARGIN = 0.04  # an effect makes gaps at least four per cent smaller, in the geometric mean
_MARGIN_OF_JOINT = 0.1  # or those of some joint ten per cent
_MORE_EACH = 0.5  # of these margins for each effect that is there: several names fit many a gap
_CHANCE = 0.05
_LARGE, _CHANCE_OF_LARGE = 0.25, 0.15  # gaps a quarter smaller, which few blocks may decide
_OVER_NOISE = 0.5  # what an effect explains of some channel, over its noise
_OVER_NUMERICAL = 0.4  # and over what half the timestep changes, which is taken out already
_MUCH_LARGER = 0.4  # a gap, as ½ log of its square
_NO_NOISE = 2.0  # times noise and numerical error together
_TIED = 0.2  # of resamples in which the second is first
_CLOSE = 0.1  # scores, summed over the channels, this near are the same explanation


def worth_it(
    problem: Problem, evidence: Evidence, k: int, base: int = 0, *, effects: int = 1
) -> bool:
    """Whether fit `k` improves on fit `base` by more than chance and by what matters.

    What is as close to it as the members of a confusion set are to each other does not.

    Args:
        problem: what is to be explained.
        evidence: what recordings say of the fits.
        k: index of the larger fit.
        base: index of the smaller one.
        effects: how many effects the larger has; every further one has to bring more.
    """
    of_joint = _by_joint(problem, evidence.mean_square[base], evidence.mean_square[k])
    gain = evidence.held[base] - evidence.held[k]
    more = 1 + _MORE_EACH * (effects - 1)
    large = gain >= more * _MARGIN or (gain > 0 and max(of_joint) >= more * _MARGIN_OF_JOINT)
    other = len(problem.channels) * (evidence.both[base] - evidence.both[k]) >= _CLOSE
    by_chance = np.mean(evidence.held_resampled[:, base] <= evidence.held_resampled[:, k])
    explained = np.sqrt(np.maximum(evidence.mean_square[base] - evidence.mean_square[k], 0))
    least = _OVER_NOISE * problem.noise
    least = np.maximum(least, _OVER_NUMERICAL * problem.held.objective.numerical_size())
    most = _CHANCE_OF_LARGE if gain >= more * _LARGE else _CHANCE
    return bool(large and other and by_chance < most and (explained > least).any())


def much_is_lost(evidence: Evidence, k: int, base: int = 0) -> bool:
    """Whether fit `base` has so much larger gaps than fit `k` that what it lacks is there.

    On what was fitted and what was held out together: what is held out may know nothing of an
    effect that the other recordings excite, or its size may be known badly.
    """
    return bool(evidence.both[base] - evidence.both[k] >= _LARGE)


def much_is_lost_at_a_joint(problem: Problem, evidence: Evidence, k: int, base: int = 0) -> bool:
    """The same of the joint that loses most, however many others there are."""
    held, fitted = (
        np.array(_by_joint(problem, sizes[base], sizes[k]))
        for sizes in (evidence.mean_square, evidence.fitted_mean_square)
    )
    return bool(np.max(0.5 * (held + fitted)) >= _LARGE)


def one_sided(problem: Problem, evidence: Evidence) -> bool:
    """Whether only one half of the recordings shows something that fit 0 does not explain.

    Another fit explains a part of those that were fitted but not of those that were held out, or
    the gap of those that were held out is much larger to begin with.
    """
    for k in range(1, len(evidence.held)):
        fitted = evidence.fitted_mean_square
        gained = _by_joint(problem, fitted[0], fitted[k])
        if max(gained) >= _MARGIN_OF_JOINT and not worth_it(problem, evidence, k):
            return True
    excess = _by_joint(problem, evidence.mean_square[0], evidence.fitted_mean_square[0])
    return max(excess) > _MUCH_LARGER


def only_fitted(problem: Problem, evidence: Evidence) -> bool:
    """Whether fit 0 leaves a gap of what was fitted, far larger than of what was held out."""
    left = np.sqrt(evidence.fitted_mean_square[0])
    floor = np.hypot(problem.noise, problem.fit.objective.numerical_size())
    excess = _by_joint(problem, evidence.fitted_mean_square[0], evidence.mean_square[0])
    return bool((left > _NO_NOISE * floor).any() and max(excess) > _MUCH_LARGER)


def _by_joint(problem: Problem, before: FloatArray, after: FloatArray) -> list[float]:
    """How much smaller mean squares are in each joint, (n_scored,) each: means of ½ log."""
    floor = problem.held.objective.floor
    gains = 0.5 * np.log((before + floor**2) / (after + floor**2))
    joints = [channel.joint for channel in problem.channels]
    return [float(gains[[j == joint for j in joints]].mean()) for joint in dict.fromkeys(joints)]


def tied(contest: Evidence, channels: int, k: int) -> bool:
    """Whether fit `k` may as well be the best as fit 0."""
    behind = channels * (contest.both[k] - contest.both[0])
    ahead = np.mean(contest.both_resampled[:, k] <= contest.both_resampled[:, 0])
    return bool(behind < _CLOSE or ahead > _TIED)


def least_gain(problem: Problem) -> float:
    """What anything that is worth it takes off the score at least, summed over the channels."""
    joints = [channel.joint for channel in problem.channels]
    fewest = min(joints.count(joint) for joint in joints)
    return min(_MARGIN * len(joints), _MARGIN_OF_JOINT * fewest)


def close_to(contest: Evidence, channels: int, first: int = 0) -> list[int]:
    """Fits that explain as well as fit `first`: by score, or in more than chance of resamples."""
    resampled = contest.both_resampled
    ahead = np.mean(resampled <= resampled[:, first : first + 1], axis=0)
    near = channels * (contest.both - contest.both[first]) < _CLOSE
    return [k for k in range(len(near)) if k != first and (near[k] or ahead[k] > _CHANCE)]


def confidence(contest: Evidence, channels: int) -> float:
    """How often fit 0 is best in resampled recordings, ties shared."""
    scores = channels * contest.both_resampled
    best = scores < scores.min(axis=1, keepdims=True) + 0.5 * _CLOSE
    return float((best[:, 0] / best.sum(axis=1)).mean())
