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
_CHANCE = 0.05
_OVER_NOISE = 0.5  # what an effect explains of some channel, over its noise
_OVER_NUMERICAL = 0.4  # and over what half the timestep changes, which is taken out already
_CLOSE = 0.1  # scores, summed over the channels, this near are the same explanation


def worth_it(problem: Problem, evidence: Evidence, k: int, base: int = 0) -> bool:
    """Whether fit `k` improves on fit `base` by more than chance and by what matters."""
    floor = problem.held.objective.floor
    gains = 0.5 * np.log(
        (evidence.mean_square[base] + floor**2) / (evidence.mean_square[k] + floor**2)
    )
    joints = [channel.joint for channel in problem.channels]
    of_joint = [gains[[j == joint for j in joints]].mean() for joint in dict.fromkeys(joints)]
    gain = evidence.held[base] - evidence.held[k]
    large = gain >= _MARGIN or (gain > 0 and max(of_joint) >= _MARGIN_OF_JOINT)
    by_chance = np.mean(evidence.held_resampled[:, base] <= evidence.held_resampled[:, k])
    explained = np.sqrt(np.maximum(evidence.mean_square[base] - evidence.mean_square[k], 0))
    least = _OVER_NOISE * problem.noise
    numerical = problem.held.objective.numerical
    if len(numerical):
        size = np.sqrt(problem.held.objective.mean_square(numerical)[0])
        least = np.maximum(least, _OVER_NUMERICAL * size)
    return bool(large and by_chance < _CHANCE and (explained > least).any())


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
