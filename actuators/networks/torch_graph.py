"""A TorchScript graph, read operation by operation into a `Chain`.

Freezing inlines every call, makes constants of the parameters and drops what evaluation does not
need (dropout), so that a chain of layers is left as a list of tensor operations. The scripted and
the traced form differ in details, older PyTorch has `addmm` or `matmul` and `add` in place of
`linear`, and `softsign` has always been three operations.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from walkerkit.actuators.networks.activations import named
from walkerkit.actuators.networks.chain import Chain, inverse
from walkerkit.actuators.networks.torch_files import as_array

_ACTIVATIONS = {"relu", "tanh", "sigmoid", "silu"}
_AFFINE = {"add", "sub", "rsub", "mul", "div", "neg"}


class GraphReader:
    """Reads the graph of a frozen module."""

    affine_kinds = frozenset(_AFFINE)

    def __init__(self, source: str, module: Any, frozen: Any):
        """Makes a reader.

        Args:
            source: what is being read, for errors.
            module: the TorchScript module before freezing, which knows its parts by name.
            frozen: the same, frozen.
        """
        self._module = module
        self._graph = frozen.graph
        self._chain = Chain(source)

    def read(self) -> Chain:
        """Returns the chain.

        Raises:
            ValueError: An operation does not belong to a plain chain; names it and its module.
        """
        inputs = [value.debugName() for value in self._graph.inputs()][1:]  # without self
        if len(inputs) != 1:
            raise self._chain.refusal("forward", f"it takes {len(inputs)} inputs, not one")
        self._chain.current = inputs[0]
        for node in self._graph.nodes():
            if any(value.type().kind() == "TensorType" for value in node.outputs()) and (
                node.kind() != "prim::Constant"
            ):
                self._read_node(node)  # the others ask for sizes, and complain
        outputs = [value.debugName() for value in self._graph.outputs()]
        if outputs != [self._chain.current]:
            raise self._chain.refusal("forward", "it returns something else than its last layer")
        return self._chain

    def _read_node(self, node: Any) -> None:
        kind = node.kind().removeprefix("aten::").rstrip("_")
        names = [value.debugName() for value in node.inputs()]
        constants = [value.toIValue() for value in node.inputs()]
        where = self._where(node, kind)
        adds_one = kind == "add" and _are_ones(constants[1:])
        output = "" if node.outputsSize() != 1 else node.output().debugName()
        if self._chain.is_softsign(where, kind, names, output, adds_one=adds_one):
            return
        if kind in _AFFINE and self._chain.current in names and not self._is_bias(kind, constants):
            self._chain.affine(where, *self._affine(where, kind, names, constants))
        elif kind == "addmm" and names[1] == self._chain.current:
            bias, _, weight, *factors = constants
            self._check_ones(where, factors)
            self._chain.linear(where, self._array(where, weight).T, self._array(where, bias))
        elif names[:1] != [self._chain.current]:
            raise self._chain.refusal(where, "it does not work on the layer before it")
        elif kind == "linear":
            weight, bias = constants[1:]
            self._chain.linear(
                where,
                self._array(where, weight),
                None if bias is None else self._array(where, bias),
            )
        elif kind in ("matmul", "mm"):
            self._chain.linear(where, self._array(where, constants[1]).T, None)
        elif kind == "add":
            self._check_ones(where, constants[2:])
            self._chain.bias(where, self._array(where, constants[1]))
        elif kind == "batch_norm":
            self._chain.affine(where, *self._normalised(where, constants))
        elif kind == "elu":
            alpha, *factors = constants[1:4]
            self._check_ones(where, factors)
            self._chain.activation(where, named("elu", float(alpha)))
        elif kind == "leaky_relu":
            self._chain.activation(where, named("leaky_relu", float(constants[1])))
        elif kind == "gelu":
            exact = constants[1] == "none"
            self._chain.activation(where, "gelu" if exact else "gelu_tanh")
        elif kind in _ACTIVATIONS:
            self._chain.activation(where, kind)
        else:
            raise self._chain.refusal(where, "it is neither a linear layer nor such an activation")
        self._chain.advance(output)

    def _is_bias(self, kind: str, constants: list[Any]) -> bool:
        """Whether it is the bias that older PyTorch adds behind a product of matrices."""
        return kind == "add" and self._chain.lacks_bias and getattr(constants[1], "ndim", 0) == 1

    def _affine(
        self, where: str, kind: str, names: list[str], constants: list[Any]
    ) -> tuple[Any, Any]:
        """Scale and shift of an operation with a constant."""
        if kind == "neg":
            return -1.0, 0.0
        mine = names.index(self._chain.current)
        other = self._number(where, constants[1 - mine])
        if kind in ("mul", "div"):
            if kind == "div" and (mine or (len(constants) > 2 and constants[2] is not None)):
                raise self._chain.refusal(where, "it divides by the layer before it, or rounds")
            return (other, 0.0) if kind == "mul" else (inverse(other), 0.0)
        factor = 1.0 if len(constants) < 3 else float(constants[2])  # of the second
        first, second = {"add": (1.0, factor), "sub": (1.0, -factor), "rsub": (-factor, 1.0)}[kind]
        if mine:
            return second, first * other
        return first, second * other

    def _normalised(self, where: str, constants: list[Any]) -> tuple[Any, Any]:
        """Scale and shift of a batch norm that does not learn any more."""
        weight, bias, mean, variance, training, _, epsilon = constants[1:8]
        if training or mean is None or variance is None:
            raise self._chain.refusal(where, "it takes its means from what it is given")
        scale = 1.0 / np.sqrt(as_array(variance) + epsilon)
        scale = scale if weight is None else scale * as_array(weight)
        return scale, (0.0 if bias is None else as_array(bias)) - scale * as_array(mean)

    def _number(self, where: str, constant: Any) -> Any:
        if isinstance(constant, int | float):
            return np.float64(constant)
        return self._array(where, constant)

    def _array(self, where: str, constant: Any) -> Any:
        if constant is None or not hasattr(constant, "detach"):
            raise self._chain.refusal(where, "its numbers are not constant")
        return as_array(constant)

    def _check_ones(self, where: str, numbers: list[Any]) -> None:
        if not _are_ones(numbers):
            raise self._chain.refusal(where, f"its factors are {numbers}, not 1")

    def _where(self, node: Any, kind: str) -> str:
        """The operation, and the module that it comes from as far as that is known."""
        for value in node.inputs():
            name = value.debugName()
            if name.startswith("self.") and name.count(".") > 1:
                module = name.removeprefix("self.").rpartition(".")[0]
                return f"`{node.kind()}` of module `{module}`"
        plain = kind.replace("_", "")
        modules = [
            f"`{name}`"
            for name, module in self._module.named_modules()
            if name and getattr(module, "original_name", "").lower() == plain
        ]
        of = f" of module {' or '.join(modules)}" if modules else ""
        return f"`{node.kind()}`{of}"


def _are_ones(numbers: list[Any]) -> bool:
    return all(number is not None and np.all(np.asarray(number) == 1.0) for number in numbers)
