"""The numerical error at some values, and for which others it will do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.numerical_error import NumericalError
from walkerkit.gap.search.structure import Structure

FloatArray = NDArray[np.float64]

_SAME_ERROR = 0.05  # of a number's scale, over which that hardly changes
_NO_MATTER = 0.03  # of a gap, which a numerical error may change


@dataclass(frozen=True, kw_only=True)
class KnownError:
    """The numerical error at some values.

    Attributes:
        structure: what they are values of.
        values: (n_parameters,).
        error: the error.
        size: (n_scored,) root mean square of it.
    """

    structure: Structure
    values: FloatArray
    error: NumericalError
    size: FloatArray

    def suits(self, structure: Structure, values: FloatArray, gap: FloatArray) -> bool:
        """Whether it is as good as that at other values.

        Either these are nearly the same, or it is small beside the gap and all that is there was
        there, too.

        Args:
            structure: what they are values of.
            values: (n_parameters,).
            gap: (n_scored,) that they leave, with the numerical error in it.
        """
        if structure.key == self.structure.key:
            # The error of a delay between two steps is another than that of whole steps.
            late = np.array([slot.parameter.is_delay for slot in structure.slots], dtype=bool)
            near = np.where(late, 0.0, _SAME_ERROR * structure.scale)
            if (np.abs(values - self.values) <= near).all():
                return True
        return bool(
            self.error.ways
            and self.error.starts is None
            and (self.size <= _NO_MATTER * gap).all()
            and _there(structure, values) <= _there(self.structure, self.values)
        )


def _there(structure: Structure, values: FloatArray) -> set[str]:
    """The effects that some value makes differ from nothing."""
    changed = zip(structure.slots, values, structure.zero, strict=True)
    return {slot.term.effect.name for slot, value, zero in changed if value != zero}
