"""What training an actuator network gives."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.networks.history import InputOrder
from walkerkit.actuators.networks.mlp import Mlp

FloatArray = NDArray[np.float64]

_OVERFITTED = 2.0  # held-out over training error
_POOR = 0.5  # held-out error over the effort's spread


class LearnedMlpFields(TypedDict):
    """The fields of a `LearnedMlpActuatorCfg` that belong to its network."""

    network_file: str
    pos_scale: float
    vel_scale: float
    torque_scale: float
    input_order: InputOrder
    history_length: int


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedMlp:
    """A trained network, the scales it was trained with, and how training went.

    Attributes:
        mlp: the network, from a row of `History` to effort / torque_scale.
        pos_scale: factor on position errors [1/rad, or 1/m].
        vel_scale: factor on velocities [s/rad, or s/m].
        torque_scale: factor on the network's output [N·m, or N].
        input_order: order of the row.
        history_length: samples of each signal in the row.
        training_error: (n_epochs,) root-mean-square error over each epoch's batches [N·m, or N].
        validation_error: (n_epochs,) the same for the held-out time, after each epoch.
        validation_spread: standard deviation of the held-out effort [N·m, or N].
        best_epoch: the epoch, counted from 0, after which the network was kept.
        stopped_early: whether the held-out error had stopped falling.
    """

    mlp: Mlp
    pos_scale: float
    vel_scale: float
    torque_scale: float
    input_order: InputOrder
    history_length: int
    training_error: FloatArray
    validation_error: FloatArray
    validation_spread: float
    best_epoch: int
    stopped_early: bool

    def __post_init__(self) -> None:
        for name in ("training_error", "validation_error"):
            errors = np.array(getattr(self, name), dtype=np.float64)
            errors.flags.writeable = False
            object.__setattr__(self, name, errors)

    @property
    def held_out_error(self) -> float:
        """Root-mean-square error of the kept network on the held-out time [N·m, or N]."""
        return float(self.validation_error[self.best_epoch])

    def save(self, path: Path | str) -> LearnedMlpFields:
        """Writes the network, and returns what a config needs to use it.

            LearnedMlpActuatorCfg(joint_names_expr=(".*_ankle",), **trained.save("ankle.npz"), ...)

        Raises:
            FileNotFoundError: The folder does not exist.
            ValueError: The name does not end in `.npz`.
        """
        self.mlp.save(path)
        return {
            "network_file": str(path),
            "pos_scale": self.pos_scale,
            "vel_scale": self.vel_scale,
            "torque_scale": self.torque_scale,
            "input_order": self.input_order,
            "history_length": self.history_length,
        }

    def __str__(self) -> str:
        held_out, training = self.held_out_error, float(self.training_error[self.best_epoch])
        share = held_out / self.validation_spread if self.validation_spread else np.inf
        lines = [
            f"Predicts the held-out effort to {held_out:.4g} (rms), {100 * share:.2g} % of its "
            f"spread of {self.validation_spread:.4g}.",
            f"  epochs {len(self.validation_error)}, kept {self.best_epoch + 1}; "
            f"training error {training:.4g}, held-out error {held_out:.4g} [N·m, or N]",
            f"  pos_scale {self.pos_scale:.6g}, vel_scale {self.vel_scale:.6g}, "
            f"torque_scale {self.torque_scale:.6g}, history_length {self.history_length}, "
            f"input_order {self.input_order}",
        ]
        notes = []
        if not self.stopped_early:
            notes.append("The held-out error was still falling at the end: raise `max_epochs`.")
        if held_out > _OVERFITTED * training:
            notes.append(
                f"The held-out error is {held_out / training:.1f} times the training error: the "
                "held-out time is unlike the rest, or the network too large for the data."
            )
        if share > _POOR:
            notes.append(
                "Most of the effort is not explained: check the signs, units and synchronisation "
                "of the signals, or raise `history_length`."
            )
        return "\n".join(lines + [f"  {n}. {note}" for n, note in enumerate(notes, start=1)])
