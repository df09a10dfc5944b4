"""Checks that the networks share."""

from __future__ import annotations

from collections.abc import Sequence
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def frozen_floats(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Returns a read-only copy of finite numbers.

    Args:
        name: what to call it in an error.
        value: the numbers.
        shape: its shape, with None for a length of at least 1 that is free.

    Raises:
        ValueError: The shape is another one, or an entry is not a finite number.
    """
    given = np.asarray(value)
    if given.dtype.kind not in "fiu":
        raise ValueError(f"`{name}` has dtype {given.dtype}, expected numbers: use .astype(float)")
    expected = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
    fits = len(given.shape) == len(shape) and all(
        found > 0 if wanted is None else found == wanted
        for found, wanted in zip(given.shape, shape, strict=True)
    )
    if not fits:
        raise ValueError(
            f"`{name}` has shape {given.shape}, expected {expected}: a weight is (outputs, "
            "inputs), its inputs are the outputs of the layer before, and a bias is (outputs,)"
        )
    array = np.array(given, dtype=np.float64)
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(
            f"`{name}`{list(index)} is {array[index]}, expected finite numbers: train or convert "
            "the network again"
        )
    array.flags.writeable = False
    return array


def check_shape(name: str, found: tuple[int, ...], expected: tuple[int, ...]) -> None:
    """Refuses an array of another shape, also one that would broadcast.

    Raises:
        ValueError: The shapes differ.
    """
    if found != expected:
        raise ValueError(
            f"`{name}` has shape {found}, expected {expected}: pass an array of that shape, or "
            "make this object for the shape that you have"
        )


def row_index(
    rows: Sequence[int] | NDArray[Any] | None, shape: tuple[int, ...]
) -> NDArray[Any] | EllipsisType:
    """Returns an index of the first axis, where that is the axis of simulations.

    Args:
        rows: which simulations, as numbers or as a mask (n_sims,); None for all.
        shape: (n_joints,) of one simulation, or (n_sims, n_joints).

    Raises:
        ValueError: There are no simulations to choose from, or not these.
    """
    if rows is None:
        return ...
    if len(shape) < 2:
        raise ValueError(
            f"`rows` is {rows!r}, but the shape {shape} has no axis of simulations: leave it out"
        )
    index = np.asarray(rows)
    if index.dtype == bool:
        check_shape("rows", index.shape, shape[:1])
        return index
    if index.size == 0:
        return np.zeros(0, dtype=np.intp)
    if index.dtype.kind not in "iu" or index.ndim != 1:
        raise ValueError(
            f"`rows` is {rows!r}, expected the numbers of simulations, or a mask of {shape[0]}"
        )
    outside = index[(index < 0) | (index >= shape[0])]
    if outside.size:
        raise ValueError(
            f"`rows` names simulation {outside[0]}, there are {shape[0]}: use 0 to {shape[0] - 1}"
        )
    return index
