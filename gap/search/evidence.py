"""What held-out recordings say of a candidate: block bootstrap of the scores.

The errors of a joint stay alike for a while, so stretches of half a second are resampled, not rows
(Künsch, Annals of Statistics 17, 1989). Recordings that were fitted and recordings that were held
out count the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.journal import digest, finished, packed, unpacked
from walkerkit.gap.search.objective import Objective, residuals_of
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit

FloatArray = NDArray[np.float64]

_RESAMPLES = 400
_SEED = 20260101


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Scores of some fits under resampling.

    Attributes:
        mean_square: (n_fits, n_scored) mean square gaps of the held-out recordings.
        fitted_mean_square: (n_fits, n_scored) those of the fitted ones.
        held: (n_fits,) scores of the held-out recordings.
        both: (n_fits,) means of the scores of fitted and of held-out recordings.
        held_resampled, both_resampled: (n_resamples, n_fits).
    """

    mean_square: FloatArray
    fitted_mean_square: FloatArray
    held: FloatArray
    both: FloatArray
    held_resampled: FloatArray
    both_resampled: FloatArray

    @property
    def fitted(self) -> FloatArray:
        """(n_fits,) scores of the recordings that were fitted."""
        scores = np.full_like(self.both, np.inf)  # of what diverged
        known = np.isfinite(self.both)
        scores[known] = 2 * self.both[known] - self.held[known]
        return scores

    @classmethod
    def joined(cls, parts: Sequence[Evidence]) -> Evidence:
        """The fits of several pieces of evidence, one after the other."""
        return cls(
            mean_square=np.concatenate([part.mean_square for part in parts]),
            fitted_mean_square=np.concatenate([part.fitted_mean_square for part in parts]),
            held=np.concatenate([part.held for part in parts]),
            both=np.concatenate([part.both for part in parts]),
            held_resampled=np.concatenate([part.held_resampled for part in parts], axis=1),
            both_resampled=np.concatenate([part.both_resampled for part in parts], axis=1),
        )

    def some(self, fits: Sequence[int]) -> Evidence:
        """That of some of the fits, in their order."""
        k = np.asarray(fits, dtype=np.intp)
        return Evidence(
            mean_square=self.mean_square[k],
            fitted_mean_square=self.fitted_mean_square[k],
            held=self.held[k],
            both=self.both[k],
            held_resampled=self.held_resampled[:, k],
            both_resampled=self.both_resampled[:, k],
        )

    def replaced(self, k: int, other: Evidence) -> Evidence:
        """With that of fit `k` exchanged for another's only fit."""
        parts = [self.some([i]) for i in range(len(self.held))]
        parts[k] = other
        return Evidence.joined(parts)


def weigh(problem: Problem, fits: Sequence[Fit]) -> Evidence:
    """Simulates the fits on all recordings and resamples their scores."""
    return weigh_by(problem.fit.objective, problem.held.objective, fits)


def weigh_by(fitted: Objective, held_out: Objective, fits: Sequence[Fit]) -> Evidence:
    """As `weigh`, by objectives whose numerical errors are another's."""
    return _finished(fits, lambda: _weigh(fitted, held_out, fits))


def weigh_as_told(problem: Problem, fits: Sequence[Fit]) -> Evidence:
    """As `weigh`, of what is held out alone, over the horizon that the gap is told of."""
    return _finished(fits, lambda: _weigh(problem.told, problem.told, fits))


def _finished(fits: Sequence[Fit], make: Callable[[], Evidence]) -> Evidence:
    return finished(
        digest(*(part for f in fits for part in (repr(f.structure.key), f.values))),
        make,
        lambda evidence: packed([getattr(evidence, field.name) for field in fields(Evidence)]),
        _evidence,
    )


def _evidence(content: Any) -> Evidence:
    names = [field.name for field in fields(Evidence)]
    return Evidence(**dict(zip(names, unpacked(content), strict=True)))


def _weigh(fit: Objective, held_out: Objective, fits: Sequence[Fit]) -> Evidence:
    objectives = list(dict.fromkeys((held_out, fit)))
    squares: list[list[FloatArray]] = [[] for _ in objectives]
    for residuals in residuals_of(objectives, [one.case for one in fits]):
        for one, own, residual in zip(objectives, squares, residuals, strict=True):
            own.append(one.block_squares(residual[0]))
    scores = [_scores(one, np.stack(own)) for one, own in zip(objectives, squares, strict=True)]
    held, held_resampled, mean_square = scores[0]
    fitted, fitted_resampled, fitted_mean_square = scores[-1]
    return Evidence(
        mean_square=mean_square,
        fitted_mean_square=fitted_mean_square,
        held=held,
        both=0.5 * (held + fitted),
        held_resampled=held_resampled,
        both_resampled=0.5 * (held_resampled + fitted_resampled),
    )


def _scores(objective: Objective, squares: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    counts = objective.block_counts()
    rng = np.random.default_rng(_SEED)
    drawn = rng.multinomial(len(counts), np.full(len(counts), 1 / len(counts)), size=_RESAMPLES)
    mean_square = squares.sum(axis=1) / objective.count
    # A channel whose every sample was left out of a draw has no gap in it.
    samples = np.maximum(drawn @ counts, 1)
    resampled = np.einsum("rb,fbc->rfc", drawn, squares) / samples[:, None, :]
    return objective.score(mean_square), objective.score(resampled), mean_square
