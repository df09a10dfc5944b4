"""The input rows of a learned actuator: what its joints did lately.

    history = History((12,), history_length=3, pos_scale=1.0, vel_scale=0.05)
    history.reset()
    features = history.push(position_error, velocity)   # (12,), (12,) → (12, 6)

A row is [e_t, e_{t−1}, …]·pos_scale, then [v_t, v_{t−1}, …]·vel_scale, or the velocities first
where the order is "vel_pos". `history_length` counts the present sample. After a reset the first
sample also stands for the past.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.networks.array_checks import check_shape, row_index

FloatArray = NDArray[np.float64]
InputOrder = Literal["pos_vel", "vel_pos"]


class History:
    """The last samples of every joint, newest first.

    Attributes:
        shape: (n_joints,) of one simulation, or (n_sims, n_joints).
        history_length: samples kept of each signal, the present one included.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        *,
        history_length: int,
        pos_scale: ArrayLike = 1.0,
        vel_scale: ArrayLike = 1.0,
        input_order: InputOrder = "pos_vel",
    ):
        """Makes a history that has been reset.

        Args:
            shape: (n_joints,) of one simulation, or (n_sims, n_joints).
            history_length: samples kept of each signal, the present one included; at least 1.
            pos_scale: factor on position errors [1/rad, or 1/m], one or (n_joints,).
            vel_scale: factor on velocities [s/rad, or s/m], one or (n_joints,).
            input_order: which signal comes first in a row.

        Raises:
            ValueError: An argument is not of these.
        """
        check_history(history_length, input_order)
        if not shape:
            raise ValueError("`shape` is (): use (n_joints,) or (n_sims, n_joints)")
        self.shape = shape
        self.history_length = history_length
        self._pos_scale = _scale("pos_scale", pos_scale, shape[-1])
        self._vel_scale = _scale("vel_scale", vel_scale, shape[-1])
        self._rows = np.zeros((*shape, 2 * history_length))
        self._visible = self._rows.view()
        self._visible.flags.writeable = False
        blocks = (self._rows[..., :history_length], self._rows[..., history_length:])
        self._errors, self._velocities = blocks if input_order == "pos_vel" else blocks[::-1]
        self._error_now, self._velocity_now = self._errors[..., 0], self._velocities[..., 0]
        self._is_new = np.ones(shape[:-1], dtype=bool)
        self._any_new = True

    @property
    def features(self) -> FloatArray:
        """(*shape, 2·history_length), as of the last push; read-only, overwritten by the next."""
        return self._visible

    def reset(self, rows: Sequence[int] | NDArray[Any] | None = None) -> None:
        """Forgets the past, of some simulations or of all.

        Args:
            rows: which simulations, as numbers or as a mask (n_sims,); None for all.

        Raises:
            ValueError: There are no such simulations.
        """
        index = row_index(rows, self.shape)
        self._rows[index] = 0.0
        self._is_new[index] = True
        self._any_new = bool(self._is_new.any())

    def push(self, error: FloatArray, velocity: FloatArray) -> FloatArray:
        """Takes the present sample.

        Args:
            error: position target − position, `shape` [rad, or m].
            velocity: `shape` [rad/s, or m/s].

        Returns:
            `features`.

        Raises:
            ValueError: An array has another shape.
        """
        if error.shape != self.shape or velocity.shape != self.shape:
            check_shape("error", error.shape, self.shape)
            check_shape("velocity", velocity.shape, self.shape)
        # Both blocks at once; what slips from one into the other is what is written next.
        self._rows[..., 1:] = self._rows[..., :-1]
        np.multiply(error, self._pos_scale, out=self._error_now)
        np.multiply(velocity, self._vel_scale, out=self._velocity_now)
        if self._any_new:
            self._backfill()
        return self._visible

    def _backfill(self) -> None:
        new = self._is_new[..., None, None]
        np.copyto(self._errors, self._error_now[..., None], where=new)
        np.copyto(self._velocities, self._velocity_now[..., None], where=new)
        self._is_new[...] = False
        self._any_new = False


def check_history(history_length: int, input_order: str) -> None:
    """Refuses what a history cannot be.

    Raises:
        ValueError: The length is not a positive integer, or the order is unknown.
    """
    is_integer = isinstance(history_length, int | np.integer)
    if not is_integer or isinstance(history_length, bool) or history_length < 1:
        raise ValueError(
            f"`history_length` is {history_length!r}, expected an integer of at least 1: it counts "
            "the present sample, so 3 is the present and two past ones"
        )
    if input_order not in get_args(InputOrder):
        raise ValueError(
            f"`input_order` is {input_order!r}: use 'pos_vel' or 'vel_pos', as in training"
        )


def _scale(name: str, value: ArrayLike, n_joints: int) -> FloatArray:
    scale = np.array(value, dtype=np.float64)
    if scale.shape not in ((), (n_joints,)):
        raise ValueError(
            f"`{name}` has shape {scale.shape}, expected one number or ({n_joints},): give one "
            "for each joint"
        )
    if not np.isfinite(scale).all():
        raise ValueError(f"`{name}` is {value!r}: use finite numbers")
    return scale
