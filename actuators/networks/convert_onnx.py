"""Networks in ONNX as `.npz`, with the extra `walkerkit[onnx]`.

    convert_onnx("ankle.onnx", "ankle.npz")

The graph has to be a plain chain of Gemm, or MatMul and Add, each followed by at most one of the
activations of `networks.activations`; Add, Sub, Mul, Div and BatchNormalization with constants
become part of the layers. Before anything is saved, the network is held against
ONNX's own reference evaluator on random inputs, to 1e-6 of the largest output.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.networks.activations import named
from walkerkit.actuators.networks.archive import check_npz
from walkerkit.actuators.networks.chain import Chain, inverse, verify
from walkerkit.actuators.networks.mlp import Mlp

FloatArray = NDArray[np.float64]

_ACTIVATIONS = {
    "Elu": "elu",
    "Relu": "relu",
    "Tanh": "tanh",
    "Softsign": "softsign",
    "Sigmoid": "sigmoid",
}
_AFFINE = {"Add", "Sub", "Mul", "Div", "Neg"}


def convert_onnx(path: Path | str, out: Path | str) -> Mlp:
    """Converts an ONNX file and saves it.

    Args:
        path: the ONNX file.
        out: the `.npz` to write.

    Returns:
        The network, as saved.

    Raises:
        FileNotFoundError: `path` or the folder of `out` does not exist.
        ImportError: The package onnx is not installed.
        ValueError: The file is damaged or not such a chain (names the node that is not), or the
            conversion is not exact.
    """
    try:
        import onnx
        from onnx.reference import ReferenceEvaluator
    except ImportError as error:
        raise ImportError(
            "this needs the package onnx, which is not installed: pip install 'walkerkit[onnx]'"
        ) from error
    check_npz(out)
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"the network file {path} does not exist: relative paths start at {Path.cwd()}"
        )
    try:
        model = onnx.load(path)
        onnx.checker.check_model(model)
    except Exception as error:  # protobuf's and onnx's own
        reason = str(error).strip().partition("\n")[0]
        raise ValueError(
            f"{path}: cannot be read as ONNX ({type(error).__name__}: {reason}): export the "
            "network again"
        ) from error
    reader = _Reader(str(path), onnx, model.graph)
    mlp = reader.read().build()
    _make_double(onnx, model.graph)
    evaluator = ReferenceEvaluator(model)

    def evaluate(x: FloatArray) -> FloatArray:
        (y,) = evaluator.run(None, {reader.input: x})
        return np.asarray(y, dtype=np.float64)

    verify(str(path), mlp, evaluate)
    mlp.save(out)
    return mlp


def _make_double(onnx: Any, graph: Any) -> None:
    """Makes the weights double precision, so that only a wrong conversion makes a difference."""
    tensors = [*graph.initializer]
    for node in graph.node:
        tensors += [attribute.t for attribute in node.attribute if attribute.HasField("t")]
    for tensor in tensors:
        array = onnx.numpy_helper.to_array(tensor)
        tensor.CopyFrom(onnx.numpy_helper.from_array(array.astype(np.float64), tensor.name))


class _Reader:
    """Reads an ONNX graph into a `Chain`."""

    def __init__(self, source: str, onnx: Any, graph: Any):
        self._onnx = onnx
        self._graph = graph
        self._constants: dict[str, NDArray[Any]] = {
            tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in graph.initializer
        }
        self._uses = Counter(name for node in graph.node for name in node.input)
        self._sigmoid = ""  # what may be the sigmoid in x σ(x)
        # Files of IR version 3 list initializers among the inputs.
        inputs = [value.name for value in graph.input if value.name not in self._constants]
        self._chain = Chain(source)
        if len(inputs) != 1:
            raise self._chain.refusal("the graph", f"it takes {len(inputs)} inputs, not one")
        self.input = self._chain.current = inputs[0]

    def read(self) -> Chain:
        for node in self._graph.node:
            attributes = {
                attribute.name: self._onnx.helper.get_attribute_value(attribute)
                for attribute in node.attribute
            }
            if node.op_type == "Constant" and "value" in attributes:
                self._constants[node.output[0]] = self._onnx.numpy_helper.to_array(
                    attributes["value"]
                )
            else:
                self._read_node(node, attributes)
        outputs = [value.name for value in self._graph.output]
        if outputs != [self._chain.current]:
            raise self._chain.refusal("the graph", "its output is not its last layer's alone")
        return self._chain

    def _read_node(self, node: Any, attributes: dict[str, Any]) -> None:
        chain, kind = self._chain, node.op_type
        where = f"node `{node.name or node.output[0]}` ({kind})"
        inputs = list(node.input)
        if node.domain not in ("", "ai.onnx"):
            raise chain.refusal(where, f"it belongs to {node.domain}, not to ONNX itself")
        adds_one = bool(np.all(self._constants.get(inputs[-1] if inputs else "", 0.0) == 1.0))
        if chain.is_softsign(where, kind.lower(), inputs, node.output[0], adds_one=adds_one):
            return
        if self._is_silu(where, node, inputs):
            return
        if kind in _AFFINE and chain.current in inputs and not self._is_bias(kind, inputs):
            chain.affine(where, *self._affine(where, kind, inputs))
            chain.advance(node.output[0])
            return
        if kind == "Add" and inputs[0] in self._constants:
            inputs.reverse()
        if inputs[:1] != [chain.current]:
            raise chain.refusal(where, "it does not work on the layer before it")
        if kind == "Gemm":
            self._read_gemm(where, inputs, attributes)
        elif kind == "MatMul":
            chain.linear(where, self._constant(where, inputs[1]).T, None)
        elif kind == "Add":
            chain.bias(where, self._constant(where, inputs[1]).reshape(-1))
        elif kind == "Elu":
            chain.activation(where, named("elu", float(attributes.get("alpha", 1.0))))
        elif kind == "LeakyRelu":
            slope = float(np.float32(attributes.get("alpha", 0.01)).astype(str))
            chain.activation(where, named("leaky_relu", slope))
        elif kind == "Gelu":
            tanh = attributes.get("approximate", b"none") == b"tanh"
            chain.activation(where, "gelu_tanh" if tanh else "gelu")
        elif kind == "BatchNormalization":
            scale, bias, mean, variance = (self._constant(where, name) for name in inputs[1:5])
            scale = scale / np.sqrt(variance + attributes.get("epsilon", 1e-5))
            chain.affine(where, scale, bias - scale * mean)
        elif kind in _ACTIVATIONS:
            chain.activation(where, _ACTIVATIONS[kind])
        elif kind != "Identity":
            raise chain.refusal(where, "it is neither a linear layer nor such an activation")
        chain.advance(node.output[0])

    def _is_silu(self, where: str, node: Any, inputs: list[str]) -> bool:
        """Takes an operation that is a part of x σ(x), as exporters write silu."""
        chain = self._chain
        if node.op_type == "Sigmoid" and inputs == [chain.current]:
            if self._uses[chain.current] < 2:
                return False
            self._sigmoid = node.output[0]
            return True
        if node.op_type == "Mul" and set(inputs) == {chain.current, self._sigmoid}:
            chain.activation(where, "silu")
            chain.advance(node.output[0])
            return True
        return False

    def _is_bias(self, kind: str, inputs: list[str]) -> bool:
        """Whether it is the bias behind a MatMul."""
        other = [name for name in inputs if name != self._chain.current]
        return (
            kind == "Add"
            and self._chain.lacks_bias
            and len(other) == 1
            and self._constants.get(other[0], np.zeros(())).size > 1
        )

    def _affine(self, where: str, kind: str, inputs: list[str]) -> tuple[Any, Any]:
        """Scale and shift of an operation with a constant."""
        if kind == "Neg":
            return -1.0, 0.0
        mine = inputs.index(self._chain.current)
        other = self._constant(where, inputs[1 - mine])
        if kind == "Mul":
            return other, 0.0
        if kind == "Div":
            if mine:
                raise self._chain.refusal(where, "it divides by the layer before it")
            return inverse(other), 0.0
        if kind == "Add":
            return 1.0, other
        return (-1.0, other) if mine else (1.0, -other)

    def _read_gemm(self, where: str, inputs: list[str], attributes: dict[str, Any]) -> None:
        if attributes.get("transA", 0):
            raise self._chain.refusal(where, "it transposes its input")
        weight = attributes.get("alpha", 1.0) * self._constant(where, inputs[1])
        bias = None
        if len(inputs) > 2 and inputs[2]:  # an optional input that is left out may be named ""
            bias = attributes.get("beta", 1.0) * self._constant(where, inputs[2]).reshape(-1)
        self._chain.linear(where, weight if attributes.get("transB", 0) else weight.T, bias)

    def _constant(self, where: str, name: str) -> FloatArray:
        if name not in self._constants:
            raise self._chain.refusal(where, f"its `{name}` is not constant")
        return self._constants[name].astype(np.float64)
