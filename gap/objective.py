"""How well a structure explains the recordings: residuals, and one score.

The score is the mean over the measured channels of ½ log(mean square gap + floor²): the log of the
geometric mean of their gaps. It is the profile likelihood of channels whose error variance is
unknown, so neither units nor an optimistic noise estimate decide what counts; 0.05 less means
gaps that are five per cent smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.replay import Channel, Replay
from walkerkit.gap.structure import Structure
from walkerkit.gap.trials import Trials

FloatArray = NDArray[np.float64]

_MEMORY = 2**28  # bytes of residuals held at once, unless one case alone takes more
_BLOCK = 0.5  # s; longer than the memory of a joint's error


@dataclass(frozen=True, kw_only=True)
class Case:
    """Some values of a structure, to be simulated.

    Attributes:
        structure: the structure.
        values: (n, n_parameters).
    """

    structure: Structure
    values: FloatArray


class Objective:
    """Recordings of one or several robots, compared with what structures predict.

    Args:
        replays: one per robot, over the same channels.
        scored: channels that count; the others are only simulated.
        floor: (n_scored,) gap below which nothing is gained, in each channel's unit.

    Attributes:
        correction: (rows, n_scored) added to every prediction: the simulation's own numerical
            error, to first order, so that no effect is named for it. Zero until it is set.
        block: (rows,) index of the stretch of about half a second that a row belongs to.
    """

    def __init__(self, replays: Sequence[Replay], scored: Sequence[Channel], floor: FloatArray):
        self.replays = tuple(replays)
        self.channels = tuple(scored)
        self.floor = floor
        self._columns = [replays[0].channels.index(channel) for channel in scored]
        self.measured = np.concatenate([r.measured[:, self._columns] for r in replays])
        self.correction = np.zeros_like(self.measured)
        self.count = np.isfinite(self.measured).sum(axis=0)
        self.block = _blocks(replays)

    @property
    def steps(self) -> int:
        """Simulation steps of one evaluation."""
        return sum(replay.steps for replay in self.replays)

    def residuals(self, cases: Sequence[Case]) -> list[FloatArray]:
        """Predicted minus measured, (n, rows, n_scored) a case; 0 where nothing was measured.

        Rows of trials that diverged are NaN.
        """
        sizes = [len(case.values) for case in cases]
        missing = np.isnan(self.measured)
        stacks = []
        for replay in self.replays:
            blocks = [case.structure.trials(replay.robot, case.values) for case in cases]
            predicted = replay.predict(Trials.joined(blocks))
            stacks.append(predicted[:, :, self._columns])
        residual = np.concatenate(stacks, axis=1) + self.correction - self.measured
        residual[:, missing] = 0.0
        failed = [np.isnan(s).all(axis=2).any(axis=1) for s in stacks]
        residual[np.any(failed, axis=0)] = np.nan
        return np.split(residual, np.cumsum(sizes)[:-1])

    def grouped(self, cases: Sequence[Case]) -> list[slice]:
        """Consecutive cases whose residuals fit into memory together."""
        row_bytes = 8 * self.measured.size
        groups, start, size = [], 0, 0
        for i, case in enumerate(cases):
            need = row_bytes * len(case.values)
            if size and size + need > _MEMORY:
                groups.append(slice(start, i))
                start, size = i, 0
            size += need
        return [*groups, slice(start, len(cases))]

    def mean_squares(self, cases: Sequence[Case]) -> list[FloatArray]:
        """(n, n_scored) mean square gaps a case, NaN for trials that diverged."""
        return [
            self.mean_square(residual)
            for group in self.grouped(cases)
            for residual in self.residuals(cases[group])
        ]

    def mean_square(self, residual: FloatArray) -> FloatArray:
        """(..., rows, n_scored) residuals → (..., n_scored) mean squares."""
        return np.einsum("...rc,...rc->...c", residual, residual) / self.count

    def score(self, mean_square: FloatArray) -> FloatArray:
        """(..., n_scored) mean squares → (...) scores; infinity for a trial that diverged."""
        score = 0.5 * np.log(mean_square + self.floor**2).mean(axis=-1)
        return np.where(np.isnan(score), np.inf, score)

    def weights(self, mean_square: FloatArray) -> FloatArray:
        """(n_scored,) factors that make ½ Σ w r² change as the score does near these gaps."""
        return 1 / (self.count * (mean_square + self.floor**2)) / len(self.channels)

    def block_squares(self, residual: FloatArray) -> FloatArray:
        """(rows, n_scored) residuals → (n_blocks, n_scored) sums of squares."""
        return np.stack(
            [np.bincount(self.block, weights=column**2) for column in residual.T], axis=1
        )

    def block_counts(self) -> FloatArray:
        """(n_blocks, n_scored) measured samples."""
        present = np.isfinite(self.measured).astype(float)
        return np.stack([np.bincount(self.block, weights=column) for column in present.T], axis=1)


def _blocks(replays: Sequence[Replay]) -> NDArray[np.int64]:
    labels, offset = [], 0
    for replay in replays:
        within = (replay.time_of_row / _BLOCK).astype(np.int64)
        pairs = np.stack([replay.segment_of_row, within])
        _, label = np.unique(pairs, axis=1, return_inverse=True)
        labels.append(label.ravel() + offset)
        offset += int(label.max()) + 1
    return np.concatenate(labels)
