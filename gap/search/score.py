"""Scores: how well a fitted structure predicts blocks of time that its fit has not seen.

    foretold = Foretold(objective, slopes)
    scoring = Scoring(objective, fit, foretold, noise)
    (scores,) = scoring.scores([(foretold.far(step), kept)], memory_of(objective, slopes.residual))
    scores.elpd(scores)     # (n_blocks,) log densities

A block is half a second. Its score is the log density of its residual, under a multivariate
Student t of each channel (a normal density whose variance differs from block to block), after one
Gauss–Newton step of the values to where they would be without the part of the recording in which
it lies, a tenth of all at most: approximate cross-validation (Beirami, Razaviyayn, Shahrampour and
Tarokh, NeurIPS 2017) costs no simulation. What lies side by side is alike, so that leaving out no
more than the block itself would say little of other data (Roberts et al., Ecography 40, 2017).
Motions that repeat are alike as well, so that where several recordings are fitted each is also left
out as a whole; the score is the mean of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from walkerkit.gap.search.decision import NUMERICAL_LEFT, TAILS
from walkerkit.gap.search.foretold import Foretold
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.structure import Fit

FloatArray = NDArray[np.float64]

_SWEEPS = 20  # of expectation and maximisation for a channel's variance
_LONGEST = 2.0  # s, over which a residual's memory is looked at


@dataclass(frozen=True, kw_only=True, eq=False)
class Scores:
    """How a structure predicts blocks that its fit has not seen.

    Attributes:
        squares: (n_blocks, n_scored) sums of squares of each block, by a fit without the part of
            the recording in which it lies.
        elsewhere: the same by a fit to the other recordings alone; as `squares` where there are
            none.
        count: (n_blocks, n_scored) measured samples.
        memory: (n_scored,) autocorrelation times of the residuals, in samples, 1 at least.
        floor: (n_scored,) below which a residual says nothing: noise, and what is left of the
            numerical error.
    """

    squares: FloatArray
    elsewhere: FloatArray
    count: FloatArray
    memory: FloatArray
    floor: FloatArray

    @property
    def unseen(self) -> FloatArray:
        """(n_blocks, n_scored) the mean of `squares` and `elsewhere`, as the elpd is of theirs."""
        return 0.5 * (self.squares + self.elsewhere)

    @property
    def size(self) -> FloatArray:
        """(n_scored,) root mean squares over all blocks."""
        size: FloatArray = np.sqrt(self.squares.sum(axis=0) / np.maximum(self.count.sum(axis=0), 1))
        return size

    def elpd(self, scale: Scores) -> FloatArray:
        """(n_blocks,) log densities, with the memory and the floor of another structure.

        The mean of those by a fit without the part and by one without the recording.
        """
        elsewhere = _density(self.elsewhere, self.count, scale.memory, scale.floor)
        density: FloatArray = 0.5 * (self.elpd_nearby(scale) + elsewhere)
        return density

    def elpd_nearby(self, scale: Scores) -> FloatArray:
        """(n_blocks,) the same by fits without the part alone."""
        return _density(self.squares, self.count, scale.memory, scale.floor)


def _density(
    squares: FloatArray, count: FloatArray, memory: FloatArray, floor: FloatArray
) -> FloatArray:
    """(n_blocks,) log densities of sums of squares."""
    count, square = count / memory, squares / memory
    variance, _ = _variance(square, count, floor)
    density: FloatArray = np.sum(
        gammaln(0.5 * (TAILS + count))
        - gammaln(0.5 * TAILS)
        - 0.5 * count * np.log(TAILS * np.pi * variance)
        - 0.5 * (TAILS + count) * np.log1p(square / (TAILS * variance)),
        axis=1,
    )
    return density


def _variance(
    square: FloatArray, count: FloatArray, floor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n_scored,) that of a multivariate t, and (n_blocks, n_scored) how much each block counts."""
    total = np.maximum(count.sum(axis=0), 1)
    variance = np.maximum(square.sum(axis=0) / total, floor**2)
    for _ in range(_SWEEPS):
        heavy = (TAILS + count) / (TAILS + square / variance)
        variance = np.maximum(np.sum(heavy * square, axis=0) / total, floor**2)
    return variance, heavy


class Wildness:
    """How wild blocks are, by the density of the comparison, for fits that are to make it largest.

    Fits in which each block counts by `trust`, again and again, do (Lange, Little and Taylor,
    Journal of the American Statistical Association 84, 1989).

    Args:
        objective: the recordings.
        residual: (rows, n_scored) of a fit to them, whose memory is that of all others.
        noise: (n_scored,) of the measurement.
    """

    def __init__(self, objective: Objective, residual: FloatArray, noise: FloatArray):
        self._objective = objective
        self._counts = objective.block_counts()
        self._memory = memory_of(objective, residual)
        self._floor = _floor(objective, noise)

    def trust(self, residual: FloatArray) -> FloatArray:
        """(n_blocks, n_scored) how much each block counts beside a fit's residual; 1 on average."""
        square = self._objective.block_squares(residual) / self._memory
        _, heavy = _variance(square, self._counts / self._memory, self._floor)
        usual = np.sum(heavy * self._counts, axis=0) / np.maximum(self._counts.sum(axis=0), 1)
        found: FloatArray = heavy / np.where(usual > 0, usual, 1.0)
        return found

    def density(self, residual: FloatArray) -> float:
        """The log density of a fit's residual, over all blocks."""
        squares = self._objective.block_squares(residual)
        return float(_density(squares, self._counts, self._memory, self._floor).sum())


def _floor(objective: Objective, noise: FloatArray) -> FloatArray:
    return np.hypot(noise, NUMERICAL_LEFT * objective.numerical_size())


class Scoring:
    """Scores the structures within a fit.

    Args:
        objective: the recordings.
        one: the fit, to them.
        foretold: its residual, wherever its slopes lead.
        noise: (n_scored,) of the measurement.
    """

    def __init__(self, objective: Objective, one: Fit, foretold: Foretold, noise: FloatArray):
        self._foretold = foretold
        self._floor = _floor(objective, noise)
        self._count = objective.block_counts()
        self._part = objective.folds
        products = foretold.products(objective.weights(one.mean_square), self._part)
        self._pull = foretold.along @ products
        self._normal = self._pull @ foretold.along.T
        # What goes together: each part by itself, and all parts of a recording where it has others.
        _, first = np.unique(self._part, return_index=True)
        recording = objective.recording_of_block[first]
        self._together = [np.arange(len(first))]
        if recording.max() > 0:
            self._together.append(recording)
        self._prior = one.structure.prior_curvature(one.values) / objective.prior_samples

    def scores(
        self, structures: Sequence[tuple[FloatArray, NDArray[np.intp]]], memory: FloatArray
    ) -> list[Scores]:
        """Those of some structures.

        Args:
            structures: of each (n_columns,) of what its residual is made, and indices of the values
                that it has; the others are fixed.
            memory: (n_scored,) of the residuals.
        """
        made_of = [one for far, kept in structures for one in self._without_parts(far, kept)]
        squares = self._foretold.squares(np.stack(made_of))
        return [
            Scores(
                squares=each[0].copy(),  # which lasts longer than the others
                elsewhere=each[-1].copy(),
                count=self._count,
                memory=memory,
                floor=self._floor,
            )
            for each in np.split(squares, len(structures))
        ]

    def _without_parts(self, far: FloatArray, kept: NDArray[np.intp]) -> list[FloatArray]:
        """(n_blocks, n_columns) of what blocks are made without their part, or recording."""
        if not len(kept):
            return [np.tile(far, (len(self._part), 1)) for _ in self._together]
        normal = self._normal[:, kept[:, None], kept]
        total = normal.sum(axis=0) + np.diag(self._prior[kept])
        pull = self._pull[:, kept] @ far
        # Where slopes of another place led, what is left still pulls in all parts together.
        pull -= normal @ np.linalg.solve(total, pull.sum(axis=0))
        # What a part alone knows of may be open without it; its prior holds it then.
        ridge = 1e-12 * np.trace(total) * np.eye(len(kept))
        found = []
        for of_part in self._together:
            has = np.equal.outer(np.arange(of_part.max() + 1), of_part).astype(float)
            without = total - np.tensordot(has, normal, 1) + ridge
            step = np.linalg.solve(without, (has @ pull)[..., None])[of_part, :, 0]
            moved = far + step @ self._foretold.along[kept]
            found.append(moved[self._part])
        return found


def memory_of(objective: Objective, residual: FloatArray) -> FloatArray:
    """(n_scored,) 1 + 2 Σ of the autocorrelation up to where it first vanishes, in samples."""
    spans, durations = objective.spans
    present = np.isfinite(objective.measured)
    memory = np.ones(residual.shape[1])
    for c in range(residual.shape[1]):
        longest = 1
        total = np.zeros(1)
        for span, duration in zip(spans, durations, strict=True):
            own = residual[span, c][present[span, c]]
            if own.size < 2:
                continue
            own = own - own.mean()  # a bias is no memory
            lags = min(own.size - 1, int(_LONGEST * own.size / max(duration, 1e-9)))
            size = 1 << int(2 * own.size - 1).bit_length()
            spectrum = np.abs(np.fft.rfft(own, size)) ** 2
            product = np.fft.irfft(spectrum, size)[: lags + 1]
            longest = max(longest, lags + 1)
            total = np.pad(total, (0, max(0, longest - total.size)))
            total[: product.size] += product
        if total[0] <= 0:
            continue
        correlation = total / total[0]
        ends = np.flatnonzero(correlation <= 0)
        memory[c] = 1 + 2 * correlation[1 : ends[0] if ends.size else None].sum()
    # Blocks are taken as independent, so that each tells something of each channel.
    counts = objective.block_counts()
    return np.clip(memory, 1.0, np.maximum(1.0, np.median(counts, axis=0)))
