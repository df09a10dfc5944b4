"""What the catalogue does not have: a free effort at each joint, against what was named without.

    unknown_weight(problem, robots)     # of the structure with a free effort beside what was named

A smooth function of a joint's motion and effort, of which nothing is known but that it is smooth,
predicts the effort that the simulation lacks in blocks of time that it has not seen. Where it does,
something is missing beside what was named.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, gammaln

from walkerkit.gap.search.decision import LEAST_GAIN, PRICE_UNKNOWN, TAILS, TEMPERATURE
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.residual_effort import ResidualEffort, residual_effort
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]

_FEATURES, _SEED = 80, 20260103  # of random Fourier features (Rahimi and Recht, NeurIPS 2007)
_RIDGES = np.logspace(-2, 4, 13)
_FOLDS = 8
_FEWEST = 40  # windows of a joint
_OUTLIER = 6.0  # times the usual effort
_DRAWS = 1000
_SLOW = 0.05  # of a joint's peak speed, over which dry friction turns


def unknown_weight(problem: Problem, named: Sequence[Robot]) -> float | None:
    """The weight of what was named with a free effort beside it, over that without.

    Args:
        problem: the recordings; only those that are fitted are looked at.
        named: the robots with all that was named.

    Returns:
        The weight; None where no effort can be told, as of a base that floats.
    """
    if any(robot.base is not None for robot in problem.robots):
        return None
    missing = residual_effort(problem, named, problem.joints, ("fit",))
    gains = [] if missing is None else [_gains(missing, k) for k in range(len(problem.joints))]
    known = [one for one in gains if one is not None]
    if not known:
        return None
    rng = np.random.default_rng(_SEED)
    total = np.zeros(_DRAWS)
    for blocks in known:
        total += rng.dirichlet(np.ones(len(blocks)), size=_DRAWS) @ blocks * len(blocks)
    return float(expit(total / TEMPERATURE - PRICE_UNKNOWN).mean())


def _gains(missing: ResidualEffort, joint: int) -> FloatArray | None:
    """(n_blocks,) log densities of the missing effort of a joint with a free one, over without."""
    missing = missing.at(np.isfinite(missing.residual[:, joint]))
    if len(missing.time) < _FEWEST:
        return None
    target = missing.residual[:, joint]
    _, block = np.unique(missing.block, return_inverse=True)
    left = _across(_features(missing, joint), target, block)
    if np.sum(left**2) > np.exp(-2 * LEAST_GAIN) * np.sum(target**2):
        return np.zeros(block.max() + 1)  # less than is worth a name
    return _density(left, block) - _density(target, block)


def _features(missing: ResidualEffort, joint: int) -> FloatArray:
    """(n, k) smooth functions of a joint's motion and effort."""
    qd = missing.qd[:, joint]
    slow = _SLOW * float(np.abs(qd).max() or 1.0)
    inputs = np.stack(
        [
            missing.q[:, joint],
            qd,
            np.tanh(qd / slow),
            missing.qdd[:, joint],
            missing.effort[:, joint],
        ],
        axis=1,
    )
    scale = np.where(inputs.std(axis=0) > 0, inputs.std(axis=0), 1.0)
    inputs = (inputs - inputs.mean(axis=0)) / scale
    rng = np.random.default_rng(_SEED)
    directions = rng.normal(size=(inputs.shape[1], _FEATURES)) / np.sqrt(inputs.shape[1])
    phase = rng.uniform(0, 2 * np.pi, size=_FEATURES)
    waves = np.sqrt(2 / _FEATURES) * np.cos(inputs @ directions + phase)
    return np.concatenate([np.ones((len(inputs), 1)), inputs, waves], axis=1)


def _across(features: FloatArray, target: FloatArray, block: NDArray[np.intp]) -> FloatArray:
    """(n,) what is left of a target by ridge regressions that have not seen its block."""
    usual = float(np.sqrt(np.mean(target**2)))
    target = np.clip(target, -_OUTLIER * usual, _OUTLIER * usual)
    fold = block % _FOLDS
    left = np.empty((len(_RIDGES), len(target)))
    for one in range(_FOLDS):
        mine, others = fold == one, fold != one
        if not mine.any():
            continue
        if not others.any():
            left[:, mine] = target[mine]
            continue
        normal = features[others].T @ features[others]
        along = features[others].T @ target[others]
        for k, ridge in enumerate(_RIDGES):
            factors = np.linalg.solve(normal + ridge * np.eye(len(normal)), along)
            left[k, mine] = target[mine] - features[mine] @ factors
    best: FloatArray = left[int(np.argmin(np.square(left).sum(axis=1)))]
    return best


def _density(left: FloatArray, block: NDArray[np.intp]) -> FloatArray:
    """(n_blocks,) log densities of blocks, each of one independent sample, Student t."""
    square = np.bincount(block, weights=left**2) / np.bincount(block)
    variance = float(np.mean(square)) or 1.0
    for _ in range(_FOLDS):
        heavy = (TAILS + 1) / (TAILS + square / variance)
        variance = float(np.mean(heavy * square)) or 1.0
    density: FloatArray = (
        gammaln(0.5 * (TAILS + 1))
        - gammaln(0.5 * TAILS)
        - 0.5 * np.log(TAILS * np.pi * variance)
        - 0.5 * (TAILS + 1) * np.log1p(square / (TAILS * variance))
    )
    return density
