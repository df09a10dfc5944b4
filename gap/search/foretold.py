"""What slopes foretell of a fit's residual after any step: sums of squares, by algebra alone.

    foretold = Foretold(objective, slopes)
    far = foretold.far(step)             # of what the residual is made there
    foretold.squares(far[None, None])    # (1, n_blocks, n_scored)
    foretold.score(step)

A residual is made of columns: that of the fit, what each number changes, and what each way to
integrate does. Its sums of squares are quadratic forms in how much there is of each. They are found
block by block, of each channel over the columns that change it: what moves one leg moves no other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.numerical_error import bounded_least_squares
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.slopes import Slopes

FloatArray = NDArray[np.float64]

_SAME = 1e-9  # of its squares, that a column may have beside what others make of it


class Foretold:
    """The residual of a fit, wherever its slopes lead.

    Args:
        objective: the recordings.
        slopes: of the fit.

    Attributes:
        along: (n_parameters, n_columns) the columns by which a small step changes the residual: the
            numerical error follows.
    """

    def __init__(self, objective: Objective, slopes: Slopes):
        self._objective = objective
        residual, simulated, changes = slopes.residual, slopes.jacobian, slopes.jacobian[:0]
        if slopes.uncorrected is not None:
            residual, simulated = slopes.uncorrected
            changes = objective.numerical.changes
        parts = [residual[None], simulated, changes]
        n, k = len(simulated), len(changes)
        self.along = np.hstack([np.zeros((n, 1)), np.eye(n), np.zeros((n, k))])
        if slopes.uncorrected is not None:
            follows = _made_of(changes, slopes.jacobian, simulated)
            if follows is None:  # as of another numerical error
                parts.append(slopes.jacobian)
                self.along = np.hstack([np.zeros((n, 1 + n + k)), np.eye(n)])
            else:
                self.along[:, 1 + n :] = follows
        self._n_columns = self.along.shape[1]
        self._numbers, self._errors = slice(1, 1 + n), slice(1 + n, 1 + n + k)
        self._products = _products(objective, parts)
        self._whole = [(columns, each.sum(axis=0)) for columns, each in self._products]
        of_errors = [_spread(*one, self._n_columns)[self._errors] for one in self._whole]
        self._of_errors = np.stack(of_errors)

    def far(self, step: FloatArray) -> FloatArray:
        """(n_columns,) of what the residual is made after a step, in scales, however long.

        The numerical error is taken out of it within its bounds, which a long step may reach.
        """
        objective = self._objective
        found = np.zeros(self._n_columns)
        found[0], found[self._numbers] = 1.0, step
        if self._errors.start < self._errors.stop:
            weights = objective.error_weights(self.mean_square(found))
            of_errors = np.einsum("c,cij->ij", weights, self._of_errors)
            (factors,) = bounded_least_squares(
                of_errors[None, :, self._errors],
                -(of_errors @ found)[None],
                objective.numerical.bounds,
            )
            found[self._errors] = factors
        return found

    def squares(self, made_of: FloatArray) -> FloatArray:
        """Sums of squares of blocks, of several residuals at once.

        Args:
            made_of: (n, n_blocks, n_columns) of what each is made in each block, or (n, 1,
                n_columns) in all of them.

        Returns:
            (n, n_blocks, n_scored).
        """
        each = np.moveaxis(made_of, 0, -1)
        found = []
        for columns, products in self._products:
            own = each[:, columns]
            found.append(np.sum((products @ own) * own, axis=1).T)
        squares: FloatArray = np.maximum(np.stack(found, axis=-1), 0.0)
        return squares

    def mean_square(self, made_of: FloatArray) -> FloatArray:
        """(n_columns,) → (n_scored,) mean squares over all blocks."""
        found = [made_of[own] @ products @ made_of[own] for own, products in self._whole]
        squares: FloatArray = np.maximum(found, 0.0) / self._objective.count
        return squares

    def score(self, step: FloatArray) -> float:
        """The score after a step, in scales, however long."""
        return float(self._objective.score(self.mean_square(self.far(step))))

    def products(self, weights: FloatArray, part: NDArray[np.int64]) -> FloatArray:
        """(n_parts, n_columns, n_columns) weighted products of columns over parts of all blocks.

        Args:
            weights: (n_scored,) of the channels.
            part: (n_blocks,) index of each block's.
        """
        found = np.zeros((int(part.max()) + 1, self._n_columns, self._n_columns))
        for weight, (columns, products) in zip(weights, self._products, strict=True):
            for k, one in enumerate(found):
                one[np.ix_(columns, columns)] += weight * products[part == k].sum(axis=0)
        return found


def _products(
    objective: Objective, parts: list[FloatArray]
) -> list[tuple[NDArray[np.intp], FloatArray]]:
    """Of each channel the columns that change it, and (n_blocks, …, …) products of these."""
    first = np.flatnonzero(np.diff(objective.block, prepend=-1))
    blocks = [slice(*ends) for ends in zip(first, [*first[1:], len(objective.block)], strict=True)]
    changed = np.concatenate([part.any(axis=1) for part in parts])
    offsets = np.cumsum([0, *(len(part) for part in parts)])
    found = []
    for c, has in enumerate(changed.T):
        columns = np.flatnonzero(has)
        own = np.concatenate(
            [
                part[columns[(columns >= low) & (columns < low + len(part))] - low, :, c]
                for part, low in zip(parts, offsets, strict=False)
            ]
        )
        found.append((columns, np.stack([own[:, rows] @ own[:, rows].T for rows in blocks])))
    return found


def _spread(columns: NDArray[np.intp], products: FloatArray, count: int) -> FloatArray:
    """Products of some columns among those of all."""
    found = np.zeros((count, count))
    found[np.ix_(columns, columns)] = products
    return found


def _made_of(changes: FloatArray, ones: FloatArray, others: FloatArray) -> FloatArray | None:
    """(n, k) how much of each change is in the differences of n from others; None if more is."""
    difference, over = ones - others, ((1, 2), (1, 2))
    shared = np.tensordot(difference, changes, over)
    found: FloatArray = shared @ np.linalg.pinv(
        np.tensordot(changes, changes, over), hermitian=True
    )
    whole = np.einsum("nrc,nrc->n", difference, difference)
    left = whole - np.sum(found * shared, axis=1)
    return found if (left <= _SAME * whole).all() else None
