"""The numerical error at some values, and for which others it will do."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.numerical_error import NumericalError
from walkerkit.gap.search.structure import Structure

FloatArray = NDArray[np.float64]

_SAME_ERROR = 0.05  # of a number's scale, over which that hardly changes


@dataclass(frozen=True, kw_only=True)
class KnownError:
    """The numerical error at some values.

    Attributes:
        structure: what they are values of.
        values: (n_parameters,).
        error: the error, without what errors in starting states change.
        started: (k, rows, n_scored) what these change; None where they are taken as they are.
    """

    structure: Structure
    values: FloatArray
    error: NumericalError
    started: FloatArray | None

    def is_near(self, structure: Structure, values: FloatArray, *, jumps: bool = False) -> bool:
        """Whether other values are nearly the same, so that their error is.

        Args:
            structure: what they are values of.
            values: (n_parameters,).
            jumps: residuals jump, so that only the same values have the same error.
        """
        if structure.key != self.structure.key:
            return False
        # The error of a delay between two steps is another than that of whole steps.
        late = [jumps or slot.parameter.is_delay for slot in structure.slots]
        near = np.where(late, 0.0, _SAME_ERROR * structure.scale)
        return bool((np.abs(values - self.values) <= near).all())

    @property
    def of_half(self) -> FloatArray:
        """(rows, n_scored) what half the timestep changes."""
        found: FloatArray = self.error.changes[self.error.ways.index("half")]
        return found

    def times(self, factor: FloatArray) -> KnownError:
        """That of residuals that are so many times as large, (rows, n_scored)."""
        return replace(
            self,
            error=replace(self.error, changes=factor * self.error.changes),
            started=None if self.started is None else factor * self.started,
        )
