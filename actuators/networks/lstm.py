"""Long short-term memory (LSTM) networks in numpy, for laws that run every substep.

    lstm = Lstm.load("ankle.npz")
    forward = lstm.forward((12,))    # 12 joints of one physics; (100, 12) for a batch of 100
    forward.reset()
    effort = forward(inputs)         # one step: (12, n_inputs) → (12, n_outputs)

The equations are those of `torch.nn.LSTM` (Hochreiter and Schmidhuber, Neural Computation 9, 1997,
with the forget gate of Gers et al. 2000), layer by layer, then one linear layer, the head:

    i, f, o = σ(W x + U h + b),  g = tanh(W x + U h + b),  c ← f c + i g,  h ← o tanh(c)

**File.** `.npz` with `format` ("walkerkit.lstm"), `version` (1), for layer k from 0
`weight_ih_k` (4·hidden, inputs), `weight_hh_k` (4·hidden, hidden), `bias_ih_k` and `bias_hh_k`
(4·hidden,), their rows in PyTorch's order i, f, g, o; then `head_weight` (outputs, hidden) and
`head_bias` (outputs,); in float64 or float32.

**Rounding.** As in `walkerkit.actuators.networks.mlp`: a simulation in a batch gives bit for bit
what it gives by itself, a row among others what it gives alone to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.networks import archive
from walkerkit.actuators.networks.array_checks import check_shape, frozen_floats, row_index

FloatArray = NDArray[np.float64]

_KIND = "walkerkit.lstm"
_GATES = 4
_HALF = np.array(0.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Lstm:
    """Layers of LSTM cells and a linear head; arrays are kept as read-only copies.

    Attributes:
        weights_ih: (4·hidden, inputs) of each layer.
        weights_hh: (4·hidden, hidden) of each layer.
        biases_ih: (4·hidden,) of each layer.
        biases_hh: (4·hidden,) of each layer.
        head_weight: (outputs, hidden).
        head_bias: (outputs,).

    Raises:
        ValueError: There is no layer, the counts differ, a shape does not follow from the others,
            or an entry is not finite.
    """

    weights_ih: Sequence[FloatArray]
    weights_hh: Sequence[FloatArray]
    biases_ih: Sequence[FloatArray]
    biases_hh: Sequence[FloatArray]
    head_weight: FloatArray
    head_bias: FloatArray

    def __post_init__(self) -> None:
        fields = ("weights_ih", "weights_hh", "biases_ih", "biases_hh")
        counts = [len(getattr(self, field)) for field in fields]
        if len(set(counts)) != 1 or counts[0] == 0:
            raise ValueError(
                f"{', '.join(fields)} should have one entry for each layer, got {counts}: use "
                "zeros where a layer has no bias"
            )
        head = frozen_floats("head_weight", self.head_weight, (None, None))
        hidden = head.shape[1]
        kept: dict[str, list[FloatArray]] = {field: [] for field in fields}
        inputs: int | None = None
        for layer in range(counts[0]):
            for field, shape in zip(
                fields,
                ((_GATES * hidden, inputs), (_GATES * hidden, hidden), *2 * ((_GATES * hidden,),)),
                strict=True,
            ):
                name = f"{field.replace('weights', 'weight').replace('biases', 'bias')}_{layer}"
                kept[field].append(frozen_floats(name, getattr(self, field)[layer], shape))
            inputs = hidden
        for field in fields:
            object.__setattr__(self, field, tuple(kept[field]))
        object.__setattr__(self, "head_weight", head)
        object.__setattr__(
            self, "head_bias", frozen_floats("head_bias", self.head_bias, (len(head),))
        )

    @property
    def n_inputs(self) -> int:
        """Length of an input row."""
        return int(self.weights_ih[0].shape[1])

    @property
    def n_outputs(self) -> int:
        """Length of an output row."""
        return len(self.head_weight)

    @property
    def n_hidden(self) -> int:
        """Cells of each layer."""
        return int(self.head_weight.shape[1])

    @property
    def n_layers(self) -> int:
        """Layers of cells."""
        return len(self.weights_ih)

    def __call__(self, x: ArrayLike) -> FloatArray:
        """Outputs (n_steps, ..., n_outputs) for inputs (n_steps, ..., n_inputs), from rest.

        Raises:
            ValueError: `x` has no axis of steps, or its last axis is not n_inputs long.
        """
        x = np.asarray(x, dtype=np.float64)
        if x.ndim < 2:
            raise ValueError(
                f"`x` has shape {x.shape}, expected (n_steps, ..., {self.n_inputs}): add an axis "
                "of steps"
            )
        forward = self.forward(x.shape[1:-1])
        y = np.empty((*x.shape[:-1], self.n_outputs))
        for step, row in enumerate(x):
            y[step] = forward(row)
        return y

    def forward(self, shape: tuple[int, ...]) -> LstmForward:
        """Prepares for steps with inputs (*shape, n_inputs), at rest."""
        return LstmForward(self, shape)

    def save(self, path: Path | str) -> None:
        """Writes the `.npz` that `load` reads; the same network gives the same bytes.

        Raises:
            FileNotFoundError: The folder does not exist.
            ValueError: The name does not end in `.npz`.
        """
        arrays: dict[str, NDArray[Any]] = {}
        for layer in range(self.n_layers):
            arrays[f"weight_ih_{layer}"] = self.weights_ih[layer]
            arrays[f"weight_hh_{layer}"] = self.weights_hh[layer]
            arrays[f"bias_ih_{layer}"] = self.biases_ih[layer]
            arrays[f"bias_hh_{layer}"] = self.biases_hh[layer]
        arrays |= {"head_weight": self.head_weight, "head_bias": self.head_bias}
        archive.write(path, _KIND, arrays)

    @classmethod
    def load(cls, path: Path | str) -> Lstm:
        """Reads a network; nothing in the file is executed.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: The file is damaged or not such a network; names the file, the array, what
                was found and what was expected.
        """
        arrays = archive.read(path, _KIND)
        layers = range(max(1, arrays.count("weight_ih_")))
        weights_ih, weights_hh, biases_ih, biases_hh = (
            [arrays.floats(f"{name}_{layer}") for layer in layers]
            for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
        )
        head_weight, head_bias = arrays.floats("head_weight"), arrays.floats("head_bias")
        arrays.finish()
        try:
            return cls(
                weights_ih=weights_ih,
                weights_hh=weights_hh,
                biases_ih=biases_ih,
                biases_hh=biases_hh,
                head_weight=head_weight,
                head_bias=head_bias,
            )
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error


class LstmForward:
    """An Lstm with the state of inputs of one shape.

    Attributes:
        shape: what precedes n_inputs in the shape of an input.
        hidden: h of each layer, (*shape, n_hidden); read-only.
        cell: c of each layer, (*shape, n_hidden); read-only.
    """

    def __init__(self, lstm: Lstm, shape: tuple[int, ...]):
        self.shape = shape
        self._input_shape = (*shape, lstm.n_inputs)
        outer, rows = (shape[:-1], shape[-1]) if shape else ((), 1)
        self._layers = [_Layer(lstm, layer, outer, rows) for layer in range(lstm.n_layers)]
        last = np.ones((*outer, lstm.n_hidden + 1, rows))
        # What a layer puts out is the input of the next, so that it is written there at once.
        sinks = [layer.input for layer in self._layers[1:]] + [last[..., :-1, :]]
        self._steps = list(zip(self._layers, sinks, strict=True))
        self._head = np.concatenate([lstm.head_weight, lstm.head_bias[:, None]], axis=1)
        self._last = last
        self._input = self._layers[0].input.swapaxes(-1, -2)
        self._result = np.empty((*outer, lstm.n_outputs, rows))
        self._output = _rows_first(self._result, shape)
        self.hidden = tuple(_read_only(layer.hidden, shape) for layer in self._layers)
        self.cell = tuple(_read_only(layer.cell, shape) for layer in self._layers)

    def reset(self, rows: Sequence[int] | NDArray[Any] | None = None) -> None:
        """Puts some simulations, or all, to rest: h = c = 0.

        Args:
            rows: which simulations, as numbers or as a mask (n_sims,); None for all.

        Raises:
            ValueError: There are no such simulations.
        """
        index = row_index(rows, self.shape)
        for layer in self._layers:
            layer.hidden[index] = 0.0
            layer.cell[index] = 0.0

    def __call__(self, x: FloatArray) -> FloatArray:
        """One step.

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
        for layer, sink in self._steps:
            layer.step()
            sink[...] = layer.hidden
        np.matmul(self._head, self._last, out=self._result)
        return self._output


class _Layer:
    """One layer's state; rows run along the last axis, as in `MlpForward`."""

    def __init__(self, lstm: Lstm, layer: int, outer: tuple[int, ...], rows: int):
        hidden = lstm.n_hidden
        weight_ih, weight_hh = lstm.weights_ih[layer], lstm.weights_hh[layer]
        bias = lstm.biases_ih[layer] + lstm.biases_hh[layer]
        matrix = np.concatenate([weight_ih, weight_hh, bias[:, None]], axis=1)
        i, f, g, o = np.split(matrix, _GATES)
        # σ(x) = (1 + tanh(x/2)) / 2: with the halves here, one tanh serves all four gates.
        self._matrix = np.concatenate([0.5 * i, 0.5 * f, 0.5 * o, g])
        inputs = weight_ih.shape[1]
        self._operand = np.ones((*outer, inputs + hidden + 1, rows))
        self.input = self._operand[..., :inputs, :]
        self.hidden = self._operand[..., inputs:-1, :]
        self.hidden[...] = 0.0
        self.cell = np.zeros((*outer, hidden, rows))
        self._scratch = np.empty_like(self.cell)
        self._gates = np.empty((*outer, _GATES * hidden, rows))
        self._sigmoids = self._gates[..., : 3 * hidden, :]
        self._i, self._f, self._o, self._g = (
            self._gates[..., k * hidden : (k + 1) * hidden, :] for k in range(_GATES)
        )

    def step(self) -> None:
        np.matmul(self._matrix, self._operand, out=self._gates)
        np.tanh(self._gates, out=self._gates)
        np.multiply(self._sigmoids, _HALF, out=self._sigmoids)
        np.add(self._sigmoids, _HALF, out=self._sigmoids)
        np.multiply(self._i, self._g, out=self._scratch)
        np.multiply(self._f, self.cell, out=self.cell)
        np.add(self.cell, self._scratch, out=self.cell)
        np.tanh(self.cell, out=self._scratch)
        np.multiply(self._o, self._scratch, out=self.hidden)


def _rows_first(array: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    view = array.swapaxes(-1, -2)
    return view if shape else view[0]


def _read_only(array: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    view = _rows_first(array, shape).view()
    view.flags.writeable = False
    return view
