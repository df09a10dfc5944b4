"""A network of another library, read operation by operation into an `Mlp`, and held against it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.networks.activations import ACTIVATIONS
from walkerkit.actuators.networks.array_checks import frozen_floats
from walkerkit.actuators.networks.mlp import Mlp

FloatArray = NDArray[np.float64]

_USABLE = [name for name in ACTIVATIONS if name != "identity"]
TOLERANCE = 1e-6  # of the largest output
SINGLE_TOLERANCE = 1e-5  # where the source can only be asked in single precision
_ROWS = 256


class Chain:
    """Collects layers in the order of their execution.

    Attributes:
        source: what is being read, for errors.
        current: name of the value that the chain has reached, where values have names.
    """

    def __init__(self, source: str, current: str = ""):
        self.source = source
        self.current = current
        self._softsign: dict[str, str] = {}  # value → what it is of the current one
        self._pending: tuple[FloatArray, FloatArray] | None = None  # scale, shift of what follows
        self._weights: list[FloatArray] = []
        self._biases: list[FloatArray | None] = []
        self._activations: list[str | None] = []

    def linear(self, where: str, weight: FloatArray, bias: FloatArray | None) -> None:
        """Adds weight @ x + bias, with a weight (outputs, inputs) and a bias (outputs,).

        Raises:
            ValueError: These are not finite arrays of such shapes.
        """
        try:
            weight = frozen_floats("weight", weight, (None, None))
            bias = None if bias is None else frozen_floats("bias", bias, (len(weight),))
        except ValueError as error:
            raise ValueError(f"{self.source}: {where}: {error}") from error
        if self._pending is not None:
            scale, shift = self._spread(where, weight.shape[1], *self._pending)
            bias = weight @ shift + (0.0 if bias is None else bias)
            weight, self._pending = weight * scale, None
        self._weights.append(weight)
        self._biases.append(bias)
        self._activations.append(None)

    def bias(self, where: str, bias: FloatArray) -> None:
        """Adds a bias (outputs,) to a linear layer that has none yet.

        Raises:
            ValueError: The last operation is not such a layer, or the shape is another one.
        """
        if not self.lacks_bias:
            raise self.refusal(where, "it does not directly follow a linear layer without a bias")
        try:
            self._biases[-1] = frozen_floats("bias", bias, (len(self._weights[-1]),))
        except ValueError as error:
            raise ValueError(f"{self.source}: {where}: {error}") from error

    @property
    def lacks_bias(self) -> bool:
        """The last operation is a linear layer to which no bias was added yet."""
        return bool(self._weights) and self._biases[-1] is None and self._activations[-1] is None

    def affine(self, where: str, scale: FloatArray | float, shift: FloatArray | float) -> None:
        """Adds scale · x + shift, element by element, to the linear layer before or behind it.

        Args:
            where: the operation, for errors.
            scale: numbers of any shape that has one of them, or one for each element.
            shift: the same.

        Raises:
            ValueError: These are not finite numbers of such shapes.
        """
        scale, shift = (_flat(self, where, one) for one in (scale, shift))
        if not self._weights or self._activations[-1] is not None:
            before = (np.ones(1), np.zeros(1)) if self._pending is None else self._pending
            self._pending = scale * before[0], scale * before[1] + shift
            return
        weight, bias = self._weights[-1], self._biases[-1]
        scale, shift = self._spread(where, len(weight), scale, shift)
        self._weights[-1] = scale[:, None] * weight
        self._biases[-1] = shift + (0.0 if bias is None else scale * bias)

    def _spread(self, where: str, n: int, *numbers: FloatArray) -> list[FloatArray]:
        """Numbers of n elements each, of which there may be one alone."""
        for one in numbers:
            if one.shape not in ((1,), (n,)):
                raise self.refusal(where, f"it has {len(one)} numbers for {n} elements")
        return [np.broadcast_to(one, (n,)) for one in numbers]

    def activation(self, where: str, name: str) -> None:
        """Adds an activation.

        Raises:
            ValueError: It does not directly follow a linear layer.
        """
        if not self._weights or self._activations[-1] is not None or self._pending is not None:
            raise self.refusal(where, "it does not directly follow a linear layer")
        self._activations[-1] = name

    def is_softsign(
        self, where: str, kind: str, inputs: Sequence[str], output: str, *, adds_one: bool
    ) -> bool:
        """Takes an operation that is a part of x / (|x| + 1), as exporters write softsign.

        Args:
            where: the operation, for errors.
            kind: "abs", "add" or "div", else it is none.
            inputs: names of the values that it works on.
            output: name of the value that it makes.
            adds_one: whether its second value is the constant 1.

        Returns:
            Whether it was taken.
        """
        first, second = (*inputs, "", "")[:2]
        if kind == "abs" and first == self.current:
            self._softsign[output] = "|x|"
        elif kind == "add" and self._softsign.get(first) == "|x|" and adds_one:
            self._softsign[output] = "|x| + 1"
        elif kind == "div" and first == self.current and self._softsign.get(second) == "|x| + 1":
            self.activation(where, "softsign")
            self.advance(output)
        else:
            return False
        return True

    def advance(self, output: str) -> None:
        """Goes on to the value of that name."""
        self.current = output
        self._softsign.clear()

    def refusal(self, where: str, why: str) -> ValueError:
        """The error for an operation that an `Mlp` does not have."""
        return ValueError(
            f"{self.source}: {where} cannot be converted: {why}. A network should be a plain chain "
            f"of linear layers, each followed by at most one of {', '.join(_USABLE)}, with fixed "
            "scales and offsets before, between and behind them"
        )

    def build(self) -> Mlp:
        """The network.

        Raises:
            ValueError: There is no layer, or shapes do not follow from each other.
        """
        if not self._weights:
            raise ValueError(
                f"{self.source}: there is no linear layer: give the network itself, not a part of "
                "it"
            )
        if self._pending is not None:  # behind the last activation
            n = len(self._weights[-1])
            scale, shift = self._spread("the last scale", n, *self._pending)
            self._pending = None
            self.linear("the last scale", np.diag(scale), shift)
        try:
            return Mlp(
                weights=self._weights,
                biases=[
                    np.zeros(len(weight)) if bias is None else bias
                    for weight, bias in zip(self._weights, self._biases, strict=True)
                ],
                activations=[name or "identity" for name in self._activations],
            )
        except ValueError as error:
            raise ValueError(f"{self.source}: {error}") from error


def inverse(numbers: FloatArray | float) -> FloatArray:
    """One over numbers; infinite where they are 0, which a chain refuses."""
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / np.asarray(numbers, dtype=np.float64))


def _flat(chain: Chain, where: str, value: FloatArray | float) -> FloatArray:
    """One number, or one for each element, as a vector: only the last axis may be long."""
    array = np.asarray(value, dtype=np.float64)
    if array.size != array.shape[-1:][0] if array.ndim else False:
        raise chain.refusal(where, f"its numbers have the shape {array.shape}")
    if not np.isfinite(array).all():
        raise chain.refusal(where, "its numbers are not finite")
    return array.reshape(-1)


def verify(
    source: str,
    mlp: Mlp,
    evaluate: Callable[[FloatArray], FloatArray],
    *,
    tolerance: float = TOLERANCE,
) -> None:
    """Holds a converted network against its source, on random inputs from small to large.

    Args:
        source: what was read, for errors.
        mlp: the converted network.
        evaluate: what the source makes of inputs (n, n_inputs).
        tolerance: how much the outputs may differ, as a share of the largest.

    Raises:
        ValueError: They differ by more.
    """
    rng = np.random.default_rng(0)
    x = rng.normal(size=(_ROWS, mlp.n_inputs)) * np.geomspace(0.1, 10.0, _ROWS)[:, None]
    theirs = evaluate(x)
    ours = mlp(x)
    if theirs.shape != ours.shape:
        raise ValueError(
            f"{source}: gives outputs of shape {theirs.shape} for inputs {x.shape}, where its "
            f"layers make {ours.shape}: remove what reshapes the output"
        )
    check_close(source, ours, theirs, tolerance=tolerance)


def check_close(
    source: str, ours: FloatArray, theirs: FloatArray, *, tolerance: float = TOLERANCE
) -> None:
    """Refuses outputs that differ.

    Args:
        source: what was read, for errors.
        ours: outputs of the converted network.
        theirs: outputs of the source, of the same shape.
        tolerance: how much they may differ, as a share of the largest.

    Raises:
        ValueError: They differ by more.
    """
    allowed = tolerance * float(np.abs(theirs).max())
    difference = float(np.abs(ours - theirs).max())
    if not difference <= allowed:
        raise ValueError(
            f"{source}: on random inputs the converted network differs by {difference:.3g}, "
            f"{allowed:.3g} is allowed ({tolerance:.0e} of the largest output): the network does "
            "more than its layers show, or has other activations than those given"
        )
