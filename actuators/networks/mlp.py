"""Multilayer perceptrons in numpy, for laws that run every substep.

    mlp = Mlp.load("ankle.npz")
    forward = mlp.forward((12,))     # 12 joints of one physics; (100, 12) for a batch of 100
    effort = forward(features)       # (12, n_inputs) → (12, n_outputs)
    mlp(features)                    # the same, slower and in a new array

**File.** `.npz` with `format` ("walkerkit.mlp"), `version` (1), `activations` (one name per layer:
those of `networks.activations`, as elu, elu(0.5), relu or identity) and, for layer k from 0,
`weight_k` (outputs, inputs) and `bias_k` (outputs,) in float64 or float32. Layer k is
`activation_k(weight_k @ x + bias_k)`.

**Rounding.** All is computed in float64. BLAS sees the last two axes of the input at a time, so
inputs (n_sims, n_joints, n_inputs) give bit for bit what each simulation gives by itself, and a
composer walker and a batch follow the same trajectory. One row among others, however, differs from
the same row alone by rounding (some 1e-16 of the sums), since BLAS sums in another order; so it
does on another processor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.networks import archive
from walkerkit.actuators.networks.activations import activation, check_activation
from walkerkit.actuators.networks.array_checks import check_shape, frozen_floats

FloatArray = NDArray[np.float64]

_KIND = "walkerkit.mlp"


@dataclass(frozen=True, kw_only=True, eq=False)
class Mlp:
    """A chain of linear layers, each followed by an activation.

    Attributes:
        weights: (outputs, inputs) of each layer; kept as read-only copies.
        biases: (outputs,) of each layer; kept as read-only copies.
        activations: the name of each layer's activation.

    Raises:
        ValueError: There is no layer, the counts differ, a shape does not follow from the layer
            before, an entry is not finite, or an activation is unknown.
    """

    weights: Sequence[FloatArray]
    biases: Sequence[FloatArray]
    activations: Sequence[str]

    def __post_init__(self) -> None:
        counts = (len(self.weights), len(self.biases), len(self.activations))
        if isinstance(self.activations, str):
            raise ValueError(
                f"`activations` is {self.activations!r}, expected one name for each layer: use "
                f"{(self.activations,)!r}"
            )
        if len(set(counts)) != 1 or counts[0] == 0:
            raise ValueError(
                "`weights`, `biases` and `activations` should have one entry for each layer, got "
                f"{counts[0]}, {counts[1]} and {counts[2]}: use 'identity' where a layer has no "
                "activation, and zeros where it has no bias"
            )
        weights: list[FloatArray] = []
        biases: list[FloatArray] = []
        inputs: int | None = None
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            weights.append(frozen_floats(f"weight_{layer}", weight, (None, inputs)))
            inputs = len(weights[-1])
            biases.append(frozen_floats(f"bias_{layer}", bias, (inputs,)))
            check_activation(f"`activations`[{layer}]", self.activations[layer])
        object.__setattr__(self, "weights", tuple(weights))
        object.__setattr__(self, "biases", tuple(biases))
        object.__setattr__(self, "activations", tuple(self.activations))

    @property
    def n_inputs(self) -> int:
        """Length of an input row."""
        return int(self.weights[0].shape[1])

    @property
    def n_outputs(self) -> int:
        """Length of an output row."""
        return len(self.weights[-1])

    def __call__(self, x: ArrayLike) -> FloatArray:
        """Outputs (..., n_outputs) for inputs (..., n_inputs), in a new array.

        Raises:
            ValueError: The last axis of `x` is not n_inputs long.
        """
        x = np.asarray(x, dtype=np.float64)
        return self.forward(x.shape[:-1])(x).copy()

    def forward(self, shape: tuple[int, ...]) -> MlpForward:
        """Prepares for inputs (*shape, n_inputs), again and again."""
        return MlpForward(self, shape)

    def save(self, path: Path | str) -> None:
        """Writes the `.npz` that `load` reads; the same network gives the same bytes.

        Raises:
            FileNotFoundError: The folder does not exist.
            ValueError: The name does not end in `.npz`.
        """
        arrays: dict[str, NDArray[np.float64] | NDArray[np.str_]] = {
            "activations": np.array(self.activations)
        }
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays[f"weight_{layer}"] = weight
            arrays[f"bias_{layer}"] = bias
        archive.write(path, _KIND, arrays)

    @classmethod
    def load(cls, path: Path | str) -> Mlp:
        """Reads a network; nothing in the file is executed.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: The file is damaged or not such a network; names the file, the array, what
                was found and what was expected.
        """
        arrays = archive.read(path, _KIND)
        activations = arrays.names("activations")
        layers = range(len(activations))
        weights = [arrays.floats(f"weight_{layer}") for layer in layers]
        biases = [arrays.floats(f"bias_{layer}") for layer in layers]
        arrays.finish()
        try:
            return cls(weights=weights, biases=biases, activations=activations)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error


class MlpForward:
    """An Mlp with the memory for inputs of one shape.

    Attributes:
        shape: what precedes n_inputs in the shape of an input.
    """

    def __init__(self, mlp: Mlp, shape: tuple[int, ...]):
        self.shape = shape
        self._input_shape = (*shape, mlp.n_inputs)
        outer, rows = (shape[:-1], shape[-1]) if shape else ((), 1)
        # Rows run along the last axis, below them a row of ones: the bias is then one more weight,
        # and every other operation is on contiguous memory. A third faster for twelve rows.
        sizes = (mlp.n_inputs, *(len(bias) for bias in mlp.biases))
        augmented = [np.ones((*outer, size + 1, rows)) for size in sizes]
        values = [array[..., :-1, :] for array in augmented]
        self._input = values[0].swapaxes(-1, -2)
        output = values[-1].swapaxes(-1, -2)
        self._output = output if shape else output[0]
        self._steps = [
            (
                np.concatenate([weight, bias[:, None]], axis=1),
                before,
                after,
                np.empty_like(after),
                activation(name),
            )
            for weight, bias, name, before, after in zip(
                mlp.weights, mlp.biases, mlp.activations, augmented[:-1], values[1:], strict=True
            )
        ]

    def __call__(self, x: FloatArray) -> FloatArray:
        """Outputs for a set of inputs.

        Args:
            x: (*shape, n_inputs).

        Returns:
            (*shape, n_outputs), in memory that the next call overwrites.

        Raises:
            ValueError: `x` has another shape.
        """
        if x.shape != self._input_shape:
            check_shape("x", x.shape, self._input_shape)
        self._input[...] = x
        for matrix, before, after, scratch, activate in self._steps:
            np.matmul(matrix, before, out=after)
            activate(after, scratch)
        return self._output
