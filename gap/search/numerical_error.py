"""The simulation's own numerical error, which is a nuisance of every prediction.

What a finer timestep changes, and what another integrator, drier friction and a still finer
timestep change then, are added to a prediction by the factors that suit the measurement best: all 0
for a log from a simulation with the same timestep; 1, 0, about 1 and up to 2 for a machine, which
has no such error, if the timesteps are a half and a quarter. So no effect is named for an error
that a finer step removes, or for how MuJoCo's solver rounds off the dry friction of a model. Nor
for the order in which a control loop reads efforts and sends targets, or for whether it logs those
of the cycle before, which a log does not tell.
Errors of the states that segments start from are taken out beside it (`starts`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.starting_states import Starts

FloatArray = NDArray[np.float64]
_Float = TypeVar("_Float", np.float32, np.float64)

Way = Literal["half", "integrator", "friction", "reading", "earlier", "quarter"]
"""Another way to integrate: half the timestep, and over that another integrator, friction that is
as dry as it goes, and a quarter of the timestep. And another way to read efforts: before the
targets beside them act, as a loop does that reads, computes and sends, and a timestep earlier, as
one does that logs those of the cycle before."""

# Of an error that goes with the timestep, half of it is in half the step: twice the change takes
# all of it out, and another integrator's is in the log by no more than twice what half of it shows.
_FACTORS: Final[Mapping[Way, tuple[float, float]]] = {
    "half": (0.0, 2.0),
    "integrator": (0.0, 2.0),
    "friction": (0.0, 2.0),
    "reading": (0.0, 1.0),
    "earlier": (0.0, 1.0),
    "quarter": (0.0, 2.5),
}
OF_READING: Final = ("reading", "earlier")
"""Those that change nothing but how efforts are read."""
_OVER_OWN = ("half", *OF_READING)  # the others change something of half the timestep
_SWEEPS = 30


@dataclass(frozen=True, eq=False)
class NumericalError:
    """What other ways to integrate change of a prediction.

    Attributes:
        ways: how else it was integrated.
        changes: (k, rows, n_scored), of half the timestep over its own, and of others over that;
            empty where the error is unknown or left alone. Freed of what starts can make.
        starts: what errors in the measured states that segments start from change; None where these
            are taken as they are.
    """

    ways: tuple[Way, ...]
    changes: FloatArray
    starts: Starts | None = None

    @classmethod
    def none(cls, shape: tuple[int, ...]) -> NumericalError:
        """No error of residuals of a shape, (rows, n_scored)."""
        return cls((), np.zeros((0, *shape)))

    @classmethod
    def of(cls, own: FloatArray, others: Mapping[Way, FloatArray]) -> NumericalError:
        """The error of some residuals; none where one of the others diverged.

        Args:
            own: (rows, n_scored) as simulated, at their own timestep.
            others: as simulated otherwise, with half the timestep among them.
        """
        half = others["half"]
        changes = np.stack(
            [each - (own if way in _OVER_OWN else half) for way, each in others.items()]
        )
        return cls(tuple(others), changes) if np.isfinite(changes).all() else cls.none(own.shape)

    def beside(self, starts: Starts) -> NumericalError:
        """This error, where errors in starting states are taken out, too."""
        changes = self.changes.copy()
        starts.free(changes)
        return replace(self, changes=changes, starts=starts)

    def free(self, residuals: NDArray[_Float]) -> None:
        """Takes out of (n, rows, n_scored) residuals, or changes of them, what starts can make."""
        if self.starts is not None:
            self.starts.free(residuals)

    @property
    def of_the_timestep(self) -> FloatArray:
        """(k, rows, n_scored) those changes that come of how it is integrated."""
        return self.changes[[way not in OF_READING for way in self.ways]]

    @property
    def bounds(self) -> FloatArray:
        """(k, 2) between which the factors of the changes lie."""
        return np.array([_FACTORS[way] for way in self.ways]).reshape(-1, 2)

    @cached_property
    def _products(self) -> FloatArray:
        """(k, k, n_scored) of the changes with each other."""
        return np.einsum("irc,jrc->ijc", self.changes, self.changes)  # type: ignore[no-any-return]

    def take_out(self, residual: FloatArray, weights: FloatArray) -> FloatArray:
        """Adds the best multiples of the changes to each (rows, n_scored) residual, in place.

        Args:
            residual: (n, rows, n_scored), freed of what starts can make; NaN for what diverged.
            weights: (n, n_scored) by which the channels decide on the factors.

        Returns:
            (n, k) those factors.
        """
        if not self._products.any():
            return np.zeros((len(residual), len(self.changes)))
        size = np.einsum("tc,ijc->tij", weights, self._products)
        along = np.einsum("tc,itc->ti", weights, np.einsum("irc,trc->itc", self.changes, residual))
        factors = bounded_least_squares(size, -along, self.bounds)
        for factor, change in zip(factors.T, self.changes, strict=True):
            residual += factor[:, None, None] * change
        return factors

    def take_out_along(
        self, residual: FloatArray, moved: FloatArray, weights: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """A residual with the error, (rows, n_scored), and changes of it, without.

        The error follows the change as far as it is free to (Kaufman, BIT 15, 1975), and not
        beyond: where a factor reaches a bound the gap bends, and its slope ahead says nothing of
        that behind.

        Args:
            residual: (rows, n_scored), freed of what starts can make.
            moved: (n, rows, n_scored) changes of it, as much freed, written to.
            weights: (n_scored,) as for `take_out`.
        """
        at = residual[None].copy()
        (factors,) = self.take_out(at, weights[None])
        low, high = self.bounds.T
        free = self.changes[(low < factors) & (factors < high)]
        if not len(free):
            return at[0], moved
        flat, weighted = free.reshape(len(free), -1), (free * weights).reshape(len(free), -1)
        along = weighted @ moved.reshape(len(moved), free[0].size).T
        follow = np.linalg.pinv(weighted @ flat.T, hermitian=True) @ along
        corrected = (follow.T @ flat).reshape(moved.shape)
        return at[0], np.subtract(moved, corrected, out=corrected)


def bounded_least_squares(matrix: FloatArray, target: FloatArray, bounds: FloatArray) -> FloatArray:
    """Minimises ½ xᵀAx − bᵀx within bounds, (t, k, k), (t, k) and (k, 2) → (t, k)."""
    x = np.zeros_like(target)
    # A trial that diverged has no weights; it stays at zero.
    matrix, target = np.nan_to_num(matrix), np.nan_to_num(target)
    for _ in range(_SWEEPS):
        before = x.copy()
        for i, (low, high) in enumerate(bounds):
            diagonal = matrix[:, i, i]
            rest = target[:, i] - np.einsum("tj,tj->t", matrix[:, i], x) + diagonal * x[:, i]
            x[:, i] = np.clip(rest / np.where(diagonal > 0, diagonal, 1.0), low, high)
        if (x == before).all():
            break
    return x
