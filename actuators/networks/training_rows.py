"""A log as the rows that train an actuator network: histories, scales, and the split in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.networks.history import InputOrder

FloatArray = NDArray[np.float64]

_FEWEST_ROWS = 10  # of time, on either side of the split
_CONSTANT = 1e-12  # spread over size, at which only rounding is left


class Scales(TypedDict):
    """Factors on the rows of a network, as in `History`, and on its output."""

    pos_scale: float
    vel_scale: float
    torque_scale: float


@dataclass(frozen=True, kw_only=True)
class TrainingRows:
    """Scaled rows of all joints, each a pair of features (n, 2·history_length) and efforts (n, 1).

    Attributes:
        scales: what they are scaled with.
        training: rows whose history lies before the split.
        validation: rows whose history lies behind it.
    """

    scales: Scales
    training: tuple[FloatArray, FloatArray]
    validation: tuple[FloatArray, FloatArray]

    @classmethod
    def of(
        cls,
        signals: Mapping[str, ArrayLike],
        *,
        history_length: int,
        input_order: InputOrder,
        given: Mapping[str, float | None],
        validation_fraction: float,
    ) -> TrainingRows:
        """Makes rows of a log.

        Args:
            signals: `position_error`, `velocity` and `effort`, each (T, n_joints).
            history_length: samples of each signal in a row.
            input_order: which signal comes first in a row.
            given: `pos_scale`, `vel_scale` and `torque_scale`, None for one from the training time.
            validation_fraction: share of the time, at its end, that is held out.

        Raises:
            ValueError: Signals differ in shape, are not finite or too short, or an argument is out
                of range.
        """
        error, velocity, effort = _check_signals(signals)
        cut = _split(len(error), history_length, validation_fraction)
        scales: Scales = {
            "pos_scale": _scale("pos_scale", given, 1.0 / _spread(error[:cut])),
            "vel_scale": _scale("vel_scale", given, 1.0 / _spread(velocity[:cut])),
            "torque_scale": _scale("torque_scale", given, _spread(effort[:cut])),
        }
        blocks = [
            scales["pos_scale"] * _histories(error, history_length),
            scales["vel_scale"] * _histories(velocity, history_length),
        ]
        features = np.concatenate(blocks if input_order == "pos_vel" else blocks[::-1], axis=-1)
        targets = effort[history_length - 1 :, :, None] / scales["torque_scale"]
        # Features begin with the first full history: row k ends at sample k + history_length − 1.
        ends, starts = cut - (history_length - 1), cut
        return cls(
            scales=scales,
            training=(_flat(features[:ends]), _flat(targets[:ends])),
            validation=(_flat(features[starts:]), _flat(targets[starts:])),
        )


def _histories(signal: FloatArray, length: int) -> FloatArray:
    """(T − length + 1, n_joints, length), newest first."""
    return np.lib.stride_tricks.sliding_window_view(signal, length, axis=0)[..., ::-1]


def _flat(array: FloatArray) -> FloatArray:
    return np.ascontiguousarray(array.reshape(-1, array.shape[-1]))


def _scale(name: str, given: Mapping[str, float | None], default: float) -> float:
    value = given[name]
    scale = default if value is None else float(value)
    if not 0 < scale < np.inf:
        raise ValueError(f"`{name}` is {scale!r}: use a finite number above 0")
    return scale


def _spread(signal: FloatArray) -> float:
    """Standard deviation; 1 for a signal that never changes, which no scale can help."""
    spread = float(np.std(signal))
    return spread if spread > _CONSTANT * float(np.abs(signal).max()) else 1.0


def _split(n_times: int, history_length: int, validation_fraction: float) -> int:
    """The first held-out time."""
    if not 0 < validation_fraction < 1:
        raise ValueError(
            f"`validation_fraction` is {validation_fraction!r}: use a number between 0 and 1, say "
            "0.2"
        )
    cut = n_times - round(validation_fraction * n_times)
    fewest = _FEWEST_ROWS + history_length - 1
    if min(cut, n_times - cut) < fewest:
        raise ValueError(
            f"the signals have {n_times} rows, of which {cut} are for training and "
            f"{n_times - cut} held out; with a history of {history_length} each needs at least "
            f"{fewest}: give a longer log, or change `validation_fraction`"
        )
    return cut


def _check_signals(signals: Mapping[str, ArrayLike]) -> list[FloatArray]:
    arrays = {name: np.asarray(signal, dtype=np.float64) for name, signal in signals.items()}
    shape = next(iter(arrays.values())).shape
    for name, array in arrays.items():
        if array.ndim != 2 or array.shape[1] == 0:
            raise ValueError(
                f"`{name}` has shape {array.shape}, expected (T, n_joints): for one joint use "
                "signal[:, None]"
            )
        if array.shape != shape:
            raise ValueError(
                f"`{name}` has shape {array.shape}, `position_error` {shape}: give all signals at "
                "the same times, for the same joints"
            )
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            row, joint = (int(i) for i in bad[0])
            raise ValueError(
                f"`{name}`[{row}, {joint}] is {array[row, joint]}: give finite numbers, cut such "
                "rows out at an end or interpolate them"
            )
    return list(arrays.values())
