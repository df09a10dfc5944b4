"""Residuals that were simulated not long ago: what is asked for again is not simulated again.

    wanted = recent.wanted(objective, cases)
    residual = wanted.filled(simulate(wanted.unknown))      # (n of all cases, rows, n_scored)

A search comes back to the same values: a fit that is compared was the end of another, and slopes
begin with the residual that the last step has found.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.structure import Case

FloatArray = NDArray[np.float64]

_MOST = 2**27  # bytes


class Recent:
    """What was found at rows of values, as much of the latest as there is room for."""

    def __init__(self) -> None:
        self._found: OrderedDict[Hashable, FloatArray] = OrderedDict()
        self._size = 0

    def wanted(self, owner: Hashable, cases: Sequence[Case]) -> Wanted:
        """What is known of some cases' rows to one owner."""
        return Wanted(self, owner, cases)

    def get(self, key: Hashable) -> FloatArray | None:
        """What was found at a row, or None."""
        found = self._found.get(key)
        if found is not None:
            self._found.move_to_end(key)
        return found

    def put(self, key: Hashable, found: FloatArray) -> None:
        """Keeps a copy of what was found at a row, and gives up the oldest for it."""
        if key in self._found or found.nbytes > _MOST:
            return
        self._found[key] = found.copy()
        self._size += found.nbytes
        while self._size > _MOST:
            _, oldest = self._found.popitem(last=False)
            self._size -= oldest.nbytes


class Wanted:
    """Cases of which some rows may be known.

    Attributes:
        unknown: the cases with the other rows only; none where all are known.
    """

    def __init__(self, recent: Recent, owner: Hashable, cases: Sequence[Case]):
        self._recent = recent
        # Of starts with errors every row has its own, and none is asked for again.
        self._keys = [
            None if case.start_errors else (owner, case.structure.key, row.tobytes())
            for case in cases
            for row in case.values
        ]
        self._known = {
            k: found
            for k, key in enumerate(self._keys)
            if key is not None and (found := recent.get(key)) is not None
        }
        self._left = np.array([k not in self._known for k in range(len(self._keys))], dtype=bool)
        self.unknown = _some(cases, self._left)

    def filled(self, found: FloatArray | None) -> FloatArray:
        """What is known and what was found at the other rows, in their order.

        Args:
            found: (n of `unknown`, ...), or None where that is nothing.
        """
        left = np.flatnonzero(self._left)
        for k, one in zip(left, () if found is None else found, strict=True):
            # What diverges is simulated each time, and warned of each time.
            if self._keys[k] is not None and np.isfinite(one).all():
                self._recent.put(self._keys[k], one)
        if found is not None and not self._known:
            return found
        known = np.stack(list(self._known.values()))
        whole = np.empty((len(self._keys), *known.shape[1:]))
        whole[list(self._known)] = known
        if found is not None:
            whole[left] = found
        return whole


def _some(cases: Sequence[Case], rows: NDArray[np.bool_]) -> list[Case]:
    """Some rows of cases, without the cases of which nothing is left."""
    found = []
    for case, mine in zip(
        cases, np.split(rows, np.cumsum([len(case.values) for case in cases])[:-1]), strict=True
    ):
        if mine.all():
            found.append(case)
        elif mine.any():
            found.append(replace(case, values=case.values[mine]))
    return found
