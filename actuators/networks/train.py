"""Trains an actuator network on a log, with the extra `walkerkit[torch]`.

    trained = train_mlp_actuator(target - position, velocity, effort)    # each (T, n_joints)
    print(trained)
    cfg = LearnedMlpActuatorCfg(joint_names_expr=(".*_ankle",), **trained.save("ankle.npz"), ...)

As in Hwangbo et al., Learning agile and dynamic motor skills for legged robots, Science Robotics 4
(2019): a small network learns the effort from the last position errors and velocities of a joint.
All joints of the log train one network, so give those of one kind.

The history counts rows: a network is right only at the time step of the log it was trained on, so
resample the log to the time step of the simulation first. Rows of several recordings put one behind
the other make a few false histories at each seam.

The end of the log is held out, and training stops when it is no longer predicted better; as many
rows as the history has past samples are left out between the two, so that no sample is on both
sides. The same input and seed give the same network, at any thread count.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.networks.activations import check_activation
from walkerkit.actuators.networks.history import InputOrder, check_history
from walkerkit.actuators.networks.mlp import Mlp
from walkerkit.actuators.networks.torch_files import as_array, import_torch
from walkerkit.actuators.networks.trained import TrainedMlp
from walkerkit.actuators.networks.training_rows import TrainingRows

FloatArray = NDArray[np.float64]


def train_mlp_actuator(
    position_error: ArrayLike,
    velocity: ArrayLike,
    effort: ArrayLike,
    *,
    hidden: Sequence[int] = (32, 32),
    activation: str = "softsign",
    history_length: int = 3,
    input_order: InputOrder = "pos_vel",
    pos_scale: float | None = None,
    vel_scale: float | None = None,
    torque_scale: float | None = None,
    validation_fraction: float = 0.2,
    max_epochs: int = 300,
    patience: int = 30,
    batch_size: int = 256,
    learning_rate: float = 2e-3,
    seed: int = 0,
) -> TrainedMlp:
    """Fits a network that predicts effort from the history of position error and velocity.

    Args:
        position_error: (T, n_joints) position target − position [rad, or m], at a constant step.
        velocity: (T, n_joints) at the same times [rad/s, or m/s].
        effort: (T, n_joints) that was applied at the same times [N·m, or N].
        hidden: size of each hidden layer.
        activation: of the hidden layers.
        history_length: samples of each signal, the present one included.
        input_order: which signal comes first.
        pos_scale: factor on position errors; None for 1 / their standard deviation.
        vel_scale: factor on velocities; None for 1 / their standard deviation.
        torque_scale: factor on the output; None for the effort's standard deviation.
        validation_fraction: share of the time, at its end, that is held out.
        max_epochs: passes over the training time at most.
        patience: epochs without a better held-out error before training stops.
        batch_size: rows of each step of the optimiser (Adam).
        learning_rate: of the optimiser; falls to a tenth over `max_epochs`.
        seed: of the first weights and of the order of the rows.

    Returns:
        The network, its scales, and the errors of each epoch.

    Raises:
        ImportError: PyTorch is not installed.
        ValueError: Signals differ in shape, are not finite or too short; an argument is out of
            range; or training diverged.
    """
    check_activation("`activation`", activation)
    check_history(history_length, input_order)
    _check_numbers(hidden, max_epochs, patience, batch_size, learning_rate)
    rows = TrainingRows.of(
        {"position_error": position_error, "velocity": velocity, "effort": effort},
        history_length=history_length,
        input_order=input_order,
        given={"pos_scale": pos_scale, "vel_scale": vel_scale, "torque_scale": torque_scale},
        validation_fraction=validation_fraction,
    )
    fit = _Fit(rows, tuple(hidden), activation, np.random.default_rng(seed))
    best_epoch, stopped_early = fit.on_one_thread(max_epochs, patience, batch_size, learning_rate)
    return fit.trained(input_order, int(history_length), best_epoch, stopped_early)


def _check_numbers(
    hidden: Sequence[int],
    max_epochs: int,
    patience: int,
    batch_size: int,
    learning_rate: float,
) -> None:
    """Raises ValueError where one of them cannot be what it is for."""
    if not isinstance(hidden, Sequence):
        raise ValueError(f"`hidden` is {hidden!r}: use a tuple, one size for each layer")
    for name, count in (
        *((f"hidden[{layer}]", size) for layer, size in enumerate(hidden)),
        ("max_epochs", max_epochs),
        ("patience", patience),
        ("batch_size", batch_size),
    ):
        if not isinstance(count, int | np.integer) or isinstance(count, bool) or count < 1:
            raise ValueError(f"`{name}` is {count!r}: use an integer of at least 1")
    if not 0 < learning_rate < np.inf:
        raise ValueError(f"`learning_rate` is {learning_rate!r}: use a number above 0, say 1e-3")


class _Fit:
    """The optimisation, with the losses (mean squares of scaled effort) of each epoch so far."""

    def __init__(
        self, rows: TrainingRows, hidden: tuple[int, ...], activation: str, rng: np.random.Generator
    ):
        self.torch = import_torch()
        self._rows = rows
        self.training_losses: list[float] = []
        self.validation_losses: list[float] = []
        self._rng = rng
        self._training = [self.torch.from_numpy(array) for array in rows.training]
        self._validation = [self.torch.from_numpy(array) for array in rows.validation]
        sizes = (rows.training[0].shape[1], *hidden, 1)
        self._activations = (*len(hidden) * (activation,), "identity")
        self._layers = [
            (self._draw((after, before), before), self._draw((after,), before))
            for before, after in pairwise(sizes)
        ]
        self.best = self._mlp()

    def on_one_thread(
        self, max_epochs: int, patience: int, batch_size: int, learning_rate: float
    ) -> tuple[int, bool]:
        """As `run`: one thread sums in one order, and small networks are no faster with more."""
        threads = self.torch.get_num_threads()
        self.torch.set_num_threads(1)
        try:
            return self.run(max_epochs, patience, batch_size, learning_rate)
        finally:
            self.torch.set_num_threads(threads)

    def trained(
        self, input_order: InputOrder, history_length: int, best_epoch: int, stopped_early: bool
    ) -> TrainedMlp:
        """The best network, with its errors in the unit of the effort."""
        torque = self._rows.scales["torque_scale"]
        return TrainedMlp(
            mlp=self.best,
            **self._rows.scales,
            input_order=input_order,
            history_length=history_length,
            training_error=torque * np.sqrt(self.training_losses),
            validation_error=torque * np.sqrt(self.validation_losses),
            validation_spread=torque * float(np.std(self._rows.validation[1])),
            best_epoch=best_epoch,
            stopped_early=stopped_early,
        )

    def run(
        self, max_epochs: int, patience: int, batch_size: int, learning_rate: float
    ) -> tuple[int, bool]:
        """Returns the epoch whose network is `best`, and whether patience ended it."""
        torch = self.torch
        parameters = [tensor for layer in self._layers for tensor in layer]
        optimizer = torch.optim.Adam(parameters, lr=learning_rate)
        schedule = torch.optim.lr_scheduler.ExponentialLR(optimizer, 0.1 ** (1 / max_epochs))
        n_rows = len(self._training[0])
        best_epoch = 0
        for epoch in range(max_epochs):
            squares = 0.0
            for batch in torch.from_numpy(self._rng.permutation(n_rows)).split(batch_size):
                optimizer.zero_grad()
                loss = self._loss(*(tensor[batch] for tensor in self._training))
                loss.backward()
                optimizer.step()
                squares += float(loss.detach()) * len(batch)
            schedule.step()
            with torch.no_grad():
                held_out = float(self._loss(*self._validation))
            if not np.isfinite(held_out):
                raise ValueError(
                    f"training diverged in epoch {epoch + 1}: lower `learning_rate` (now "
                    f"{learning_rate})"
                )
            self.training_losses.append(squares / n_rows)
            self.validation_losses.append(held_out)
            if epoch == 0 or held_out < self.validation_losses[best_epoch]:
                best_epoch, self.best = epoch, self._mlp()
            if epoch - best_epoch >= patience:
                return best_epoch, True
        return best_epoch, False

    def _draw(self, shape: tuple[int, ...], inputs: int) -> Any:
        """First weights as in torch.nn.Linear, but without touching torch's own generator."""
        bound = 1.0 / np.sqrt(inputs)
        return self.torch.from_numpy(self._rng.uniform(-bound, bound, shape)).requires_grad_()

    def _loss(self, features: Any, targets: Any) -> Any:
        functional = self.torch.nn.functional
        y = features
        for (weight, bias), activation in zip(self._layers, self._activations, strict=True):
            y = functional.linear(y, weight, bias)
            y = y if activation == "identity" else getattr(functional, activation)(y)
        return functional.mse_loss(y, targets)

    def _mlp(self) -> Mlp:
        return Mlp(
            weights=[as_array(weight) for weight, _ in self._layers],
            biases=[as_array(bias) for _, bias in self._layers],
            activations=self._activations,
        )
