"""The member of every comparison that the catalogue does not have: a free effort at each joint.

    unknown = unknown_weight(problem, given, named)
    unknown.weight          # of the structures with a free effort
    unknown.instead         # of those that have it instead of what was named

A smooth function of a joint's motion and effort, of which nothing is known but that it is smooth,
predicts the effort that the simulation lacks in blocks of time that it has not seen. Where it does,
something is missing that has no name; where it does so better than what was named, that may be it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from walkerkit.gap.search.decision import (
    PRICE_PLACE,
    PRICE_RARE,
    PRICE_UNKNOWN,
    TAILS,
    TEMPERATURE,
)
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.stopgap.residual import ResidualEffort, residual_effort

FloatArray = NDArray[np.float64]

_FEATURES, _SEED = 80, 20260103  # of random Fourier features (Rahimi and Recht, NeurIPS 2007)
_RIDGES = np.logspace(-2, 4, 13)
_FOLDS = 8
_FEWEST = 40  # windows of a joint
_OUTLIER = 6.0  # times the usual effort
_DRAWS = 1000
_SLOW = 0.05  # of a joint's peak speed, over which dry friction turns


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """How much of what is missing the catalogue cannot name.

    Attributes:
        weight: of all structures that have a free effort.
        instead: of that which has it in place of all rare effects that were named.
    """

    weight: float
    instead: float


def unknown_weight(
    problem: Problem, plain: Sequence[Robot], named: Sequence[Robot], rare: int, places: int
) -> Unknown | None:
    """Weighs a free effort beside what was named, and instead of it.

    Args:
        problem: the recordings; only those that are fitted are looked at.
        plain: the robots with the ordinary effects alone.
        named: the robots with all that was named.
        rare: how many rare effects that is.
        places: and at how many places.

    Returns:
        The weights; None where no effort can be told, as of a base that floats.
    """
    if any(robot.base is not None for robot in problem.robots):
        return None
    joints = problem.joints
    missing = [residual_effort(problem, robots, joints, ("fit",)) for robots in (plain, named)]
    gains = []
    for k in range(len(joints)):
        blocks = _densities(*missing, k)
        if blocks is not None:
            gains.append(blocks)
    if not gains:
        return None
    # (draws, 3) of what was named, that with a free effort, and the ordinary with a free effort.
    rng = np.random.default_rng(_SEED)
    total = np.zeros((_DRAWS, 3))
    for blocks in gains:
        drawn = rng.dirichlet(np.ones(len(blocks)), size=_DRAWS) * len(blocks)
        total += drawn @ blocks
    free = PRICE_UNKNOWN
    own = PRICE_RARE * rare + PRICE_PLACE * places
    logs = total / TEMPERATURE - np.array([own, own + free, free])
    logs -= logs.max(axis=1, keepdims=True)
    weights = np.exp(logs)
    weights /= weights.sum(axis=1, keepdims=True)
    _, beside, instead = weights.mean(axis=0)
    return Unknown(weight=float(beside + instead), instead=float(instead) if rare else 0.0)


def _densities(
    plain: ResidualEffort | None, named: ResidualEffort | None, joint: int
) -> FloatArray | None:
    """(n_blocks, 3) log densities of the missing effort of a joint, out of its block."""
    if plain is None or named is None:
        return None
    rows = np.isfinite(plain.residual[:, joint]) & np.isfinite(named.residual[:, joint])
    if rows.sum() < _FEWEST:
        return None
    plain, named = plain.at(rows), named.at(rows)
    features = _features(named, joint)
    _, block = np.unique(named.block, return_inverse=True)
    left = [
        named.residual[:, joint],
        _across(features, named.residual[:, joint], block),
        _across(features, plain.residual[:, joint], block),
    ]
    return np.stack([_density(one, block) for one in left], axis=1)


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
