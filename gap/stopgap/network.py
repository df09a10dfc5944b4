"""A small network beside a drive's own law, fitted in a second, without PyTorch.

    trained = fit_network(rows, history_length=3)     # a TrainedMlp, as of `networks.train`
    whole = beside(trained, stiffness=20.0, damping=0.6, constant=0.0)

Full batches and L-BFGS (scipy) suit a few hundred weights. The same rows give the same network, at
any thread count. The hidden units saturate, so that what the network adds stays bounded wherever
the joint goes, and the drive's own law keeps it stable.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from walkerkit.actuators.networks.mlp import Mlp
from walkerkit.actuators.networks.trained import TrainedMlp
from walkerkit.actuators.networks.training_rows import TrainingRows

FloatArray = NDArray[np.float64]

_HIDDEN = 24
_MOST_ROWS = 3000
_CHUNK = 1000  # rows; BLAS multiplies so few in one thread, which is faster here than in several
_ROUNDS, _ITERATIONS = 12, 15  # iterations between two looks at the rows that are left out
_PATIENCE = 3  # looks
_DECAY = 1e-4  # of squared weights
_SEED = 20260101
_LINEAR = 1e-4  # of the size at which a hidden unit saturates: it passes on what it gets


def fit_network(rows: TrainingRows, history_length: int) -> TrainedMlp:
    """Fits a network to rows, and keeps it as it was when it predicted the other rows best.

    Args:
        rows: scaled rows.
        history_length: samples of each signal in a row.
    """
    rng = np.random.default_rng(_SEED)
    features, targets = rows.training
    some = np.sort(rng.permutation(len(features))[:_MOST_ROWS])
    training, validation = (features[some], targets[some, 0]), rows.validation
    inputs = 2 * history_length
    weights = rng.uniform(-1, 1, _HIDDEN * (inputs + 2) + 1) / np.sqrt(_HIDDEN)
    best, kept = weights, 0
    errors: list[tuple[float, float]] = []
    for turn in range(_ROUNDS):
        found = minimize(
            loss,
            weights,
            args=training,
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": _ITERATIONS, "maxcor": 20},
        )
        weights = found.x
        errors.append(
            (_error(weights, *training), _error(weights, validation[0], validation[1][:, 0]))
        )
        if errors[turn][1] <= errors[kept][1]:
            best, kept = weights, turn
        if turn - kept >= _PATIENCE:
            break
    into, bias, out, constant = _parts(best, inputs)
    torque = rows.scales["torque_scale"]
    on_training, on_validation = (torque * np.array(part) for part in zip(*errors, strict=True))
    return TrainedMlp(
        mlp=Mlp(
            weights=[into, out[None]],
            biases=[bias, np.array([constant])],
            activations=("tanh", "identity"),
        ),
        **rows.scales,
        input_order="pos_vel",
        history_length=history_length,
        training_error=on_training,
        validation_error=on_validation,
        validation_spread=torque * float(np.std(validation[1])),
        best_epoch=kept,
        stopped_early=kept < len(errors) - 1,
    )


def beside(trained: TrainedMlp, *, stiffness: float, damping: float, constant: float) -> TrainedMlp:
    """The network with a drive's law kp e − kd q̇ + c added to what it says.

    Args:
        trained: a network of `fit_network`.
        stiffness: kp [N·m/rad; N/m].
        damping: kd [N·m·s/rad; N·s/m].
        constant: c [N·m; N].
    """
    (into, out), (bias, last) = trained.mlp.weights, trained.mlp.biases
    law = np.zeros(into.shape[1])
    law[0] = stiffness / (trained.pos_scale * trained.torque_scale)
    law[trained.history_length] = -damping / (trained.vel_scale * trained.torque_scale)
    size = max(float(np.abs(law).max()), 1e-12)
    mlp = Mlp(
        weights=[
            np.vstack([into, _LINEAR / size * law]),
            np.append(out, [[size / _LINEAR]], axis=1),
        ],
        biases=[np.append(bias, 0.0), last + constant / trained.torque_scale],
        activations=trained.mlp.activations,
    )
    return replace(trained, mlp=mlp)


def loss(weights: FloatArray, x: FloatArray, y: FloatArray) -> tuple[float, FloatArray]:
    """Half the mean square error with weight decay, and its gradient.

    Args:
        weights: all of the network's.
        x: (n_rows, n_inputs) features.
        y: (n_rows,) targets.
    """
    _, _, out, _ = _parts(weights, x.shape[1])
    gradient, total = _DECAY * weights, 0.5 * _DECAY * float(weights @ weights)
    of_into, of_bias, of_out, _ = _parts(gradient, x.shape[1])
    for rows in _chunks(len(x)):
        hidden, said = _said(weights, x[rows])
        wrong = (said - y[rows]) / len(x)
        total += 0.5 * len(x) * float(wrong @ wrong)
        of_out += wrong @ hidden
        slope = wrong[:, None] * out * (1 - hidden**2)
        of_into += slope.T @ x[rows]
        of_bias += slope.sum(axis=0)
        gradient[-1] += wrong.sum()
    return total, gradient


def _parts(weights: FloatArray, inputs: int) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Views of the weights into the hidden units, their biases, the weights out, the constant."""
    into, rest = weights[: _HIDDEN * inputs].reshape(_HIDDEN, inputs), weights[_HIDDEN * inputs :]
    return into, rest[:_HIDDEN], rest[_HIDDEN : 2 * _HIDDEN], float(rest[-1])


def _said(weights: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The hidden units (n_rows, n_hidden), and what the network says (n_rows,)."""
    into, bias, out, constant = _parts(weights, x.shape[1])
    hidden = np.tanh(x @ into.T + bias)
    return hidden, hidden @ out + constant


def _error(weights: FloatArray, x: FloatArray, y: FloatArray) -> float:
    square = sum(float(np.sum((_said(weights, x[r])[1] - y[r]) ** 2)) for r in _chunks(len(x)))
    return float(np.sqrt(square / len(x)))


def _chunks(count: int) -> list[slice]:
    return [slice(start, start + _CHUNK) for start in range(0, count, _CHUNK)]
