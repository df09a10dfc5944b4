"""A network of another library, read operation by operation into an `Mlp`, and held against it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.networks.checks import frozen_floats
from walkerkit.actuators.networks.mlp import Mlp

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-6  # of the largest output
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
        self._weights.append(weight)
        self._biases.append(bias)
        self._activations.append(None)

    def bias(self, where: str, bias: FloatArray) -> None:
        """Adds a bias (outputs,) to a linear layer that has none yet.

        Raises:
            ValueError: The last operation is not such a layer, or the shape is another one.
        """
        if not self._weights or self._biases[-1] is not None or self._activations[-1] is not None:
            raise self.refusal(where, "it does not directly follow a linear layer without a bias")
        try:
            self._biases[-1] = frozen_floats("bias", bias, (len(self._weights[-1]),))
        except ValueError as error:
            raise ValueError(f"{self.source}: {where}: {error}") from error

    def activation(self, where: str, name: str) -> None:
        """Adds an activation.

        Raises:
            ValueError: It does not directly follow a linear layer.
        """
        if not self._weights or self._activations[-1] is not None:
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
            "of linear layers, each followed by at most one of elu (alpha 1), relu, tanh, "
            "softsign or sigmoid; put scales into the actuator's pos_scale, vel_scale and "
            "torque_scale"
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
